// SPDX-License-Identifier: BSD-3-Clause
#include "apriltag_detector.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include <opencv2/imgproc.hpp>

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h10.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagCircle21h7.h>
#include <apriltag/tagCircle49h12.h>
#include <apriltag/tagCustom48h12.h>
#include <apriltag/tagStandard41h12.h>
#include <apriltag/tagStandard52h13.h>
}

#include "border_refinement.h"
#include "detector_support.h"

namespace brick_detection {
namespace {

struct FamilyFunctions {
  const char* name;
  apriltag_family_t* (*create)();
  void (*destroy)(apriltag_family_t*);
};
constexpr std::array<FamilyFunctions, 9> kFamilies = {
    {{"tag16h5", tag16h5_create, tag16h5_destroy},
     {"tag25h9", tag25h9_create, tag25h9_destroy},
     {"tag36h10", tag36h10_create, tag36h10_destroy},
     {"tag36h11", tag36h11_create, tag36h11_destroy},
     {"tagCircle21h7", tagCircle21h7_create, tagCircle21h7_destroy},
     {"tagCircle49h12", tagCircle49h12_create, tagCircle49h12_destroy},
     {"tagCustom48h12", tagCustom48h12_create, tagCustom48h12_destroy},
     {"tagStandard41h12", tagStandard41h12_create, tagStandard41h12_destroy},
     {"tagStandard52h13", tagStandard52h13_create, tagStandard52h13_destroy}}};

const FamilyFunctions* findFamily(const std::string& name) {
  for (const FamilyFunctions& family : kFamilies) {
    if (name == family.name) return &family;
  }
  return nullptr;
}

// The library finds codes with errors in a table of all of them, 48 bytes each. For two errors that is 88 MB for
// tagStandard41h12, and gigabytes for the families of more than 40000 codes, which therefore correct one.
constexpr std::uint32_t kManyCodes = 10000;

int blurKernelSize(double sigma_px) {
  return 2 * static_cast<int>(std::ceil(3.0 * sigma_px)) + 1;
}

/// Standard deviation of the pixels' noise [grey levels]: the mask of Immerkaer (Fast noise variance estimation, 1996), which
/// answers to noise alone where brightness is smooth, with the median instead of the mean because of edges. Every second
/// pixel of every second row will do.
double noiseStd(const cv::Mat& grey) {
  constexpr int kMaxAnswer = 8 * 255;
  std::array<int, kMaxAnswer + 1> histogram{};
  int count = 0;
  for (int row = 1; row + 1 < grey.rows; row += 2) {
    const auto* above = grey.ptr<std::uint8_t>(row - 1);
    const auto* here = grey.ptr<std::uint8_t>(row);
    const auto* below = grey.ptr<std::uint8_t>(row + 1);
    for (int column = 1; column + 1 < grey.cols; column += 2, ++count) {
      const auto second = [column](const std::uint8_t* line) {
        return line[column - 1] - 2 * line[column] + line[column + 1];
      };
      ++histogram[static_cast<std::size_t>(std::abs(second(above) - 2 * second(here) + second(below)))];
    }
  }
  int median = 0;
  for (int below = histogram[0]; 2 * below < count; below += histogram[static_cast<std::size_t>(median)]) ++median;
  constexpr double kGain = 6.0;  // the mask's coefficients, root of the sum of squares
  constexpr double kMedianToSigma = 1.4826;
  return kMedianToSigma * median / kGain;
}

class AprilTagDetector : public TagDetector {
 public:
  explicit AprilTagDetector(const TagDetectorConfig& config)
      : config_(config),
        family_(findFamily(config.family)->create(), findFamily(config.family)->destroy),
        detector_(apriltag_detector_create(), apriltag_detector_destroy) {
    const int max_hamming = family_->ncodes > kManyCodes ? std::min(1, config.max_hamming) : config.max_hamming;
    apriltag_detector_add_family_bits(detector_.get(), family_.get(), max_hamming);
    detector_->nthreads = config.threads;
    detector_->quad_decimate = static_cast<float>(config.decimate);
    if (config.blur_sigma_px > 0.0) {
      const cv::Mat_<double> kernel = cv::getGaussianKernel(blurKernelSize(config.blur_sigma_px), config.blur_sigma_px);
      noise_gain_ = kernel.dot(kernel);  // separable: the square of what one direction leaves
    }
    detector_->decode_sharpening = config.sharpening;
  }

