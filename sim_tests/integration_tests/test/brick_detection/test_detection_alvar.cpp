// SPDX-License-Identifier: BSD-3-Clause
// Markers of ar_track_alvar instead of images.
#include <ar_track_alvar_msgs/AlvarMarkers.h>
#include <interactive_mapping_common_ros/poses.h>
#include <std_srvs/Trigger.h>

#include "brick_camera.h"

namespace integration_tests {
namespace {

using ar_track_alvar_msgs::AlvarMarker;
using ar_track_alvar_msgs::AlvarMarkers;
using interactive_mapping_msgs::TagSighting;
using mp700_ur5e_description::BrickFace;

class DetectionAlvar : public testing::Test {
 protected:
  void SetUp() override {
    markers_ = ros::NodeHandle().advertise<AlvarMarkers>("alvar_markers", 10);
    tf_ = ros::NodeHandle().advertise<tf2_msgs::TFMessage>("/tf", 10);
    subscriber_ = ros::NodeHandle().subscribe<DetectionUpdate>(
        "/brick_detection/update", 100,
        [this](const DetectionUpdate::ConstPtr& update) { updates_.push_back(*update); });
    ASSERT_TRUE(waitUntil([this] {
      return markers_.getNumSubscribers() > 0 && tf_.getNumSubscribers() > 0 && subscriber_.getNumPublishers() > 0;
    }));
    // A subscriber is counted before its connection is ready.
    ASSERT_TRUE(waitUntil([this] {
      look({});
      return !updates_.empty();
    }));
    std_srvs::Trigger trigger;
    ASSERT_TRUE(call("/brick_detection/clear", trigger));
  }

  AlvarMarker marker(int brick_id, BrickFace face, const Eigen::Isometry3d& T_map_brick) const {
    const auto& type = catalogue_.typeOf(brick_id);
    const Eigen::Isometry3d T = T_map_camera_.inverse() * T_map_brick * mp700_ur5e_description::tagPose(type, face);
    AlvarMarker marker;
    marker.id = static_cast<std::uint32_t>(catalogue_.tagId(brick_id, face));
    marker.pose.pose = interactive_mapping_ros::toPose(T);
    return marker;
  }

  /// The header is in each marker; that of the message stays empty, as ar_track_alvar has it.
  ros::Time look(std::vector<AlvarMarker> markers) {
    waitUntil([this] { return ros::Time::now() > stamp_; });
    stamp_ = ros::Time::now();
    geometry_msgs::TransformStamped transform = toTransformMessage(T_map_camera_);
    transform.header.stamp = stamp_;
    tf2_msgs::TFMessage transforms;
    transforms.transforms.push_back(transform);
    tf_.publish(transforms);
    AlvarMarkers message;
    for (AlvarMarker& marker : markers) {
      marker.header.stamp = stamp_;
      if (marker.header.frame_id.empty()) marker.header.frame_id = kCameraFrame;
      message.markers.push_back(marker);
    }
    markers_.publish(message);
    return stamp_;
  }

  DetectionUpdate awaitUpdate(const ros::Time& stamp) {
    DetectionUpdate found;
    EXPECT_TRUE(waitUntil([&] {
      for (const DetectionUpdate& update : updates_) {
        if (update.header.stamp == stamp) found = update;
      }
      return found.header.stamp == stamp;
    }));
    return found;
  }

