// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/bag_sequence.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <set>

#include <boost/array.hpp>
#include <boost/make_shared.hpp>
#include <rosbag/bag.h>
#include <rosbag/query.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include <depth_camera_ros/conversions.h>
#include "gpis_mapping_ros/compressed_depth.h"

namespace gpis_mapping_ros {
namespace {

using depth_camera_ros::isDepthEncoding;
using depth_camera_ros::isRectifiedTopic;
using depth_camera_ros::kAllowedDepthEncodings;
using depth_camera_ros::Refusal;
using depth_camera_ros::shifted;
using depth_camera_ros::shownName;
using depth_camera_ros::toDepthImage;
using depth_camera_ros::toDepthRectifier;
using depth_camera_ros::toIsometry;

using depth_camera::StampedPose;
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
// Drivers that compute K and P anew for each message round them. 1e-3 px is 2 micrometres at 1 m and 500 px.
constexpr double kInfoJitter_px = 1e-3;
constexpr double kForever_s = 1e9;  // how long the buffer keeps a transform; stamps plus this stay below 2^32 s

template <typename Container>
std::string join(const Container& items) {
  std::string text;
  for (const std::string& item : items) text += (text.empty() ? "" : ", ") + item;
  return text.empty() ? "none" : text;
}

/// A compressedDepth topic's name without the transport, or any other topic's.
std::string baseTopic(const std::string& topic) {
  const std::string suffix = kCompressedDepthSuffix;
  const bool is_compressed =
      topic.size() > suffix.size() && topic.compare(topic.size() - suffix.size(), suffix.size(), suffix) == 0;
  return is_compressed ? topic.substr(0, topic.size() - suffix.size()) : topic;
}

template <std::size_t N>
bool isAlike(const boost::array<double, N>& a, const boost::array<double, N>& b) {
  return std::equal(a.begin(), a.end(), b.begin(),
                    [](double x, double y) { return std::abs(x - y) <= kInfoJitter_px; });
}

class BagSequence : public DepthSequence {
 public:
  BagSequence(const std::string& path, const BagOptions& options)
      : path_(path), units_per_metre_(options.units_per_metre) {
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
  bool hasClock() const override { return true; }

  std::optional<DepthFrame> frame(std::size_t i, SkipReason* reason) override {
    try {
      return readFrame(i, reason);
    } catch (const rosbag::BagException& error) {
      throw DepthSequenceError(frameName(i) + ": cannot be read: " + error.what());
    } catch (const ros::Exception& error) {  // a message shorter than its fields say
      throw DepthSequenceError(frameName(i) + ": cannot be decoded: " + error.what());
    }
  }

  std::optional<StampedPose> pose(std::size_t i, double time_offset_s, SkipReason* reason) override {
    auto known = headers_.find(i);  // an image is read from the file again each time
    if (known == headers_.end()) known = headers_.emplace(i, readHeader(i)).first;
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
      if (const auto image = message.instantiate<sensor_msgs::Image>()) return image->encoding;
      if (const auto image = message.instantiate<sensor_msgs::CompressedImage>()) {
        const std::string encoding = compressedDepthEncoding(image->format);
        const bool is_depth = topic != baseTopic(topic) && isDepthEncoding(encoding);
        return is_depth ? encoding : "compressed, not read: " + shownName(image->format);
      }
    }
    return "no message";
  }

  void chooseDepthTopic(const std::string& wanted) {
    std::vector<std::string> described;
    std::map<std::string, std::string> depth;   // base name to topic: the raw one where there are both
    std::map<std::string, std::string> mono16;  // of a depth or an infrared camera
    for (const char* type : {kImageType, kCompressedType}) {
      for (const std::string& topic : topicsOf(type)) {
        const std::string encoding = firstEncoding(topic);
        described.push_back(topic + " (" + encoding + ")");
        if (isDepthEncoding(encoding)) (encoding == "mono16" ? mono16 : depth).emplace(baseTopic(topic), topic);
      }
    }
    if (!wanted.empty()) {
      depth_topic_ = wanted;
      if (types_.count(depth_topic_) == 0) depth_topic_ += kCompressedDepthSuffix;
      const auto found = types_.find(depth_topic_);
      const bool is_compressed = baseTopic(depth_topic_) != depth_topic_;
      if (found == types_.end() || found->second != (is_compressed ? kCompressedType : kImageType)) {
        throw DepthSequenceError(path_ + ": no image topic " + wanted + "; image topics: " + join(described));
      }
      return;
    }
    std::vector<std::string> candidates;
    for (const auto& entry : depth.empty() ? mono16 : depth) candidates.push_back(entry.second);
    if (candidates.empty()) {
      throw DepthSequenceError(path_ + ": no depth image topic; allowed encodings: " + kAllowedDepthEncodings +
                               "; image topics: " + join(described));
    }
    if (candidates.size() > 1) {
      throw DepthSequenceError(path_ + ": several depth image topics, choose one: " + join(candidates));
    }
    depth_topic_ = candidates.front();
  }

  void readCameraInfo(const std::string& wanted) {
    const std::string base = baseTopic(depth_topic_);
    const std::string name_space = base.substr(0, base.rfind('/') + 1);
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
      } else if (!isAlike(info->K, first->K) || !isAlike(info->P, first->P) || info->width != first->width ||
                 info->height != first->height || info->D != first->D || info->roi != first->roi ||
                 info->binning_x != first->binning_x || info->binning_y != first->binning_y) {
        throw DepthSequenceError(path_ + ": " + topic +
                                 " changes during the recording, must stay the same (K and P within 0.001 px)");
      }
    }
    if (!first) throw DepthSequenceError(path_ + ": " + topic + " holds no message");
    takeCamera(*first, topic);
  }

