// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/frame_map.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "analytic_surfaces.h"
#include "dense_gp.h"
#include "depth_frames.h"
#include "eigen_asserts.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::DenseFrameTile;
using gpis_mapping_test::isNear;
using gpis_mapping_test::makeFrame;
using gpis_mapping_test::planeDepth;

/// A small cut-out with the focal lengths of a real camera; not square on purpose.
CameraModel smallCamera(int width = 53, int height = 38) {
  return {width, height, 525.0, 498.0, 0.5 * (width - 1) + 1.3, 0.5 * (height - 1) - 0.7};
}

/// Noise of an inverse range at the middle of the working range, as the map sets it up.
double noiseStd(const GpisConfig& config) {
  const double z = 0.5 * (config.sensor.min_range_m + config.sensor.max_range_m);
  return config.sensor.noise.sigma(z) / (z * z);
}

std::shared_ptr<const FrameRegressor> makeRegressor(const CameraModel& camera, const GpisConfig& config) {
  return std::make_shared<const FrameRegressor>(camera, config.frame_map, noiseStd(config));
}

/// A smooth random image: a slope and a few waves of the size of a tile.
std::shared_ptr<ClassifiedFrame> smoothFrame(const CameraModel& camera, std::mt19937* rng, double noise = 0.0) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::normal_distribution<double> normal;
  const double base = 0.6 + 0.2 * uniform(*rng);
  const double slope_u = 0.002 * uniform(*rng);
  const double slope_v = 0.002 * uniform(*rng);
  struct Wave {
    double u, v, phase, amplitude;
  };
  std::vector<Wave> waves;
  for (int i = 0; i < 4; ++i) {
    waves.push_back({0.3 * uniform(*rng), 0.3 * uniform(*rng), 3.0 * uniform(*rng), 0.004 * uniform(*rng)});
  }
  auto frame = makeFrame(camera, [](int, int) { return 1.0; });
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      double y = base + slope_u * u + slope_v * v + noise * normal(*rng);
      for (const Wave& wave : waves) y += wave.amplitude * std::sin(wave.u * u + wave.v * v + wave.phase);
      frame->inverse_range[frame->index(u, v)] = static_cast<float>(y);
    }
  }
  return frame;
}

/// First pixel of the window that serves pixel p: the tile with its overlap, moved inwards at the border.
int windowStart(int p, int tile, int window, int size) {
  int start = p / tile * tile - (window - tile) / 2;
  while (start < 0) ++start;
  while (start + window > size) --start;
  return start;
}

/// The dense GP of the tile that serves pixel (pu, pv).
DenseFrameTile denseTile(const FrameRegressor& regressor, const ClassifiedFrame& frame, const GpisConfig& config,
                         int pu, int pv) {
  const int window = regressor.window();
  const int start_u = windowStart(pu, config.frame_map.tile_px, window, frame.width);
  const int start_v = windowStart(pv, config.frame_map.tile_px, window, frame.height);
  std::vector<double> values;
  for (int j = 0; j < window; ++j) {
    for (int i = 0; i < window; ++i) {
      values.push_back(static_cast<double>(frame.inverse_range[frame.index(start_u + i, start_v + j)]));
    }
  }
  return DenseFrameTile(regressor.camera(), 1.0 / config.frame_map.kernel_length_rad,
                        std::pow(config.frame_map.prior_std_per_m, 2), std::pow(noiseStd(config), 2), window, start_u,
                        start_v, values);
}

