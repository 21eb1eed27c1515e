// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/depth_classifier.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "depth_frames.h"

namespace gpis_mapping {
namespace {

using depth_camera::depthImageFromU16;

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// One row of interest, repeated: shadows are thrown along image rows.
CameraModel wideCamera() {
  return {320, 16, 525.0, 525.0, 159.5, 7.5};
}

DepthImage flatImage(const CameraModel& camera, float depth) {
  return {camera.width, camera.height,
          std::vector<float>(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), depth)};
}

/// Sets columns [begin, end) of every row.
void setColumns(DepthImage* image, int begin, int end, float depth) {
  for (int v = 0; v < image->height; ++v) {
    for (int u = begin; u < end; ++u) {
      image->depth_m[static_cast<std::size_t>(v) * static_cast<std::size_t>(image->width) +
                     static_cast<std::size_t>(u)] = depth;
    }
  }
}

PixelKind kindAt(const GpisConfig& config, const DepthImage& image, int u, int v = 8) {
  const ClassifiedFrame frame = DepthClassifier(wideCamera(), config).classify(image, 1);
  return frame.kind[frame.index(u, v)];
}

/// Kind of a hole of `width_px` columns between a surface at `left` and one at `right` [m].
PixelKind holeKind(const GpisConfig& config, int width_px, float left, float right) {
  DepthImage image = flatImage(wideCamera(), left);
  setColumns(&image, 100 + width_px, 320, right);
  setColumns(&image, 100, 100 + width_px, 0.0f);
  const PixelKind first = kindAt(config, image, 100);
  EXPECT_EQ(kindAt(config, image, 100 + width_px - 1), first) << "one hole, two kinds";
  return first;
}

TEST(DepthClassifier, FollowsRep117) {
  const GpisConfig config;
  DepthImage image = flatImage(wideCamera(), 1.5f);
  const auto kindOf = [&](float depth) {
    setColumns(&image, 150, 170, depth);
    return kindAt(config, image, 160);
  };
  EXPECT_EQ(kindOf(1.4f), PixelKind::kSurface);
  EXPECT_EQ(kindOf(kInf), PixelKind::kWall);
  EXPECT_EQ(kindOf(-kInf), PixelKind::kNoInformation);
  EXPECT_EQ(kindOf(kNaN), PixelKind::kNoInformation);
  EXPECT_EQ(kindOf(-1.0f), PixelKind::kNoInformation);
  EXPECT_EQ(kindOf(1e-40f), PixelKind::kNoInformation);  // nearer than anything can be
  EXPECT_EQ(kindOf(50.0f), PixelKind::kSurface);         // beyond max_range: sees past things, inserts nothing
}

TEST(DepthClassifier, ExplainsValuesOfSurfaceAndWallPixels) {
  const GpisConfig config;
  const CameraModel camera = wideCamera();
  DepthImage image = flatImage(camera, 1.5f);
  setColumns(&image, 200, 220, kInf);
  setColumns(&image, 240, 250, 2e4f);  // a "measurement" behind the virtual wall
  const DepthClassifier classifier(camera, config);
  const ClassifiedFrame frame = classifier.classify(image, 1);
  EXPECT_EQ(frame.num_surface, static_cast<std::size_t>(16 * 300));
  for (const int u : {0, 100, 319}) {
    const std::size_t i = frame.index(u, 3);
    const double length = camera.ray(u, 3).norm();
    EXPECT_NEAR(classifier.rayLength(u, 3), length, 1e-6);
    EXPECT_NEAR(frame.inverse_depth[i], 1.0 / 1.5, 1e-6);  // float
    EXPECT_NEAR(frame.inverse_range[i], 1.0 / (1.5 * length), 1e-6);
  }
  EXPECT_FLOAT_EQ(frame.inverse_range[frame.index(210, 3)], static_cast<float>(1.0 / config.frame_map.wall_range_m));
  EXPECT_EQ(frame.inverse_depth[frame.index(210, 3)], 0.0f);
  EXPECT_FLOAT_EQ(frame.inverse_range[frame.index(245, 3)], static_cast<float>(1.0 / config.frame_map.wall_range_m));
}

TEST(DepthClassifier, TooNearIsJudgedByRangeNotDepth) {
  GpisConfig config;
  config.sensor.min_range_m = 0.3;
  DepthImage image = flatImage(wideCamera(), 0.29f);
  // Ray length 1 in the middle, sqrt(1 + (159.5 / 525)^2) = 1.045 at the side.
  EXPECT_EQ(kindAt(config, image, 160), PixelKind::kNoInformation);
  EXPECT_EQ(kindAt(config, image, 0), PixelKind::kSurface);
  image = flatImage(wideCamera(), 0.301f);
  EXPECT_EQ(kindAt(config, image, 160), PixelKind::kSurface);
}

TEST(DepthClassifier, HolePolicyOverridesTheGuess) {
  GpisConfig config;
  for (const int width : {2, 8, 100}) {
    config.sensor.hole_policy = HolePolicy::kWall;
    EXPECT_EQ(holeKind(config, width, 1.0f, 2.0f), PixelKind::kWall);
    config.sensor.hole_policy = HolePolicy::kNoInformation;
    EXPECT_EQ(holeKind(config, width, 1.0f, 2.0f), PixelKind::kNoInformation);
  }
}

TEST(DepthClassifier, ShadowBesideADepthEdgeIsNoInformation) {
  const GpisConfig config;  // f B = 525 px x 0.075 m = 39.4 px m
  // Between 1 m and 2 m the shadow is 39.4 (1 - 1/2) = 19.7 px wide. Both orders: cameras differ in where they look from.
  for (const auto& [left, right] : {std::pair<float, float>{1.0f, 2.0f}, {2.0f, 1.0f}}) {
    EXPECT_EQ(holeKind(config, 2, left, right), PixelKind::kNoInformation);
    EXPECT_EQ(holeKind(config, 19, left, right), PixelKind::kNoInformation);
    EXPECT_EQ(holeKind(config, 21, left, right), PixelKind::kNoInformation);  // measured widths scatter
    EXPECT_EQ(holeKind(config, 30, left, right), PixelKind::kHole);           // half as wide again: no shadow
    EXPECT_EQ(holeKind(config, 150, left, right), PixelKind::kHole);
  }
  // A small step throws a small shadow: 39.4 (1/1.5 - 1/1.7) = 3.1 px.
  EXPECT_EQ(holeKind(config, 3, 1.5f, 1.7f), PixelKind::kNoInformation);
  EXPECT_EQ(holeKind(config, 10, 1.5f, 1.7f), PixelKind::kHole);
}

TEST(DepthClassifier, ShadowWidthFollowsBaselineAndFocalLength) {
  GpisConfig config;
  config.sensor.baseline_m = 0.15;
  EXPECT_EQ(holeKind(config, 38, 1.0f, 2.0f), PixelKind::kNoInformation);
  EXPECT_EQ(holeKind(config, 60, 1.0f, 2.0f), PixelKind::kHole);
  config.sensor.baseline_m = 0.0;  // time of flight: no shadows
  EXPECT_EQ(holeKind(config, 10, 1.0f, 2.0f), PixelKind::kHole);
  EXPECT_EQ(holeKind(config, 2, 1.0f, 2.0f), PixelKind::kHole);
}

TEST(DepthClassifier, GapThatADepthEdgeExplainsIsClearUpToItsNearerSide) {
  GpisConfig config;
  DepthImage image;
  const auto clearAt = [&](int u, int v) {
    const ClassifiedFrame frame = DepthClassifier(wideCamera(), config).classify(image, 1);
    const float range = 1.0f / frame.clear_to[frame.index(u, v)];
    return range / DepthClassifier(wideCamera(), config).rayLength(u, v);  // the depth, but for a few pixels' slope
  };
  const auto clearOf = [&](int width_px, float left, float right, float value) {
    image = flatImage(wideCamera(), left);
    setColumns(&image, 100 + width_px, 320, right);
    setColumns(&image, 100, 100 + width_px, value);
    return clearAt(100 + width_px / 2, 8);
  };
  // 1 % for the slope of the rays: 20 px of 525 in tan, at 7 degrees.
  for (const auto& [left, right] : {std::pair<float, float>{1.0f, 2.0f}, {2.0f, 1.0f}, {1.0f, kInf}}) {
    EXPECT_NEAR(clearOf(19, left, right, 0.0f), 1.0f, 0.01f) << "the baseline's shadow";
    EXPECT_EQ(clearOf(60, left, right, 0.0f), kInf) << "wider than any";
    EXPECT_EQ(clearOf(6, left, right, kNaN), kInf) << "masked: something may stand there";
  }
  EXPECT_EQ(clearOf(5, 1.5f, 1.5f, 0.0f), kInf) << "one surface on both sides: a thin dark thing before it";
  EXPECT_EQ(clearOf(5, 0.0f, 1.0f, 0.0f), kInf) << "one end only";
  config.sensor.baseline_m = 0.0;
  EXPECT_NEAR(clearOf(6, 1.0f, 2.0f, 0.0f), 1.0f, 0.01f) << "a strip beside the edge";
  EXPECT_EQ(clearOf(7, 1.0f, 2.0f, 0.0f), kInf);
  // Edges along the rows have strips too.
  image = flatImage(wideCamera(), 2.0f);
  std::fill(image.depth_m.begin(), image.depth_m.begin() + 4 * 320, 1.0f);
  std::fill(image.depth_m.begin() + 4 * 320, image.depth_m.begin() + 10 * 320, 0.0f);
  EXPECT_NEAR(clearAt(160, 7), 1.0f, 0.01f);
  std::fill(image.depth_m.begin() + 10 * 320, image.depth_m.begin() + 11 * 320, 0.0f);
  EXPECT_EQ(clearAt(160, 7), kInf);
}

TEST(DepthClassifier, HoleInOneSurfaceIsAHoleUnlessItIsSpeckle) {
  const GpisConfig config;
  DepthImage image = flatImage(wideCamera(), 1.5f);
  for (int u = 100; u < 103; ++u) image.depth_m[static_cast<std::size_t>(5 * 320 + u)] = 0.0f;
  EXPECT_EQ(kindAt(config, image, 101, 5), PixelKind::kNoInformation) << "three pixels, one surface round them";
  image.depth_m[static_cast<std::size_t>(6 * 320 + 101)] = 0.0f;
  EXPECT_EQ(kindAt(config, image, 101, 5), PixelKind::kHole) << "four";
  for (const int width : {4, 16, 120}) EXPECT_EQ(holeKind(config, width, 1.5f, 1.5f), PixelKind::kHole) << width;
}

TEST(DepthClassifier, HoleOfSomethingTooNearIsNoInformation) {
  const GpisConfig config;
  // The border of a gripper inside the minimum range (0.25 m, with a fifth of margin) round a wide hole.
  EXPECT_EQ(holeKind(config, 100, 0.28f, 1.5f), PixelKind::kNoInformation);
  EXPECT_EQ(holeKind(config, 100, 1.5f, 0.28f), PixelKind::kNoInformation);
  // Beyond it, a hole wider than its shadow, 39.4 (1/0.35 - 1/1.5) = 86 px and a fifth.
  EXPECT_EQ(holeKind(config, 120, 0.35f, 1.5f), PixelKind::kHole);
  EXPECT_EQ(holeKind(config, 120, 0.28f, 1.5f), PixelKind::kNoInformation);
}

TEST(DepthClassifier, HoleAtTheImageBorderTellsNothingOfItsWidth) {
  const GpisConfig config;
  for (const bool left : {false, true}) {
    for (const int width : {10, 60, 200}) {
      DepthImage image = flatImage(wideCamera(), 1.0f);
      setColumns(&image, left ? 0 : 320 - width, left ? width : 320, 0.0f);
      EXPECT_EQ(kindAt(config, image, left ? 0 : 319), PixelKind::kHole) << width;
    }
  }
}

TEST(DepthClassifier, HoleBesideOtherSpecialValues) {
  const GpisConfig config;
  EXPECT_EQ(holeKind(config, 150, kInf, kInf), PixelKind::kHole);
  EXPECT_EQ(holeKind(config, 150, kNaN, kNaN), PixelKind::kHole);
  EXPECT_EQ(holeKind(config, 10, 1.0f, kInf), PixelKind::kNoInformation);         // a shadow on the wall behind
  EXPECT_EQ(holeKind(config, 150, -kInf, 1.0f), PixelKind::kNoInformation);       // its border is too near
  EXPECT_EQ(kindAt(config, flatImage(wideCamera(), 0.0f), 5), PixelKind::kHole);  // an image of holes only
}

TEST(DepthClassifier, FillsNoInformationFromItsRow) {
  const GpisConfig config;
  DepthImage image = flatImage(wideCamera(), 1.5f);
  setColumns(&image, 0, 10, kNaN);
  setColumns(&image, 160, 180, kNaN);
  setColumns(&image, 180, 320, 3.0f);
  const ClassifiedFrame frame = DepthClassifier(wideCamera(), config).classify(image, 1);
  for (int u = 0; u < 10; ++u) {
    EXPECT_EQ(frame.inverse_range[frame.index(u, 4)], frame.inverse_range[frame.index(10, 4)]);
  }
  for (int u = 160; u < 180; ++u) {
    EXPECT_EQ(frame.inverse_range[frame.index(u, 4)], frame.inverse_range[frame.index(159, 4)]);
    EXPECT_EQ(frame.inverse_depth[frame.index(u, 4)], 0.0f) << "filled for the GP only";
  }
}

/// In an image of one depth: at most three dropouts in the 5 x 5 pixels about (u, v), itself included.
bool isLonely(const ClassifiedFrame& frame, int u, int v) {
  int dropouts = 0;
  for (int j = std::max(0, v - 2); j <= std::min(frame.height - 1, v + 2); ++j) {
    for (int i = std::max(0, u - 2); i <= std::min(frame.width - 1, u + 2); ++i) {
      dropouts += frame.kind[frame.index(i, j)] == PixelKind::kNoInformation ? 1 : 0;
    }
  }
  return dropouts <= 3;
}

TEST(DepthClassifier, BlockedMatchesBruteForceDilation) {
  GpisConfig config;
  const CameraModel camera{70, 50, 525.0, 350.0, 34.5, 24.5};  // another radius along each axis
  std::mt19937 rng(1);
  std::size_t num_blocked = 0;
  for (const double length : {0.002, 0.006, 0.03}) {
    config.frame_map.kernel_length_rad = length;
    const double radius_u = length * camera.fx + M_SQRT1_2;  // of points anywhere in the pixel
    const double radius_v = length * camera.fy + M_SQRT1_2;
    for (const double share : {0.0, 0.002, 0.05, 0.3}) {
      DepthImage image = flatImage(camera, 1.5f);
      std::bernoulli_distribution drop(share);
      for (float& depth : image.depth_m) {
        if (drop(rng)) depth = kNaN;
      }
      const ClassifiedFrame frame = DepthClassifier(camera, config).classify(image, 2);
      for (int v = 0; v < camera.height; ++v) {
        for (int u = 0; u < camera.width; ++u) {
          bool near = false;
          for (int j = 0; j < camera.height; ++j) {
            for (int i = 0; i < camera.width; ++i) {
              if (frame.kind[frame.index(i, j)] != PixelKind::kNoInformation) continue;
              if (std::hypot((i - u) / radius_u, (j - v) / radius_v) > 1.0 || isLonely(frame, i, j)) continue;
              near = true;
            }
          }
          ASSERT_EQ(frame.blocked[frame.index(u, v)] != Block::kNone, near) << u << ", " << v;
          num_blocked += near ? 1 : 0;
        }
      }
    }
  }
  EXPECT_GT(num_blocked, 1000u);
}

TEST(DepthClassifier, SpeckleBlocksNothingUnlessItMayHideAnEdge) {
  const CameraModel camera = wideCamera();
  const auto blockedBy = [&](const DepthImage& image) {
    const ClassifiedFrame frame = DepthClassifier(camera, GpisConfig()).classify(image, 1);
    return static_cast<std::ptrdiff_t>(frame.blocked.size()) -
           std::count(frame.blocked.begin(), frame.blocked.end(), Block::kNone);
  };
  const auto at = [&](int u, int v) { return static_cast<std::size_t>(v) * camera.width + u; };
  DepthImage image = flatImage(camera, 1.5f);
  image.depth_m[at(60, 4)] = kNaN;
  image.depth_m[at(61, 4)] = kNaN;
  image.depth_m[at(100, 0)] = kNaN;  // at the border
  EXPECT_EQ(blockedBy(image), 0);
  DepthImage blob = image;
  blob.depth_m[at(61, 5)] = kNaN;
  EXPECT_EQ(blockedBy(blob), 0) << "three";
  blob.depth_m[at(60, 5)] = kNaN;
  EXPECT_GT(blockedBy(blob), 4) << "four";
  DepthImage edge = image;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 62; u < camera.width; ++u) edge.depth_m[at(u, v)] = 1.7f;
  }
  EXPECT_GT(blockedBy(edge), 2) << "an edge within two pixels";
  DepthImage beside_wall = image;
  beside_wall.depth_m[at(62, 5)] = std::numeric_limits<float>::infinity();
  EXPECT_GT(blockedBy(beside_wall), 2) << "something ends here";
  DepthImage wall = flatImage(camera, std::numeric_limits<float>::infinity());
  wall.depth_m[at(60, 4)] = kNaN;
  EXPECT_EQ(blockedBy(wall), 0) << "nothing in reach all round";
  EXPECT_EQ(blockedBy(flatImage(camera, kNaN)), camera.width * camera.height);
}

