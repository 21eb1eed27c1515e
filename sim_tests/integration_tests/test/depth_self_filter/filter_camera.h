// SPDX-License-Identifier: BSD-3-Clause
// A camera and an arm for a self filter under test, which publish in step with it, and an ear for what it says.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <depth_self_filter_ros/conversions.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/SelfFilterUpdate.h>
#include <mp700_ur5e_description/robot_names.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/JointState.h>
#include <tf2_msgs/TFMessage.h>

#include "support/await_update.h"

namespace integration_tests {

using node_tests::has;
using node_tests::Latest;
using node_tests::waitUntil;

namespace description = mp700_ur5e_description;
using Update = interactive_mapping_msgs::SelfFilterUpdate;

inline depth_camera::CameraModel filterCameraModel() {
  return {160, 120, 131.25, 131.25, 79.5, 59.5};
}

inline sensor_msgs::CameraInfo infoOf(const depth_camera::CameraModel& camera) {
  sensor_msgs::CameraInfo info;
  info.header.frame_id = description::kDepthFrame;
  info.width = static_cast<std::uint32_t>(camera.width);
  info.height = static_cast<std::uint32_t>(camera.height);
  info.K = {camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0};
  info.P = {camera.fx, 0.0, camera.cx, 0.0, 0.0, camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

/// One depth everywhere, 32FC1.
inline sensor_msgs::Image flatImage(float depth_m) {
  const depth_camera::CameraModel camera = filterCameraModel();
  const auto pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  sensor_msgs::Image image =
      *depth_self_filter_ros::toMessage({camera.width, camera.height, std::vector<float>(pixels, depth_m)});
  image.header.frame_id = description::kDepthFrame;
  return image;
}

/// The node listens below "<node>_in", so that several nodes of one test do not hear each other's robots.
class FilterCamera {
 public:
  explicit FilterCamera(const std::string& node)
      : images(node + "/image_rect"), infos(node + "/camera_info"), node_(node) {
    ros::NodeHandle in(node + "_in");
    image_ = in.advertise<sensor_msgs::Image>("depth/image_rect", 100);
    info_ = in.advertise<sensor_msgs::CameraInfo>("depth/camera_info", 100);
    joints_ = in.advertise<sensor_msgs::JointState>("joint_states", 1000);
    brick_ = in.advertise<interactive_mapping_msgs::AttachedBrick>("attached_brick", 10, true);
    tf_ = in.advertise<tf2_msgs::TFMessage>("tf", 100);
    update_subscriber_ =
        in.subscribe<Update>(node + "/update", 200, [this](const Update::ConstPtr& u) { updates.push_back(*u); });
    diagnostics_subscriber_ = in.subscribe<diagnostic_msgs::DiagnosticArray>(
        "/diagnostics", 100, [this](const diagnostic_msgs::DiagnosticArrayConstPtr& message) {
          for (const diagnostic_msgs::DiagnosticStatus& status : message->status) diagnostics_[status.name] = status;
        });
  }

  /// Waits until the node hears and is heard: until it has refused an image of encoding "probe".
  bool connect() {
    const bool is_there = waitUntil([this] {
      return image_.getNumSubscribers() > 0 && info_.getNumSubscribers() > 0 && joints_.getNumSubscribers() > 0 &&
             brick_.getNumSubscribers() > 0 && update_subscriber_.getNumPublishers() > 0;
    });
    if (!is_there) return false;
    // A subscriber is counted before its connection is ready: the first answers may be lost.
    sensor_msgs::Image probe;
    probe.encoding = "probe";
    probe.header.frame_id = description::kDepthFrame;
    for (int i = 0; i < 30; ++i) {
      probe.header.stamp = nextStamp();
      image_.publish(probe);
      if (waitUntil([&] { return !updates.empty() && updates.back().header.stamp == probe.header.stamp; }, 1.0)) {
        return true;
      }
    }
    return false;
  }

  /// Now, and long enough after all that has been published for joint states of 10 ms before to be in order.
  ros::Time nextStamp() {
    waitUntil([this] { return ros::Time::now() > published_ + ros::Duration(0.02); });
    note(ros::Time::now());
    return published_;
  }

  void publish(const sensor_msgs::Image& image) {
    note(image.header.stamp);
    image_.publish(image);
  }
  void publish(const sensor_msgs::CameraInfo& info) { info_.publish(info); }
  void publish(const sensor_msgs::JointState& joints) {
    note(joints.header.stamp);
    joints_.publish(joints);
  }
  void publish(const interactive_mapping_msgs::AttachedBrick& brick) { brick_.publish(brick); }
  void publish(const tf2_msgs::TFMessage& transforms) { tf_.publish(transforms); }

  /// The arm's joints, all at one angle but for what the arm in view needs, in the order of the real driver.
  static sensor_msgs::JointState armAt(const ros::Time& stamp, const std::vector<double>& arm_rad) {
    static const std::vector<std::size_t> kDriversOrder = {2, 1, 0, 3, 4, 5};
    sensor_msgs::JointState joints;
    joints.header.stamp = stamp;
    for (const std::size_t i : kDriversOrder) {
      joints.name.emplace_back(description::kArmJoints[i]);
      joints.position.push_back(arm_rad[i]);
    }
    return joints;
  }

  /// What the node says about the image of this stamp.
  Update await(const ros::Time& stamp, std::size_t since) { return awaitUpdate(updates, stamp, since, node_); }

  /// Publishes the image as it is, with joint states of 10 ms before and after it, and waits for what becomes of it.
  Update lookAsIs(const sensor_msgs::Image& image, const std::vector<double>& arm_rad) {
    const std::size_t since = updates.size();
    publish(armAt(image.header.stamp - ros::Duration(0.01), arm_rad));
    publish(armAt(image.header.stamp + ros::Duration(0.01), arm_rad));
    publish(image);
    return await(image.header.stamp, since);
  }

  /// The same, exposed now.
  Update look(sensor_msgs::Image image, const std::vector<double>& arm_rad) {
    image.header.stamp = nextStamp();
    return lookAsIs(image, arm_rad);
  }

  /// Messages of different topics overtake each other: looks until one that was sent before has been heard.
  Update lookUntil(const sensor_msgs::Image& image, const std::vector<double>& arm_rad,
                   const std::function<bool(const Update&)>& condition) {
    Update update;
    for (int i = 0; i < 100; ++i) {
      update = look(image, arm_rad);
      if (condition(update) || update.status == Update::NUM_STATUS) return update;
    }
    ADD_FAILURE() << "still status " << static_cast<int>(update.status) << ": " << update.message;
    return update;
  }
  Update lookUntil(const sensor_msgs::Image& image, const std::vector<double>& arm_rad, std::uint8_t status) {
    return lookUntil(image, arm_rad, [status](const Update& update) { return update.status == status; });
  }

  /// What /diagnostics says under "<node>: <task>".
  diagnostic_msgs::DiagnosticStatus diagnostic(const std::string& task) const {
    const auto found = diagnostics_.find(node_.substr(1) + ": " + task);
    return found == diagnostics_.end() ? diagnostic_msgs::DiagnosticStatus() : found->second;
  }

  std::vector<Update> updates;  // all, in the order they came
  Latest<sensor_msgs::Image> images;
  Latest<sensor_msgs::CameraInfo> infos;

 private:
  /// Stamps that are wrong on purpose, by seconds, do not count.
  void note(const ros::Time& stamp) {
    if (std::abs((stamp - ros::Time::now()).toSec()) < 1.0) published_ = std::max(published_, stamp);
  }

  std::string node_;
  ros::Publisher image_, info_, joints_, brick_, tf_;
  ros::Subscriber update_subscriber_, diagnostics_subscriber_;
  std::map<std::string, diagnostic_msgs::DiagnosticStatus> diagnostics_;
  ros::Time published_;  // latest stamp of all that was sent
};

}  // namespace integration_tests
