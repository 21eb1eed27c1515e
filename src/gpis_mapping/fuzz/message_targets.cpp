// SPDX-License-Identifier: BSD-3-Clause
// Targets that take ROS messages: built from odd values, and as bytes damaged on their way.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include <interactive_mapping_msgs/QueryMap.h>
#include <ros/serialization.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <depth_camera_ros/conversions.h>
#include "fuzz/fuzz_engine.h"
#include "fuzz/small_map.h"
#include "fuzz/targets.h"
#include "gpis_mapping_ros/map_messages.h"

namespace gpis_mapping_fuzz {
namespace {

using depth_camera_ros::FrameStatus;
using depth_camera_ros::Refusal;
using interactive_mapping_msgs::QueryMap;

// Fields of a message on the wire: n bytes (positive), a string (0), an array of elements of n bytes (-n).
using Layout = std::vector<int>;
const Layout kImageLayout = {12, 0, 8, 0, 5, -1};
const Layout kCameraInfoLayout = {12, 0, 8, 0, -8, 240, 8, 17};
const Layout kQueryLayout = {0, -24, 2};

/// roscpp makes an array as long as its length field says before it looks how many bytes there are; a length of 4 G
/// would test the machine's memory and not this program.
bool isBearable(const std::string& bytes, const Layout& layout) {
  constexpr std::uint64_t kMaxExcess = 1 << 20;
  std::size_t at = 0;
  for (const int field : layout) {
    if (field > 0) {
      at += static_cast<std::size_t>(field);
      continue;
    }
    if (at + 4 > bytes.size()) return true;  // overrun, as it must be
    std::uint32_t count = 0;
    std::memcpy(&count, &bytes[at], sizeof(count));
    const std::uint64_t size = std::uint64_t{count} * static_cast<std::uint64_t>(field == 0 ? 1 : -field);
    if (size > bytes.size() + kMaxExcess) return false;
    at += 4 + static_cast<std::size_t>(size);
  }
  return true;
}

/// Serialises, damages the bytes, and reads them back into `message`. False if that is refused.
template <typename Message>
bool sendThroughDamage(const Layout& layout, Random* random, Message* message) {
  namespace ser = ros::serialization;
  std::string bytes(ser::serializationLength(*message), '\0');
  ser::OStream out(reinterpret_cast<std::uint8_t*>(&bytes[0]), static_cast<std::uint32_t>(bytes.size()));
  ser::serialize(out, *message);
  bytes = mutateBytes(std::move(bytes), random);
  if (!isBearable(bytes, layout)) return false;
  *message = Message();
  ser::IStream in(reinterpret_cast<std::uint8_t*>(&bytes[0]), static_cast<std::uint32_t>(bytes.size()));
  try {
    ser::deserialize(in, *message);
  } catch (const ros::Exception&) {
    return false;
  }
  return true;
}

std::uint32_t oddSize(Random* random) {
  return random->chance(0.8) ? static_cast<std::uint32_t>(random->between(0, 24))
                             : static_cast<std::uint32_t>(random->pick<std::uint64_t>(
                                   {65535, 65536, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, random->next()}));
}

const std::vector<std::string>& encodings() {
  static const std::vector<std::string> kNames = {"16UC1",
                                                  "16UC1",
                                                  "16UC1",
                                                  "32FC1",
                                                  "32FC1",
                                                  "32FC1",
                                                  "",
                                                  "mono16",
                                                  "mono8",
                                                  "rgb8",
                                                  "16UC2",
                                                  "16uc1",
                                                  "32FC1 ",
                                                  "64FC1",
                                                  std::string("16UC1\0", 6),
                                                  std::string(3000, 'x'),
                                                  "\xFF\n%s%n"};
  return kNames;
}

class ImageMessageTarget : public Target {
 public:
  Outcome feed(Random* random) override {
    sensor_msgs::Image message;
    message.header.frame_id = random->pick({"camera", "", "/camera"});
    message.encoding = random->pick(encodings());
    message.width = static_cast<std::uint32_t>(random->between(1, 20));
    message.height = static_cast<std::uint32_t>(random->between(1, 20));
    const std::uint32_t pixel = message.encoding.compare(0, 2, "32") == 0 ? 4 : 2;
    message.step = message.width * pixel + static_cast<std::uint32_t>(random->pick({0, 0, 0, 1, 7}));
    message.data.resize(static_cast<std::size_t>(message.step) * message.height);
    for (std::uint8_t& byte : message.data) byte = static_cast<std::uint8_t>(random->next());
    message.is_bigendian = random->pick<std::uint8_t>({0, 0, 1, 255});
    if (random->chance(0.5)) {
      switch (random->below(5)) {
        case 0:
          message.width = oddSize(random);
          break;
        case 1:
          message.height = oddSize(random);
          break;
        case 2:
          message.step = oddSize(random);
          break;
        case 3:
          message.data.resize(random->below(2000));
          break;
        default:
          message.width = oddSize(random);
          message.height = oddSize(random);
          message.step = oddSize(random);
      }
    }
    if (random->chance(0.4) && !sendThroughDamage(kImageLayout, random, &message)) return Outcome::kRefused;

    Refusal refusal;
    const auto image = depth_camera_ros::toDepthImage(message, random->pick({1000.0, 1.0, 5000.0}), &refusal);
    if (!image) {
      require(refusal.status != FrameStatus::kAccepted && !refusal.message.empty(), "refused without a reason");
      require(refusal.message.size() < 300, "a reason as long as a foreign string");
      return Outcome::kRefused;
    }
    require(image->width == static_cast<int>(message.width) && image->height == static_cast<int>(message.height) &&
                image->depth_m.size() == static_cast<std::size_t>(image->width) * image->height,
            "the image has another size than its message");
    require(message.data.size() >= image->depth_m.size() * pixelBytes(message), "more pixels than bytes");
    const bool holds = depth_camera::holdsMeasurement(*image);
    require(!holds || !image->depth_m.empty(), "nothing holds a measurement");
    return Outcome::kAccepted;
  }