TEST(DepthClassifier, BlocksBesideAShadowAreToldFromOthers) {
  // Left 1 m, right 1.5 m: the shadow is 525 px * 0.075 m * (1 - 1/1.5) / m = 13 px wide.
  const CameraModel camera = wideCamera();
  const auto blockBeside = [&](const GpisConfig& config, int width_px, float fill, float right_m) {
    DepthImage image = flatImage(camera, 1.0f);
    for (int v = 0; v < camera.height; ++v) {
      for (int u = 100; u < camera.width; ++u) {
        image.depth_m[static_cast<std::size_t>(v) * camera.width + u] = u < 100 + width_px ? fill : right_m;
      }
    }
    const ClassifiedFrame frame = DepthClassifier(camera, config).classify(image, 1);
    return frame.blocked[frame.index(99, 8)];
  };
  GpisConfig config;
  const float infinity = std::numeric_limits<float>::infinity();
  EXPECT_EQ(blockBeside(config, 13, kNaN, 1.5f), Block::kNarrow);
  EXPECT_EQ(blockBeside(config, 20, kNaN, 1.5f), Block::kNoInformation) << "wider than the shadow can be";
  EXPECT_EQ(blockBeside(config, 20, kNaN, infinity), Block::kNarrow) << "before nothing in reach it is 39 px wide";
  EXPECT_EQ(blockBeside(config, 13, kNaN, 1.0f), Block::kNoInformation) << "no depth edge: a mask";
  EXPECT_EQ(blockBeside(config, 13, -infinity, 1.5f), Block::kNoInformation) << "too near";
  EXPECT_EQ(blockBeside(config, 13, 0.1f, 1.5f), Block::kNoInformation) << "nearer than the least range";
  EXPECT_EQ(blockBeside(config, 13, 0.0f, 1.5f), Block::kNarrow) << "16-bit images";
  EXPECT_EQ(blockBeside(config, 100, 0.0f, 1.0f), Block::kNarrow) << "a hole, however wide";
  EXPECT_EQ(blockBeside(config, 300, kNaN, 1.5f), Block::kNoInformation) << "open to the image border";
  config.sensor.baseline_m = 0.0;
  EXPECT_EQ(blockBeside(config, 13, kNaN, 1.5f), Block::kNoInformation) << "a sensor without baseline has no shadows";
}