TEST(FrameMap, MatchesDenseGpPerTile) {
  // Sizes that are and are not multiples of the tile, down to the smallest camera allowed, and the largest windows.
  struct Case {
    int width, height, tile_px, overlap_px;
  };
  std::mt19937 rng(1);
  for (const Case& c : {Case{48, 32, 8, 2}, Case{53, 38, 4, 2}, Case{17, 16, 8, 2}, Case{31, 22, 5, 3},
                        Case{33, 19, 8, 0}, Case{20, 16, 16, 6}}) {
    SCOPED_TRACE(testing::Message() << c.width << " x " << c.height << ", tile " << c.tile_px << " + " << c.overlap_px);
    GpisConfig config;
    config.frame_map.tile_px = c.tile_px;
    config.frame_map.overlap_px = c.overlap_px;
    const CameraModel camera = smallCamera(c.width, c.height);
    const auto regressor = makeRegressor(camera, config);
    EXPECT_EQ(regressor->window(), std::min({c.tile_px + 2 * c.overlap_px, c.width, c.height}));
    const auto frame = smoothFrame(camera, &rng, 0.001);
    const FrameMap map(regressor, frame, config.sensor.noise, 1);
    for (int v = 0; v < c.height; v += c.tile_px) {
      for (int u = 0; u < c.width; u += c.tile_px) {
        const DenseFrameTile dense = denseTile(*regressor, *frame, config, u, v);
        std::uniform_real_distribution<double> inside(-0.49, c.tile_px - 0.51);
        for (int i = 0; i < 10; ++i) {
          // A tile answers for half a pixel round its own pixels.
          const double pu = std::max(0.0, std::min(c.width - 1.0, u + inside(rng)));
          const double pv = std::max(0.0, std::min(c.height - 1.0, v + inside(rng)));
          // The weights are interpolated over a quarter of a pixel, and the kernel has a cusp at every pixel: linear
          // interpolation about it is off by a hundredth of the kernel at the nearest pixel, of whose residual (1e-2 /m)
          // the mean takes half: 5e-5 /m, a fortieth of the noise.
          EXPECT_NEAR(map.infer(pu, pv).inverse_range, dense.infer(pu, pv).mean, 5e-5) << pu << ", " << pv;
          // Where the table has its entries only floats are left: values near 0.6 /m round by 3e-8, and hundreds are summed.
          const double grid_u = std::round(4.0 * pu) / 4.0;
          const double grid_v = std::round(4.0 * pv) / 4.0;
          const auto inTile = [](double p, double first, int tile, int size) {
            return p > first - 0.49 && p < first + tile - 0.51 && p >= 0.0 && p <= size - 1.0;
          };
          if (!inTile(grid_u, u, c.tile_px, c.width) || !inTile(grid_v, v, c.tile_px, c.height)) continue;
          EXPECT_NEAR(map.infer(grid_u, grid_v).inverse_range, dense.infer(grid_u, grid_v).mean, 2e-6)
              << grid_u << ", " << grid_v;
        }
      }
    }
  }
}

TEST(FrameMap, SigmaMatchesDenseGpScaledToTheTilesNoise) {
  const GpisConfig config;
  const CameraModel camera = smallCamera();
  const auto regressor = makeRegressor(camera, config);
  std::mt19937 rng(2);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  double squares = 0.0;
  int count = 0;
  for (const double z : {0.5, 1.0, 2.0, 3.5}) {
    const auto frame = makeFrame(camera, [z](int, int) { return z; });
    const FrameMap map(regressor, frame, config.sensor.noise, 1);
    // The same covariance serves near and far tiles; noise and prior are scaled together.
    const double scale = config.sensor.noise.sigma(z) / (z * z) / noiseStd(config);
    for (int i = 0; i < 40; ++i) {
      const double u = uniform(rng) * (camera.width - 1);
      const double v = uniform(rng) * (camera.height - 1);
      const DenseFrameTile dense =
          denseTile(*regressor, *frame, config, static_cast<int>(u + 0.5), static_cast<int>(v + 0.5));
      const double expected = scale * std::sqrt(dense.infer(u, v).variance);
      // The table has four steps per pixel: an eighth of a pixel off, where the variance has a cusp at every pixel,
      // is up to 15 % and 5 % on average; range instead of depth in the scale is below 1 %.
      const double relative = map.infer(u, v).sigma / expected - 1.0;
      EXPECT_NEAR(relative, 0.0, 0.2) << z << " m, " << u << ", " << v;
      squares += relative * relative;
      ++count;
    }
  }
  EXPECT_LT(std::sqrt(squares / count), 0.08);
}

