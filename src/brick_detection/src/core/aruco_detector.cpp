// SPDX-License-Identifier: BSD-3-Clause
#include "aruco_detector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include <Eigen/Dense>
#include <opencv2/aruco.hpp>
#include <opencv2/imgproc.hpp>

#include "border_refinement.h"
#include "detector_support.h"

namespace brick_detection {
namespace {

struct DictionaryName {
  const char* name;
  int id;
};
constexpr std::array<DictionaryName, 3> kDictionaries = {{{"DICT_4X4_1000", cv::aruco::DICT_4X4_1000},
                                                          {"DICT_5X5_1000", cv::aruco::DICT_5X5_1000},
                                                          {"DICT_6X6_1000", cv::aruco::DICT_6X6_1000}}};

const DictionaryName* findDictionary(const std::string& name) {
  for (const DictionaryName& dictionary : kDictionaries) {
    if (name == dictionary.name) return &dictionary;
  }
  return nullptr;
}

/// Brightness over the tag's plane: a + b x + c y.
class BrightnessPlane {
 public:
  void add(const Eigen::Vector2d& at, double value) {
    const Eigen::Vector3d row(1.0, at.x(), at.y());
    normal_ += row * row.transpose();
    right_ += value * row;
  }
  /// Nothing if the places do not span the plane.
  std::optional<Eigen::Vector3d> solve() const {
    if (!(std::abs(normal_.determinant()) > 1e-6)) return std::nullopt;
    return Eigen::Vector3d(normal_.ldlt().solve(right_));
  }

 private:
  Eigen::Matrix3d normal_{Eigen::Matrix3d::Zero()};
  Eigen::Vector3d right_{Eigen::Vector3d::Zero()};
};

class ArucoDetector : public TagDetector {
 public:
  explicit ArucoDetector(const TagDetectorConfig& config)
      : config_(config),
        dictionary_(cv::aruco::getPredefinedDictionary(findDictionary(config.family)->id)),
        parameters_(cv::aruco::DetectorParameters::create()) {
    const double most = dictionary_->maxCorrectionBits;
    // The library multiplies and cuts off.
    parameters_->errorCorrectionRate = most > 0.0 ? std::min(1.0, (config.max_hamming + 0.01) / most) : 0.0;
    // Of two squares one in the other OpenCV keeps the outer one alone, which often is the paper: by the default, 0.05,
    // half of the tags of DICT_6X6_1000 with a margin of one cell are lost. What is then found twice is thinned out below.
    parameters_->minMarkerDistanceRate = 0.01;
    // Grey levels below the mean around. The default, 7, loses a third of the tags at an exposure of 0.15, where black to
    // white are 33 levels; 3 loses a ninth, and none more in good light.
    parameters_->adaptiveThreshConstant = 3.0;
  }

  std::vector<TagObservation> detect(const cv::Mat& grey) override {
    requireGrey(grey);
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    cv::aruco::detectMarkers(grey, dictionary_, corners, ids, parameters_);
    std::vector<TagObservation> tags;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      TagObservation tag;
      tag.id = ids[i];
      for (std::size_t corner = 0; corner < 4; ++corner) {
        tag.corners_px[corner] = {corners[i][corner].x, corners[i][corner].y};
      }
      tag.corners_px = refineBorder(grey, tag.corners_px, dictionary_->markerSize + 2);
      if (readBits(grey, &tag) && tag.hamming <= config_.max_hamming) keepBest(tag, &tags);
    }
    sortById(&tags);
    return tags;
  }

 private:
  /// Adds a tag unless it was found before, with better bits.
  static void keepBest(const TagObservation& tag, std::vector<TagObservation>* tags) {
    const auto middle = [](const TagObservation& t) -> Eigen::Vector2d {
      return 0.25 * (t.corners_px[0] + t.corners_px[1] + t.corners_px[2] + t.corners_px[3]);
    };
    for (TagObservation& other : *tags) {
      // Two tags cannot be nearer than one side; twice the same is, by far.
      if (other.id != tag.id || (middle(other) - middle(tag)).norm() > 0.5 * tag.shortestSide()) continue;
      if (tag.margin > other.margin) other = tag;
      return;
    }
    tags->push_back(tag);
  }

