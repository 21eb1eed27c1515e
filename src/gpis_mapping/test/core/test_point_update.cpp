// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/point_update.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "analytic_surfaces.h"
#include "depth_frames.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::makeFrame;
using gpis_mapping_test::planeDepth;
using gpis_mapping_test::surfacePoint;

const CameraModel kCamera{160, 120, 130.0, 130.0, 79.5, 59.5};

/// A plane n . x = offset, n towards the camera; camera frame.
struct Plane {
  Eigen::Vector3d n;
  double offset;
};

/// The surface nearest along each ray: the camera looks into a room of these planes.
double roomDepth(const std::vector<Plane>& planes, int u, int v, const Plane** seen = nullptr) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const Plane& plane : planes) {
    const double z = planeDepth(kCamera.ray(u, v), plane.n, plane.offset);
    if (!(z > 0.0) || z > nearest) continue;
    nearest = z;
    if (seen != nullptr) *seen = &plane;
  }
  return nearest;
}

class PointUpdate : public ::testing::Test {
 protected:
  Frame frameOf(const std::vector<Plane>& planes, const Eigen::Isometry3d& T_map_camera,
                const CameraMotion& motion = {}) {
    pixels_ = makeFrame(kCamera, [&](int u, int v) { return roomDepth(planes, u, v); });
    return frameOf(T_map_camera, motion);
  }
  Frame frameOf(const Eigen::Isometry3d& T_map_camera, const CameraMotion& motion = {}) {
    const double z = 0.5 * (config_.sensor.min_range_m + config_.sensor.max_range_m);
    const auto regressor =
        std::make_shared<FrameRegressor>(kCamera, config_.frame_map, config_.sensor.noise.sigma(z) / (z * z));
    return Frame(config_, pixels_, regressor, pixel_history_, T_map_camera, motion, 1.0f, 1);
  }

  GpisConfig config_;
  std::shared_ptr<ClassifiedFrame> pixels_;
  std::vector<PixelHistory> pixel_history_ = std::vector<PixelHistory>(160 * 120, PixelHistory::kMeasures);
};

const std::vector<Plane> kCorner = {
    {{-0.6, 0.0, -0.8}, -1.6}, {{0.6, 0.0, -0.8}, -1.6}, {Eigen::Vector3d(0.0, -0.8, -0.6), -1.3}};

/// Points of the corner as a camera at `T_map_camera` sees them, every `step` pixels.
std::vector<SurfacePoint> cornerPoints(const Eigen::Isometry3d& T_map_camera, int step) {
  std::vector<SurfacePoint> points;
  for (int v = 4; v < kCamera.height - 4; v += step) {
    for (int u = 4; u < kCamera.width - 4; u += step) {
      const Plane* plane = nullptr;
      const double z = roomDepth(kCorner, u, v, &plane);
      points.push_back(surfacePoint(T_map_camera * (z * kCamera.ray(u, v)), T_map_camera.linear() * plane->n, 0.002));
    }
  }
  return points;
}

Eigen::Isometry3d motionBy(const Eigen::Vector3d& shift, const Eigen::Vector3d& turn) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
  T.translation() = shift;
  return T;
}

TEST_F(PointUpdate, MisalignmentIsWhatThePoseIsOff) {
  const Eigen::Isometry3d T_true = motionBy({0.3, -0.2, 1.0}, {0.1, 0.9, -0.3});
  const Eigen::Vector3d shift(0.02, -0.015, 0.03);
  const Eigen::Vector3d turn(0.012, -0.015, 0.008);
  std::vector<SurfacePoint> points = cornerPoints(T_true, 5);
  for (const bool has_outliers : {false, true}) {
    if (has_outliers) {  // a quarter stands before what is there now: it was taken away
      for (std::size_t i = 0; i < points.size(); i += 4) {
        points[i].position_map += 0.12 * points[i].normal_map.cast<double>();
      }
    }
    // T_given = T_true D: a point at p by the given pose is seen at D p.
    const Frame frame = frameOf(kCorner, T_true * motionBy(shift, turn));
    const Frame::Misalignment found = frame.measureMisalignment(gpis_mapping_test::pointers(points));
    // Half the angle squared times 2 m of linearisation, 0.4 mm, and a pixel's quantisation of where a point is seen:
    // 1/2 px / 130 px x 2 m x slope 0.75 = 6 mm at most, some hundredth of that in the mean of 500.
    EXPECT_LT((found.shift_m - shift).norm(), 0.004) << found.shift_m.transpose() << ", outliers " << has_outliers;
    EXPECT_LT((found.turn_rad - turn).norm(), 0.003) << found.turn_rad.transpose() << ", outliers " << has_outliers;
    EXPECT_GT(found.rms_m, 0.01);
  }
  const Frame good = frameOf(kCorner, T_true);
  EXPECT_LT(good.measureMisalignment(gpis_mapping_test::pointers(cornerPoints(T_true, 5))).rms_m, 0.001);
}