TEST(FrameRegressor, VarianceTableIsExactOnItsGrid) {
  const GpisConfig config;
  const CameraModel camera = smallCamera();
  const FrameRegressor regressor(camera, config.frame_map, noiseStd(config));
  const int window = regressor.window();
  const DenseFrameTile dense(
      camera, 1.0 / config.frame_map.kernel_length_rad, std::pow(config.frame_map.prior_std_per_m, 2),
      std::pow(noiseStd(config), 2), window, 0, 0,
      std::vector<double>(static_cast<std::size_t>(window) * static_cast<std::size_t>(window), 0.5));
  std::mt19937 rng(3);
  std::uniform_int_distribution<int> quarter(0, 4 * (window - 1));
  const double prior = std::pow(config.frame_map.prior_std_per_m, 2);
  double largest = 0.0;
  for (int i = 0; i < 300; ++i) {
    const double u = 0.25 * quarter(rng);
    const double v = 0.25 * quarter(rng);
    // Kept as float, computed in double.
    EXPECT_NEAR(regressor.variance(u, v), dense.infer(u, v).variance, 1e-6 * prior);
    EXPECT_GE(regressor.variance(u, v), 0.0);
    largest = std::max(largest, regressor.variance(u, v));
  }
  EXPECT_LT(largest, prior);
  // At a pixel the posterior is better than the pixel's own noise.
  EXPECT_LT(regressor.variance(5.0, 5.0), std::pow(noiseStd(config), 2));
}

TEST(FrameMap, DoesNotDependOnTheNumberOfThreads) {
  const GpisConfig config;
  const CameraModel camera = smallCamera(200, 170);
  const auto regressor = makeRegressor(camera, config);
  std::mt19937 rng(4);
  const auto frame = smoothFrame(camera, &rng, 0.001);
  const FrameMap one(regressor, frame, config.sensor.noise, 1);
  const FrameMap two(regressor, frame, config.sensor.noise, 2);
  for (int v = 0; v < camera.height; v += 3) {
    for (int u = 0; u < camera.width; u += 3) {
      // Rows of tiles are one unit of work whatever the number of threads.
      ASSERT_EQ(one.infer(u, v).inverse_range, two.infer(u, v).inverse_range);
      ASSERT_EQ(one.isSmooth(u, v), two.isSmooth(u, v));
      ASSERT_EQ(one.nearestAround(u, v), two.nearestAround(u, v));
    }
  }
}

TEST(FrameMap, AgreesAcrossTileBordersWithinSigma) {
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  const auto regressor = makeRegressor(camera, config);
  std::mt19937 rng(5);
  int within = 0;
  int total = 0;
  for (int trial = 0; trial < 5; ++trial) {
    const auto frame = smoothFrame(camera, &rng, noiseStd(config));
    const FrameMap map(regressor, frame, config.sensor.noise, 1);
    for (int border = config.frame_map.tile_px; border < 64; border += config.frame_map.tile_px) {
      for (double across = 1.0; across < 46.0; across += 1.7) {
        const FrameMap::Inference left = map.infer(border - 0.5 - 1e-6, across);
        const FrameMap::Inference right = map.infer(border - 0.5 + 1e-6, across);
        ++total;
        within += std::abs(left.inverse_range - right.inverse_range) < left.sigma ? 1 : 0;
        EXPECT_LT(std::abs(left.inverse_range - right.inverse_range), 3.0 * left.sigma);
      }
    }
  }
  // Two windows that share half of their pixels differ at their border by less than either is uncertain.
  EXPECT_GT(within, 0.95 * total);
}