  /// OpenCV tells neither how many bits it corrected nor how sure it was: the cells are read again. The threshold lies half
  /// way between the black border and the white ring around it. Returns whether there was enough of them in the image.
  bool readBits(const cv::Mat& grey, TagObservation* tag) const {
    const int num_cells = dictionary_->markerSize + 2;
    const auto edge = static_cast<float>(num_cells);
    const std::array<cv::Point2f, 4> source = {cv::Point2f(0, 0), {edge, 0}, {edge, edge}, {0, edge}};
    std::array<cv::Point2f, 4> target;
    for (std::size_t i = 0; i < 4; ++i) {
      target[i] = {static_cast<float>(tag->corners_px[i].x()), static_cast<float>(tag->corners_px[i].y())};
    }
    const cv::Mat_<double> transform = cv::getPerspectiveTransform(source.data(), target.data());
    const Eigen::Matrix3d H = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(transform[0]);
    // Mean of the middle of a cell, nothing outside the image.
    const auto readCell = [&](int column, int row) -> std::optional<double> {
      double sum = 0.0;
      for (int k = 0; k < 9; ++k) {
        const Eigen::Vector2d at(column + 0.3 + 0.2 * (k % 3), row + 0.3 + 0.2 * (k / 3));
        const Eigen::Vector2d p = (H * at.homogeneous()).hnormalized();
        const int u = static_cast<int>(std::floor(p.x() + 0.5));
        const int v = static_cast<int>(std::floor(p.y() + 0.5));
        if (!cv::Rect(0, 0, grey.cols, grey.rows).contains({u, v})) return std::nullopt;
        sum += grey.at<std::uint8_t>(v, u);
      }
      return sum / 9.0;
    };
    BrightnessPlane black;
    BrightnessPlane white;
    for (int row = -1; row <= num_cells; ++row) {
      for (int column = -1; column <= num_cells; ++column) {
        const int ring = std::min({row, column, num_cells - 1 - row, num_cells - 1 - column});
        if (ring > 0) continue;
        const std::optional<double> value = readCell(column, row);
        if (value) (ring < 0 ? white : black).add(Eigen::Vector2d(column, row), *value);
      }
    }
    const std::optional<Eigen::Vector3d> black_level = black.solve();
    const std::optional<Eigen::Vector3d> white_level = white.solve();
    if (!black_level || !white_level) return false;

    const cv::Mat code = cv::aruco::Dictionary::getBitsFromByteList(
        dictionary_->bytesList.rowRange(tag->id, tag->id + 1), dictionary_->markerSize);
    double sum[2] = {0.0, 0.0};
    int count[2] = {0, 0};
    tag->border_cells = num_cells;
    tag->cells = cv::Mat(num_cells + 2, num_cells + 2, CV_8UC1, cv::Scalar(255));
    tag->cells(cv::Rect(1, 1, num_cells, num_cells)).setTo(0);
    tag->cells(cv::Rect(2, 2, code.cols, code.rows)).setTo(255, code);
    tag->hamming = 0;
    for (int row = 0; row < code.rows; ++row) {
      for (int column = 0; column < code.cols; ++column) {
        const std::optional<double> value = readCell(column + 1, row + 1);
        if (!value) return false;
        const double threshold = 0.5 * (*black_level + *white_level).dot(Eigen::Vector3d(1.0, column + 1.0, row + 1.0));
        const bool is_white = code.at<std::uint8_t>(row, column) != 0;
        const double contrast = is_white ? *value - threshold : threshold - *value;
        if (contrast <= 0.0) ++tag->hamming;
        sum[is_white] += contrast;
        ++count[is_white];
      }
    }
    // As libapriltag has it: of the worse colour.
    tag->margin = std::min(count[0] > 0 ? sum[0] / count[0] : 255.0, count[1] > 0 ? sum[1] / count[1] : 255.0);
    return true;
  }

  TagDetectorConfig config_;
  cv::Ptr<cv::aruco::Dictionary> dictionary_;
  cv::Ptr<cv::aruco::DetectorParameters> parameters_;
};

}  // namespace

bool isArucoFamily(const std::string& family) {
  return findDictionary(family) != nullptr;
}

std::unique_ptr<TagDetector> makeArucoDetector(const TagDetectorConfig& config) {
  return std::make_unique<ArucoDetector>(config);
}

}  // namespace brick_detection