  void takeCamera(const sensor_msgs::CameraInfo& info, const std::string& topic) {
    Refusal refusal;
    if (!toDepthRectifier(info, isRectifiedTopic(baseTopic(depth_topic_)), &rectifier_, &refusal)) {
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
        transform.header.frame_id = interactive_mapping_ros::withoutSlash(transform.header.frame_id);
        transform.child_frame_id = interactive_mapping_ros::withoutSlash(transform.child_frame_id);
        if (!isRotation(&transform)) continue;
        if (buffer_->setTransform(transform, path_, is_static)) {
          frames_.insert(transform.header.frame_id);
          frames_.insert(transform.child_frame_id);
        }
      }
    }
    if (num_bad_transforms_ > 0) notes_.push_back(badTransforms());
    if (frames_.empty()) {
      throw DepthSequenceError(path_ + ": holds no usable transform on /tf or /tf_static" +
                               (num_bad_transforms_ > 0 ? "; " + badTransforms() : ""));
    }
  }

  /// Whether tf2 would take it; it does so aloud for each one that it refuses. Rounding is taken out.
  bool isRotation(geometry_msgs::TransformStamped* transform) {
    Refusal refusal;
    const std::optional<Eigen::Isometry3d> T = toIsometry(transform->transform, &refusal);
    if (T) {
      const Eigen::Quaterniond q(T->linear());
      transform->transform.rotation.x = q.x();
      transform->transform.rotation.y = q.y();
      transform->transform.rotation.z = q.z();
      transform->transform.rotation.w = q.w();
      return true;
    }
    if (num_bad_transforms_++ == 0) {
      first_bad_transform_ =
          "'" + transform->header.frame_id + "' to '" + transform->child_frame_id + "': " + refusal.message;
    }
    return false;
  }

  std::string badTransforms() const {
    return std::to_string(num_bad_transforms_) + " transforms were left out, the first from " + first_bad_transform_;
  }

  void chooseMapFrame(const std::string& wanted) {
    map_frame_ = interactive_mapping_ros::withoutSlash(wanted);
    if (frames_.count(map_frame_) > 0) return;
    throw DepthSequenceError(path_ + ": no frame '" + map_frame_ + "'; frames: " + join(frames_) +
                             (num_bad_transforms_ > 0 ? "; " + badTransforms() : ""));
  }

  sensor_msgs::ImageConstPtr readMessage(std::size_t i) const {
    if (const auto message = images_.at(i).instantiate<sensor_msgs::Image>()) return message;
    const auto compressed = images_.at(i).instantiate<sensor_msgs::CompressedImage>();
    if (!compressed) throw DepthSequenceError(frameName(i) + ": is no " + kImageType);
    Refusal refusal;
    const std::optional<sensor_msgs::Image> image = decodeCompressedDepth(*compressed, &refusal);
    if (!image) throw DepthSequenceError(frameName(i) + ": " + refusal.message);
    return boost::make_shared<sensor_msgs::Image>(*image);
  }

  std_msgs::Header readHeader(std::size_t i) const {
    if (const auto message = images_.at(i).instantiate<sensor_msgs::Image>()) return message->header;
    if (const auto message = images_.at(i).instantiate<sensor_msgs::CompressedImage>()) return message->header;
    throw DepthSequenceError(frameName(i) + ": is no " + kImageType);
  }

  std::optional<StampedPose> lookUp(const std_msgs::Header& header, double time_offset_s, std::size_t i,
                                    SkipReason* reason) {
    if (header.stamp.isZero()) {  // tf would give its newest pose
      *reason = {"no stamp", "stamp is 0, must be the time of exposure"};
      return std::nullopt;
    }
    const std::string camera_frame = interactive_mapping_ros::withoutSlash(header.frame_id);
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
    return StampedPose{*T_map_camera, header.stamp.toSec()};
  }

  std::optional<DepthFrame> readFrame(std::size_t i, SkipReason* reason) {
    const sensor_msgs::ImageConstPtr message = readMessage(i);
    const std::optional<StampedPose> pose = lookUp(message->header, timeOffset(), i, reason);
    if (!pose) return std::nullopt;
    return DepthFrame{readImage(*message, i), pose->T_map_camera, pose->stamp_s, frameName(i)};
  }

  DepthImage readImage(const sensor_msgs::Image& message, std::size_t i) const {
    Refusal refusal;
    std::optional<DepthImage> image = toDepthImage(message, units_per_metre_, &refusal);
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
  double units_per_metre_;
  rosbag::Bag bag_;
  std::map<std::string, std::string> types_;  // topic to message type
  std::string depth_topic_;
  std::string map_frame_;
  depth_camera::DepthRectifier rectifier_;
  std::unique_ptr<tf2::BufferCore> buffer_;
  std::set<std::string> frames_;
  std::size_t num_bad_transforms_{0};
  std::string first_bad_transform_;
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
    throw DepthSequenceError(path + ": cannot be read as a ROS bag: " + error.what() +
                             (looksLikeBag(path) ? "; if the recording was cut off, run `rosbag reindex` on it" : ""));
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
