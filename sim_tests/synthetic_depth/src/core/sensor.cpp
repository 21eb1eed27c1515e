// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/sensor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <vector>

#include <interactive_mapping_common/threads/parallel_for.h>

#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/missing_returns.h"
#include "synthetic_depth/seeded_random.h"

namespace synthetic_depth {
namespace {

using interactive_mapping::parallelFor;
using interactive_mapping::resolveThreadCount;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Which of the normal values an image needs.
struct NeededDraws {
  bool jitter, axial;
};

/// Standard normal pairs as SeededRandom::normalPair() makes them, bit for bit, for many generators at once: step by step
/// for all of them, so that the processor works at several logarithms, and then cosines, at the same time.
class NormalPairs {
 public:
  explicit NormalPairs(std::size_t count) : radius_(count), angle_(count) {}

  void take(std::size_t i, SeededRandom& random) {
    radius_[i] = 1.0 - random.uniform();
    angle_[i] = 2.0 * 3.14159265358979323846 * random.uniform();
  }
  /// After take() of all.
  void evaluate() {
    for (double& radius : radius_) radius = std::log(radius);
    for (double& radius : radius_) radius = std::sqrt(-2.0 * radius);
  }
  double first(std::size_t i) const { return radius_[i] * std::cos(angle_[i]); }
  double second(std::size_t i) const { return radius_[i] * std::sin(angle_[i]); }

 private:
  std::vector<double> radius_;
  std::vector<double> angle_;
};

/// Draws of a row of pixels. Each pixel's are taken from a stream of its own, always in this order, so that effects do
/// not disturb each other. Those of an effect that is off are used up and not evaluated.
class RowDraws {
 public:
  RowDraws(std::size_t width, const NeededDraws& needed)
      : needed_(needed),
        jitter_(needed.jitter ? width : 0),
        axial_(needed.axial ? width : 0),
        later_(width, SeededRandom(0)) {}

  void draw(const SeededStreams& streams, std::uint64_t first_pixel) {
    for (std::size_t u = 0; u < later_.size(); ++u) {
      SeededRandom random = streams.stream(first_pixel + u);
      takePair(jitter_, needed_.jitter, u, random);
      takePair(axial_, needed_.axial, u, random);
      later_[u] = random;
    }
    jitter_.evaluate();
    axial_.evaluate();
  }

  double jitterU(std::size_t u) const { return jitter_.first(u); }
  double jitterV(std::size_t u) const { return jitter_.second(u); }
  double axial(std::size_t u) const { return needed_.axial ? axial_.first(u) : 0.0; }
  /// The pixel's stream from here on: chance of an edge, its weight, chance of a dropout.
  SeededRandom later(std::size_t u) const { return later_[u]; }

 private:
  static void takePair(NormalPairs& pairs, bool is_needed, std::size_t u, SeededRandom& random) {
    if (is_needed) {
      pairs.take(u, random);
    } else {
      random.next();
      random.next();
    }
  }

