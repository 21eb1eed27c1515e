// SPDX-License-Identifier: BSD-3-Clause
#include "border_refinement.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <Eigen/Dense>

#include "rotation.h"

namespace brick_detection {
namespace {

constexpr double kStepPx = 0.25;    // along a profile
constexpr double kMaxHalfPx = 3.0;  // of a profile: blur of up to one pixel fits in
constexpr double kMinHalfPx = 1.0;
constexpr double kCellShare = 0.45;   // of a cell: beyond are the tag's bits, or what the paper lies on
constexpr double kMinContrast = 8.0;  // [grey levels] below it noise decides
constexpr double kBlurPx = 1.5;       // reach of the blur round a corner
constexpr double kMinUsablePx = 3.0;  // of an edge
constexpr int kMinProfiles = 6;
constexpr int kLineIterations = 3;  // the window follows the line
constexpr double kMaxShiftPx = 2.0;

/// n . p = c, n unit.
struct Line {
  Eigen::Vector2d n;
  double c{0.0};
};

bool isInside(const cv::Mat& grey, const Eigen::Vector2d& p) {
  return p.x() >= 0.0 && p.y() >= 0.0 && p.x() < grey.cols - 1 && p.y() < grey.rows - 1;
}

double interpolate(const cv::Mat& grey, const Eigen::Vector2d& p) {
  const int column = static_cast<int>(p.x());
  const int row = static_cast<int>(p.y());
  const double dx = p.x() - column;
  const double dy = p.y() - row;
  const auto* upper = grey.ptr<std::uint8_t>(row) + column;
  const auto* lower = grey.ptr<std::uint8_t>(row + 1) + column;
  return (1.0 - dy) * ((1.0 - dx) * upper[0] + dx * upper[1]) + dy * ((1.0 - dx) * lower[0] + dx * lower[1]);
}

/// Straight line through values at places in [0, 1].
class Trend {
 public:
  void add(double at, double value) {
    ++n_;
    s_ += at;
    ss_ += at * at;
    v_ += value;
    sv_ += at * value;
  }
  double operator()(double at) const {
    const double determinant = n_ * ss_ - s_ * s_;
    if (determinant < 1e-9 * n_ * n_) return v_ / n_;
    const double slope = (n_ * sv_ - s_ * v_) / determinant;
    return (v_ - slope * s_) / n_ + slope * at;
  }