TEST_F(PointUpdate, TooFewPointsTellNoMisalignment) {
  const Eigen::Isometry3d T_true = motionBy({0.3, -0.2, 1.0}, {0.1, 0.9, -0.3});
  const std::vector<SurfacePoint> points = cornerPoints(T_true, 30);
  const Frame frame = frameOf(kCorner, T_true * motionBy({0.05, 0.0, 0.0}, {0.0, 0.01, 0.0}));
  const Frame::Misalignment found = frame.measureMisalignment(gpis_mapping_test::pointers(points));
  EXPECT_EQ(found.shift_m.norm() + found.turn_rad.norm() + found.rms_m, 0.0);
}

/// A point `before_m` before the plane, on the optical axis, camera at the origin of the map.
SurfacePoint pointBefore(const Plane& plane, double before_m) {
  SurfacePoint point =
      surfacePoint(Eigen::Vector3d(0.0, 0.0, plane.offset / plane.n.z()) + before_m * plane.n, plane.n);
  point.seen_from_map = Eigen::Vector3f::Zero();
  return point;
}

const Plane kFacing{{0.0, 0.0, -1.0}, -2.0};
const Plane kSlanted{Eigen::Vector3d(std::sin(M_PI / 3.0), 0.0, -0.5), -1.0};  // 60 degrees, at 2 m

TEST_F(PointUpdate, ToleranceGrowsWithTurningOnSlantedSurfaces) {
  config_.sensor.stamp_std_s = 0.005;
  const CameraMotion turning{0.0, 2.0};  // 2 rad/s x 5 ms x 2 m = 2 cm across the line of sight
  const auto outcome = [&](const Plane& plane, const CameraMotion& motion) {
    SurfacePoint point = pointBefore(plane, plane.n.x() > 0.0 ? 0.035 : 0.05);
    return frameOf({plane}, Eigen::Isometry3d::Identity(), motion).apply(&point);
  };
  EXPECT_EQ(outcome(kSlanted, {}), PointOutcome::kDeleted);
  EXPECT_EQ(outcome(kSlanted, turning), PointOutcome::kFused);
  EXPECT_EQ(outcome(kFacing, turning), PointOutcome::kDeleted) << "turning does not change the depth of what one faces";
  EXPECT_EQ(outcome(kFacing, {5.0, 0.0}), PointOutcome::kFused) << "driving at 5 m/s for 5 ms does";
}

TEST_F(PointUpdate, ToleranceGrowsWithRangeByTheRotation) {
  config_.sensor.pose_std_rad = 0.008;
  const auto outcome = [&](double scale) {
    const Plane plane{kSlanted.n, kSlanted.offset * scale};
    SurfacePoint point = pointBefore(plane, 0.03);
    return frameOf({plane}, Eigen::Isometry3d::Identity()).apply(&point);
  };
  EXPECT_EQ(outcome(0.5), PointOutcome::kDeleted);  // 8 mm at 1 m
  EXPECT_EQ(outcome(1.5), PointOutcome::kFused);    // 24 mm at 3 m
}

TEST_F(PointUpdate, MisalignmentIsAllowedFor) {
  SurfacePoint point = pointBefore(kFacing, 0.05);
  Frame frame = frameOf({kFacing}, Eigen::Isometry3d::Identity());
  SurfacePoint copy = point;
  EXPECT_EQ(frame.apply(&copy), PointOutcome::kDeleted);
  Frame::Misalignment misalignment;
  misalignment.shift_m.z() = 0.05;
  frame.allowFor(misalignment);
  EXPECT_EQ(frame.apply(&point), PointOutcome::kFused);
}

TEST_F(PointUpdate, DoubleBehindASurfaceGoesAsOneBeforeIt) {
  SurfacePoint point = pointBefore(kFacing, -0.05);
  SurfacePoint far_behind = pointBefore(kFacing, -0.15);
  SurfacePoint other_face = pointBefore(kFacing, -0.05);
  other_face.normal_map = Eigen::Vector3f(-1.0f, 0.0f, -0.1f).normalized();
  const Frame frame = frameOf({kFacing}, Eigen::Isometry3d::Identity());
  EXPECT_EQ(frame.apply(&point), PointOutcome::kDoubtful);
  EXPECT_EQ(frame.apply(&point), PointOutcome::kDoubtful);
  EXPECT_EQ(frame.apply(&point), PointOutcome::kDeleted) << "the third look running";
  for (int look = 0; look < 4; ++look) {
    EXPECT_EQ(frame.apply(&far_behind), PointOutcome::kOccluded) << look;
    EXPECT_NE(frame.apply(&other_face), PointOutcome::kDeleted) << look;
  }
}

