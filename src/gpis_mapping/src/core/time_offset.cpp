// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/time_offset.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Dense>
#include <interactive_mapping_common/formatted.h>

namespace gpis_mapping {
namespace {

using depth_camera::StampedPose;
using interactive_mapping::formatted;

constexpr double kStep_s = 0.005;
constexpr int kHalfSteps = 40;  // kMaxEstimatedOffset_s
constexpr int kNumSteps = 2 * kHalfSteps + 1;
constexpr int kFitSteps = 3;  // a parabola over 15 ms to each side: less is noise, more is not a parabola

constexpr std::size_t kMaxFrames = 400;  // that begin a pair
constexpr std::size_t kReach = 45;       // frames between the images of a pair: they see the same
constexpr double kMaxTurn_rad = 0.35;
constexpr double kMaxMove_m = 0.4;
// By how much depths change per second of offset. Below 0.2 m/s an offset of 10 ms moves them by 2 mm, less than the noise
// of a single one.
constexpr double kMinLeverage_mps = 0.2;
constexpr double kLeverageDepth_m = 1.5;  // at which a turn counts
constexpr double kLeverageStep_s = 0.02;

constexpr std::size_t kNumParts = 8;
constexpr std::size_t kPairsPerPart = 15;
constexpr std::size_t kMinPairsPerPart = 5;
constexpr std::size_t kMinParts = 3;
constexpr int kUsesPerFrame = 2;  // in pairs of a part: different moments tell more
constexpr double kMaxSpread_s = 0.02;

constexpr double kMinUsed_m = 0.3;
constexpr double kMaxUsed_m = 4.0;
constexpr double kCut = 0.03;        // of the depth: farther off are occlusions and what moved
constexpr double kEdgeShare = 0.03;  // of the depth, over 3 x 3 pixels
constexpr double kPointsPerImage = 1500;
constexpr double kMinShare = 0.25;  // of the points, that must be seen by both

using Pose = std::optional<StampedPose>;

struct Pair {
  std::size_t first, second;
  double leverage_mps;
};

/// Sums over offsets -kMaxEstimatedOffset_s ... kMaxEstimatedOffset_s.
struct Curve {
  std::array<double, kNumSteps> sum_m{};
  double count{0.0};

