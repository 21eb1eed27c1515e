// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/compressed_depth.h"

#include <cstring>
#include <limits>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

namespace gpis_mapping_ros {
namespace {

using depth_camera_ros::isDepthEncoding;
using depth_camera_ros::shownName;

// ConfigHeader of compressed_depth_image_transport, as it lies in memory: compression format, and the two quantisation
// parameters of 32FC1 images.
constexpr std::size_t kHeaderBytes = sizeof(std::int32_t) + 2 * sizeof(float);

std::optional<sensor_msgs::Image> refuse(FrameStatus status, const std::string& message, Refusal* refusal) {
  *refusal = {status, message};
  return std::nullopt;
}

/// Depth [m] = a / (raw - b); raw 0: no value.
cv::Mat fromInverseDepth(const cv::Mat& raw, float a, float b) {
  cv::Mat depth_m(raw.size(), CV_32FC1);
  for (int v = 0; v < raw.rows; ++v) {
    for (int u = 0; u < raw.cols; ++u) {
      const std::uint16_t value = raw.at<std::uint16_t>(v, u);
      depth_m.at<float>(v, u) =
          value == 0 ? std::numeric_limits<float>::quiet_NaN() : a / (static_cast<float>(value) - b);
    }
  }
  return depth_m;
}

}  // namespace

std::string compressedDepthEncoding(const std::string& format) {
  const std::string encoding = format.substr(0, format.find(';'));
  return encoding.substr(0, encoding.find_last_not_of(' ') + 1);
}

std::optional<sensor_msgs::Image> decodeCompressedDepth(const sensor_msgs::CompressedImage& message, Refusal* refusal) {
  const std::string encoding = compressedDepthEncoding(message.format);
  if (!isDepthEncoding(encoding)) {
    return refuse(FrameStatus::kWrongEncoding,
                  "compressed format is " + shownName(message.format) + ", must begin with 16UC1, mono16 or 32FC1",
                  refusal);
  }
  // Older transports wrote "16UC1; compressedDepth" and knew only PNG.
  if (message.format.find("rvl") != std::string::npos) {
    return refuse(FrameStatus::kWrongEncoding,
                  "compressed format is " + shownName(message.format) +
                      ": RVL is not read; set the publisher's parameter "
                      "compressedDepth/format to png",
                  refusal);
  }
  if (message.data.size() <= kHeaderBytes) {
    return refuse(FrameStatus::kMalformedImage,
                  "compressed image has " + std::to_string(message.data.size()) + " bytes, must have more than the " +
                      std::to_string(kHeaderBytes) + " of its header",
                  refusal);
  }
  cv::Mat raw;
  try {
    const std::vector<std::uint8_t> png(message.data.begin() + kHeaderBytes, message.data.end());
    raw = cv::imdecode(png, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
    raw.release();
  }
  if (raw.empty() || raw.type() != CV_16UC1) {
    return refuse(FrameStatus::kMalformedImage,
                  "compressed image is no PNG of one channel of 16 bits after its " + std::to_string(kHeaderBytes) +
                      " bytes of header (sent by a transport other than compressedDepth?)",
                  refusal);
  }
  if (encoding == "32FC1") {
    float parameters[2];
    std::memcpy(parameters, message.data.data() + sizeof(std::int32_t), sizeof(parameters));
    raw = fromInverseDepth(raw, parameters[0], parameters[1]);
  }
  sensor_msgs::Image image;
  image.header = message.header;
  image.width = static_cast<std::uint32_t>(raw.cols);
  image.height = static_cast<std::uint32_t>(raw.rows);
  image.encoding = encoding;
  const std::uint16_t probe = 1;
  image.is_bigendian = reinterpret_cast<const std::uint8_t*>(&probe)[0] == 0;
  image.step = static_cast<std::uint32_t>(raw.cols * raw.elemSize());
  image.data.assign(raw.data, raw.data + raw.total() * raw.elemSize());
  return image;
}

}  // namespace gpis_mapping_ros