  std::vector<TagObservation> detect(const cv::Mat& grey) override {
    requireGrey(grey);
    // Smaller images hold no tag, and the library's tiles do not fit in.
    constexpr int kMinImagePx = 16;
    if (std::min(grey.cols, grey.rows) < kMinImagePx * config_.decimate) return {};
    // The library blurs its input in place, and ten times slower.
    cv::Mat input = grey;
    if (config_.blur_sigma_px > 0.0) {
      const int border = cv::BORDER_REFLECT_101 | cv::BORDER_ISOLATED;  // part of an image: nothing from beside it
      const int size = blurKernelSize(config_.blur_sigma_px);
      cv::GaussianBlur(grey, blurred_, cv::Size(size, size), config_.blur_sigma_px, config_.blur_sigma_px, border);
      input = blurred_;
    }
    detector_->qtp.min_white_black_diff = smallestStep(grey);
    image_u8_t image = {input.cols, input.rows, static_cast<int>(input.step), input.data};
    const std::unique_ptr<zarray_t, void (*)(zarray_t*)> found(apriltag_detector_detect(detector_.get(), &image),
                                                               apriltag_detections_destroy);
    std::vector<TagObservation> tags;
    for (int i = 0; i < zarray_size(found.get()); ++i) {
      const apriltag_detection_t* detection = nullptr;
      zarray_get(found.get(), i, static_cast<void*>(&detection));
      TagObservation tag;
      tag.id = detection->id;
      tag.hamming = detection->hamming;
      tag.margin = detection->decision_margin;
      for (std::size_t corner = 0; corner < 4; ++corner) {
        // The library starts at the bottom left and goes to the right; its pixel centres are at .5.
        const double* p = detection->p[3 - corner];
        tag.corners_px[corner] = {p[0] - 0.5, p[1] - 0.5};
      }
      tag.corners_px = refineBorder(grey, tag.corners_px, family_->width_at_border);
      tag.border_cells = family_->width_at_border;
      tag.cells = cellsOf(tag.id);
      tags.push_back(tag);
    }
    sortById(&tags);
    return tags;
  }

 private:
  cv::Mat cellsOf(int id) const {
    const int outside = (family_->total_width - family_->width_at_border) / 2;
    const int width = family_->width_at_border;
    cv::Mat cells(width + 2 * outside, width + 2 * outside, CV_8UC1, cv::Scalar(TagObservation::kUnknownCell));
    const int inner = family_->reversed_border ? 255 : 0;
    cells(cv::Rect(outside - 1, outside - 1, width + 2, width + 2)).setTo(255 - inner);
    cells(cv::Rect(outside, outside, width, width)).setTo(inner);
    cells(cv::Rect(outside + 1, outside + 1, width - 2, width - 2)).setTo(TagObservation::kUnknownCell);
    for (std::uint32_t bit = 0; bit < family_->nbits; ++bit) {
      const bool is_white = (family_->codes[id] >> (family_->nbits - bit - 1) & 1U) != 0;
      cells.at<std::uint8_t>(static_cast<int>(family_->bit_y[bit]) + outside,
                             static_cast<int>(family_->bit_x[bit]) + outside) = is_white ? 255 : 0;
    }
    return cells;
  }

  /// Difference of brightness within 12 x 12 pixels below which the library takes them for one plain surface. Its own
  /// number, 5, lets noise of 2 grey levels through as edges everywhere: the search then takes ten times as long.
  int smallestStep(const cv::Mat& grey) const {
    constexpr double kNoiseRange = 7.0;  // standard deviations: 144 pixels of noise rarely span more
    constexpr double kLeast = 5.0;
    constexpr double kMost = 60.0;  // texture taken for noise must not hide tags
    return static_cast<int>(std::lround(std::clamp(kNoiseRange * noise_gain_ * noiseStd(grey), kLeast, kMost)));
  }

  TagDetectorConfig config_;
  cv::Mat blurred_;
  double noise_gain_{1.0};                                                   // of the blur
  std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)> family_;  // must outlive detector_
  std::unique_ptr<apriltag_detector_t, void (*)(apriltag_detector_t*)> detector_;
};

}  // namespace

bool isAprilTagFamily(const std::string& family) {
  return findFamily(family) != nullptr;
}

std::unique_ptr<TagDetector> makeAprilTagDetector(const TagDetectorConfig& config) {
  return std::make_unique<AprilTagDetector>(config);
}

}  // namespace brick_detection
