// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth_publisher.h"

#include <map>
#include <sstream>
#include <stdexcept>
#include <vector>

#include <XmlRpcException.h>
#include <XmlRpcValue.h>
#include <cv_bridge/cv_bridge.h>
#include <geometry_msgs/TransformStamped.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/image_encodings.h>

#include "camera_info.h"
#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/sensor.h"

namespace sim_tests_ros {
namespace {

constexpr double kMillimetresPerMetre = 1000.0;

/// Takes values out of one parameter map and collects what is wrong with them.
class ParamReader {
 public:
  ParamReader(std::string name_space, XmlRpc::XmlRpcValue values)
      : name_space_(std::move(name_space)), values_(std::move(values)) {}

  void read(const std::string& key, std::string& value, const std::string& rule) {
    if (XmlRpc::XmlRpcValue* found = take(key, {XmlRpc::XmlRpcValue::TypeString}, rule)) {
      value = static_cast<std::string>(*found);
    }
  }
  void read(const std::string& key, bool& value) {
    if (XmlRpc::XmlRpcValue* found = take(key, {XmlRpc::XmlRpcValue::TypeBoolean}, "true or false")) {
      value = static_cast<bool>(*found);
    }
  }
  void read(const std::string& key, int& value, const std::string& rule) {
    if (XmlRpc::XmlRpcValue* found = take(key, {XmlRpc::XmlRpcValue::TypeInt}, rule)) {
      value = static_cast<int>(*found);
    }
  }
  void read(const std::string& key, double& value, const std::string& rule) {
    if (XmlRpc::XmlRpcValue* found = take(key, {XmlRpc::XmlRpcValue::TypeDouble, XmlRpc::XmlRpcValue::TypeInt}, rule)) {
      value = found->getType() == XmlRpc::XmlRpcValue::TypeInt ? static_cast<int>(*found) : static_cast<double>(*found);
    }
  }

  template <typename Value>
  void check(bool is_good, const std::string& key, const Value& value, const std::string& rule) {
    if (!is_good) {
      std::ostringstream text;
      text << name_space_ << "/" << key << " = " << value << ", must be " << rule;
      problems_.push_back(text.str());
    }
  }

  /// Throws if there was any problem or a key that nobody read.
  void finish() {
    for (auto& entry : values_) {
      if (known_.count(entry.first) == 0) {
        problems_.push_back(name_space_ + "/" + entry.first + " is unknown");
      }
    }
    std::string text;
    for (const std::string& problem : problems_) {
      text += (text.empty() ? "" : "\n") + problem;
    }
    if (!text.empty()) {
      throw std::invalid_argument(text);
    }
  }

 private:
  XmlRpc::XmlRpcValue* take(const std::string& key, const std::vector<XmlRpc::XmlRpcValue::Type>& types,
                            const std::string& rule) {
    known_[key] = true;
    if (!values_.hasMember(key)) {
      return nullptr;
    }
    XmlRpc::XmlRpcValue& value = values_[key];
    for (const XmlRpc::XmlRpcValue::Type type : types) {
      if (value.getType() == type) {
        return &value;
      }
    }
    check(false, key, value.toXml(), rule);
    return nullptr;
  }

