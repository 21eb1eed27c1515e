// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter_ros/conversions.h"

#include <cmath>
#include <cstring>

#include <boost/make_shared.hpp>
#include <interactive_mapping_common_ros/poses.h>
#include <sensor_msgs/distortion_models.h>
#include <sensor_msgs/image_encodings.h>

namespace depth_self_filter_ros {

Drop toDrop(const depth_camera_ros::Refusal& refusal) {
  return {depth_camera_ros::statusOf<SelfFilterStatus>(refusal.status), refusal.message};
}

Drop toDrop(const depth_self_filter::JointHistory::Answer& answer) {
  using Verdict = depth_self_filter::JointHistory::Verdict;
  switch (answer.verdict) {
    case Verdict::kKnown:
      return {};
    case Verdict::kNotYet:
      return {SelfFilterStatus::kJointStatesLate, answer.message};
    case Verdict::kNeverHeard:
      return {SelfFilterStatus::kNoJointStates, answer.message};
    case Verdict::kGap:
    case Verdict::kForgotten:
      break;
  }
  return {SelfFilterStatus::kJointStatesMissing, answer.message};
}

depth_self_filter::HandHistory::Change toChange(const interactive_mapping_msgs::AttachedBrick& message,
                                                const mp700_ur5e_description::RobotModel& robot, std::string* problem) {
  problem->clear();
  depth_self_filter::HandHistory::Change change;
  change.since_s = message.header.stamp.toSec();
  if (message.is_attached == 0) return change;
  depth_self_filter::HeldBrick brick;
  brick.frame = interactive_mapping_ros::withoutSlash(message.header.frame_id);
  brick.size_m << message.size.x, message.size.y, message.size.z;
  depth_camera_ros::Refusal refusal;
  const auto T_frame_brick = depth_camera_ros::toIsometry(message.pose, &refusal);
  if (T_frame_brick) {
    brick.T_frame_brick = *T_frame_brick;
    *problem = depth_self_filter::whyNotHeld(robot, brick);
  } else {
    *problem = "of the brick, the " + refusal.message;
  }
  change.is_clear = problem->empty();
  if (change.is_clear) change.brick = brick;
  return change;
}

sensor_msgs::ImagePtr toMessage(const depth_camera::DepthImage& image) {
  const auto message = boost::make_shared<sensor_msgs::Image>();
  message->width = static_cast<std::uint32_t>(image.width);
  message->height = static_cast<std::uint32_t>(image.height);
  message->encoding = sensor_msgs::image_encodings::TYPE_32FC1;
  message->step = static_cast<std::uint32_t>(image.width * sizeof(float));
  const std::uint16_t probe = 1;
  std::uint8_t first = 0;
  std::memcpy(&first, &probe, 1);
  message->is_bigendian = first == 0 ? 1 : 0;
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(image.depth_m.data());
  message->data.assign(bytes, bytes + image.depth_m.size() * sizeof(float));
  return message;
}

sensor_msgs::CameraInfo toOutputInfo(const sensor_msgs::CameraInfo& info, const depth_camera::CameraModel& camera) {
  sensor_msgs::CameraInfo output;
  output.header = info.header;
  output.width = static_cast<std::uint32_t>(camera.width);
  output.height = static_cast<std::uint32_t>(camera.height);
  output.distortion_model = sensor_msgs::distortion_models::PLUMB_BOB;
  output.D.assign(5, 0.0);
  output.K = {camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0};
  output.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  output.P = {camera.fx, 0.0, camera.cx, 0.0, 0.0, camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0};
  return output;
}

}  // namespace depth_self_filter_ros