TEST(FrameMap, PredictsHeldBackPixelsAsWellAsItsSigmaSays) {
  // Inference between noisy pixels of a plane: the error's chi-square per sample. The posterior assumes a rougher prior
  // than a plane is, so it is never optimistic.
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  const auto regressor = makeRegressor(camera, config);
  const double z = 2.125;
  std::mt19937 rng(6);
  std::normal_distribution<double> normal;
  double chi2 = 0.0;
  int count = 0;
  for (int trial = 0; trial < 10; ++trial) {
    const auto frame = makeFrame(camera, [&](int, int) { return z + config.sensor.noise.sigma(z) * normal(rng); });
    const FrameMap map(regressor, frame, config.sensor.noise, 1);
    for (double v = 0.3; v < 47.0; v += 2.3) {
      for (double u = 0.4; u < 63.0; u += 2.3) {
        const FrameMap::Inference seen = map.infer(u, v);
        chi2 += std::pow((seen.inverse_range - 1.0 / (z * camera.ray(u, v).norm())) / seen.sigma, 2);
        ++count;
      }
    }
  }
  EXPECT_LT(chi2 / count, 1.0);
  EXPECT_GT(chi2 / count, 0.2);  // and not uselessly pessimistic
}

TEST(FrameMap, PlaneIsSmoothAndStepEdgeIsNot) {
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  const auto regressor = makeRegressor(camera, config);
  std::mt19937 rng(7);
  std::normal_distribution<double> normal;
  const Eigen::Vector3d n = Eigen::Vector3d(0.4, 0.2, -1.0).normalized();
  const auto noisy = [&](double z) { return z + config.sensor.noise.sigma(z) * normal(rng); };
  const auto plane_frame =
      makeFrame(camera, [&](int u, int v) { return noisy(planeDepth(camera.ray(u, v), n, n.z() * 1.5)); });
  const FrameMap plane(regressor, plane_frame, config.sensor.noise, 1);
  const int tile = config.frame_map.tile_px;
  const int window = regressor->window();
  int smooth = 0;
  for (int v = 0; v < 48; v += tile) {
    for (int u = 0; u < 64; u += tile) smooth += plane.isSmooth(u, v);
  }
  EXPECT_GE(smooth, 191);  // of 192: thresholds at four standard deviations of the rms and 4.5 of a sample

  // 5 cm at 1.5 m, over five sigma. The windows (tile and overlap) that hold both sides are not smooth, the others are.
  const int edge = 28;
  const auto step_frame = makeFrame(camera, [&](int u, int) { return noisy(u < edge ? 1.5 : 1.55); });
  const FrameMap step(regressor, step_frame, config.sensor.noise, 1);
  for (int v = 0; v < 48; v += tile) {
    for (int u = 0; u < 64; u += tile) {
      const int start = windowStart(u, tile, window, 64);
      const bool straddles = start < edge && start + window > edge;
      EXPECT_EQ(step.isSmooth(u, v), !straddles) << u << ", " << v;
      EXPECT_EQ(step.infer(u, v).smooth, step.isSmooth(u, v));
    }
  }
}

TEST(FrameMap, RippleOrOutlierAboveTheNoiseIsNotSmooth) {
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  const auto regressor = makeRegressor(camera, config);
  const double z = 1.5;
  const auto smoothAt = [&](const std::function<double(int, int)>& sigmas) {
    const auto frame = makeFrame(camera, [&](int u, int v) { return z + config.sensor.noise.sigma(z) * sigmas(u, v); });
    return FrameMap(regressor, frame, config.sensor.noise, 1).isSmooth(28, 20);
  };
  EXPECT_TRUE(smoothAt([](int, int) { return 0.0; }));
  // Bounds: rms 1.35 sigma, largest 4.5 sigma. A ripple of amplitude A has rms A / sqrt 2 and no large sample.
  EXPECT_TRUE(smoothAt([](int u, int) { return 1.5 * std::sin(1.3 * u); }));
  EXPECT_FALSE(smoothAt([](int u, int) { return 2.5 * std::sin(1.3 * u); }));
  // One pixel of 64: its rms is an eighth.
  EXPECT_TRUE(smoothAt([](int u, int v) { return u == 28 && v == 20 ? 4.0 : 0.0; }));
  EXPECT_FALSE(smoothAt([](int u, int v) { return u == 28 && v == 20 ? 6.0 : 0.0; }));
}