 private:
  static std::size_t pixelBytes(const sensor_msgs::Image& message) { return message.encoding == "32FC1" ? 4 : 2; }
};

class CameraInfoTarget : public Target {
 public:
  static constexpr std::size_t kMaxRectified_px = 100 * 100;  // tables of larger ones take the time of many inputs

  Outcome feed(Random* random) override {
    sensor_msgs::CameraInfo message;
    message.header.frame_id = "camera";
    message.width = static_cast<std::uint32_t>(random->between(16, random->chance(0.5) ? 100 : 640));
    message.height = static_cast<std::uint32_t>(random->between(16, random->chance(0.5) ? 100 : 480));
    message.distortion_model = "plumb_bob";
    message.D.assign(random->pick({0U, 5U, 8U}), 0.0);
    message.K[0] = message.P[0] = 500.0;
    message.K[4] = message.P[5] = 500.0;
    message.K[2] = message.P[2] = 0.5 * message.width;
    message.K[5] = message.P[6] = 0.5 * message.height;
    for (int i = random->between(0, 2); i > 0; --i) {
      switch (random->below(7)) {
        case 0:
          message.K[random->below(9)] = random->oddDouble();
          break;
        case 1:
          message.P[random->below(12)] = random->oddDouble();
          break;
        case 2:
          message.width = oddSize(random);
          break;
        case 3:
          message.binning_x = random->pick({0U, 1U, 2U, 3U, 0xFFFFFFFFU});
          message.binning_y = random->pick({0U, 1U, 2U, 5U, 0x80000000U});
          break;
        case 4:
          message.roi.x_offset = oddSize(random);
          message.roi.width = random->pick({oddSize(random), 40U, 200U});
          message.roi.height = random->pick({oddSize(random), 30U});
          break;
        case 5:
          message.distortion_model = random->pick({"plumb_bob", "rational_polynomial", "equidistant", "fisheye", "?"});
          for (double& d : message.D)
            d = random->chance(0.2) ? random->oddDouble() : 0.1 - 0.02 * random->between(0, 9);
          message.D.resize(random->pick({4U, 5U, 8U, 12U, 14U}), 0.01);
          break;
        default:
          message.height = oddSize(random);
      }
    }
    if (random->chance(0.4) && !sendThroughDamage(kCameraInfoLayout, random, &message)) return Outcome::kRefused;

    Refusal refusal;
    const bool is_rectified = random->chance(0.5);
    const auto camera = depth_camera_ros::toCameraModel(message, is_rectified, &refusal);
    if (!camera) {
      require(refusal.status == FrameStatus::kBadCameraInfo && !refusal.message.empty(), "refused without a reason");
      return Outcome::kRefused;
    }
    require(camera->validate().empty(), "an impossible camera was taken");
    const bool is_whole = message.roi.width == 0 && message.roi.height == 0;
    const std::uint32_t width = is_whole ? message.width : message.roi.width;
    require(camera->width == static_cast<int>(width / std::max(1U, message.binning_x)),
            "another width than the message's");
    const auto size = static_cast<std::size_t>(camera->width) * static_cast<std::size_t>(camera->height);
    if (size > kMaxRectified_px) return Outcome::kAccepted;
    depth_camera::DepthRectifier rectifier;
    if (!depth_camera_ros::toDepthRectifier(message, is_rectified, &rectifier, &refusal)) {
      require(refusal.status == FrameStatus::kBadCameraInfo && refusal.message.size() < 300,
              "refused without a reason");
      return Outcome::kRefused;
    }
    const auto image = rectifier.rectify({camera->width, camera->height, std::vector<float>(size, 2.0f)});
    require(rectifier.camera().validate().empty() && image.width == rectifier.camera().width &&
                image.depth_m.size() == static_cast<std::size_t>(image.width) * image.height,
            "the rectified image does not fit its camera");
    require(std::all_of(image.depth_m.begin(), image.depth_m.end(),
                        [](float z) { return std::isnan(z) || std::abs(z - 2.0f) < 1e-5f; }),
            "the rectified image shows what was not there");
    return Outcome::kAccepted;
  }
};

class QueryMessageTarget : public Target {
 public:
  QueryMessageTarget() {
    static const gpis_mapping::GpisMap kMap(smallMap());
    map_ = kMap.snapshot();
  }

