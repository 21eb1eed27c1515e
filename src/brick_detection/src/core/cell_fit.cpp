// SPDX-License-Identifier: BSD-3-Clause
#include "cell_fit.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Dense>
#include <opencv2/imgproc.hpp>

#include "bearing_grid.h"

namespace brick_detection {
namespace {

using Corners = std::array<Eigen::Vector2d, 4>;

constexpr double kMostSide_px = 56.0;  // larger tags are looked at in a smaller image: that is sharp enough
constexpr int kSubPixels = 4;          // per pixel and axis
constexpr double kHalf = 0.5;
constexpr double kOwnBlur_px = 0.5;
// What the model of the image leaves, in pixels of the smaller image: seen on clean tags of all sizes.
constexpr double kModelShift_px = 0.05;
constexpr double kModelBend_px = 0.02;
constexpr int kIterations = 5;
constexpr double kPrior_px = 2.0;         // of a corner's shift
constexpr double kLeastNoise = 0.02;      // of the contrast: what the model of the image leaves anyhow
constexpr double kDamaged = 0.3;          // of the contrast: a pixel that is neither
constexpr std::size_t kLeastPixels = 60;  // on the cells; a tag of 12 px has 120
constexpr int kNumLight = 8;              // unknowns that are no geometry
constexpr int kNumCorners = 8;
constexpr int kNumBends = 4;

/// Projective map of the square (0, 0) ... (n, n), row 0 at the top, to four points in the order of TagObservation.
Eigen::Matrix3d squareTo(const Corners& points, double n) {
  Eigen::Matrix<double, 8, 8> A;
  Eigen::Matrix<double, 8, 1> b;
  const Corners square = {Eigen::Vector2d(0.0, 0.0), {n, 0.0}, {n, n}, {0.0, n}};
  for (int i = 0; i < 4; ++i) {
    const Eigen::Vector2d& from = square[static_cast<std::size_t>(i)];
    const Eigen::Vector2d& to = points[static_cast<std::size_t>(i)];
    A.row(2 * i) << from.x(), from.y(), 1.0, 0.0, 0.0, 0.0, -to.x() * from.x(), -to.x() * from.y();
    A.row(2 * i + 1) << 0.0, 0.0, 0.0, from.x(), from.y(), 1.0, -to.y() * from.x(), -to.y() * from.y();
    b.segment<2>(2 * i) = to;
  }
  const Eigen::Matrix<double, 8, 1> h = A.partialPivLu().solve(b);
  return (Eigen::Matrix3d() << h(0), h(1), h(2), h(3), h(4), h(5), h(6), h(7), 1.0).finished();
}

/// A tag's part of an image, and what its cells predict there.
class CellImage {
 public:
  CellImage(const cv::Mat& grey, const CameraModel& camera, const TagObservation& tag)
      : camera_(camera),
        cells_(tag.cells),
        num_cells_(tag.border_cells),
        outside_((tag.cells.cols - tag.border_cells) / 2) {
    double side_px = 0.0;
    for (std::size_t i = 0; i < 4; ++i) {
      side_px = std::max(side_px, (tag.corners_px[i] - tag.corners_px[(i + 1) % 4]).norm());
    }
    factor_ = std::max(1, static_cast<int>(std::ceil(side_px / kMostSide_px)));
    const double reach = 1.0 / num_cells_;  // a cell about the tag
    Eigen::AlignedBox2d box;
    const Eigen::Vector2d middle =
        0.25 * (tag.corners_px[0] + tag.corners_px[1] + tag.corners_px[2] + tag.corners_px[3]);
    for (const Eigen::Vector2d& corner : tag.corners_px) box.extend(middle + (1.0 + 2.0 * reach) * (corner - middle));
    const int left = std::max(0, static_cast<int>(std::floor(box.min().x())));
    const int top = std::max(0, static_cast<int>(std::floor(box.min().y())));
    const int width = (std::min(grey.cols, static_cast<int>(std::ceil(box.max().x())) + 1) - left) / factor_;
    const int height = (std::min(grey.rows, static_cast<int>(std::ceil(box.max().y())) + 1) - top) / factor_;
    if (width < 4 || height < 4) return;
    origin_px_ = {left, top};
    cv::Mat small;
    cv::resize(grey(cv::Rect(left, top, width * factor_, height * factor_)), small, cv::Size(width, height), 0.0, 0.0,
               cv::INTER_AREA);
    small.convertTo(image_, CV_32F);
    // A sharp image says where an edge is by one pixel only, which the drawn cells meet less well.
    cv::GaussianBlur(image_, image_, cv::Size(), kOwnBlur_px, kOwnBlur_px, cv::BORDER_REPLICATE);
    const Eigen::AlignedBox2d nodes(origin_px_ - Eigen::Vector2d::Constant(kHalf),
                                    origin_px_ + factor_ * Eigen::Vector2d(width, height));
    const BearingGrid bearings(nodes, camera);
    for (int row = 0; row <= height; ++row) {
      for (int column = 0; column <= width; ++column) {
        bearings_.push_back(
            bearings.at(origin_px_ + factor_ * Eigen::Vector2d(column, row) - Eigen::Vector2d::Constant(kHalf)));
      }
    }
  }

