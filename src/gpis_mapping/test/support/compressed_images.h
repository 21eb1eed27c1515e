// SPDX-License-Identifier: BSD-3-Clause
// Depth images as compressed_depth_image_transport publishes them.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sensor_msgs/CompressedImage.h>

namespace test_support {

/// The transport's header (format, a, b) and the PNG of `raw`.
inline sensor_msgs::CompressedImage compressedDepth(const std::string& format, const cv::Mat& raw, float a = 0.0f,
                                                    float b = 0.0f) {
  sensor_msgs::CompressedImage message;
  message.format = format;
  std::vector<std::uint8_t> png;
  if (!cv::imencode(".png", raw, png)) throw std::runtime_error("PNG cannot be written");
  const std::int32_t kind = 0;
  message.data.resize(12);
  std::memcpy(message.data.data(), &kind, 4);
  std::memcpy(message.data.data() + 4, &a, 4);
  std::memcpy(message.data.data() + 8, &b, 4);
  message.data.insert(message.data.end(), png.begin(), png.end());
  return message;
}

}  // namespace test_support