TEST(FrameMap, TrendNormalMatchesPlanesUpToGrazing) {
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  const auto regressor = makeRegressor(camera, config);
  for (const double incidence_deg : {0.0, 20.0, 45.0, 60.0, 70.0}) {
    for (double turn = 0.0; turn < 6.0; turn += 1.1) {
      const double incidence = incidence_deg * M_PI / 180.0;
      const Eigen::Vector3d n(std::sin(incidence) * std::cos(turn), std::sin(incidence) * std::sin(turn),
                              -std::cos(incidence));  // towards the camera
      const auto frame = makeFrame(camera, [&](int u, int v) { return planeDepth(camera.ray(u, v), n, n.z() * 1.2); });
      const FrameMap map(regressor, frame, config.sensor.noise, 1);
      for (double v = 2.0; v < 47.0; v += 7.3) {
        for (double u = 1.0; u < 63.0; u += 7.3) {
          const Eigen::Vector3f seen = map.trendNormal(u, v);
          EXPECT_NEAR(seen.norm(), 1.0, 1e-6);
          // Inverse depth of a plane is linear, inverse range is that over |(theta, 1)|, whose second derivative is 1:
          // the slope is off by the distance to the window's centre, at most 8 px / 500 px = 0.016 rad at the image's
          // corner.
          EXPECT_GT(seen.cast<double>().dot(n), std::cos(0.017)) << incidence_deg << " deg at " << u << ", " << v;
        }
      }
    }
  }
}

TEST(FrameMap, NearestAroundMatchesBruteForce) {
  const GpisConfig config;
  std::mt19937 rng(8);
  for (const auto& [width, height] : {std::pair<int, int>{16, 16}, {53, 38}, {130, 70}}) {
    const CameraModel camera = smallCamera(width, height);
    auto frame = makeFrame(camera, [](int, int) { return 1.0; });
    std::uniform_real_distribution<float> uniform(0.01f, 4.0f);
    for (float& y : frame->inverse_range) y = uniform(rng);
    const FrameMap map(makeRegressor(camera, config), frame, config.sensor.noise, 2);
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u) {
        float largest = 0.0f;
        for (int j = std::max(0, v - 2); j <= std::min(height - 1, v + 2); ++j) {
          for (int i = std::max(0, u - 2); i <= std::min(width - 1, u + 2); ++i) {
            largest = std::max(largest, frame->inverse_range[frame->index(i, j)]);
          }
        }
        ASSERT_EQ(map.nearestAround(u, v), largest) << u << ", " << v;
      }
    }
  }
}

TEST(FitLocalPlane, RecoversPlanesExactlyWithoutNoise) {
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  for (const double incidence_deg : {0.0, 30.0, 60.0, 75.0}) {
    const double incidence = incidence_deg * M_PI / 180.0;
    const Eigen::Vector3d n(std::sin(incidence) * 0.6, std::sin(incidence) * 0.8, -std::cos(incidence));
    const auto frame = makeFrame(camera, [&](int u, int v) { return planeDepth(camera.ray(u, v), n, n.z() * 1.2); });
    for (const auto& [u, v] : {std::pair<int, int>{30, 20}, {3, 20}, {60, 30}, {30, 45}}) {
      LocalPlane plane;
      ASSERT_TRUE(fitLocalPlane(*frame, camera, config.sensor.noise, u, v, 0.02, &plane)) << u << ", " << v;
      const Eigen::Vector3d ray = camera.ray(u, v);
      // Inverse depth is linear: only the floats of the image (6e-8 of 1 /m, times z^2) are left.
      EXPECT_TRUE(isNear(plane.point_camera, ray * planeDepth(ray, n, n.z() * 1.2), 1e-6));
      EXPECT_GT(plane.normal_camera.cast<double>().dot(n), 1.0 - 1e-6);
      EXPECT_GT(plane.depth_std_m, 0.0);
    }
  }
}