TEST_F(PointUpdate, HoleIsEvidenceOnlyWhereTheSensorMeasuredBefore) {
  const SurfacePoint seen = pointBefore(kFacing, 0.0);
  pixels_ = makeFrame(kCamera, [](int, int) { return 2.0; });
  std::fill(pixels_->kind.begin(), pixels_->kind.end(), PixelKind::kHole);
  const auto outcomeAt = [&](SurfacePoint point, const Eigen::Vector3d& camera_map) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = camera_map;
    return frameOf(T).apply(&point);
  };
  EXPECT_EQ(outcomeAt(seen, {0.0, 0.0, 0.0}), PointOutcome::kMissing);
  EXPECT_EQ(outcomeAt(seen, {0.25, 0.0, 0.0}), PointOutcome::kMissing) << "7 degrees away";
  EXPECT_EQ(outcomeAt(seen, {0.7, 0.0, 0.0}), PointOutcome::kUnseen) << "19 degrees away";
  EXPECT_EQ(outcomeAt(seen, {0.0, 0.0, -0.5}), PointOutcome::kUnseen) << "a quarter farther";
  EXPECT_EQ(outcomeAt(seen, {0.0, 0.0, 0.9}), PointOutcome::kMissing) << "nearer";
  EXPECT_EQ(outcomeAt(seen, {0.0, 0.0, 1.75}), PointOutcome::kUnseen) << "too near to be measured";
  EXPECT_EQ(outcomeAt(seen, {0.0, 0.0, 1.65}), PointOutcome::kMissing) << "35 cm away, the least range is 25 cm";
  SurfacePoint far = seen;
  far.seen_from_map = Eigen::Vector3f(0.0f, 0.0f, -1.5f);
  EXPECT_EQ(outcomeAt(far, {0.0, 0.0, -1.1}), PointOutcome::kMissing) << "3.1 m away";
  EXPECT_EQ(outcomeAt(far, {0.0, 0.0, -1.3}), PointOutcome::kUnseen) << "3.3 m away, the greatest range is 4 m";
  SurfacePoint restored = seen;
  restored.seen_from_map.setConstant(std::numeric_limits<float>::quiet_NaN());
  EXPECT_EQ(outcomeAt(restored, {0.0, 0.0, 0.0}), PointOutcome::kUnseen);
  std::fill(pixel_history_.begin(), pixel_history_.end(), PixelHistory::kUnknown);
  EXPECT_EQ(outcomeAt(seen, {0.0, 0.0, 0.0}), PointOutcome::kUnseen) << "a pixel that has not measured yet";
  std::fill(pixel_history_.begin(), pixel_history_.end(), PixelHistory::kNeverMeasures);
  EXPECT_EQ(outcomeAt(seen, {0.0, 0.0, 0.0}), PointOutcome::kNothing) << "a margin of the sensor";
  std::fill(pixel_history_.begin(), pixel_history_.end(), PixelHistory::kMeasures);
  config_.dynamic.enabled = false;
  EXPECT_EQ(outcomeAt(seen, {0.0, 0.0, 0.0}), PointOutcome::kUnseen) << "a static map";
}

TEST_F(PointUpdate, WhatAnExplainedGapIsSeenPastGoesAfterSomeLooks) {
  pixels_ = makeFrame(kCamera, [](int, int) { return 2.5; });
  std::fill(pixels_->blocked.begin(), pixels_->blocked.end(), Block::kNarrow);
  const auto looksUntilGone = [&](PixelKind kind, float clear_to_m, double z) {
    const double x = (80 - kCamera.cx) / kCamera.fx;
    SurfacePoint point = surfacePoint(z * Eigen::Vector3d(x, 0.0, 1.0), {0.0, 0.0, -1.0}, 0.002);
    std::fill(pixels_->kind.begin(), pixels_->kind.end(), kind);
    std::fill(pixels_->clear_to.begin(), pixels_->clear_to.end(), clear_to_m > 0.0f ? 1.0f / clear_to_m : 0.0f);
    const Frame frame = frameOf(Eigen::Isometry3d::Identity());
    for (int look = 1; look <= 10; ++look) {
      if (frame.apply(&point) == PointOutcome::kDeleted) return look;
    }
    return 0;
  };
  for (const PixelKind kind : {PixelKind::kHole, PixelKind::kNoInformation}) {
    EXPECT_EQ(looksUntilGone(kind, 2.0f, 1.5), 3);
    EXPECT_EQ(looksUntilGone(kind, 2.0f, 2.0), 0) << "the nearer side itself";
    EXPECT_EQ(looksUntilGone(kind, 2.0f, 2.2), 0) << "behind it";
    EXPECT_EQ(looksUntilGone(kind, 0.0f, 1.5), 0) << "no gap that an edge explains";
  }
}

