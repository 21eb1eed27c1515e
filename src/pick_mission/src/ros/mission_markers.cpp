// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/mission_markers.h"

#include <algorithm>
#include <optional>
#include <string>

#include <Eigen/Geometry>
#include <interactive_mapping_common_ros/markers.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_msgs/MissionBrick.h>

#include "pick_mission_ros/mission_words.h"

namespace pick_mission_ros {
namespace {

using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionState;
using interactive_mapping_ros::makeMarker;
using interactive_mapping_ros::toIsometry;
using interactive_mapping_ros::toPoint;
using visualization_msgs::Marker;
using visualization_msgs::MarkerArray;
namespace description = mp700_ur5e_description;

constexpr float kBoxAlpha = 0.6F;        // the map's mesh shows through
constexpr float kOldPlaceAlpha = 0.45F;  // what is not there any more
constexpr double kGrow_m = 0.01;         // boxes lie about the detection's own, not in their faces
constexpr double kFrame_m = 0.03;        // of the brick in work: its frame is so much larger on each side
constexpr double kLine_m = 0.008;
constexpr double kFrameLine_m = 0.02;
constexpr double kBall_m = 0.15;        // of a brick of unknown size
constexpr double kIdHeight_m = 0.09;    // letters
constexpr double kTextHeight_m = 0.07;  // letters
constexpr double kTextAbove_m = 1.7;    // over arm and mast
constexpr std::size_t kTextWidth = 36;  // letters in a line
constexpr double kArrowLength_m = 0.6;
constexpr double kArrowWidth_m = 0.3;
constexpr double kArrowThickness_m = 0.02;

std_msgs::ColorRGBA color(const Rgb& rgb, float alpha) {
  return interactive_mapping_ros::color(rgb.r / 255.0, rgb.g / 255.0, rgb.b / 255.0, alpha);
}

/// Half way to white: a thin line of a dark colour is not seen on a dark ground.
Rgb lightened(const Rgb& rgb) {
  const auto half = [](std::uint8_t byte) { return static_cast<std::uint8_t>((byte + 255) / 2); };
  return {half(rgb.r), half(rgb.g), half(rgb.b)};
}

std::optional<Eigen::Vector3d> sizeOf(const std::string& type, const description::BrickCatalogue& catalogue) {
  for (const description::BrickType& known : catalogue.types) {
    if (known.name == type) return known.size_m;
  }
  return std::nullopt;
}

/// The twelve edges of a box about the marker's own origin.
void addEdges(const Eigen::Vector3d& size_m, Marker* lines) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const auto& [u, v] :
         {std::pair{-0.5, -0.5}, std::pair{-0.5, 0.5}, std::pair{0.5, -0.5}, std::pair{0.5, 0.5}}) {
      Eigen::Vector3d corner;
      corner[(axis + 1) % 3] = u * size_m[(axis + 1) % 3];
      corner[(axis + 2) % 3] = v * size_m[(axis + 2) % 3];
      for (const double end : {-0.5, 0.5}) {
        corner[axis] = end * size_m[axis];
        lines->points.push_back(toPoint(corner));
      }
    }
  }
}

Marker outlineMarker(const std_msgs::Header& header, const std::string& ns, const MissionBrick& brick,
                     const Eigen::Vector3d& size_m, double line_m, const std_msgs::ColorRGBA& tint) {
  Marker lines = makeMarker(header, ns, brick.id, Marker::LINE_LIST);
  lines.pose = brick.pose;
  lines.scale.x = line_m;
  lines.color = tint;
  addEdges(size_m, &lines);
  return lines;
}