TEST(DepthClassifier, RefusesAnImageOfAnotherSize) {
  const DepthClassifier classifier(wideCamera(), GpisConfig());
  const auto message = [&](const DepthImage& image) -> std::string {
    try {
      classifier.classify(image, 1);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "no exception";
  };
  const std::string swapped = message({16, 320, std::vector<float>(16 * 320, 1.0f)});
  EXPECT_NE(swapped.find("16 x 320"), std::string::npos) << swapped;
  EXPECT_NE(swapped.find("320 x 16"), std::string::npos) << swapped;
  const std::string short_data = message({320, 16, std::vector<float>(100, 1.0f)});
  EXPECT_NE(short_data.find("100 values"), std::string::npos) << short_data;
  EXPECT_NE(message({}).find("0 x 0"), std::string::npos);
}

TEST(DepthImageFromU16, ScalesAndTakes65535AsHole) {
  const std::vector<std::uint16_t> raw = {0, 1, 1500, 65534, 65535, 5000};
  const DepthImage millimetres = depthImageFromU16(raw.data(), 3, 2, 1000.0);
  EXPECT_EQ(millimetres.width, 3);
  EXPECT_EQ(millimetres.height, 2);
  EXPECT_EQ(millimetres.at(0, 0), 0.0f);
  EXPECT_FLOAT_EQ(millimetres.at(1, 0), 0.001f);
  EXPECT_FLOAT_EQ(millimetres.at(2, 0), 1.5f);
  EXPECT_FLOAT_EQ(millimetres.at(0, 1), 65.534f);
  EXPECT_EQ(millimetres.at(1, 1), 0.0f);
  EXPECT_FLOAT_EQ(depthImageFromU16(raw.data(), 3, 2, 5000.0).at(2, 1), 1.0f);  // TUM's factor
  for (const double units : {0.0, -1.0, static_cast<double>(kInf), static_cast<double>(kNaN)}) {
    EXPECT_THROW(depthImageFromU16(raw.data(), 3, 2, units), std::invalid_argument) << units;
  }
}

TEST(DepthClassifier, InverseRangeIsCompleteForAnyInput) {
  const CameraModel camera{40, 24, 60.0, 55.0, 18.0, 13.0};  // wide: long rays
  const std::vector<float> specials = {0.0f,
                                       -0.0f,
                                       kInf,
                                       -kInf,
                                       kNaN,
                                       -kNaN,
                                       -1.0f,
                                       1e-45f,
                                       1e-38f,
                                       1e38f,
                                       3.4e38f,
                                       std::numeric_limits<float>::max(),
                                       std::numeric_limits<float>::lowest(),
                                       0.1f,
                                       0.3f,
                                       1.5f,
                                       1.51f,
                                       3.9f,
                                       100.0f,
                                       65.535f};
  std::mt19937 rng(2);
  std::uniform_int_distribution<std::size_t> pick(0, specials.size() - 1);
  std::uniform_int_distribution<int> length(1, 30);
  for (const HolePolicy policy : {HolePolicy::kAuto, HolePolicy::kWall, HolePolicy::kNoInformation}) {
    GpisConfig config;
    config.sensor.hole_policy = policy;
    const DepthClassifier classifier(camera, config);
    const float wall = static_cast<float>(1.0 / config.frame_map.wall_range_m);
    for (int trial = 0; trial < 300; ++trial) {
      DepthImage image = flatImage(camera, 1.0f);
      // Runs of one value: holes of all widths beside all kinds of borders. Whole images of one value at first.
      for (std::size_t i = 0; i < image.depth_m.size();) {
        const float value = static_cast<std::size_t>(trial) < specials.size()
                                ? specials[static_cast<std::size_t>(trial)]
                                : specials[pick(rng)];
        for (int run = length(rng); run > 0 && i < image.depth_m.size(); --run) image.depth_m[i++] = value;
      }
      const ClassifiedFrame frame = classifier.classify(image, 1);
      std::size_t surfaces = 0;
      for (std::size_t i = 0; i < frame.inverse_range.size(); ++i) {
        ASSERT_TRUE(std::isfinite(frame.inverse_range[i])) << image.depth_m[i];
        ASSERT_GE(frame.inverse_range[i], wall) << image.depth_m[i];
        ASSERT_LE(frame.inverse_range[i], 1.0f / 0.25f * 1.0001f) << image.depth_m[i];  // the minimum range
        ASSERT_TRUE(std::isfinite(frame.inverse_depth[i]));
        ASSERT_EQ(frame.inverse_depth[i] > 0.0f, frame.kind[i] == PixelKind::kSurface) << image.depth_m[i];
        surfaces += frame.kind[i] == PixelKind::kSurface;
      }
      ASSERT_EQ(frame.num_surface, surfaces);
    }
  }
}

TEST(DepthClassifier, DoesNotDependOnTheNumberOfThreads) {
  const CameraModel camera{64, 200, 100.0, 100.0, 31.5, 99.5};
  std::mt19937 rng(3);
  std::uniform_int_distribution<int> pick(0, 9);
  DepthImage image = flatImage(camera, 1.5f);
  for (float& depth : image.depth_m) depth = pick(rng) == 0 ? 0.0f : pick(rng) == 0 ? kNaN : 1.5f;
  const DepthClassifier classifier(camera, GpisConfig());
  const ClassifiedFrame one = classifier.classify(image, 1);
  const ClassifiedFrame three = classifier.classify(image, 3);
  EXPECT_EQ(one.kind, three.kind);
  EXPECT_EQ(one.inverse_range, three.inverse_range);
  EXPECT_EQ(one.blocked, three.blocked);
}

// A camera at (1, 2, 3) m that looks along the map's x axis.
TEST(DepthClassifier, ViewBoxHoldsTheCameraAndAllThatTheImageTells) {
  const GpisConfig config;
  const CameraModel camera = wideCamera();
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  T_map_camera.translation() << 1.0, 2.0, 3.0;
  const DepthClassifier classifier(camera, config);
  const auto boxOf = [&](const DepthImage& image) {
    return classifier.viewBox(classifier.classify(image, 1), T_map_camera);
  };
  constexpr double kFewPixels_m = 4.0 * 2.0 / 525.0;  // every fourth row and column, at 2 m
  DepthImage image = flatImage(camera, 2.0f);
  const Eigen::AlignedBox3d box = boxOf(image);
  EXPECT_EQ(box.min().x(), 1.0);
  EXPECT_NEAR(box.max().x(), 3.0, 1e-5);  // single precision
  EXPECT_NEAR(box.max().y(), 2.0 + 2.0 * 159.5 / 525.0, kFewPixels_m);
  EXPECT_NEAR(box.min().y(), 2.0 - 2.0 * 159.5 / 525.0, kFewPixels_m);
  EXPECT_NEAR(box.max().z(), 3.0 + 2.0 * 7.5 / 525.0, kFewPixels_m);
  setColumns(&image, 0, 160, kInf);  // nothing in reach: the image tells that it is free up to there
  EXPECT_NEAR(boxOf(image).max().x(), 1.0 + config.sensor.max_range_m, 1e-3);
  setColumns(&image, 0, 160, kNaN);  // masked
  EXPECT_NEAR(boxOf(image).max().x(), 3.0, 1e-5);
  EXPECT_EQ(boxOf(image).max().y(), 2.0) << "nothing is known left of the camera";
  const Eigen::AlignedBox3d none = boxOf(flatImage(camera, kNaN));
  EXPECT_EQ(none.min(), none.max()) << "the camera alone";
}

}  // namespace
}  // namespace gpis_mapping