TEST(FitLocalPlane, ErrorsAreWhatItsStandardDeviationsSay) {
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  struct Case {
    int u, v;
    double incidence_deg, z;
  };
  // In the middle, and at the border, where the patch is one-sided.
  for (const Case& c : {Case{30, 20, 0.0, 1.0}, Case{30, 20, 50.0, 1.5}, Case{30, 20, 0.0, 3.0}, Case{3, 20, 0.0, 1.5},
                        Case{60, 30, 30.0, 1.5}}) {
    SCOPED_TRACE(testing::Message() << c.u << ", " << c.v << ", " << c.incidence_deg << " deg, " << c.z << " m");
    const double incidence = c.incidence_deg * M_PI / 180.0;
    const Eigen::Vector3d n(std::sin(incidence), 0.0, -std::cos(incidence));
    const Eigen::Vector3d ray = camera.ray(c.u, c.v);
    std::mt19937 rng(9);
    std::normal_distribution<double> normal;
    double depth_chi2 = 0.0;
    double normal_chi2 = 0.0;
    int count = 0;
    constexpr int kTrials = 400;
    for (int trial = 0; trial < kTrials; ++trial) {
      const auto frame = makeFrame(camera, [&](int u, int v) {
        const double z = planeDepth(camera.ray(u, v), n, n.z() * c.z);
        return z + config.sensor.noise.sigma(z) * normal(rng);
      });
      LocalPlane plane;
      if (!fitLocalPlane(*frame, camera, config.sensor.noise, c.u, c.v, 0.03, &plane)) continue;
      ++count;
      depth_chi2 += std::pow((plane.point_camera.z() - planeDepth(ray, n, n.z() * c.z)) / plane.depth_std_m, 2);
      const Eigen::Vector3d seen = plane.normal_camera.cast<double>();
      normal_chi2 += (seen - n.dot(seen) * n).squaredNorm() / (2.0 * plane.normal_var);
    }
    EXPECT_GT(count, 0.95 * kTrials);
    // Mean of 400 chi-square samples: 1 +- 0.07. Clipping at three sigma and a variance taken at the noisy centre pixel
    // shift it by some 10 %; the normal's variance is that of its worst axis and an isotropic camera.
    EXPECT_NEAR(depth_chi2 / count, 1.0, 0.35);
    EXPECT_GT(normal_chi2 / count, 0.3);
    EXPECT_LT(normal_chi2 / count, 1.5);
  }
}

TEST(FitLocalPlane, StaysOnItsOwnSideOfAStepEdge) {
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  const int edge = 30;
  std::mt19937 rng(10);
  std::normal_distribution<double> normal;
  for (const double step : {0.06, 0.3}) {
    const auto frame = makeFrame(camera, [&](int u, int) {
      const double z = u < edge ? 1.2 : 1.2 + step;
      return z + config.sensor.noise.sigma(z) * normal(rng);
    });
    for (int u = 3; u < 61; ++u) {
      LocalPlane plane;
      const bool fitted = fitLocalPlane(*frame, camera, config.sensor.noise, u, 20, 0.02, &plane);
      const bool seed_straddles = u - 2 < edge && u + 2 >= edge;
      EXPECT_EQ(fitted, !seed_straddles) << "u = " << u << ", step " << step;
      if (!fitted) continue;
      // Five standard deviations of the fit; the step is twenty and more.
      EXPECT_NEAR(plane.point_camera.z(), u < edge ? 1.2 : 1.2 + step, 5.0 * plane.depth_std_m) << "u = " << u;
      EXPECT_LT(plane.depth_std_m, 0.01);
    }
  }
}