  bool isEmpty() const { return image_.empty(); }
  const cv::Mat_<float>& image() const { return image_; }
  double factor() const { return factor_; }
  int numCells() const { return num_cells_; }
  bool hasDataOutside() const { return outside_ > 1; }

  /// Draws the cells for these corners. False if they are no square's.
  bool draw(const Corners& corners_px) {
    Corners bearings;
    for (std::size_t i = 0; i < 4; ++i) bearings[i] = camera_.bearing(corners_px[i]);
    const Eigen::Matrix3d to_cells = squareTo(bearings, num_cells_).inverse();
    if (!to_cells.allFinite()) return false;
    std::vector<Eigen::Vector2d> nodes(bearings_.size());
    for (std::size_t i = 0; i < nodes.size(); ++i) nodes[i] = (to_cells * bearings_[i].homogeneous()).hnormalized();
    sharp_.create(image_.size());
    at_.assign(image_.total(), Eigen::Vector2d::Zero());
    is_known_.assign(image_.total(), 1);
    const auto stride = static_cast<std::size_t>(image_.cols) + 1;
    for (int row = 0; row < image_.rows; ++row) {
      for (int column = 0; column < image_.cols; ++column) {
        const std::size_t first = static_cast<std::size_t>(row) * stride + static_cast<std::size_t>(column);
        const std::size_t pixel = static_cast<std::size_t>(row * image_.cols + column);
        at_[pixel] = 0.25 * (nodes[first] + nodes[first + 1] + nodes[first + stride] + nodes[first + stride + 1]);
        if (!at_[pixel].allFinite()) return false;
        int sum = 0;
        for (int y = 0; y < kSubPixels; ++y) {
          const double down = (y + 0.5) / kSubPixels;
          const Eigen::Vector2d left = (1.0 - down) * nodes[first] + down * nodes[first + stride];
          const Eigen::Vector2d right = (1.0 - down) * nodes[first + 1] + down * nodes[first + stride + 1];
          for (int x = 0; x < kSubPixels; ++x) {
            const double along = (x + 0.5) / kSubPixels;
            const int value = cellAt((1.0 - along) * left + along * right);
            if (value == TagObservation::kUnknownCell) is_known_[pixel] = 0;
            sum += value;
          }
        }
        sharp_(row, column) = static_cast<float>(sum / (255.0 * kSubPixels * kSubPixels));
      }
    }
    return true;
  }

  cv::Mat_<float> blurred(double sigma_px) const {
    cv::Mat_<float> result;
    cv::GaussianBlur(sharp_, result, cv::Size(), sigma_px, sigma_px, cv::BORDER_REPLICATE);
    return result;
  }

  bool isKnown(std::size_t pixel) const { return is_known_[pixel] != 0; }
  /// In cells, from the top left corner.
  const Eigen::Vector2d& at(std::size_t pixel) const { return at_[pixel]; }
  /// Cells from the square between the corners, positive inside.
  double depthInside(std::size_t pixel) const {
    const Eigen::Vector2d& q = at_[pixel];
    return std::min({q.x(), q.y(), num_cells_ - q.x(), num_cells_ - q.y()});
  }
  /// Beyond the last known ring.
  bool isBeyond(std::size_t pixel) const { return depthInside(pixel) < -(outside_ - kHalf); }

 private:
  int cellAt(const Eigen::Vector2d& q) const {
    const int last = cells_.cols - 1;
    const int column = std::clamp(static_cast<int>(std::floor(std::clamp(q.x(), -100.0, 100.0))) + outside_, 0, last);
    const int row = std::clamp(static_cast<int>(std::floor(std::clamp(q.y(), -100.0, 100.0))) + outside_, 0, last);
    return cells_(row, column);
  }