 private:
  double n_{0.0}, s_{0.0}, ss_{0.0}, v_{0.0}, sv_{0.0};
};

/// What to leave out of an edge at a corner: there blur mixes in the next edge, and profiles across cross it if the angle is
/// acute.
double skipAt(const Eigen::Vector2d& before, const Eigen::Vector2d& corner, const Eigen::Vector2d& after,
              double half_px) {
  const Eigen::Vector2d in = before - corner;
  const Eigen::Vector2d out = after - corner;
  const double cotangent = in.dot(out) / std::max(1e-9, std::abs(cross(in, out)));
  return kBlurPx + half_px * std::max(0.0, cotangent);
}

/// The edge from a to b. `half_px`: of the profiles. `skip_a_px`, `skip_b_px`: left out at the ends.
std::optional<Line> fitEdge(const cv::Mat& grey, const Eigen::Vector2d& a, const Eigen::Vector2d& b, double half_px,
                            double skip_a_px, double skip_b_px) {
  const double length_px = (b - a).norm();
  const double usable_px = length_px - skip_a_px - skip_b_px;
  if (usable_px < kMinUsablePx) return std::nullopt;
  // Two profiles per pixel: more would see the same pixels again.
  const int num_profiles = std::max(kMinProfiles, static_cast<int>(2.0 * usable_px));
  const int num_steps = static_cast<int>(std::lround(2.0 * half_px / kStepPx));
  const Eigen::Vector2d along = (b - a) / length_px;
  const Eigen::Vector2d across(along.y(), -along.x());
  struct Profile {
    double at{0.0};  // in [0, 1] of the edge
    std::vector<double> values;
  };
  std::vector<Profile> profiles;
  Trend low_side;
  Trend high_side;
  for (int i = 0; i < num_profiles; ++i) {
    Profile profile;
    profile.at = (skip_a_px + usable_px * (i + 0.5) / num_profiles) / length_px;
    const Eigen::Vector2d middle = a + profile.at * (b - a);
    if (!isInside(grey, middle - half_px * across) || !isInside(grey, middle + half_px * across)) continue;
    for (int k = 0; k <= num_steps; ++k) {
      profile.values.push_back(interpolate(grey, middle + (2.0 * k / num_steps - 1.0) * half_px * across));
    }
    low_side.add(profile.at, profile.values.front());
    high_side.add(profile.at, profile.values.back());
    profiles.push_back(std::move(profile));
  }
  if (profiles.size() < kMinProfiles) return std::nullopt;

  std::vector<Eigen::Vector2d> points;  // (place along the edge [px], offset of the step [px])
  for (const Profile& profile : profiles) {
    const double low = low_side(profile.at);
    const double high = high_side(profile.at);
    if (std::abs(high - low) < kMinContrast) continue;
    // The step is where a sharp one would leave the same area under the profile.
    double area = 0.5 * (profile.values.front() + profile.values.back());
    for (std::size_t k = 1; k + 1 < profile.values.size(); ++k) area += profile.values[k];
    const double share_high = std::clamp((area / num_steps - low) / (high - low), 0.0, 1.0);
    points.emplace_back((profile.at - 0.5) * length_px, half_px * (1.0 - 2.0 * share_high));
  }
  if (points.size() < kMinProfiles) return std::nullopt;

  // offset = slope * place + shift by iteratively reweighted least squares (Tukey's biweight, scale from the median).
  double slope = 0.0;
  double shift = 0.0;
  std::vector<double> weights(points.size(), 1.0);
  for (int round = 0; round < 4; ++round) {
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector2d row(points[i].x(), 1.0);
      normal += weights[i] * row * row.transpose();
      right += weights[i] * points[i].y() * row;
    }
    if (!(normal.determinant() > 1e-9)) return std::nullopt;
    const Eigen::Vector2d solution = normal.ldlt().solve(right);
    slope = solution.x();
    shift = solution.y();
    std::vector<double> residuals;
    for (const Eigen::Vector2d& point : points) residuals.push_back(std::abs(point.y() - slope * point.x() - shift));
    std::vector<double> sorted = residuals;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2), sorted.end());
    constexpr double kMedianToSigma = 1.4826;
    constexpr double kTukey = 4.685;   // 95 % efficient for Gaussian noise
    constexpr double kFloorPx = 0.02;  // perfect images have no scale
    const double limit = kTukey * std::max(kFloorPx, kMedianToSigma * sorted[sorted.size() / 2]);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double ratio = residuals[i] / limit;
      weights[i] = ratio < 1.0 ? (1.0 - ratio * ratio) * (1.0 - ratio * ratio) : 0.0;
    }
  }
  const Eigen::Vector2d middle = 0.5 * (a + b) + shift * across;
  const Eigen::Vector2d direction = (along + slope * across).normalized();
  Line line;
  line.n = {direction.y(), -direction.x()};
  line.c = line.n.dot(middle);
  return line;
}

}  // namespace

std::array<Eigen::Vector2d, 4> refineBorder(const cv::Mat& grey, const std::array<Eigen::Vector2d, 4>& corners_px,
                                            int border_cells) {
  std::array<Eigen::Vector2d, 4> corners = corners_px;
  for (int iteration = 0; iteration < kLineIterations; ++iteration) {
    std::array<Line, 4> lines;
    for (std::size_t i = 0; i < 4; ++i) {
      const Eigen::Vector2d& a = corners[i];
      const Eigen::Vector2d& b = corners[(i + 1) % 4];
      const Eigen::Vector2d opposite = 0.5 * (corners[(i + 2) % 4] + corners[(i + 3) % 4]);
      const Eigen::Vector2d edge = b - a;
      if (edge.norm() < 1.0) return corners_px;
      // A cell's extent across this edge, by the middle of the opposite one.
      const double cell_px = std::abs(cross(edge, opposite - a)) / edge.norm() / border_cells;
      const double half_px = std::clamp(kCellShare * cell_px, kMinHalfPx, kMaxHalfPx);
      const std::optional<Line> line = fitEdge(grey, a, b, half_px, skipAt(corners[(i + 3) % 4], a, b, half_px),
                                               skipAt(a, b, corners[(i + 2) % 4], half_px));
      if (!line) return corners_px;
      lines[i] = *line;
    }
    for (std::size_t i = 0; i < 4; ++i) {  // corner i is between edges i - 1 and i
      const Line& before = lines[(i + 3) % 4];
      const Line& after = lines[i];
      const double sine = cross(before.n, after.n);
      if (std::abs(sine) < 0.1) return corners_px;
      corners[i] = {(before.c * after.n.y() - after.c * before.n.y()) / sine,
                    (before.n.x() * after.c - after.n.x() * before.c) / sine};
      if (!((corners[i] - corners_px[i]).norm() < kMaxShiftPx)) return corners_px;
    }
  }
  return corners;
}

}  // namespace brick_detection
