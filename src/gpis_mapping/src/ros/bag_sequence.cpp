// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/bag_sequence.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <map>
#include <set>

#include <boost/shared_ptr.hpp>
#include <rosbag/bag.h>
#include <rosbag/query.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include "gpis_mapping_ros/conversions.h"

namespace gpis_mapping_ros {
namespace {

using gpis_mapping::CameraModel;
using gpis_mapping::DepthFrame;
using gpis_mapping::DepthImage;
using gpis_mapping::DepthSequence;
using gpis_mapping::DepthSequenceError;
using gpis_mapping::SkipReason;

constexpr char kImageType[] = "sensor_msgs/Image";
constexpr char kCompressedType[] = "sensor_msgs/CompressedImage";
constexpr char kInfoType[] = "sensor_msgs/CameraInfo";
constexpr char kTfType[] = "tf2_msgs/TFMessage";
constexpr char kOldTfType[] = "tf/tfMessage";  // the same layout under its name of 2012
constexpr char kAllowedEncodings[] = "16UC1 (mm), 32FC1 (m)";
constexpr double kUnitsPerMetre16 = 1000.0;  // REP 118
constexpr double kForever_s = 1e9;  // how long the buffer keeps a transform; stamps plus this stay below 2^32 s

template <typename Container>
std::string join(const Container& items) {
  std::string text;
  for (const std::string& item : items) text += (text.empty() ? "" : ", ") + item;
  return text.empty() ? "none" : text;
}

class BagSequence : public DepthSequence {
 public:
  BagSequence(const std::string& path, const BagOptions& options) : path_(path) {
    bag_.open(path, rosbag::bagmode::Read);
    readTopics();
    chooseDepthTopic(options.depth_topic);
    readCameraInfo(options.info_topic);
    readTransforms();
    chooseMapFrame(options.map_frame);
    rosbag::View view(bag_, rosbag::TopicQuery(depth_topic_));
    for (const rosbag::MessageInstance& message : view) images_.push_back(message);
  }

  std::size_t size() const override { return images_.size(); }
  const CameraModel& camera() const override { return rectifier_.camera(); }

  std::optional<DepthFrame> frame(std::size_t i, SkipReason* reason) override {
    try {
      return readFrame(i, reason);
    } catch (const rosbag::BagException& error) {
      throw DepthSequenceError(frameName(i) + ": cannot be read: " + error.what());
    } catch (const ros::Exception& error) {  // a message shorter than its fields say
      throw DepthSequenceError(frameName(i) + ": cannot be decoded: " + error.what());
    }
  }

  std::optional<Eigen::Isometry3d> pose(std::size_t i, double time_offset_s, SkipReason* reason) override {
    auto known = headers_.find(i);  // an image is read from the file again each time
    if (known == headers_.end()) {
      const sensor_msgs::ImageConstPtr message = images_.at(i).instantiate<sensor_msgs::Image>();
      if (!message) throw DepthSequenceError(frameName(i) + ": is no " + kImageType);
      known = headers_.emplace(i, message->header).first;
    }
    return lookUp(known->second, time_offset_s, i, reason);
  }

 private:
  std::string frameName(std::size_t i) const { return path_ + ": " + depth_topic_ + " image " + std::to_string(i); }

  void readTopics() {
    rosbag::View view(bag_);
    for (const rosbag::ConnectionInfo* connection : view.getConnections()) {
      types_[connection->topic] = connection->datatype;
    }
  }

  std::vector<std::string> topicsOf(const std::string& type) const {
    std::vector<std::string> topics;
    for (const auto& entry : types_) {
      if (entry.second == type) topics.push_back(entry.first);
    }
    return topics;
  }

  std::string firstEncoding(const std::string& topic) const {
    rosbag::View view(bag_, rosbag::TopicQuery(topic));
    for (const rosbag::MessageInstance& message : view) {
      const sensor_msgs::ImageConstPtr image = message.instantiate<sensor_msgs::Image>();
      if (image) return image->encoding;
    }
    return "no message";
  }