TEST(FitLocalPlane, LiesOnOneOfTwoNearSurfaces) {
  // A step of six sigma is within the gate of two sigma on both sides of a plane that runs up it.
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  const double sigma = config.sensor.noise.sigma(2.0);
  std::mt19937 rng(12);
  std::normal_distribution<double> normal;
  struct Fits {
    int count;
    int between;  // more than a sigma, three standard deviations of a plane, off the surface that the pixel shows
  };
  const auto fitsBeside = [&](double step_m) {
    Fits fits{0, 0};
    for (int trial = 0; trial < 100; ++trial) {
      const auto frame =
          makeFrame(camera, [&](int u, int) { return (u < 30 ? 2.0 : 2.0 + step_m) + sigma * normal(rng); });
      for (int u = 24; u < 36; ++u) {  // the step within their patch
        LocalPlane plane;
        if (!fitLocalPlane(*frame, camera, config.sensor.noise, u, 20, 0.02, &plane)) continue;
        ++fits.count;
        fits.between += std::abs(plane.point_camera.z() - (u < 30 ? 2.0 : 2.0 + step_m)) > sigma;
      }
    }
    return fits;
  };
  EXPECT_GE(fitsBeside(0.0).count,
            1188);  // of a wall's 1200 patches: the limit is 2.5 standard deviations of their rms
  // Noise of two sigma hides on which side of a step of four a pixel lies.
  for (const auto& [step, share_between] : {std::pair(4.0, 0.4), std::pair(5.0, 0.22), std::pair(6.0, 0.12)}) {
    const Fits fits = fitsBeside(step * sigma);
    EXPECT_GT(fits.count, 780) << step;  // of 1200; the seeds of 400 straddle the step
    EXPECT_LT(fits.between, share_between * fits.count) << step;
  }
}

TEST(FitLocalPlane, RefusesTextureRougherThanTheNoise) {
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  std::mt19937 rng(11);
  std::normal_distribution<double> normal;
  // Seeds are refused from an rms of 1.7 sigma on. That of 25 pixels of 4 sigma is 3.8, with a deviation of 0.6.
  for (const double roughness : {1.0, 4.0}) {
    const auto frame =
        makeFrame(camera, [&](int, int) { return 1.2 + roughness * config.sensor.noise.sigma(1.2) * normal(rng); });
    int fitted = 0;
    for (int u = 12; u < 52; ++u) {
      LocalPlane plane;
      fitted += fitLocalPlane(*frame, camera, config.sensor.noise, u, 20, 0.02, &plane) ? 1 : 0;
    }
    if (roughness > 1.0) {
      EXPECT_LE(fitted, 2);  // of 40
    } else {
      EXPECT_EQ(fitted, 40);
    }
  }
}

TEST(FitLocalPlane, RefusesWhatIsNoSurface) {
  const GpisConfig config;
  const CameraModel camera = smallCamera(64, 48);
  const auto frame = makeFrame(camera, [](int, int) { return 1.2; });
  LocalPlane plane;
  EXPECT_TRUE(fitLocalPlane(*frame, camera, config.sensor.noise, 30, 20, 0.02, &plane));
  for (const PixelKind kind : {PixelKind::kWall, PixelKind::kHole, PixelKind::kNoInformation}) {
    ClassifiedFrame spoilt = *frame;
    spoilt.kind[spoilt.index(30, 20)] = kind;
    EXPECT_FALSE(fitLocalPlane(spoilt, camera, config.sensor.noise, 30, 20, 0.02, &plane));  // itself
    EXPECT_FALSE(fitLocalPlane(spoilt, camera, config.sensor.noise, 32, 19, 0.02, &plane));  // in the seed
    EXPECT_TRUE(fitLocalPlane(spoilt, camera, config.sensor.noise, 33, 20, 0.02, &plane));   // beside it
  }
  // Too near the border for a seed.
  for (const auto& [u, v] : {std::pair<int, int>{1, 20}, {62, 20}, {30, 1}, {30, 46}}) {
    EXPECT_FALSE(fitLocalPlane(*frame, camera, config.sensor.noise, u, v, 0.02, &plane)) << u << ", " << v;
  }
}

}  // namespace
}  // namespace gpis_mapping