  Outcome feed(Random* random) override {
    QueryMap::Request request;
    request.frame_id = random->pick({"", "map", "/map"});
    request.points.resize(random->below(8));
    for (geometry_msgs::Point& p : request.points) {
      p.x = random->uniform(-1.0, 1.0);
      p.y = random->chance(0.8) ? random->uniform(-1.0, 1.0) : random->oddDouble();
      p.z = random->uniform(-0.2, 0.6);
    }
    request.with_variance = random->chance(0.5) ? 1 : 0;
    request.with_variance_gradient = random->chance(0.5) ? 1 : 0;
    if (random->chance(0.7) && !sendThroughDamage(kQueryLayout, random, &request)) return Outcome::kRefused;

    const gpis_mapping::Points3d points = gpis_mapping_ros::toPoints(request.points);
    require(points.cols() == static_cast<Eigen::Index>(request.points.size()), "another number of points");
    gpis_mapping::QueryOptions options;
    options.threads = 1;
    options.variance = request.with_variance != 0;
    options.variance_gradient = options.variance && request.with_variance_gradient != 0;  // else the node refuses
    const gpis_mapping::QueryResult result = map_->query(points, options);
    QueryMap::Response answer;
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    gpis_mapping_ros::fillAnswer(result, turn, options.variance, &answer);
    const std::size_t count = request.points.size();
    const std::size_t if_variance = options.variance ? count : 0;
    const std::size_t if_variance_gradient = options.variance_gradient ? count : 0;
    require(answer.distance.size() == count && answer.gradient.size() == count && answer.state.size() == count &&
                answer.euclidean_distance.size() == count && answer.euclidean_gradient.size() == count &&
                answer.surface_std.size() == count && answer.variance.size() == if_variance &&
                answer.occupancy.size() == if_variance && answer.variance_gradient.size() == if_variance_gradient,
            "an answer has another length than the question");
    for (std::size_t i = 0; i < count; ++i) {
      const double d = answer.distance[i];
      require(!std::isinf(d) && answer.state[i] <= QueryMap::Response::OCCUPIED, "an answer out of range");
      const auto& g = answer.gradient[i];
      require(std::isnan(d) || (std::isfinite(g.x) && std::isfinite(g.y) && std::isfinite(g.z)),
              "a distance without gradient");
    }
    return Outcome::kAccepted;
  }

 private:
  std::shared_ptr<const gpis_mapping::MapSnapshot> map_;
};

}  // namespace

std::vector<TargetInfo> messageTargets() {
  return {
      {"image_messages", 200000, 1000, [](Random*) { return std::make_unique<ImageMessageTarget>(); }},
      {"camera_info_messages", 150000, 1000, [](Random*) { return std::make_unique<CameraInfoTarget>(); }},
      {"query_messages", 90000, 1000, [](Random*) { return std::make_unique<QueryMessageTarget>(); }},
  };
}

std::vector<TargetInfo> allTargets() {
  std::vector<TargetInfo> targets = mapTargets();
  for (const auto& more : {textTargets(), messageTargets()}) targets.insert(targets.end(), more.begin(), more.end());
  return targets;
}

}  // namespace gpis_mapping_fuzz