  std::string name_space_;
  XmlRpc::XmlRpcValue values_;
  std::map<std::string, bool> known_;
  std::vector<std::string> problems_;
};

}  // namespace

PublisherParams loadPublisherParams(const ros::NodeHandle& private_nh) {
  PublisherParams params;
  XmlRpc::XmlRpcValue values;
  try {
    if (!private_nh.getParam(private_nh.getNamespace(), values) ||
        values.getType() != XmlRpc::XmlRpcValue::TypeStruct) {
      values = XmlRpc::XmlRpcValue();
      values.begin();  // makes it an empty map
    }
    ParamReader reader(private_nh.getNamespace(), values);
    reader.read("scene_file", params.scene_file, "the path of a scene file");
    reader.read("map_frame", params.map_frame, "a frame name");
    reader.read("camera_frame", params.camera_frame, "a frame name");
    reader.read("encoding", params.encoding, "32FC1 or 16UC1");
    reader.read("rate_hz", params.rate_hz, "a number in [0, 1000] Hz");
    reader.read("loop", params.loop);
    reader.read("first_frame", params.first_frame, "an integer, 0 or more");
    reader.read("last_frame", params.last_frame, "an integer, -1 or more");
    reader.read("apply_sensor", params.apply_sensor);
    reader.read("publish_clock", params.publish_clock);
    reader.read("wait_for_subscriber", params.wait_for_subscriber);
    reader.read("seed", params.seed, "an integer, -1 or more");
    reader.check(!params.scene_file.empty(), "scene_file", "\"\"", "the path of a scene file");
    reader.check(!params.map_frame.empty() && params.map_frame.front() != '/', "map_frame", params.map_frame,
                 "a frame name without leading slash");
    reader.check(
        !params.camera_frame.empty() && params.camera_frame.front() != '/' && params.camera_frame != params.map_frame,
        "camera_frame", params.camera_frame, "a frame name without leading slash, other than map_frame");
    reader.check(params.encoding == "32FC1" || params.encoding == "16UC1", "encoding", params.encoding,
                 "32FC1 or 16UC1");
    reader.check(params.rate_hz >= 0.0 && params.rate_hz <= 1000.0, "rate_hz", params.rate_hz, "in [0, 1000] Hz");
    reader.check(params.first_frame >= 0, "first_frame", params.first_frame, "0 or more");
    reader.check(params.last_frame >= -1, "last_frame", params.last_frame, "-1 or more");
    reader.check(params.seed >= -1, "seed", params.seed, "-1 or more");
    reader.finish();
  } catch (const XmlRpc::XmlRpcException& error) {
    // Not derived from std::exception: would pass every handler of the caller.
    throw std::invalid_argument(private_nh.getNamespace() + ": " + error.getMessage());
  }
  return params;
}

SyntheticDepthPublisher::SyntheticDepthPublisher(const ros::NodeHandle& nh, const PublisherParams& params)
    : params_(params), scene_(synthetic_depth::loadScene(params.scene_file)), nh_(nh), transport_(nh_) {
  if (params_.seed >= 0) {
    scene_.seed = static_cast<std::uint64_t>(params_.seed);
  }
  if (!params_.apply_sensor) {
    scene_.sensor = scene_.sensor.withoutNoise();
  }
  if (!(params_.rate_hz > 0.0)) {
    params_.rate_hz = scene_.fps;
  }
  if (params_.last_frame < 0) {
    params_.last_frame = scene_.numFrames() - 1;
  }
  if (params_.first_frame > params_.last_frame || params_.last_frame >= scene_.numFrames()) {
    throw std::invalid_argument("first_frame = " + std::to_string(params_.first_frame) + ", last_frame = " +
                                std::to_string(params_.last_frame) + ", must be in order and in [0, " +
                                std::to_string(scene_.numFrames() - 1) + "], the frames of " + params_.scene_file);
  }
  camera_info_ = cameraInfo(scene_.camera, params_.camera_frame);
  constexpr std::uint32_t kQueueSize = 10;
  // Not a CameraPublisher: that cannot tell whether both topics have a subscriber.
  image_publisher_ = transport_.advertise("depth/image_rect", kQueueSize);
  info_publisher_ = nh_.advertise<sensor_msgs::CameraInfo>("depth/camera_info", kQueueSize);
  if (params_.publish_clock) {
    clock_publisher_ = nh_.advertise<rosgraph_msgs::Clock>("/clock", kQueueSize);
  }
  ROS_INFO("%s: frames %d to %d of %d, %zu boxes, %s at %.3g Hz, %s -> %s, loop %s, sensor %s, clock %s",
           params_.scene_file.c_str(), params_.first_frame, params_.last_frame, scene_.numFrames(), scene_.boxes.size(),
           params_.encoding.c_str(), params_.rate_hz, params_.map_frame.c_str(), params_.camera_frame.c_str(),
           params_.loop ? "on" : "off", params_.apply_sensor ? "on" : "off", params_.publish_clock ? "on" : "off");
  // Wall time, as this node may be the one that makes ROS time.
  timer_ = nh_.createWallTimer(ros::WallDuration(1.0 / params_.rate_hz),
                               [this](const ros::WallTimerEvent&) { publishNext(); });
}

void SyntheticDepthPublisher::publishNext() {
  if (num_published_ == 0 && params_.wait_for_subscriber &&
      (image_publisher_.getNumSubscribers() == 0 || info_publisher_.getNumSubscribers() == 0)) {
    return;
  }
  if (!params_.loop && num_published_ == numFrames()) {
    timer_.stop();
    ROS_INFO("sequence is complete: %d frames", numFrames());
    return;
  }
  const int frame = params_.first_frame + static_cast<int>(num_published_ % numFrames());
  // The scene's time runs on through loops: ROS time must not jump back.
  const ros::Time stamp =
      params_.publish_clock
          ? ros::Time(scene_.start_time_s + static_cast<double>(params_.first_frame + num_published_) / scene_.fps)
          : ros::Time::now();
  ++num_published_;
  if (params_.publish_clock) {
    rosgraph_msgs::Clock clock;
    clock.clock = stamp;
    clock_publisher_.publish(clock);
  }

  const Eigen::Isometry3d T_map_camera = scene_.cameraInMap(frame);
  const Eigen::Quaterniond q = Eigen::Quaterniond(T_map_camera.linear()).normalized();
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = stamp;
  transform.header.frame_id = params_.map_frame;
  transform.child_frame_id = params_.camera_frame;
  transform.transform.translation.x = T_map_camera.translation().x();
  transform.transform.translation.y = T_map_camera.translation().y();
  transform.transform.translation.z = T_map_camera.translation().z();
  transform.transform.rotation.x = q.x();
  transform.transform.rotation.y = q.y();
  transform.transform.rotation.z = q.z();
  transform.transform.rotation.w = q.w();
  tf_broadcaster_.sendTransform(transform);

  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = params_.camera_frame;
  cv::Mat depth = synthetic_depth::measureDepth(scene_, frame);
  if (params_.encoding == sensor_msgs::image_encodings::TYPE_16UC1) {
    depth = synthetic_depth::encodeDepth16(depth, kMillimetresPerMetre);
  }
  camera_info_.header = header;
  info_publisher_.publish(camera_info_);
  image_publisher_.publish(cv_bridge::CvImage(header, params_.encoding, depth).toImageMsg());
}

}  // namespace sim_tests_ros
