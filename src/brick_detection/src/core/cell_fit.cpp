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
    nodes_.resize(bearings_.size());
    node_cells_.resize(bearings_.size());
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      nodes_[i] = (to_cells * bearings_[i].homogeneous()).hnormalized();
      if (!nodes_[i].allFinite()) return false;
      node_cells_[i] = cellOf(nodes_[i]);
    }
    sharp_.create(image_.size());
    at_.resize(image_.total());
    is_known_.assign(image_.total(), 1);
    const auto stride = static_cast<std::size_t>(image_.cols) + 1;
    for (int row = 0; row < image_.rows; ++row) {
      for (int column = 0; column < image_.cols; ++column) {
        const std::size_t first = static_cast<std::size_t>(row) * stride + static_cast<std::size_t>(column);
        const std::array<std::size_t, 4> around = {first, first + 1, first + stride, first + stride + 1};
        const auto pixel = static_cast<std::size_t>(row * image_.cols + column);
        at_[pixel] = 0.25 * (nodes_[around[0]] + nodes_[around[1]] + nodes_[around[2]] + nodes_[around[3]]);
        const std::optional<int> uniform = uniformValue(around);
        const int sum = uniform ? kSubPixels * kSubPixels * *uniform : sumOfSubPixels(around, &is_known_[pixel]);
        if (uniform && *uniform == TagObservation::kUnknownCell) is_known_[pixel] = 0;
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
  /// Column and row; of the last ring for what is beyond it.
  Eigen::Vector2i cellOf(const Eigen::Vector2d& q) const {
    const double end = cells_.cols - kHalf;
    return {static_cast<int>(std::clamp(q.x() + outside_, 0.0, end)),
            static_cast<int>(std::clamp(q.y() + outside_, 0.0, end))};
  }

  /// Of a pixel between four nodes whose cells, and those between them, have one value: most pixels.
  std::optional<int> uniformValue(const std::array<std::size_t, 4>& around) const {
    Eigen::Vector2i low = node_cells_[around[0]];
    Eigen::Vector2i high = low;
    for (std::size_t i = 1; i < 4; ++i) {
      low = low.cwiseMin(node_cells_[around[i]]);
      high = high.cwiseMax(node_cells_[around[i]]);
    }
    const int value = cells_(low.y(), low.x());
    for (int row = low.y(); row <= high.y(); ++row) {
      for (int column = low.x(); column <= high.x(); ++column) {
        if (cells_(row, column) != value) return std::nullopt;
      }
    }
    return value;
  }

  int sumOfSubPixels(const std::array<std::size_t, 4>& around, char* is_known) const {
    int sum = 0;
    for (int y = 0; y < kSubPixels; ++y) {
      const double down = (y + 0.5) / kSubPixels;
      const Eigen::Vector2d left = (1.0 - down) * nodes_[around[0]] + down * nodes_[around[2]];
      const Eigen::Vector2d right = (1.0 - down) * nodes_[around[1]] + down * nodes_[around[3]];
      for (int x = 0; x < kSubPixels; ++x) {
        const double along = (x + 0.5) / kSubPixels;
        const Eigen::Vector2i cell = cellOf((1.0 - along) * left + along * right);
        const int value = cells_(cell.y(), cell.x());
        if (value == TagObservation::kUnknownCell) *is_known = 0;
        sum += value;
      }
    }
    return sum;
  }

  const CameraModel& camera_;
  cv::Mat_<std::uint8_t> cells_;
  int num_cells_;
  int outside_;
  int factor_{1};
  Eigen::Vector2d origin_px_{Eigen::Vector2d::Zero()};
  cv::Mat_<float> image_;
  std::vector<Eigen::Vector2d> bearings_;    // of the pixels' corners
  std::vector<Eigen::Vector2d> nodes_;       // the same in cells
  std::vector<Eigen::Vector2i> node_cells_;  // and which they are in
  cv::Mat_<float> sharp_;                    // 0 black, 1 white
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

/// Fits the corners on the pixels of a zone; with a bend if `has_bend`. Gauss-Newton, with the weights of the iteration
/// before.
class Fit {
 public:
  Fit(CellImage* cells, const Corners& start_px, Zone zone, bool has_bend)
      : cells_(*cells),
        zone_(zone),
        has_bend_(has_bend),
        jacobian_(kNumLight + kNumCorners + (has_bend ? kNumBends : 0), cells->image().total()),
        values_(jacobian_.cols()),
        root_weights_(cells->image().total(), 1.0) {
    solution_.corners_px = start_px;
  }

  std::optional<Solution> run() {
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      num_active_ = iteration == 0 ? kNumLight - 1 : jacobian_.rows();  // brightness first
      if (!cells_.draw(solution_.corners_px) || !findPixels()) return std::nullopt;
      linearize();
      if (!solve()) return std::nullopt;
      weigh();
      if (!(unknowns_(3) > 0.0)) return std::nullopt;  // no contrast
      if (iteration > 0) move();
    }
    judge();
    return solution_;
  }

 private:
  Eigen::Index numPixels() const { return static_cast<Eigen::Index>(pixels_.size()); }

  bool findPixels() {
    const cv::Mat_<float>& image = cells_.image();
    const double least_inside = cells_.hasDataOutside() ? -1e9 : -kHalf;
    pixels_.clear();
    for (int row = 1; row + 1 < image.rows; ++row) {
      for (int column = 1; column + 1 < image.cols; ++column) {
        const auto pixel = static_cast<std::size_t>(row * image.cols + column);
        const double inside = cells_.depthInside(pixel);
        const bool is_edge = std::abs(inside) < kHalf;
        if (!cells_.isKnown(pixel) || cells_.isBeyond(pixel) || inside < least_inside) continue;
        if (zone_ == Zone::kWithoutEdge && is_edge) continue;
        pixels_.push_back(pixel);
      }
    }
    return pixels_.size() >= kLeastPixels;
  }

  /// A column for each pixel, times the root of its weight: what the unknowns change in the image there.
  void linearize() {
    const cv::Mat_<float>& image = cells_.image();
    const bool is_light_only = num_active_ < kNumLight;
    const cv::Mat_<float> drawn = cells_.blurred(sigma_px_);
    constexpr double kStep_px = 0.1;
    const cv::Mat_<float> softer = is_light_only ? drawn : cells_.blurred(sigma_px_ + kStep_px);
    for (Eigen::Index k = 0; k < numPixels(); ++k) {
      const std::size_t pixel = pixels_[static_cast<std::size_t>(k)];
      const int row = static_cast<int>(pixel) / image.cols;
      const int column = static_cast<int>(pixel) % image.cols;
      const double x = 2.0 * (column + 0.5) / image.cols - 1.0;
      const double y = 2.0 * (row + 0.5) / image.rows - 1.0;
      const double white = drawn(row, column);
      const double root = root_weights_[pixel];
      double* J = jacobian_.col(k).data();
      values_(k) = root * image(row, column);
      const std::array<double, kNumLight - 1> light = {1.0, x, y, white, white * x, white * y, white * (1.0 - white)};
      for (std::size_t i = 0; i < light.size(); ++i) J[i] = root * light[i];
      if (is_light_only) continue;
      const double contrast = root * (unknowns_(3) + unknowns_(4) * x + unknowns_(5) * y);
      J[kNumLight - 1] = contrast * (softer(row, column) - white) / kStep_px;
      // The image at a pixel that the cells move away from by d changes by -gradient . d.
      const double per_pixel = -contrast / (2.0 * cells_.factor());
      const double slope_x = per_pixel * (drawn(row, column + 1) - drawn(row, column - 1));
      const double slope_y = per_pixel * (drawn(row + 1, column) - drawn(row - 1, column));
      const Eigen::Vector2d q = cells_.at(pixel) / cells_.numCells();
      // How far each corner takes the pixel along, and then each bend.
      const std::array<double, (kNumCorners + kNumBends) / 2> shares = {
          (1.0 - q.x()) * (1.0 - q.y()), q.x() * (1.0 - q.y()),       q.x() * q.y(),
          (1.0 - q.x()) * q.y(),         4.0 * q.x() * (1.0 - q.x()), 4.0 * q.y() * (1.0 - q.y())};
      const std::size_t num_shares = has_bend_ ? shares.size() : kNumCorners / 2;
      for (std::size_t i = 0; i < num_shares; ++i) {
        J[kNumLight + 2 * i] = shares[i] * slope_x;
        J[kNumLight + 2 * i + 1] = shares[i] * slope_y;
      }
    }
  }

  bool solve() {
    const auto J = jacobian_.topLeftCorner(num_active_, numPixels());
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(num_active_, num_active_);
    information.selfadjointView<Eigen::Lower>().rankUpdate(J);
    if (num_active_ > kNumLight) {
      information.diagonal().tail(num_active_ - kNumLight).array() += variance_ / (kPrior_px * kPrior_px);
    }
    information.diagonal().array() += 1e-9 * information.diagonal().maxCoeff();
    factor_.compute(information);
    unknowns_ = Eigen::VectorXd::Zero(jacobian_.rows());
    unknowns_.head(num_active_) = factor_.solve(J * values_.head(numPixels()));
    return unknowns_.allFinite();
  }

  /// By Cauchy's function of the residuals in units of their noise.
  void weigh() {
    Eigen::VectorXd residuals = values_.head(numPixels());
    residuals.noalias() -= jacobian_.topLeftCorner(num_active_, numPixels()).transpose() * unknowns_.head(num_active_);
    for (Eigen::Index k = 0; k < numPixels(); ++k) {
      residuals(k) = std::abs(residuals(k)) / root_weights_[pixels_[static_cast<std::size_t>(k)]];
    }
    std::vector<double> sizes(residuals.data(), residuals.data() + residuals.size());
    const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    constexpr double kMedianToSigma = 1.4826;
    const double noise = std::max(kMedianToSigma * *middle, kLeastNoise * std::abs(unknowns_(3)) + 1e-3);
    variance_ = noise * noise;
    constexpr double kCauchy = 2.5;
    int num_damaged = 0;
    for (Eigen::Index k = 0; k < numPixels(); ++k) {
      root_weights_[pixels_[static_cast<std::size_t>(k)]] =
          1.0 / std::sqrt(1.0 + std::pow(residuals(k) / (kCauchy * noise), 2));
      if (residuals(k) > kDamaged * std::abs(unknowns_(3))) ++num_damaged;
    }
    solution_.damaged_share = static_cast<double>(num_damaged) / static_cast<double>(numPixels());
  }

  void move() {
    sigma_px_ = std::clamp(sigma_px_ + std::clamp(unknowns_(7), -0.3, 0.3), 0.4, 3.0);
    for (int corner = 0; corner < 4; ++corner) {
      Eigen::Vector2d step = unknowns_.segment<2>(kNumLight + 2 * corner);
      constexpr double kLongest_px = 2.0;
      if (step.norm() > kLongest_px * cells_.factor()) step *= kLongest_px * cells_.factor() / step.norm();
      solution_.corners_px[static_cast<std::size_t>(corner)] += step;
    }
  }

  /// The bend, and how well the last iteration knows it and the corners.
  void judge() {
    const Eigen::VectorXd variances =
        variance_ * factor_.solve(Eigen::MatrixXd::Identity(num_active_, num_active_)).diagonal();
    solution_.shift_std_px = std::sqrt(variances.segment<kNumCorners>(kNumLight).maxCoeff());
    if (!has_bend_) return;
    const Eigen::Vector2d along_x = unknowns_.segment<2>(kNumLight + kNumCorners);
    const Eigen::Vector2d along_y = unknowns_.tail<2>();
    solution_.bend_px = std::max({along_x.norm(), along_y.norm(), (along_x + along_y).norm()});
    solution_.bend_std_px = std::sqrt(variances.tail<kNumBends>().maxCoeff());
  }

  CellImage& cells_;
  Zone zone_;
  bool has_bend_;
  Solution solution_;
  double sigma_px_{0.8};
  std::vector<std::size_t> pixels_;
  Eigen::MatrixXd jacobian_;          // transposed; like the values, with room for all pixels
  Eigen::VectorXd values_;            // grey levels
  std::vector<double> root_weights_;  // of all pixels
  Eigen::Index num_active_{0};        // the first unknowns, which are solved for
  Eigen::VectorXd unknowns_;
  Eigen::LDLT<Eigen::MatrixXd> factor_;
  double variance_{0.0};  // of the image's noise [grey levels^2]
};

}  // namespace

std::optional<CellFit> fitCells(const cv::Mat& grey, const CameraModel& camera, const TagObservation& tag) {
  if (tag.cells.empty()) return std::nullopt;
  CellImage cells(grey, camera, tag);
  if (cells.isEmpty()) return std::nullopt;
  const std::optional<Solution> inner = Fit(&cells, tag.corners_px, Zone::kWithoutEdge, false).run();
  const std::optional<Solution> all = Fit(&cells, tag.corners_px, Zone::kAll, true).run();
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