  void add(const Curve& other) {
    for (int k = 0; k < kNumSteps; ++k) sum_m[k] += other.sum_m[k];
    count += other.count;
  }
};

double offsetOf(int step) {
  return kStep_s * (step - kHalfSteps);
}

double changeOf(const Eigen::Isometry3d& T) {
  return T.translation().norm() + kLeverageDepth_m * Eigen::AngleAxisd(T.linear()).angle();
}

/// T_a_b.
Eigen::Isometry3d between(const StampedPose& a, const StampedPose& b) {
  return a.T_map_camera.inverse() * b.T_map_camera;
}

/// All pairs of images that see about the same, and whose relative pose changes with the offset.
std::vector<Pair> findPairs(DepthSequence* sequence, std::size_t first, std::size_t last) {
  std::map<std::size_t, std::array<Pose, 3>> known;
  const auto poses = [&](std::size_t i) -> const std::array<Pose, 3>& {
    auto [entry, is_new] = known.try_emplace(i);
    SkipReason reason;
    for (int k = 0; is_new && k < 3; ++k) entry->second[k] = sequence->pose(i, (k - 1) * kLeverageStep_s, &reason);
    return entry->second;
  };
  const auto isComplete = [](const std::array<Pose, 3>& p) { return p[0] && p[1] && p[2]; };
  std::vector<Pair> pairs;
  const std::size_t stride = std::max<std::size_t>(1, (last - first + 1) / kMaxFrames);
  for (std::size_t i = first; i <= last; i += stride) {
    if (!isComplete(poses(i))) continue;
    for (std::size_t j = i + 1; j <= std::min(last, i + kReach); ++j) {
      const std::array<Pose, 3>& a = poses(i);
      const std::array<Pose, 3>& b = poses(j);
      if (!isComplete(b)) continue;
      const Eigen::Isometry3d T = between(*a[1], *b[1]);
      if (T.translation().norm() > kMaxMove_m || Eigen::AngleAxisd(T.linear()).angle() > kMaxTurn_rad) continue;
      const Eigen::Isometry3d early = between(*a[0], *b[0]);
      const Eigen::Isometry3d late = between(*a[2], *b[2]);
      const double leverage_mps = changeOf(early.inverse() * late) / (2.0 * kLeverageStep_s);
      if (leverage_mps >= kMinLeverage_mps) pairs.push_back({i, j, leverage_mps});
    }
  }
  std::sort(pairs.begin(), pairs.end(), [](const Pair& a, const Pair& b) { return a.leverage_mps > b.leverage_mps; });
  return pairs;
}

/// The best pairs of each part of the recording.
std::array<std::vector<Pair>, kNumParts> choosePairs(const std::vector<Pair>& pairs, std::size_t first,
                                                     std::size_t last) {
  std::array<std::vector<Pair>, kNumParts> parts;
  std::map<std::size_t, int> uses;
  for (const Pair& pair : pairs) {
    std::vector<Pair>& part = parts[kNumParts * (pair.first - first) / (last - first + 1)];
    if (part.size() >= kPairsPerPart || uses[pair.first] >= kUsesPerFrame || uses[pair.second] >= kUsesPerFrame)
      continue;
    ++uses[pair.first];
    ++uses[pair.second];
    part.push_back(pair);
  }
  return parts;
}

/// Points on surfaces, in the camera's frame.
std::vector<Eigen::Vector3d> surfacePoints(const DepthImage& image, const CameraModel& camera) {
  const int stride = std::max(1, static_cast<int>(std::sqrt(image.width * image.height / kPointsPerImage)));
  std::vector<Eigen::Vector3d> points;
  for (int v = 1; v < image.height - 1; v += stride) {
    for (int u = 1; u < image.width - 1; u += stride) {
      const double z = image.at(u, v);
      if (!(z >= kMinUsed_m && z <= kMaxUsed_m)) continue;
      bool is_surface = true;
      for (int y = v - 1; y <= v + 1; ++y) {
        for (int x = u - 1; x <= u + 1; ++x) is_surface = is_surface && std::abs(image.at(x, y) - z) <= kEdgeShare * z;
      }
      if (is_surface) points.emplace_back(z * (u - camera.cx) / camera.fx, z * (v - camera.cy) / camera.fy, z);
    }
  }
  return points;
}

/// Depth between four pixels of one surface, or NaN.
double depthAt(const DepthImage& image, double u, double v) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  if (!(u >= 0.0 && v >= 0.0 && u < image.width - 1 && v < image.height - 1)) return kNan;
  const int u0 = static_cast<int>(u);
  const int v0 = static_cast<int>(v);
  for (const float z : {image.at(u0, v0), image.at(u0 + 1, v0), image.at(u0, v0 + 1), image.at(u0 + 1, v0 + 1)}) {
    if (!(z >= kMinUsed_m && z <= 2.0 * kMaxUsed_m)) return kNan;
  }
  const auto [least, most] =
      std::minmax({image.at(u0, v0), image.at(u0 + 1, v0), image.at(u0, v0 + 1), image.at(u0 + 1, v0 + 1)});
  if (most - least > kEdgeShare * least) return kNan;
  const double a = u - u0;
  const double b = v - v0;
  return (1.0 - b) * ((1.0 - a) * image.at(u0, v0) + a * image.at(u0 + 1, v0)) +
         b * ((1.0 - a) * image.at(u0, v0 + 1) + a * image.at(u0 + 1, v0 + 1));
}

/// Nothing when a pose is missing at some offset, or too little is seen by both.
std::optional<Curve> differences(DepthSequence* sequence, const Pair& pair) {
  const CameraModel& camera = sequence->camera();
  SkipReason reason;
  std::array<Eigen::Isometry3d, kNumSteps> T_second_first;
  for (int k = 0; k < kNumSteps; ++k) {
    const Pose first = sequence->pose(pair.first, offsetOf(k), &reason);
    const Pose second = sequence->pose(pair.second, offsetOf(k), &reason);
    if (!first || !second) return std::nullopt;
    T_second_first[k] = between(*second, *first);
  }
  const std::optional<DepthFrame> first = sequence->frame(pair.first, &reason);
  const std::optional<DepthFrame> second = sequence->frame(pair.second, &reason);
  if (!first || !second) return std::nullopt;
  const std::vector<Eigen::Vector3d> points = surfacePoints(first->image, camera);
  Curve curve;
  for (int k = 0; k < kNumSteps; ++k) {
    double sum_m = 0.0;
    std::size_t count = 0;
    for (const Eigen::Vector3d& p : points) {
      const Eigen::Vector3d q = T_second_first[k] * p;
      if (q.z() < kMinUsed_m) continue;
      const double z =
          depthAt(second->image, q.x() / q.z() * camera.fx + camera.cx, q.y() / q.z() * camera.fy + camera.cy);
      if (std::isnan(z)) continue;
      sum_m += std::min(std::abs(z - q.z()), kCut * q.z());
      ++count;
    }
    if (static_cast<double>(count) < std::max(100.0, kMinShare * static_cast<double>(points.size())))
      return std::nullopt;
    curve.sum_m[k] = sum_m / static_cast<double>(count);
  }
  curve.count = 1.0;
  return curve;
}

/// Lowest point of a parabola about the least value; nothing at the end of the range.
std::optional<double> minimum(const Curve& curve) {
  const int least = static_cast<int>(std::min_element(curve.sum_m.begin(), curve.sum_m.end()) - curve.sum_m.begin());
  if (least < kFitSteps || least >= kNumSteps - kFitSteps) return std::nullopt;
  Eigen::Matrix<double, 2 * kFitSteps + 1, 3> A;
  Eigen::Matrix<double, 2 * kFitSteps + 1, 1> y;
  for (int i = -kFitSteps; i <= kFitSteps; ++i) {
    A.row(i + kFitSteps) << 1.0, i, i * i;
    y(i + kFitSteps) = curve.sum_m[least + i];
  }
  const Eigen::Vector3d c = A.colPivHouseholderQr().solve(y);
  if (!(c(2) > 0.0)) return std::nullopt;
  return offsetOf(least) + kStep_s * std::clamp(-c(1) / (2.0 * c(2)), -1.0 * kFitSteps, 1.0 * kFitSteps);
}

}  // namespace

