// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/mission_markers.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include <Eigen/Geometry>
#include <gmock/gmock.h>
#include <interactive_mapping_msgs/MissionBrick.h>
#include <interactive_mapping_msgs/NbvSegment.h>

#include "pick_mission_ros/mission_words.h"

namespace pick_mission_ros {
namespace {

using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionState;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
using testing::StartsWith;
using visualization_msgs::Marker;
using visualization_msgs::MarkerArray;

const mp700_ur5e_description::BrickCatalogue& catalogue() {
  static const auto kCatalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  return kCatalogue;
}

MissionBrick brick(int id, std::uint8_t status) {
  MissionBrick out;
  out.id = id;
  out.type = catalogue().types.front().name;
  out.pose.position.x = id;
  out.pose.position.y = -0.5;
  out.pose.position.z = 0.1;
  out.pose.orientation.w = 1.0;
  out.status = status;
  return out;
}

MissionState stateWith(const std::vector<MissionBrick>& bricks) {
  MissionState state;
  state.header.frame_id = "map";
  state.header.stamp = ros::Time(12.0);
  state.state = MissionState::PICK;
  state.brick = -1;
  state.bricks = bricks;
  return state;
}

std::vector<Marker> select(const MarkerArray& array, const std::string& ns) {
  std::vector<Marker> markers;
  for (const Marker& marker : array.markers) {
    if (marker.ns == ns && marker.action == Marker::ADD) markers.push_back(marker);
  }
  return markers;
}

Rgb rgbOf(const std_msgs::ColorRGBA& color) {
  const auto byte = [](float share) { return static_cast<std::uint8_t>(std::lround(255.0F * share)); };
  return {byte(color.r), byte(color.g), byte(color.b)};
}

TEST(MissionMarkers, BeginByDeletingAllAndNameEachMarkerOnce) {
  MissionState state = stateWith({brick(1, MissionBrick::OPEN), brick(2, MissionBrick::CURRENT),
                                  brick(3, MissionBrick::PICKED), brick(4, MissionBrick::AWAY)});
  state.view.resize(1);
  state.view[0].standing.orientation.w = 1.0;
  const MarkerArray array = toMarkers(state, catalogue());
  ASSERT_FALSE(array.markers.empty());
  EXPECT_EQ(array.markers.front().action, Marker::DELETEALL);
  std::set<std::pair<std::string, int>> names;
  for (const Marker& marker : array.markers) {
    EXPECT_EQ(marker.header.frame_id, "map");
    EXPECT_TRUE(marker.header.stamp.isZero()) << "tf's age must not hide it";
    EXPECT_NEAR(std::hypot(marker.pose.orientation.w, marker.pose.orientation.z), 1.0, 1e-9);
    EXPECT_TRUE(names.emplace(marker.ns, marker.id).second) << marker.ns << " " << marker.id;
    if (marker.action != Marker::ADD) continue;
    EXPECT_GT(marker.color.a, 0.0F) << marker.ns;  // else nobody sees it
    EXPECT_TRUE(marker.scale.x > 0.0 || marker.scale.z > 0.0) << marker.ns;
  }
}

TEST(MissionMarkers, BoxesAreOfTheTypesSizeInTheColourOfTheirStatus) {
  const MarkerArray array =
      toMarkers(stateWith({brick(1, MissionBrick::OPEN), brick(2, MissionBrick::EXHAUSTED)}), catalogue());
  const std::vector<Marker> boxes = select(array, "bricks");
  ASSERT_THAT(boxes, SizeIs(2));
  const Eigen::Vector3d size_m = catalogue().types.front().size_m;
  EXPECT_EQ(boxes[0].type, Marker::CUBE);
  EXPECT_EQ(boxes[0].id, 1);
  EXPECT_DOUBLE_EQ(boxes[0].pose.position.x, 1.0);
  // About the box, and by no more than a finger's breadth.
  const Eigen::Vector3d scale(boxes[0].scale.x, boxes[0].scale.y, boxes[0].scale.z);
  EXPECT_GT((scale - size_m).minCoeff(), 0.0);
  EXPECT_LT((scale - size_m).maxCoeff(), 0.02);
  EXPECT_TRUE(rgbOf(boxes[0].color) == colorOfStatus(MissionBrick::OPEN));
  EXPECT_TRUE(rgbOf(boxes[1].color) == colorOfStatus(MissionBrick::EXHAUSTED));
  EXPECT_GT(boxes[1].color.r, 2.0F * boxes[1].color.g) << "exhausted is red";
  EXPECT_LT(boxes[0].color.a, 0.8F) << "what is inside shows through";
}

TEST(MissionMarkers, PickedAndGoneOnesLeaveAFaintOutline) {
  MissionBrick turned = brick(3, MissionBrick::PICKED);
  turned.pose.orientation.w = turned.pose.orientation.z = std::sqrt(0.5);
  const MarkerArray array = toMarkers(stateWith({turned, brick(4, MissionBrick::AWAY)}), catalogue());
  EXPECT_THAT(select(array, "bricks"), IsEmpty());
  EXPECT_THAT(select(array, "ids"), IsEmpty());
  const std::vector<Marker> outlines = select(array, "old_places");
  ASSERT_THAT(outlines, SizeIs(2));
  EXPECT_EQ(outlines[0].type, Marker::LINE_LIST);
  EXPECT_LT(outlines[0].color.a, 0.5F);
  EXPECT_DOUBLE_EQ(outlines[0].pose.orientation.z, turned.pose.orientation.z);
  // Twelve edges, four along each axis, each from corner to corner of the type's box.
  ASSERT_THAT(outlines[0].points, SizeIs(24));
  const Eigen::Vector3d size_m = catalogue().types.front().size_m;
  Eigen::Vector3i along = Eigen::Vector3i::Zero();
  std::set<std::vector<double>> edges;
  for (std::size_t i = 0; i < 24; i += 2) {
    const auto& a = outlines[0].points[i];
    const auto& b = outlines[0].points[i + 1];
    for (const auto& p : {a, b}) {
      EXPECT_DOUBLE_EQ(std::abs(p.x), 0.5 * size_m.x());
      EXPECT_DOUBLE_EQ(std::abs(p.y), 0.5 * size_m.y());
      EXPECT_DOUBLE_EQ(std::abs(p.z), 0.5 * size_m.z());
    }
    const Eigen::Vector3d edge(std::abs(b.x - a.x), std::abs(b.y - a.y), std::abs(b.z - a.z));
    EXPECT_EQ((edge.array() > 0.0).count(), 1) << "edge " << i / 2;
    for (int axis = 0; axis < 3; ++axis) along[axis] += edge[axis] > 0.0;
    edges.insert({a.x + b.x, a.y + b.y, a.z + b.z});
  }
  EXPECT_EQ(along, Eigen::Vector3i(4, 4, 4));
  EXPECT_THAT(edges, SizeIs(12));
}

TEST(MissionMarkers, TheBrickInWorkHasAFrameAboutItAndAnEyeCatchingId) {
  const MarkerArray array =
      toMarkers(stateWith({brick(1, MissionBrick::OPEN), brick(2, MissionBrick::CURRENT)}), catalogue());
  const std::vector<Marker> frames = select(array, "current");
  ASSERT_THAT(frames, SizeIs(1));
  EXPECT_EQ(frames[0].id, 2);
  const Marker box = select(array, "bricks").at(1);
  for (const auto& p : frames[0].points) EXPECT_GT(std::abs(p.x), 0.5 * box.scale.x);
  const std::vector<Marker> ids = select(array, "ids");
  ASSERT_THAT(ids, SizeIs(2));
  EXPECT_EQ(ids[0].text, "1");
  EXPECT_EQ(ids[1].text, "2");
  EXPECT_GT(ids[1].scale.z, ids[0].scale.z);
  double top_m = 0.0;
  for (const auto& p : frames[0].points) top_m = std::max(top_m, frames[0].pose.position.z + p.z);
  EXPECT_GT(ids[1].pose.position.z - 0.5 * ids[1].scale.z, top_m) << "not within the frame";
  EXPECT_TRUE(rgbOf(ids[1].color) == colorOfStatus(MissionBrick::CURRENT));
}

// On its side a brick is as high as it is long: its id must not be inside.
TEST(MissionMarkers, IdsAreAboveTheBrickHoweverItLies) {
  MissionBrick upright = brick(1, MissionBrick::OPEN);
  upright.pose.orientation.w = upright.pose.orientation.y = std::sqrt(0.5);  // x up
  const Marker id = select(toMarkers(stateWith({upright}), catalogue()), "ids").at(0);
  EXPECT_GT(id.pose.position.z - 0.5 * id.scale.z, 0.1 + 0.5 * catalogue().types.front().size_m.x());
  EXPECT_DOUBLE_EQ(id.pose.position.x, 1.0);
}

TEST(MissionMarkers, WhatHasNoPlaceIsLeftOut) {
  MissionBrick no_rotation = brick(1, MissionBrick::OPEN);
  no_rotation.pose.orientation.w = 0.0;
  MissionBrick not_finite = brick(2, MissionBrick::OPEN);
  not_finite.pose.position.x = std::numeric_limits<double>::quiet_NaN();
  const MarkerArray array = toMarkers(stateWith({no_rotation, not_finite, brick(3, MissionBrick::OPEN)}), catalogue());
  const std::vector<Marker> boxes = select(array, "bricks");
  ASSERT_THAT(boxes, SizeIs(1));
  EXPECT_EQ(boxes[0].id, 3);
  EXPECT_DOUBLE_EQ(select(array, "decision").at(0).pose.position.x, 3.0) << "nor counts for the middle of the bricks";
}

TEST(MissionMarkers, AnUnknownTypeIsABallThatSaysSo) {
  MissionBrick odd = brick(5, MissionBrick::OPEN);
  odd.type = "boulder";
  const MarkerArray array = toMarkers(stateWith({odd}), catalogue());
  EXPECT_EQ(select(array, "bricks").at(0).type, Marker::SPHERE);
  EXPECT_EQ(select(array, "ids").at(0).text, "5 (unknown type \"boulder\")");
}

TEST(MissionMarkers, TheViewIsAnArrowWhereTheRobotIsToStand) {
  MissionState state = stateWith({brick(1, MissionBrick::OPEN)});
  EXPECT_THAT(select(toMarkers(state, catalogue()), "view"), IsEmpty());
  state.view.resize(1);
  state.view[0].standing.position.x = -1.5;
  state.view[0].standing.position.y = 0.25;
  state.view[0].standing.orientation.w = state.view[0].standing.orientation.z = std::sqrt(0.5);
  const MarkerArray array = toMarkers(state, catalogue());
  const std::vector<Marker> arrows = select(array, "view");
  ASSERT_THAT(arrows, SizeIs(1));
  EXPECT_EQ(arrows[0].type, Marker::ARROW);
  EXPECT_THAT(arrows[0].points, IsEmpty());  // by pose and scale: along the robot's x
  EXPECT_DOUBLE_EQ(arrows[0].pose.position.x, -1.5);
  EXPECT_DOUBLE_EQ(arrows[0].pose.orientation.z, std::sqrt(0.5));
  EXPECT_GT(arrows[0].scale.x, arrows[0].scale.y);
  const Marker text = select(array, "decision").at(0);
  EXPECT_DOUBLE_EQ(text.pose.position.x, -1.5);
  EXPECT_DOUBLE_EQ(text.pose.position.y, 0.25);
  EXPECT_GT(text.pose.position.z, 1.0);
}

TEST(MissionMarkers, TextTellsStateAndDecisionInShortLines) {
  MissionState state = stateWith({});
  state.brick = 7;
  state.decision = "the highest brick in the sector that has attempts left and was not tried without success from here";
  const Marker text = select(toMarkers(state, catalogue()), "decision").at(0);
  EXPECT_THAT(text.text, StartsWith("picking brick 7\n"));
  std::string words = text.text.substr(text.text.find('\n') + 1);
  std::vector<std::size_t> lengths;
  for (std::size_t begin = 0; begin <= words.size();) {
    const std::size_t end = std::min(words.find('\n', begin), words.size());
    EXPECT_LE(end - begin, 36U);
    lengths.push_back(end - begin);
    begin = end + 1;
  }
  EXPECT_THAT(lengths, SizeIs(3));  // 91 letters
  std::replace(words.begin(), words.end(), '\n', ' ');
  EXPECT_EQ(words, state.decision);
}

TEST(MissionMarkers, AtTheEndTheTextTellsWhy) {
  MissionState state = stateWith({});
  state.state = MissionState::ENDED;
  state.end_reason = MissionState::TIME_UP;
  state.decision = "ended";
  EXPECT_EQ(select(toMarkers(state, catalogue()), "decision").at(0).text, "ended\ntime is up");
}

}  // namespace
}  // namespace pick_mission_ros