  void chooseDepthTopic(const std::string& wanted) {
    std::vector<std::string> described;
    std::vector<std::string> candidates;
    for (const std::string& topic : topicsOf(kImageType)) {
      const std::string encoding = firstEncoding(topic);
      described.push_back(topic + " (" + encoding + ")");
      if (isDepthEncoding(encoding)) candidates.push_back(topic);
    }
    for (const std::string& topic : topicsOf(kCompressedType)) described.push_back(topic + " (compressed, not read)");
    if (!wanted.empty()) {
      const auto found = types_.find(wanted);
      if (found == types_.end() || found->second != kImageType) {
        throw DepthSequenceError(path_ + ": no image topic " + wanted + "; image topics: " + join(described));
      }
      depth_topic_ = wanted;
      return;
    }
    if (candidates.empty()) {
      throw DepthSequenceError(path_ + ": no depth image topic; allowed encodings: " + kAllowedEncodings +
                               "; image topics: " + join(described));
    }
    if (candidates.size() > 1) {
      throw DepthSequenceError(path_ + ": several depth image topics, choose one: " + join(candidates));
    }
    depth_topic_ = candidates.front();
  }

  void readCameraInfo(const std::string& wanted) {
    const std::string name_space = depth_topic_.substr(0, depth_topic_.rfind('/') + 1);
    const std::string topic = wanted.empty() ? name_space + "camera_info" : wanted;
    const auto found = types_.find(topic);
    if (found == types_.end() || found->second != kInfoType) {
      throw DepthSequenceError(path_ + ": no camera info topic " + topic +
                               "; camera info topics: " + join(topicsOf(kInfoType)));
    }
    rosbag::View view(bag_, rosbag::TopicQuery(topic));
    sensor_msgs::CameraInfoConstPtr first;
    for (const rosbag::MessageInstance& message : view) {
      const sensor_msgs::CameraInfoConstPtr info = message.instantiate<sensor_msgs::CameraInfo>();
      if (!info) continue;
      if (!first) {
        first = info;
      } else if (info->K != first->K || info->P != first->P || info->width != first->width ||
                 info->height != first->height || info->D != first->D || info->roi != first->roi ||
                 info->binning_x != first->binning_x || info->binning_y != first->binning_y) {
        throw DepthSequenceError(path_ + ": " + topic + " changes during the recording, must stay the same");
      }
    }
    if (!first) throw DepthSequenceError(path_ + ": " + topic + " holds no message");
    takeCamera(*first, topic);
  }

  void takeCamera(const sensor_msgs::CameraInfo& info, const std::string& topic) {
    Refusal refusal;
    if (!toDepthRectifier(info, isRectifiedTopic(depth_topic_), &rectifier_, &refusal)) {
      throw DepthSequenceError(path_ + ": " + topic + ": " + refusal.message);
    }
  }