TimeOffsetEstimate estimateTimeOffset(DepthSequence* sequence, std::size_t first, std::size_t last) {
  if (last >= sequence->size() || first > last) throw std::out_of_range("no such images: " + std::to_string(last));
  if (!sequence->hasPoseStamps()) {
    throw DepthSequenceError("the recording's poses have no stamps of their own: there is no offset to estimate");
  }
  const std::array<std::vector<Pair>, kNumParts> parts = choosePairs(findPairs(sequence, first, last), first, last);
  Curve all;
  TimeOffsetEstimate estimate;
  std::vector<double> offsets_s;
  for (const std::vector<Pair>& pairs : parts) {
    Curve part;
    for (const Pair& pair : pairs) {
      const std::optional<Curve> curve = differences(sequence, pair);
      if (curve) part.add(*curve);
    }
    if (part.count < kMinPairsPerPart) continue;
    all.add(part);
    ++estimate.num_parts;
    const std::optional<double> offset_s = minimum(part);
    if (offset_s) offsets_s.push_back(*offset_s);
  }
  estimate.num_pairs = static_cast<std::size_t>(all.count);
  if (estimate.num_parts < kMinParts) {
    throw DepthSequenceError(
        "the camera moves too little or too steadily: " + std::to_string(estimate.num_parts) + " of " +
        std::to_string(kNumParts) + " parts of the recording have " + std::to_string(kMinPairsPerPart) +
        " pairs of images between which its velocity changes by " + formatted("%g m/s", kMinLeverage_mps) +
        ", at least " + std::to_string(kMinParts) + " must");
  }
  const std::optional<double> offset_s = minimum(all);
  if (!offset_s || offsets_s.size() < kMinParts) {
    throw DepthSequenceError("the images fit best at no time offset within " +
                             formatted("%g s", kMaxEstimatedOffset_s) +
                             ": is the scene at rest, is the camera's frame right?");
  }
  estimate.offset_s = *offset_s;
  double squares = 0.0;
  for (const double part_s : offsets_s) squares += (part_s - *offset_s) * (part_s - *offset_s);
  estimate.spread_s = std::sqrt(squares / static_cast<double>(offsets_s.size()));
  if (estimate.spread_s > kMaxSpread_s) {
    throw DepthSequenceError(
        "the parts of the recording contradict each other: " + formatted("%.1f ms", 1e3 * *offset_s) +
        " with a standard deviation of " + formatted("%.1f ms", 1e3 * estimate.spread_s) + ", must be at most " +
        formatted("%g ms", 1e3 * kMaxSpread_s));
  }
  const auto step = static_cast<std::size_t>(std::lround(*offset_s / kStep_s) + kHalfSteps);
  estimate.residual_at_zero_m = all.sum_m[kHalfSteps] / all.count;
  estimate.residual_m = all.sum_m[step] / all.count;
  return estimate;
}

}  // namespace gpis_mapping