  NeededDraws needed_;
  NormalPairs jitter_;
  NormalPairs axial_;
  std::vector<SeededRandom> later_;
};

/// A draw that is used up if it is not needed, and then stands for a chance that never comes true.
double uniformIf(bool is_needed, SeededRandom& random) {
  if (is_needed) return random.uniform();
  random.next();
  return 1.0;
}

/// The one of the four neighbours whose depth differs most from `z`; `z` itself where no jump exceeds the threshold.
/// The border to "no return" is no edge: there is nothing to mix with.
double depthAcrossEdge(const cv::Mat& depth_m, int u, int v, double z, double threshold_m) {
  constexpr std::array<std::array<int, 2>, 4> kNeighbours{{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};
  double across = z;
  double largest_jump = threshold_m;
  for (const auto& [du, dv] : kNeighbours) {
    if (u + du < 0 || u + du >= depth_m.cols || v + dv < 0 || v + dv >= depth_m.rows) {
      continue;
    }
    const double other = depth_m.at<float>(v + dv, u + du);
    if (std::isfinite(other) && std::abs(other - z) > largest_jump) {
      largest_jump = std::abs(other - z);
      across = other;
    }
  }
  return across;
}

/// Depth where a ray between pixels meets the surface of an image. The inverse depth of a plane is linear in the image;
/// across an edge, and next to "no return", the nearest pixel decides. Rays outside see what the border pixel sees.
double depthBetweenPixels(const cv::Mat& depth_m, double u, double v, double edge_threshold_m) {
  const double inside_u = std::clamp(u, 0.0, depth_m.cols - 1.0);
  const double inside_v = std::clamp(v, 0.0, depth_m.rows - 1.0);
  const int left = std::min(static_cast<int>(inside_u), std::max(0, depth_m.cols - 2));
  const int top = std::min(static_cast<int>(inside_v), std::max(0, depth_m.rows - 2));
  const int right = std::min(left + 1, depth_m.cols - 1);
  const int bottom = std::min(top + 1, depth_m.rows - 1);
  const std::array<double, 4> corners{depth_m.at<float>(top, left), depth_m.at<float>(top, right),
                                      depth_m.at<float>(bottom, left), depth_m.at<float>(bottom, right)};
  // Without branches: which corner is the nearest is as good as random.
  const double low = std::min(std::min(corners[0], corners[1]), std::min(corners[2], corners[3]));
  const double high = std::max(std::max(corners[0], corners[1]), std::max(corners[2], corners[3]));
  if (!(low > 0.0) || !(high - low <= edge_threshold_m)) {
    return depth_m.at<float>(static_cast<int>(std::lround(inside_v)), static_cast<int>(std::lround(inside_u)));
  }
  const double across = inside_u - left;
  const double down = inside_v - top;
  return 1.0 / ((1.0 - down) * ((1.0 - across) / corners[0] + across / corners[1]) +
                down * ((1.0 - across) / corners[2] + across / corners[3]));
}

void requireImage(const char* what, const cv::Mat& image, const CameraModel& camera, int type, const char* type_name) {
  if (image.type() != type || image.cols != camera.width_px || image.rows != camera.height_px) {
    throw std::invalid_argument("applySensor: " + std::string(what) + " is " + std::to_string(image.cols) + " x " +
                                std::to_string(image.rows) + " of OpenCV type " + std::to_string(image.type()) +
                                ", must be " + std::to_string(camera.width_px) + " x " +
                                std::to_string(camera.height_px) + " px of " + type_name);
  }
}

/// Everything but the geometry: depthOfRay(u, v) [m] is asked for jittered rays, isShadowed(u, v, ray_u, ray_v, z) for
/// every pixel with a return; both from several threads. No pixel depends on what another one drew.
template <typename DepthOfRay, typename IsShadowed>
cv::Mat measure(const CameraModel& camera, const SensorModel& sensor, std::uint64_t seed, std::uint64_t frame,
                const cv::Mat& exact_depth_m, const DepthOfRay& depthOfRay, const IsShadowed& isShadowed) {
  const bool has_jitter = sensor.lateral_jitter_px > 0.0;
  const bool has_axial_noise =
      sensor.axial_noise_a_m != 0.0 || sensor.axial_noise_b != 0.0 || sensor.axial_noise_c_per_m != 0.0;
  const bool has_edges = sensor.edge_mixing_fraction > 0.0;
  const bool has_dropouts = sensor.dropout_probability > 0.0;
  const SeededStreams streams(seed, frame);
  cv::Mat measured_m(exact_depth_m.size(), CV_32FC1);
  const auto measureRow = [&](int v, RowDraws& draws) {
    draws.draw(streams, static_cast<std::uint64_t>(v) * static_cast<std::uint64_t>(measured_m.cols));
    for (int u = 0; u < measured_m.cols; ++u) {
      const auto column = static_cast<std::size_t>(u);
      SeededRandom random = draws.later(column);
      const double edge_chance = uniformIf(has_edges, random);
      const double edge_weight = uniformIf(has_edges, random);
      const double dropout_chance = uniformIf(has_dropouts, random);

      double ray_u = u;
      double ray_v = v;
      double z = exact_depth_m.at<float>(v, u);
      if (has_jitter) {
        ray_u += sensor.lateral_jitter_px * draws.jitterU(column);
        ray_v += sensor.lateral_jitter_px * draws.jitterV(column);
        z = depthOfRay(ray_u, ray_v);
      }

      if (std::isfinite(z)) {
        const bool is_shadowed = isShadowed(u, v, ray_u, ray_v, z);
        if (edge_chance < sensor.edge_mixing_fraction) {
          z += edge_weight * (depthAcrossEdge(exact_depth_m, u, v, z, sensor.edge_threshold_m) - z);
        }
        z += axialSigma(sensor, z) * draws.axial(column);
        if (sensor.disparity_step_px > 0.0 && z > 0.0) {
          const double fx_baseline = camera.fx_px * sensor.baseline_m;
          const double disparity_px = std::round(fx_baseline / z / sensor.disparity_step_px) * sensor.disparity_step_px;
          z = disparity_px > 0.0 ? fx_baseline / disparity_px : std::numeric_limits<double>::infinity();
        }
        if (z < sensor.min_range_m || z <= 0.0) {
          z = -std::numeric_limits<double>::infinity();
        } else if (z > sensor.max_range_m) {
          z = std::numeric_limits<double>::infinity();
        }
        if (is_shadowed || dropout_chance < sensor.dropout_probability) {
          z = kNaN;
        }
      }
      measured_m.at<float>(v, u) = static_cast<float>(z);
    }
  };
  constexpr std::size_t kRowsAtATime = 16;
  parallelFor(static_cast<std::size_t>(measured_m.rows), resolveThreadCount(0), kRowsAtATime,
              [&](std::size_t begin, std::size_t end) {
                RowDraws draws(static_cast<std::size_t>(measured_m.cols), {has_jitter, has_axial_noise});
                for (std::size_t v = begin; v < end; ++v) measureRow(static_cast<int>(v), draws);
              });
  return measured_m;
}

void lose(const cv::Mat& missing, cv::Mat* measured_m) {
  if (!missing.empty()) measured_m->setTo(kNaN, missing);
}

/// Albedo of what each pixel sees; empty if it does not matter.
cv::Mat albedoOf(const Scene& scene, const ViewCaster& view) {
  std::map<int, float> albedo_of_box;
  for (const Box& box : scene.boxes) {
    if (box.albedo != 1.0) albedo_of_box[box.id] = static_cast<float>(box.albedo);
  }
  if (scene.sensor.min_return_per_m2 == 0.0 || albedo_of_box.empty()) return {};
  cv::Mat albedo(scene.camera.height_px, scene.camera.width_px, CV_32FC1, cv::Scalar(1.0));
  parallelFor(static_cast<std::size_t>(albedo.rows), resolveThreadCount(0), 1, [&](std::size_t begin, std::size_t end) {
    for (int v = static_cast<int>(begin); v < static_cast<int>(end); ++v) {
      for (int u = 0; u < albedo.cols; ++u) {
        const auto found = albedo_of_box.find(view.cast(u, v).id);
        if (found != albedo_of_box.end()) albedo.at<float>(v, u) = found->second;
      }
    }
  });
  return albedo;
}

}  // namespace

double axialSigma(const SensorModel& sensor, double z_m) {
  return std::max(0.0, sensor.axial_noise_a_m + sensor.axial_noise_b * z_m + sensor.axial_noise_c_per_m * z_m * z_m);
}

cv::Mat applySensor(const Scene& scene, int frame, const cv::Mat& exact_depth_m) {
  const CameraModel& camera = scene.camera;
  const SensorModel& sensor = scene.sensor;
  requireImage("depth image", exact_depth_m, camera, CV_32FC1, "CV_32FC1 (5)");
  if (frame < 0 || frame >= scene.numFrames()) {
    throw std::out_of_range("applySensor: frame = " + std::to_string(frame) + ", must be in [0, " +
                            std::to_string(scene.numFrames()) + ")");
  }
  const Eigen::Isometry3d& T_scene_camera = scene.T_scene_camera[static_cast<std::size_t>(frame)];
  const Eigen::Isometry3d T_scene_second = T_scene_camera * Eigen::Translation3d(sensor.baseline_m, 0.0, 0.0);
  const ViewCaster first_view(scene, frame, T_scene_camera);
  const ViewCaster second_view(scene, frame, T_scene_second);
  const auto isShadowed = [&](int /*u*/, int /*v*/, double ray_u, double ray_v, double z) {
    if (!sensor.has_shadows) {
      return false;
    }
    const Eigen::Vector3d p_second((ray_u - camera.cx_px) / camera.fx_px * z - sensor.baseline_m,
                                   (ray_v - camera.cy_px) / camera.fy_px * z, z);
    constexpr double kFloatSteps = 4.0;  // exact_depth_m is rounded to float
    return !second_view.isVisible(p_second, 1e-6 + kFloatSteps * z * std::numeric_limits<float>::epsilon());
  };
  const auto frame_number = static_cast<std::uint64_t>(frame);
  cv::Mat measured_m = measure(
      camera, sensor, scene.seed, frame_number, exact_depth_m,
      [&first_view](double u, double v) { return first_view.cast(u, v).z_m; }, isShadowed);
  lose(missingReturns(camera, sensor, scene.seed, frame_number, exact_depth_m, albedoOf(scene, first_view)),
       &measured_m);
  return measured_m;
}

cv::Mat applySensor(const CameraModel& camera, const SensorModel& sensor, std::uint64_t seed, std::uint64_t frame,
                    const cv::Mat& exact_depth_m, const cv::Mat& shadow_mask, const cv::Mat& albedo) {
  requireImage("depth image", exact_depth_m, camera, CV_32FC1, "CV_32FC1 (5)");
  if (!shadow_mask.empty()) {
    requireImage("shadow mask", shadow_mask, camera, CV_8UC1, "CV_8UC1 (0)");
  }
  if (!albedo.empty()) {
    requireImage("albedo image", albedo, camera, CV_32FC1, "CV_32FC1 (5)");
  }
  cv::Mat measured_m = measure(
      camera, sensor, seed, frame, exact_depth_m,
      [&](double u, double v) { return depthBetweenPixels(exact_depth_m, u, v, sensor.edge_threshold_m); },
      [&shadow_mask](int u, int v, double /*ray_u*/, double /*ray_v*/, double /*z*/) {
        return !shadow_mask.empty() && shadow_mask.at<unsigned char>(v, u) != 0;
      });
  lose(missingReturns(camera, sensor, seed, frame, exact_depth_m, albedo), &measured_m);
  return measured_m;
}

cv::Mat measureDepth(const Scene& scene, int frame) {
  return applySensor(scene, frame, renderDepth(scene, frame));
}

cv::Mat encodeDepth16(const cv::Mat& depth_m, double units_per_metre) {
  if (depth_m.type() != CV_32FC1 || !(units_per_metre > 0.0)) {
    throw std::invalid_argument("encodeDepth16: needs a CV_32FC1 image and units_per_metre > 0");
  }
  cv::Mat units(depth_m.size(), CV_16UC1);
  for (int v = 0; v < depth_m.rows; ++v) {
    for (int u = 0; u < depth_m.cols; ++u) {
      const double value = std::round(depth_m.at<float>(v, u) * units_per_metre);
      const bool fits = value >= 0.0 && value <= std::numeric_limits<std::uint16_t>::max();  // false for NaN
      units.at<std::uint16_t>(v, u) = fits ? static_cast<std::uint16_t>(value) : std::uint16_t{0};
    }
  }
  return units;
}

cv::Mat decodeDepth16(const cv::Mat& depth_units, double units_per_metre) {
  if (depth_units.type() != CV_16UC1 || !(units_per_metre > 0.0)) {
    throw std::invalid_argument("decodeDepth16: needs a CV_16UC1 image and units_per_metre > 0");
  }
  cv::Mat depth_m(depth_units.size(), CV_32FC1);
  for (int v = 0; v < depth_units.rows; ++v) {
    for (int u = 0; u < depth_units.cols; ++u) {
      const std::uint16_t units = depth_units.at<std::uint16_t>(v, u);
      depth_m.at<float>(v, u) = static_cast<float>(units == 0 ? kNaN : units / units_per_metre);
    }
  }
  return depth_m;
}

}  // namespace synthetic_depth
