// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/vanished_surface.h"

#include <algorithm>
#include <array>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/point_update.h"

namespace gpis_mapping {
namespace {

constexpr double kReach = 0.05;
const Eigen::Vector3f kFront(-1.0f, 0.0f, 0.0f);
const Eigen::Vector3f kTop(0.0f, 0.0f, 1.0f);

/// A patch of `columns` x `rows` points, 2 cm apart, of the plane x = 1 from (y, z) on.
std::vector<HiddenPoint> patch(double y, double z, int columns, int rows, bool is_due) {
  std::vector<HiddenPoint> points;
  for (int i = 0; i < columns; ++i) {
    for (int j = 0; j < rows; ++j) points.push_back({{1.0, y + 0.02 * i, z + 0.02 * j}, kFront, is_due});
  }
  return points;
}

Witness witness(double y, double z, bool is_gone, const Eigen::Vector3f& normal = kFront) {
  return {{1.0, y, z}, normal, is_gone};
}

/// The one fate of all points; fails if they differ.
HiddenFate fateOf(const std::vector<HiddenPoint>& points, const std::vector<Witness>& witnesses) {
  const std::vector<HiddenFate> fates = judgeHidden(points, witnesses, kReach);
  EXPECT_EQ(fates.size(), points.size());
  EXPECT_EQ(std::count(fates.begin(), fates.end(), fates.front()), static_cast<std::ptrdiff_t>(fates.size()));
  return fates.front();
}

TEST(VanishedSurface, WholeObjectThatWasDueIsGone) {
  EXPECT_EQ(fateOf(patch(0.0, 0.0, 5, 5, true), {}), HiddenFate::kVanished);
}

TEST(VanishedSurface, SurfaceNeverMeasuredFromHereStands) {
  EXPECT_EQ(fateOf(patch(0.0, 0.0, 5, 5, false), {}), HiddenFate::kStands);
  EXPECT_EQ(fateOf(patch(0.0, 0.0, 5, 5, false), {witness(0.11, 0.04, true)}), HiddenFate::kStands);
}

TEST(VanishedSurface, HoleInASurfaceThatIsStillSeenStands) {
  EXPECT_EQ(fateOf(patch(0.0, 0.0, 5, 5, true), {witness(0.11, 0.04, false)}), HiddenFate::kStands);
}

TEST(VanishedSurface, OneFaceSaysNothingOfAnother) {
  // The floor before a box is confirmed; its front is not.
  EXPECT_EQ(fateOf(patch(0.0, 0.0, 5, 5, true), {witness(0.04, -0.02, false, kTop)}), HiddenFate::kVanished);
  // A point farther than the reach is another piece.
  EXPECT_EQ(fateOf(patch(0.0, 0.0, 5, 5, true), {witness(0.2, 0.04, false)}), HiddenFate::kVanished);
}

TEST(VanishedSurface, MoreSeenPastThanConfirmedDecides) {
  const std::vector<Witness> more_gone = {witness(0.11, 0.02, true), witness(0.11, 0.04, true),
                                          witness(0.11, 0.06, false)};
  const std::vector<Witness> more_there = {witness(0.11, 0.02, true), witness(0.11, 0.04, false),
                                           witness(0.11, 0.06, false)};
  EXPECT_EQ(fateOf(patch(0.0, 0.0, 5, 5, true), more_gone), HiddenFate::kVanished);
  EXPECT_EQ(fateOf(patch(0.0, 0.0, 5, 5, true), more_there), HiddenFate::kStands);
}

TEST(VanishedSurface, SmallPieceIsSuspectAtFirst) {
  EXPECT_EQ(fateOf(patch(0.0, 0.0, 2, 2, true), {}), HiddenFate::kSuspect);
  EXPECT_EQ(fateOf(patch(0.0, 0.0, 2, 2, true), {witness(0.06, 0.0, true)}), HiddenFate::kVanished);
  EXPECT_TRUE(judgeHidden({}, {witness(0.0, 0.0, true)}, kReach).empty());
}

TEST(VanishedSurface, HalfDueIsEnough) {
  std::vector<HiddenPoint> points = patch(0.0, 0.0, 4, 4, true);
  for (std::size_t i = 0; i < 8; ++i) points[i].is_due = false;
  EXPECT_EQ(fateOf(points, {}), HiddenFate::kVanished);
  points[8].is_due = false;
  EXPECT_EQ(fateOf(points, {}), HiddenFate::kStands);
  EXPECT_EQ(fateOf(points, {witness(0.09, 0.04, true)}), HiddenFate::kVanished)
      << "an eighth, if the rest is seen past";
  EXPECT_EQ(fateOf(points, {witness(0.09, 0.04, true), witness(-0.03, 0.04, false)}), HiddenFate::kStands);
}

/// The rule by its words: pieces by repeated spreading, witnesses by brute force.
std::vector<HiddenFate> slowFates(const std::vector<HiddenPoint>& hidden, const std::vector<Witness>& witnesses) {
  const auto touches = [](const auto& a, const auto& b) {
    return (a.position_map - b.position_map).norm() < kReach && a.normal_map.dot(b.normal_map) > kSameFaceCosine;
  };
  std::vector<std::size_t> label(hidden.size());
  for (std::size_t i = 0; i < label.size(); ++i) label[i] = i;
  for (bool changed = true; changed;) {
    changed = false;
    for (std::size_t i = 0; i < hidden.size(); ++i) {
      for (std::size_t j = 0; j < hidden.size(); ++j) {
        if (!touches(hidden[i], hidden[j]) || label[i] <= label[j]) continue;
        label[i] = label[j];
        changed = true;
      }
    }
  }
  std::vector<HiddenFate> fates;
  for (std::size_t i = 0; i < hidden.size(); ++i) {
    std::size_t size = 0, due = 0, confirmed = 0, gone = 0;
    for (std::size_t j = 0; j < hidden.size(); ++j) {
      if (label[j] != label[i]) continue;
      ++size;
      due += hidden[j].is_due;
    }
    for (const Witness& w : witnesses) {
      bool is_near = false;
      for (std::size_t j = 0; j < hidden.size(); ++j) is_near |= label[j] == label[i] && touches(hidden[j], w);
      (w.is_gone ? gone : confirmed) += is_near;
    }
    const bool is_gone = gone >= confirmed && (2 * due >= size || (8 * due >= size && gone > 0 && confirmed == 0));
    fates.push_back(!is_gone                                 ? HiddenFate::kStands
                    : gone > 0 || size >= kMinVanishedPoints ? HiddenFate::kVanished
                                                             : HiddenFate::kSuspect);
  }
  return fates;
}

TEST(VanishedSurface, MatchesTheSlowVersion) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> place(0.0, 0.35);
  std::bernoulli_distribution coin(0.6);
  const std::vector<Eigen::Vector3f> normals = {kFront, kTop, Eigen::Vector3f(-1, 0, 1).normalized()};
  std::array<int, 3> seen{};
  for (int round = 0; round < 40; ++round) {
    const auto point = [&] { return Eigen::Vector3d(1.0 + 0.2 * place(rng), place(rng) - 0.2, place(rng)); };
    std::vector<HiddenPoint> hidden(60);
    for (HiddenPoint& h : hidden) h = {point(), normals[rng() % normals.size()], coin(rng)};
    std::vector<Witness> witnesses(static_cast<std::size_t>(round));
    for (Witness& w : witnesses) w = {point(), normals[rng() % normals.size()], coin(rng)};
    const std::vector<HiddenFate> fates = judgeHidden(hidden, witnesses, kReach);
    EXPECT_EQ(fates, slowFates(hidden, witnesses)) << "round " << round;
    for (const HiddenFate fate : fates) ++seen[static_cast<std::size_t>(fate)];
  }
  for (const int count : seen) EXPECT_GT(count, 50) << "each fate must come about";
}

constexpr int kMargin_px = 60;  // columns from here on never have a depth

CameraModel cameraWithMargin() {
  CameraModel camera;
  camera.width = 80;
  camera.height = 60;
  camera.fx = camera.fy = 65.0;
  camera.cx = 39.5;
  camera.cy = 29.5;
  return camera;
}

/// 1 m above the floor z = 0, looking down, so that the middle of the plate of 0.2 x 0.2 m at 0.3 m is in column `u`.
Eigen::Isometry3d plateAt(double u) {
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.linear() = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()).toRotationMatrix();
  T_map_camera.translation() << 0.7 * (cameraWithMargin().cx - u) / cameraWithMargin().fx, 0.0, 1.0;
  return T_map_camera;
}