  const mp700_ur5e_description::BrickCatalogue catalogue_ = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  const Eigen::Isometry3d T_map_camera_ = lookingAt({-0.65, 0.1, 0.75}, {0.0, 0.0, 0.1});
  ros::Publisher markers_, tf_;
  ros::Subscriber subscriber_;
  std::vector<DetectionUpdate> updates_;
  Latest<BrickArray> bricks_{"/brick_detection/bricks"};
  ros::Time stamp_;
};

TEST_F(DetectionAlvar, MarkersTellWhereBricksAre) {
  const Eigen::Isometry3d T_map_brick = standing({0.0, 0.2, 0.1}, 0.3);
  AlvarMarker unknown = marker(0, BrickFace::kPlusZ, T_map_brick);
  unknown.id = 70000;  // the family has 65536
  AlvarMarker broken = marker(1, BrickFace::kPlusZ, T_map_brick);
  broken.pose.pose.orientation = geometry_msgs::Quaternion();
  const ros::Time stamp =
      look({marker(3, BrickFace::kPlusZ, T_map_brick), marker(3, BrickFace::kMinusX, T_map_brick), unknown, broken});
  const DetectionUpdate update = awaitUpdate(stamp);
  EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::ACCEPTED) << update.message;
  EXPECT_EQ(update.bricks_seen, std::vector<std::int32_t>{3});
  ASSERT_EQ(update.tags.size(), 4u);
  EXPECT_EQ(static_cast<int>(update.tags[0].status), TagSighting::USED);
  EXPECT_EQ(static_cast<int>(update.tags[1].status), TagSighting::USED);
  EXPECT_EQ(static_cast<int>(update.tags[2].status), TagSighting::UNKNOWN_ID);
  EXPECT_EQ(update.tags[2].brick_id, -1);
  EXPECT_EQ(static_cast<int>(update.tags[3].status), TagSighting::INCONSISTENT);
  EXPECT_FALSE(update.has_depth);
  const BrickArray bricks = bricks_.awaitStamp(stamp);
  ASSERT_EQ(bricks.bricks.size(), 1u);
  const Brick& brick = bricks.bricks.front();
  EXPECT_EQ(brick.id, 3);
  // The markers are exact.
  EXPECT_LT((toIsometry(brick.pose.pose).translation() - T_map_brick.translation()).norm(), 1e-6);
  EXPECT_LT(angleBetween(toIsometry(brick.pose.pose), T_map_brick), 1e-6);
  // Two markers of 4 mm each, and what the tracker adds for the camera's pose: between 2 and 8 mm.
  EXPECT_GT(std::sqrt(brick.pose.covariance[0]), 0.002);
  EXPECT_LT(std::sqrt(brick.pose.covariance[0]), 0.008);
  EXPECT_EQ(brick.faces_seen, (std::vector<std::uint8_t>{1, 4}));
}

TEST_F(DetectionAlvar, OneMarkerTwiceIsTwoBricks) {
  const ros::Time stamp = look({marker(3, BrickFace::kPlusZ, standing({0.0, 0.2, 0.1}, 0.3)),
                                marker(3, BrickFace::kPlusZ, standing({0.0, -0.2, 0.1}, 0.3))});
  EXPECT_EQ(awaitUpdate(stamp).bricks_seen, (std::vector<std::int32_t>{3, 3}));
  const BrickArray bricks = bricks_.awaitStamp(stamp);
  ASSERT_EQ(bricks.bricks.size(), 2u);
  EXPECT_TRUE(bricks.bricks[0].has_duplicate);
  EXPECT_TRUE(bricks.bricks[1].has_duplicate);
}

TEST_F(DetectionAlvar, MarkersOfTwoCamerasInOneMessageAreRefused) {
  AlvarMarker other = marker(4, BrickFace::kPlusZ, standing({0.0, -0.2, 0.1}, 0.3));
  other.header.frame_id = "another_camera";
  const DetectionUpdate update =
      awaitUpdate(look({marker(3, BrickFace::kPlusZ, standing({0.0, 0.2, 0.1}, 0.3)), other}));
  EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::MALFORMED_IMAGE);
  EXPECT_PRED2(has, update.message, "'another_camera'");
}

TEST_F(DetectionAlvar, NoMarkerInViewIsALookAsWell) {
  look({marker(3, BrickFace::kPlusZ, standing({0.0, 0.2, 0.1}, 0.3))});
  bricks_.await([](const BrickArray& bricks) { return bricks.bricks.size() == 1; });
  const std::size_t before = updates_.size();
  look({});
  EXPECT_TRUE(waitUntil([&] {
    return updates_.size() > before && updates_.back().status == DetectionUpdate::ACCEPTED &&
           updates_.back().tags.empty();
  }));
  EXPECT_EQ(bricks_.awaitStamp(updates_.back().header.stamp).bricks.size(), 1u);
}

}  // namespace
}  // namespace integration_tests
