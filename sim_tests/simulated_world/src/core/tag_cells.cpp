// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/tag_cells.h"

#include <map>
#include <memory>
#include <stdexcept>

#include <opencv2/aruco.hpp>

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
}

namespace simulated_world {
namespace {

void requireId(const std::string& family, int id, int num_ids) {
  if (id < 0 || id >= num_ids) {
    throw std::invalid_argument("tag of family " + family + ": id = " + std::to_string(id) + ", must be in [0, " +
                                std::to_string(num_ids - 1) + "]");
  }
}

cv::Mat aprilTagCells(const std::string& name, int id) {
  const std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)> family(tag36h11_create(), tag36h11_destroy);
  requireId(name, id, static_cast<int>(family->ncodes));
  const std::unique_ptr<image_u8_t, void (*)(image_u8_t*)> image(
      apriltag_to_image(family.get(), static_cast<uint32_t>(id)), image_u8_destroy);
  const cv::Mat all(image->height, image->width, CV_8UC1, image->buf, static_cast<std::size_t>(image->stride));
  const int margin = (family->total_width - family->width_at_border) / 2;  // the library draws some of it
  return all(cv::Rect(margin, margin, family->width_at_border, family->width_at_border)).clone();
}

cv::Mat arucoCells(const std::string& name, int dictionary_id, int id) {
  const cv::Ptr<cv::aruco::Dictionary> dictionary = cv::aruco::getPredefinedDictionary(dictionary_id);
  requireId(name, id, dictionary->bytesList.rows);
  cv::Mat cells;
  dictionary->drawMarker(id, dictionary->markerSize + 2, cells, 1);
  return cells;
}

}  // namespace

cv::Mat tagCells(const std::string& family, int id) {
  static const std::map<std::string, int> kDictionaries = {{"DICT_4X4_1000", cv::aruco::DICT_4X4_1000},
                                                           {"DICT_5X5_1000", cv::aruco::DICT_5X5_1000},
                                                           {"DICT_6X6_1000", cv::aruco::DICT_6X6_1000}};
  if (family == "tag36h11") {
    return aprilTagCells(family, id);
  }
  const auto dictionary = kDictionaries.find(family);
  if (dictionary == kDictionaries.end()) {
    throw std::invalid_argument("family = \"" + family +
                                "\", must be tag36h11, DICT_4X4_1000, DICT_5X5_1000 or DICT_6X6_1000");
  }
  return arucoCells(family, dictionary->second, id);
}

}  // namespace simulated_world