/// Columns from `hole_px` on are zero.
DepthImage look(const Eigen::Isometry3d& T_map_camera, bool has_plate, int hole_px) {
  const CameraModel camera = cameraWithMargin();
  DepthImage image{camera.width, camera.height, {}};
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector3d p = T_map_camera * (0.7 * camera.ray(u, v));
      const bool is_plate = has_plate && std::abs(p.x()) < 0.1 && std::abs(p.y()) < 0.1;
      image.depth_m.push_back(u >= hole_px ? 0.0f : is_plate ? 0.7f : 1.0f);
    }
  }
  return image;
}

/// Points of the plate in columns from `first` to `last` - 1.
std::size_t pointsInColumns(const GpisMap& map, const Eigen::Isometry3d& T_map_camera, double first, double last) {
  const CameraModel camera = cameraWithMargin();
  std::size_t count = 0;
  for (const SurfacePoint& point : map.contents().points) {
    const Eigen::Vector3d p = T_map_camera.inverse() * point.position_map;
    const double u = camera.fx * p.x() / p.z() + camera.cx + 0.5;
    count += point.position_map.z() > 0.2 && u >= first && u < last;
  }
  return count;
}

TEST(VanishedSurface, MarginOfTheSensorTellsNothing) {
  GpisMap map{GpisConfig()};
  double stamp_s = 100.0;
  Eigen::Isometry3d T_map_camera;
  for (const double u : {38.0, 45.0, 52.0, 60.0}) {  // the plate goes into the margin
    T_map_camera = plateAt(u);
    for (int i = 0; i < 4; ++i) {
      map.update(look(T_map_camera, true, kMargin_px), cameraWithMargin(), T_map_camera, stamp_s += 1.0);
    }
  }
  const std::size_t in_margin = pointsInColumns(map, T_map_camera, kMargin_px, 80);
  ASSERT_GT(in_margin, 10u);
  ASSERT_GT(pointsInColumns(map, T_map_camera, 55, kMargin_px), 4u);
  // The plate is gone: past part of it the floor is seen, part lies in a hole, the rest in the margin.
  map.update(look(T_map_camera, false, 55), cameraWithMargin(), T_map_camera, stamp_s + 1.0);
  EXPECT_EQ(pointsInColumns(map, T_map_camera, 0, kMargin_px), 0u);
  EXPECT_EQ(pointsInColumns(map, T_map_camera, kMargin_px, 80), in_margin);
}

TEST(VanishedSurface, IsGoneAtOnceFromAMapOfLongAgo) {
  const Eigen::Isometry3d T_map_camera = plateAt(38.0);
  const auto show = [&](GpisMap* map, double from_s) {
    for (int i = 0; i < 4; ++i) {
      map->update(look(T_map_camera, true, kMargin_px), cameraWithMargin(), T_map_camera, from_s + 0.1 * i);
    }
  };
  GpisMap recorded{GpisConfig()};
  show(&recorded, 0.0);
  GpisMap map(recorded.contents());
  const double now_s = 1.76e9;  // since 1970: in single precision 128 s apart, so all images have one stamp
  show(&map, now_s);
  ASSERT_GT(pointsInColumns(map, T_map_camera, 0, kMargin_px), 20u);
  map.update(look(T_map_camera, false, 20), cameraWithMargin(), T_map_camera, now_s + 0.4);
  EXPECT_EQ(pointsInColumns(map, T_map_camera, 0, kMargin_px), 0u);
}

}  // namespace
}  // namespace gpis_mapping