  void readTransforms() {
    buffer_ = std::make_unique<tf2::BufferCore>(ros::Duration(kForever_s));
    rosbag::View view(bag_, [](const rosbag::ConnectionInfo* connection) {
      return connection->datatype == kTfType || connection->datatype == kOldTfType;
    });
    for (const rosbag::MessageInstance& message : view) {
      tf2_msgs::TFMessage transforms;
      if (message.getDataType() == kTfType) {
        const tf2_msgs::TFMessageConstPtr received = message.instantiate<tf2_msgs::TFMessage>();
        if (!received) continue;
        transforms = *received;
      } else {
        std::vector<std::uint8_t> bytes(message.size());
        ros::serialization::OStream out(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
        message.write(out);
        ros::serialization::IStream in(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
        ros::serialization::deserialize(in, transforms);
      }
      const std::string& topic = message.getTopic();
      const std::string suffix = "tf_static";
      const bool is_static =
          topic.size() >= suffix.size() && topic.compare(topic.size() - suffix.size(), suffix.size(), suffix) == 0;
      for (geometry_msgs::TransformStamped& transform : transforms.transforms) {
        transform.header.frame_id = withoutSlash(transform.header.frame_id);
        transform.child_frame_id = withoutSlash(transform.child_frame_id);
        if (buffer_->setTransform(transform, path_, is_static)) {
          frames_.insert(transform.header.frame_id);
          frames_.insert(transform.child_frame_id);
        }
      }
    }
    if (frames_.empty()) throw DepthSequenceError(path_ + ": holds no usable transform on /tf or /tf_static");
  }

  void chooseMapFrame(const std::string& wanted) {
    map_frame_ = withoutSlash(wanted);
    if (frames_.count(map_frame_) > 0) return;
    throw DepthSequenceError(path_ + ": no frame '" + map_frame_ + "'; frames: " + join(frames_));
  }

  std::optional<Eigen::Isometry3d> lookUp(const std_msgs::Header& header, double time_offset_s, std::size_t i,
                                          SkipReason* reason) {
    const std::string camera_frame = withoutSlash(header.frame_id);
    geometry_msgs::TransformStamped transform;
    try {
      transform = buffer_->lookupTransform(map_frame_, camera_frame, shifted(header.stamp, time_offset_s));
    } catch (const tf2::TransformException& error) {
      *reason = {"no transform from '" + camera_frame + "' to '" + map_frame_ + "' at the image's stamp", error.what()};
      return std::nullopt;
    }
    Refusal refusal;
    const std::optional<Eigen::Isometry3d> T_map_camera = toIsometry(transform.transform, &refusal);
    if (!T_map_camera) throw DepthSequenceError(frameName(i) + ": its " + refusal.message);
    return T_map_camera;
  }

  std::optional<DepthFrame> readFrame(std::size_t i, SkipReason* reason) {
    const sensor_msgs::ImageConstPtr message = images_.at(i).instantiate<sensor_msgs::Image>();
    if (!message) throw DepthSequenceError(frameName(i) + ": is no " + kImageType);
    const std::optional<Eigen::Isometry3d> T_map_camera = lookUp(message->header, time_offset_s_, i, reason);
    if (!T_map_camera) return std::nullopt;
    DepthFrame frame;
    frame.T_map_camera = *T_map_camera;
    frame.image = readImage(*message, i);
    frame.stamp_s = message->header.stamp.toSec();
    frame.name = frameName(i);
    return frame;
  }

  DepthImage readImage(const sensor_msgs::Image& message, std::size_t i) const {
    Refusal refusal;
    std::optional<DepthImage> image = toDepthImage(message, kUnitsPerMetre16, &refusal);
    if (!image) throw DepthSequenceError(frameName(i) + ": " + refusal.message);
    const CameraModel& raw = rectifier_.rawCamera();
    if (image->width != raw.width || image->height != raw.height) {
      throw DepthSequenceError(frameName(i) + ": is " + std::to_string(image->width) + " x " +
                               std::to_string(image->height) + " px, must be " + std::to_string(raw.width) + " x " +
                               std::to_string(raw.height) + " px as the camera info says");
    }
    return rectifier_.rectify(std::move(*image));
  }

  std::string path_;
  rosbag::Bag bag_;
  std::map<std::string, std::string> types_;  // topic to message type
  std::string depth_topic_;
  std::string map_frame_;
  gpis_mapping::DepthRectifier rectifier_;
  std::unique_ptr<tf2::BufferCore> buffer_;
  std::set<std::string> frames_;
  std::vector<rosbag::MessageInstance> images_;
  std::map<std::size_t, std_msgs::Header> headers_;  // of the images whose pose was asked for
};

}  // namespace

std::unique_ptr<DepthSequence> openBagSequence(const std::string& path, const BagOptions& options) {
  try {
    return std::make_unique<BagSequence>(path, options);
  } catch (const rosbag::BagUnindexedException&) {
    throw DepthSequenceError(path + ": has no index (recording was cut off); run `rosbag reindex` on it");
  } catch (const rosbag::BagException& error) {
    throw DepthSequenceError(path + ": cannot be read as a ROS bag: " + error.what());
  } catch (const ros::Exception& error) {
    throw DepthSequenceError(path + ": holds a message that cannot be decoded: " + error.what());
  }
}

bool looksLikeBag(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  char head[7] = {};
  in.read(head, sizeof(head));
  return in.gcount() == sizeof(head) && std::memcmp(head, "#ROSBAG", sizeof(head)) == 0;
}

}  // namespace gpis_mapping_ros
