// SPDX-License-Identifier: BSD-3-Clause
// What the tests of the live map share: a camera that is published image by image, in step with the node under test.
#pragma once

#include <cstring>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/Trigger.h>
#include <synthetic_depth_ros/camera_info.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include "support/await_update.h"
#include "support/map_on_scene.h"

namespace integration_tests {

using node_tests::bytesOf;
using node_tests::call;
using node_tests::has;
using node_tests::kDeadline_s;
using node_tests::Latest;
using node_tests::waitUntil;

using interactive_mapping_msgs::MapUpdate;
using interactive_mapping_msgs::QueryMap;
using synthetic_depth::Scene;

inline sensor_msgs::Image toImage(const cv::Mat& depth_m, const std::string& encoding) {
  const cv::Mat pixels = encoding == "16UC1" ? synthetic_depth::encodeDepth16(depth_m, 1000.0) : depth_m;
  sensor_msgs::Image image;
  image.width = static_cast<std::uint32_t>(pixels.cols);
  image.height = static_cast<std::uint32_t>(pixels.rows);
  image.encoding = encoding;
  image.step = static_cast<std::uint32_t>(pixels.cols * pixels.elemSize());
  image.data.assign(pixels.data, pixels.data + pixels.total() * pixels.elemSize());  // fresh matrices are continuous
  return image;
}

inline geometry_msgs::TransformStamped toTransform(const Eigen::Isometry3d& T_map_camera) {
  geometry_msgs::TransformStamped transform = tf2::eigenToTransform(T_map_camera);
  transform.header.frame_id = "map";
  return transform;
}

/// All that belongs to one image.
struct LiveFrame {
  sensor_msgs::Image image;
  sensor_msgs::CameraInfo info;
  geometry_msgs::TransformStamped transform;

  void setStamp(const ros::Time& stamp) { image.header.stamp = info.header.stamp = transform.header.stamp = stamp; }
  void setCameraFrame(const std::string& frame) {
    image.header.frame_id = info.header.frame_id = transform.child_frame_id = frame;
  }
};

inline LiveFrame toLiveFrame(const Scene& scene, int frame, const std::string& encoding = "32FC1") {
  LiveFrame live{toImage(synthetic_depth::measureDepth(scene, frame), encoding),
                 synthetic_depth_ros::cameraInfo(scene.camera, ""), toTransform(scene.cameraInMap(frame))};
  live.setCameraFrame("camera_depth_optical_frame");
  return live;
}

/// 160 x 120 px, field of view of the 640 x 480 camera: small enough that an update takes some 10 ms.
inline synthetic_depth::CameraModel tinyCamera() {
  return {160, 120, 131.25, 131.25, 79.5, 59.5};
}

/// A camera for one node under test, and an ear for what it says. The node listens below "<node>_in": its
/// depth/image_rect, depth/camera_info and tf, so that several nodes of one test do not hear each other's cameras.
class LiveMap {
 public:
  explicit LiveMap(const std::string& node) : node_(node) {
    ros::NodeHandle in(node + "_in");
    image_ = in.advertise<sensor_msgs::Image>("depth/image_rect", 100);
    info_ = in.advertise<sensor_msgs::CameraInfo>("depth/camera_info", 100);
    tf_ = in.advertise<tf2_msgs::TFMessage>("tf", 100);
    update_subscriber_ = in.subscribe<MapUpdate>(
        node + "/update", 200,
        [this](const boost::shared_ptr<const MapUpdate>& update) { updates.push_back(*update); });
    diagnostics_subscriber_ = in.subscribe<diagnostic_msgs::DiagnosticArray>(
        "/diagnostics", 100, [this](const diagnostic_msgs::DiagnosticArrayConstPtr& message) {
          for (const diagnostic_msgs::DiagnosticStatus& status : message->status) diagnostics_[status.name] = status;
        });
    // In the past, so that stamps may run faster than the clock; after those of the camera before.
    static int num_cameras = 0;
    stamp_ = ros::Time::now() + ros::Duration(1000.0 * num_cameras++ - 36000.0);
  }

  /// Arguments that make a node listen to this camera.
  static std::vector<std::string> remappings(const std::string& node) {
    std::vector<std::string> out;
    for (const char* topic : {"depth/image_rect", "depth/camera_info"}) {
      out.push_back(std::string(topic) + ":=" + node + "_in/" + topic);
    }
    out.push_back("/tf:=" + node + "_in/tf");
    out.push_back("/tf_static:=" + node + "_in/tf_static");
    return out;
  }