  const CameraModel& camera_;
  cv::Mat_<std::uint8_t> cells_;
  int num_cells_;
  int outside_;
  int factor_{1};
  Eigen::Vector2d origin_px_{Eigen::Vector2d::Zero()};
  cv::Mat_<float> image_;
  std::vector<Eigen::Vector2d> bearings_;  // of the pixels' corners
  cv::Mat_<float> sharp_;                  // 0 black, 1 white
  std::vector<Eigen::Vector2d> at_;
  std::vector<char> is_known_;
};

/// Where the pixels of a fit are.
enum class Zone { kWithoutEdge, kAll };

struct Solution {
  Corners corners_px{};
  double shift_std_px{0.0};
  double bend_px{0.0};
  double bend_std_px{0.0};
  double damaged_share{0.0};
};

/// Fits the corners on the pixels of a zone; with a bend if `has_bend`.
std::optional<Solution> fit(CellImage* cells, const Corners& start_px, Zone zone, bool has_bend) {
  const cv::Mat_<float>& image = cells->image();
  const int num_unknowns = kNumLight + kNumCorners + (has_bend ? kNumBends : 0);
  const double n = cells->numCells();
  Solution solution;
  solution.corners_px = start_px;
  double sigma_px = 0.8;
  double variance = 0.0;                              // of the image's noise [grey levels^2]
  Eigen::VectorXd light;                              // of the iteration before
  std::vector<double> weight_of(image.total(), 1.0);  // of the iteration before, by Cauchy's function
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    if (!cells->draw(solution.corners_px)) return std::nullopt;
    const cv::Mat_<float> drawn = cells->blurred(sigma_px);
    constexpr double kStep_px = 0.1;
    const cv::Mat_<float> softer = cells->blurred(sigma_px + kStep_px);
    std::vector<std::size_t> pixels;
    for (int row = 1; row + 1 < image.rows; ++row) {
      for (int column = 1; column + 1 < image.cols; ++column) {
        const std::size_t pixel = static_cast<std::size_t>(row * image.cols + column);
        const double inside = cells->depthInside(pixel);
        const bool is_edge = std::abs(inside) < kHalf;
        const bool is_outside = inside < (cells->hasDataOutside() ? -1e9 : -kHalf);
        if (!cells->isKnown(pixel) || cells->isBeyond(pixel) || is_outside || (zone == Zone::kWithoutEdge && is_edge)) {
          continue;
        }
        pixels.push_back(pixel);
      }
    }
    if (pixels.size() < kLeastPixels) return std::nullopt;
    const auto num_rows = static_cast<Eigen::Index>(pixels.size());
    Eigen::MatrixXd J(num_rows, num_unknowns);
    Eigen::VectorXd values(num_rows);
    for (Eigen::Index k = 0; k < num_rows; ++k) {
      const std::size_t pixel = pixels[static_cast<std::size_t>(k)];
      const int row = static_cast<int>(pixel) / image.cols;
      const int column = static_cast<int>(pixel) % image.cols;
      const double x = 2.0 * (column + 0.5) / image.cols - 1.0;
      const double y = 2.0 * (row + 0.5) / image.rows - 1.0;
      const double white = drawn(row, column);
      const double contrast = light.size() > 0 ? light(3) + light(4) * x + light(5) * y : 0.0;
      values(k) = image(row, column);
      J.row(k).head<kNumLight>() << 1.0, x, y, white, white * x, white * y, white * (1.0 - white),
          contrast * (softer(row, column) - white) / kStep_px;
      // The image at a pixel that the cells move away from by d changes by -gradient . d.
      const Eigen::Vector2d slope = -contrast / (2.0 * cells->factor()) *
                                    Eigen::Vector2d(drawn(row, column + 1) - drawn(row, column - 1),
                                                    drawn(row + 1, column) - drawn(row - 1, column));
      const Eigen::Vector2d q = cells->at(pixel) / n;
      const std::array<double, 4> weights = {(1.0 - q.x()) * (1.0 - q.y()), q.x() * (1.0 - q.y()), q.x() * q.y(),
                                             (1.0 - q.x()) * q.y()};
      for (int corner = 0; corner < 4; ++corner) {
        J.row(k).segment<2>(kNumLight + 2 * corner) = weights[static_cast<std::size_t>(corner)] * slope.transpose();
      }
      if (has_bend) {
        const Eigen::Vector2d bend = 4.0 * q.cwiseProduct(Eigen::Vector2d::Ones() - q);
        J.row(k).segment<2>(kNumLight + kNumCorners) = bend.x() * slope.transpose();
        J.row(k).segment<2>(kNumLight + kNumCorners + 2) = bend.y() * slope.transpose();
      }
    }
    const bool is_first = light.size() == 0;
    const int active = is_first ? kNumLight - 1 : num_unknowns;  // brightness first
    Eigen::VectorXd weights(num_rows);
    for (Eigen::Index k = 0; k < num_rows; ++k) weights(k) = weight_of[pixels[static_cast<std::size_t>(k)]];
    const Eigen::MatrixXd weighted = weights.asDiagonal() * J.leftCols(active);
    Eigen::MatrixXd information = J.leftCols(active).transpose() * weighted;
    if (!is_first) information.diagonal().tail(active - kNumLight).array() += variance / (kPrior_px * kPrior_px);
    information.diagonal().array() += 1e-9 * information.diagonal().maxCoeff();
    Eigen::VectorXd unknowns = Eigen::VectorXd::Zero(num_unknowns);
    unknowns.head(active) = information.ldlt().solve(weighted.transpose() * values);
    if (!unknowns.allFinite()) return std::nullopt;
    const Eigen::VectorXd residuals = values - J.leftCols(active) * unknowns.head(active);
    std::vector<double> sizes(pixels.size());
    for (Eigen::Index k = 0; k < num_rows; ++k) sizes[static_cast<std::size_t>(k)] = std::abs(residuals(k));
    const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    constexpr double kMedianToSigma = 1.4826;
    const double noise = std::max(kMedianToSigma * *middle, kLeastNoise * std::abs(unknowns(3)) + 1e-3);
    variance = noise * noise;
    constexpr double kCauchy = 2.5;
    int num_damaged = 0;
    for (Eigen::Index k = 0; k < num_rows; ++k) {
      weight_of[pixels[static_cast<std::size_t>(k)]] = 1.0 / (1.0 + std::pow(residuals(k) / (kCauchy * noise), 2));
      if (std::abs(residuals(k)) > kDamaged * std::abs(unknowns(3))) ++num_damaged;
    }
    solution.damaged_share = static_cast<double>(num_damaged) / static_cast<double>(num_rows);
    light = unknowns.head<kNumLight>();
    if (!(light(3) > 0.0)) return std::nullopt;  // no contrast
    if (is_first) continue;
    sigma_px = std::clamp(sigma_px + std::clamp(unknowns(7), -0.3, 0.3), 0.4, 3.0);
    for (int corner = 0; corner < 4; ++corner) {
      Eigen::Vector2d step = unknowns.segment<2>(kNumLight + 2 * corner);
      constexpr double kLongest_px = 2.0;
      if (step.norm() > kLongest_px * cells->factor()) step *= kLongest_px * cells->factor() / step.norm();
      solution.corners_px[static_cast<std::size_t>(corner)] += step;
    }
    const Eigen::MatrixXd covariance = variance * information.ldlt().solve(Eigen::MatrixXd::Identity(active, active));
    solution.shift_std_px = std::sqrt(covariance.diagonal().segment<kNumCorners>(kNumLight).maxCoeff());
    if (has_bend) {
      const Eigen::Vector2d along_x = unknowns.segment<2>(kNumLight + kNumCorners);
      const Eigen::Vector2d along_y = unknowns.tail<2>();
      solution.bend_px = std::max({along_x.norm(), along_y.norm(), (along_x + along_y).norm()});
      solution.bend_std_px = std::sqrt(covariance.diagonal().tail<kNumBends>().maxCoeff());
    }
  }
  return solution;
}

}  // namespace

std::optional<CellFit> fitCells(const cv::Mat& grey, const CameraModel& camera, const TagObservation& tag) {
  if (tag.cells.empty()) return std::nullopt;
  CellImage cells(grey, camera, tag);
  if (cells.isEmpty()) return std::nullopt;
  const std::optional<Solution> inner = fit(&cells, tag.corners_px, Zone::kWithoutEdge, false);
  const std::optional<Solution> all = fit(&cells, tag.corners_px, Zone::kAll, true);
  if (!inner || !all) return std::nullopt;
  CellFit result;
  for (std::size_t i = 0; i < 4; ++i) result.shift_px[i] = inner->corners_px[i] - tag.corners_px[i];
  result.shift_std_px = std::hypot(inner->shift_std_px, kModelShift_px * cells.factor());
  result.bend_px = all->bend_px;
  result.bend_std_px = std::hypot(all->bend_std_px, kModelBend_px * cells.factor());
  result.damaged_share = std::max(inner->damaged_share, all->damaged_share);
  return result;
}

}  // namespace brick_detection