TEST_F(PointUpdate, NothingWithinReachSaysNothingOfWhatLiesBeyond) {
  pixels_ = makeFrame(kCamera, [this](int, int) { return config_.frame_map.wall_range_m; });
  std::fill(pixels_->kind.begin(), pixels_->kind.end(), PixelKind::kWall);
  const Frame frame = frameOf(Eigen::Isometry3d::Identity());
  const double reach_m = config_.sensor.max_range_m;
  const double noise_m = 3.0 * config_.sensor.noise.sigma(reach_m);
  for (const auto& [z_m, outcome] :
       std::vector<std::pair<double, PointOutcome>>{{0.5 * reach_m, PointOutcome::kDeleted},
                                                    {reach_m - 1.1 * noise_m, PointOutcome::kDeleted},
                                                    {reach_m - 0.9 * noise_m, PointOutcome::kNothing},
                                                    {1.2 * reach_m, PointOutcome::kNothing}}) {
    SurfacePoint point = surfacePoint({0.0, 0.0, z_m}, -Eigen::Vector3d::UnitZ());
    EXPECT_EQ(frame.apply(&point), outcome) << z_m << " m";
  }
}

TEST_F(PointUpdate, BlanketIsWherePointsAreDeletedAndKept) {
  constexpr int kStride = 4, kU = 80, kV = 60;
  const Eigen::Isometry3d T_map_camera = motionBy({0.3, -0.2, 1.0}, {0.1, 0.9, -0.3});
  for (const Plane& plane : {kFacing, kSlanted}) {
    const Frame frame = frameOf({plane}, T_map_camera);
    const FrameBlanket blanket = frame.blanket(kStride);
    ASSERT_EQ(blanket.columns, 40);
    ASSERT_EQ(blanket.knots.size(), 40u * 30u);
    const FrameBlanket::Knot& knot = blanket.knots[kV / kStride * 40 + kU / kStride];
    EXPECT_FALSE(knot.is_wall);
    const auto outcome = [&](const Eigen::Vector3f& border, double share) {
      const Eigen::Vector3f p = knot.seen + static_cast<float>(share) * (border - knot.seen);
      SurfacePoint point =
          surfacePoint(p.cast<double>(), T_map_camera.linear() * plane.n, config_.surface.min_noise_std_m);
      return frame.apply(&point);
    };
    // Inverse range is not linear in range, and the point's pixel may be the next one: some per cent of the tolerance.
    EXPECT_EQ(outcome(knot.nearer, 0.9), PointOutcome::kFused);
    EXPECT_EQ(outcome(knot.nearer, 1.1), PointOutcome::kDeleted);
    EXPECT_EQ(outcome(knot.farther, 0.9), PointOutcome::kFused);
    EXPECT_NE(outcome(knot.farther, 1.1), PointOutcome::kFused);
  }
}

TEST_F(PointUpdate, BlanketEndsAtWallAndWhereNothingIsTold) {
  pixels_ = makeFrame(kCamera, [this](int u, int) { return u < 80 ? config_.frame_map.wall_range_m : 2.0; });
  for (int v = 0; v < kCamera.height; ++v) {
    for (int u = 0; u < 80; ++u) pixels_->kind[pixels_->index(u, v)] = PixelKind::kWall;
    pixels_->blocked[pixels_->index(120, v)] = Block::kNoInformation;
  }
  const FrameBlanket blanket = frameOf(Eigen::Isometry3d::Identity()).blanket(4);
  EXPECT_TRUE(blanket.knots[5].is_wall);
  EXPECT_NEAR(blanket.knots[5].seen.norm(), config_.sensor.max_range_m, 1e-5);
  EXPECT_FALSE(blanket.knots[25].is_wall);
  EXPECT_TRUE(blanket.knots[25].seen.allFinite());
  EXPECT_FALSE(blanket.knots[30].seen.allFinite());
  // The left border of what is near: up to there the raw depths spread.
  EXPECT_LT(blanket.knots[20].nearer.z(), blanket.knots[25].nearer.z() + 0.01f);
}

}  // namespace
}  // namespace gpis_mapping