  /// Waits until the node hears and is heard: until it has refused an image of encoding "probe".
  bool connect() {
    const bool is_up = waitUntil([this] {
      return image_.getNumSubscribers() > 0 && info_.getNumSubscribers() > 0 && tf_.getNumSubscribers() > 0 &&
             ros::service::exists(node_ + "/query", false);
    });
    if (!is_up) return false;
    // A subscriber is counted before its connection is ready: the first answers may be lost.
    sensor_msgs::Image probe;
    probe.encoding = "probe";
    probe.header.frame_id = "camera_depth_optical_frame";
    const std::size_t before = updates.size();
    for (int i = 0; i < 30; ++i) {
      probe.header.stamp = nextStamp(0.01);
      image_.publish(probe);
      if (waitUntil([&] { return updates.size() > before && updates.back().header.stamp == probe.header.stamp; },
                    1.0)) {
        return true;
      }
    }
    return false;
  }

  ros::Time nextStamp(double step_s) {
    stamp_ += ros::Duration(step_s);
    return stamp_;
  }
  ros::Time stamp() const { return stamp_; }
  void setStamp(const ros::Time& stamp) { stamp_ = stamp; }

  void publish(const sensor_msgs::Image& image) { image_.publish(image); }
  void publish(const sensor_msgs::CameraInfo& info) { info_.publish(info); }
  void publish(const geometry_msgs::TransformStamped& transform) {
    tf2_msgs::TFMessage message;
    message.transforms.push_back(transform);
    tf_.publish(message);
  }

  /// What the node says about the image of this stamp that was published when `updates` had `since` entries.
  MapUpdate await(const ros::Time& stamp, std::size_t since) { return awaitUpdate(updates, stamp, since, node_); }

  /// Publishes the image alone and waits for what becomes of it.
  MapUpdate look(const sensor_msgs::Image& image) {
    const std::size_t since = updates.size();
    publish(image);
    return await(image.header.stamp, since);
  }

  /// Publishes transform, camera info and image, and waits for what becomes of it.
  MapUpdate look(const LiveFrame& frame) {
    publish(frame.transform);
    publish(frame.info);
    return look(frame.image);
  }

  /// The next image of a scene, `step_s` after the last one.
  MapUpdate look(const Scene& scene, int frame, const std::string& encoding, double step_s) {
    LiveFrame live = toLiveFrame(scene, frame, encoding);
    live.setStamp(nextStamp(step_s));
    return look(live);
  }

  /// Camera info and image come by different connections. Publishes the info, then images without any measurement
  /// until they show whether the node has it: they meet NOTHING_MEASURED only after the info has been found good.
  MapUpdate publishInfoAndAwait(const LiveFrame& frame, std::uint8_t status) {
    publish(frame.info);
    LiveFrame blind = frame;
    std::fill(blind.image.data.begin(), blind.image.data.end(), 0);
    MapUpdate update;
    for (int i = 0; i < 1000; ++i) {
      blind.image.header.stamp = nextStamp(0.01);
      update = look(blind.image);
      if (update.status == status || update.status == MapUpdate::NUM_STATUS) return update;
    }
    ADD_FAILURE() << "camera info published, status " << static_cast<int>(status) << " expected, still "
                  << static_cast<int>(update.status) << " " << update.message;
    return update;
  }

  QueryMap::Response ask(const Eigen::Matrix3Xd& points, bool with_variance = true, const std::string& frame = "",
                         bool with_variance_gradient = false) {
    QueryMap query;
    query.request.frame_id = frame;
    query.request.with_variance = with_variance ? 1 : 0;
    query.request.with_variance_gradient = with_variance_gradient ? 1 : 0;
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      geometry_msgs::Point p;
      p.x = points(0, i);
      p.y = points(1, i);
      p.z = points(2, i);
      query.request.points.push_back(p);
    }
    EXPECT_TRUE(call(node_ + "/query", query)) << node_;
    return query.response;
  }

  bool clear() {
    std_srvs::Trigger trigger;
    return call(node_ + "/clear_map", trigger) && trigger.response.success != 0;
  }

  /// What /diagnostics says under "<node>: <task>".
  diagnostic_msgs::DiagnosticStatus diagnostic(const std::string& task) const {
    const auto found = diagnostics_.find(node_.substr(1) + ": " + task);
    return found == diagnostics_.end() ? diagnostic_msgs::DiagnosticStatus() : found->second;
  }
  std::string diagnosticValue(const std::string& task, const std::string& key) const {
    for (const diagnostic_msgs::KeyValue& value : diagnostic(task).values) {
      if (value.key == key) return value.value;
    }
    return "";
  }
  long count(const std::string& key) const { return std::atol(diagnosticValue("input", key).c_str()); }

  const std::string& node() const { return node_; }

  std::vector<MapUpdate> updates;  // all, in the order they came

 private:
  std::string node_;
  ros::Publisher image_, info_, tf_;
  ros::Subscriber update_subscriber_, diagnostics_subscriber_;
  std::map<std::string, diagnostic_msgs::DiagnosticStatus> diagnostics_;
  ros::Time stamp_;
};

}  // namespace integration_tests