void addBrick(const MissionState& state, const MissionBrick& brick, const Eigen::Isometry3d& T_map_brick,
              const std::optional<Eigen::Vector3d>& known_size_m, MarkerArray* array) {
  const Rgb rgb = colorOfStatus(brick.status);
  const Eigen::Vector3d size_m = known_size_m.value_or(Eigen::Vector3d::Constant(kBall_m));
  const Eigen::Vector3d grown_m = size_m + Eigen::Vector3d::Constant(kGrow_m);
  if (brick.status == MissionBrick::PICKED || brick.status == MissionBrick::AWAY) {
    array->markers.push_back(
        outlineMarker(state.header, "old_places", brick, size_m, kLine_m, color(lightened(rgb), kOldPlaceAlpha)));
    return;
  }
  Marker body = makeMarker(state.header, "bricks", brick.id, known_size_m ? Marker::CUBE : Marker::SPHERE);
  body.pose = brick.pose;
  body.scale.x = grown_m.x();
  body.scale.y = grown_m.y();
  body.scale.z = grown_m.z();
  body.color = color(rgb, kBoxAlpha);
  array->markers.push_back(body);

  const bool is_current = brick.status == MissionBrick::CURRENT;
  if (is_current) {
    const Eigen::Vector3d frame_m = size_m + Eigen::Vector3d::Constant(2.0 * kFrame_m);
    array->markers.push_back(outlineMarker(state.header, "current", brick, frame_m, kFrameLine_m, color(rgb, 1.0F)));
  }
  Marker id = makeMarker(state.header, "ids", brick.id, Marker::TEXT_VIEW_FACING);
  id.scale.z = is_current ? 1.5 * kIdHeight_m : kIdHeight_m;
  const double half_height_m = T_map_brick.linear().row(2).cwiseAbs().dot(0.5 * size_m);
  id.pose.position = toPoint(T_map_brick.translation() +
                             Eigen::Vector3d(0.0, 0.0, half_height_m + kFrame_m + kFrameLine_m + 0.5 * id.scale.z));
  id.text = std::to_string(brick.id);
  if (!known_size_m) id.text += " (unknown type \"" + brick.type + "\")";
  id.color = is_current ? color(rgb, 1.0F) : color({255, 255, 255}, 1.0F);
  array->markers.push_back(id);
}

/// Lines of at most so many letters, unless a word is longer.
std::string wrapped(const std::string& text, std::size_t width) {
  std::string out;
  std::size_t begin = 0;
  std::size_t line = 0;
  while (begin < text.size()) {
    const std::size_t end = std::min(text.find(' ', begin), text.size());
    const std::string word = text.substr(begin, end - begin);
    if (!word.empty()) {
      if (line > 0 && line + 1 + word.size() > width) {
        out += "\n";
        line = 0;
      } else if (line > 0) {
        out += " ";
        ++line;
      }
      out += word;
      line += word.size();
    }
    begin = end + 1;
  }
  return out;
}

}  // namespace

MarkerArray toMarkers(const MissionState& state, const description::BrickCatalogue& catalogue) {
  MarkerArray array;
  Marker clear = makeMarker(state.header, "", 0, Marker::CUBE);
  clear.action = Marker::DELETEALL;
  array.markers.push_back(clear);

  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  int num_placed = 0;
  for (const MissionBrick& brick : state.bricks) {
    const std::optional<Eigen::Isometry3d> T_map_brick = toIsometry(brick.pose);
    if (!T_map_brick) continue;
    sum += T_map_brick->translation();
    ++num_placed;
    addBrick(state, brick, *T_map_brick, sizeOf(brick.type, catalogue), &array);
  }

  Eigen::Vector3d below = num_placed > 0 ? Eigen::Vector3d(sum / num_placed) : Eigen::Vector3d::Zero();
  if (!state.view.empty()) {
    const geometry_msgs::Pose& standing = state.view.front().standing;
    if (const std::optional<Eigen::Isometry3d> T_map_base = toIsometry(standing)) {
      below = T_map_base->translation();
      Marker arrow = makeMarker(state.header, "view", 0, Marker::ARROW);
      arrow.pose = standing;
      arrow.scale.x = kArrowLength_m;
      arrow.scale.y = kArrowWidth_m;
      arrow.scale.z = kArrowThickness_m;
      arrow.color = color({66, 165, 245}, 0.9F);
      array.markers.push_back(arrow);
    }
  }

  Marker text = makeMarker(state.header, "decision", 0, Marker::TEXT_VIEW_FACING);
  text.pose.position = toPoint(below + Eigen::Vector3d(0.0, 0.0, kTextAbove_m));
  text.scale.z = kTextHeight_m;
  text.text = stateInWords(state);
  const std::string why =
      state.state == MissionState::ENDED ? endReasonInWords(state.end_reason) : std::string(state.decision);
  if (!why.empty()) text.text += "\n" + wrapped(why, kTextWidth);
  text.color = color({255, 255, 255}, 1.0F);
  array.markers.push_back(text);
  // Shown where it is, whatever tf's age: the frame is the map's.
  for (Marker& marker : array.markers) marker.header.stamp = ros::Time();
  return array;
}

}  // namespace pick_mission_ros
