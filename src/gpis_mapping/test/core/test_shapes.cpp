// SPDX-License-Identifier: BSD-3-Clause
// The map of shapes without flat faces, seen by a noisy camera, against their exact distance.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "analytic_surfaces.h"
#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/mesh_extractor.h"

namespace gpis_mapping {
namespace {

using Distance = std::function<double(const Eigen::Vector3d&)>;  // signed, exact, negative inside [m]

/// The middle of a VGA image: at 0.9 m a pixel sees 1.7 mm.
CameraModel middleOfVga() {
  CameraModel camera;
  camera.width = 240;
  camera.height = 200;
  camera.fx = camera.fy = 525.0;
  camera.cx = 119.5;
  camera.cy = 99.5;
  return camera;
}

Eigen::Isometry3d lookAt(const Eigen::Vector3d& eye, const Eigen::Vector3d& target) {
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  const Eigen::Vector3d forward = (target - eye).normalized();
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
  T_map_camera.linear() << right, forward.cross(right), forward;
  T_map_camera.translation() = eye;
  return T_map_camera;
}

/// Standard normal noise; of its variance `correlated_share` is common to pixels about 8 px apart.
class Noise {
 public:
  Noise(std::uint32_t seed, double correlated_share) : engine_(seed), share_(correlated_share) {}

  std::vector<double> image(const CameraModel& camera) {
    constexpr int kStep_px = 8;
    const int columns = camera.width / kStep_px + 2;
    std::vector<double> coarse(static_cast<std::size_t>(columns) * (camera.height / kStep_px + 2));
    for (double& value : coarse) value = normal_(engine_);
    std::vector<double> result;
    for (int v = 0; v < camera.height; ++v) {
      for (int u = 0; u < camera.width; ++u) {
        const double a = static_cast<double>(u % kStep_px) / kStep_px, b = static_cast<double>(v % kStep_px) / kStep_px;
        const std::size_t at = static_cast<std::size_t>(v / kStep_px) * columns + u / kStep_px;
        const double weights[4] = {(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b};
        const double smooth = weights[0] * coarse[at] + weights[1] * coarse[at + 1] +
                              weights[2] * coarse[at + columns] + weights[3] * coarse[at + columns + 1];
        double squares = 0.0;
        for (const double weight : weights) squares += weight * weight;
        result.push_back(std::sqrt(share_ / squares) * smooth + std::sqrt(1.0 - share_) * normal_(engine_));
      }
    }
    return result;
  }

 private:
  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
  double share_;
};

/// Sphere tracing; the noise is what the map expects.
DepthImage render(const Distance& distance, const Eigen::Isometry3d& T_map_camera, Noise* noise) {
  const CameraModel camera = middleOfVga();
  const std::vector<double> noise_sigmas = noise->image(camera);
  DepthImage image;
  image.width = camera.width;
  image.height = camera.height;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector3d ray = camera.ray(u, v);
      const Eigen::Vector3d direction = T_map_camera.linear() * ray.normalized();
      double range = 0.0;
      for (double step = 1.0; step > 1e-6 && range < 5.0; range += step) {
        step = distance(T_map_camera.translation() + range * direction);
      }
      const double z = range / ray.norm();
      image.depth_m.push_back(static_cast<float>(z + DepthNoiseModel().sigma(z) * noise_sigmas[image.depth_m.size()]));
    }
  }
  return image;
}

struct Mapped {
  std::unique_ptr<GpisMap> map;
  std::shared_ptr<const MapSnapshot> snapshot;
  TriangleMesh mesh;
  std::size_t deleted{0};
};

/// Twelve views round the z axis from 0.9 m, two turns at two heights.
Mapped mapOf(const Distance& distance, double correlated_share = 0.0) {
  GpisConfig config;
  config.threads = 1;
  Mapped result;
  result.map = std::make_unique<GpisMap>(config);
  Noise noise(1, correlated_share);
  const Eigen::Vector3d target(0.0, 0.0, 0.1);
  for (int i = 0; i < 12; ++i) {
    const double azimuth = M_PI / 3.0 * i + 0.1, elevation = i < 6 ? 0.5 : 0.9;
    const Eigen::Vector3d eye =
        target + 0.9 * Eigen::Vector3d(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                                       std::sin(elevation));
    const Eigen::Isometry3d T_map_camera = lookAt(eye, target);
    result.deleted +=
        result.map->update(render(distance, T_map_camera, &noise), middleOfVga(), T_map_camera, 0.2 * i).deleted;
  }
  result.snapshot = result.map->snapshot();
  MeshExtractor extractor(config);
  extractor.update(*result.snapshot);
  result.mesh = extractor.mesh();
  return result;
}

/// Of the surface within `radius_m` of the z axis and above `least_z_m`.
struct Errors {
  double rms_m;            // of the mesh, by area
  double largest_m;        // of the mesh
  double complete;         // share of the true surface with mesh within a centimetre
  double clearance_rms_m;  // of the Euclidean distance asked for 1 to 5 cm before the surface
  double missed;           // share of those that claim 2 cm more than there are
};

Errors errorsOf(const Mapped& mapped, const Distance& distance, const std::vector<SurfacePoint>& samples,
                double radius_m, double least_z_m) {
  Errors errors{};
  double area = 0.0;
  for (const auto& triangle : mapped.mesh.triangles) {
    const auto& p = mapped.mesh.vertices_map;
    const Eigen::Vector3d a = p[triangle[0]], b = p[triangle[1]], c = p[triangle[2]];
    const Eigen::Vector3d middle = (a + b + c) / 3.0;
    if (middle.head<2>().norm() > radius_m || middle.z() < least_z_m) continue;
    const double part = 0.5 * (b - a).cross(c - a).norm();
    const double error = distance(middle);
    area += part;
    errors.rms_m += part * error * error;
    errors.largest_m = std::max(errors.largest_m, std::abs(error));
  }
  errors.rms_m = std::sqrt(errors.rms_m / area);
  std::mt19937 rng(2);
  std::uniform_real_distribution<double> clearance(0.01, 0.05);
  Points3d asked(3, static_cast<Eigen::Index>(samples.size()));
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const Eigen::Vector3d on = samples[i].position_map;
    double nearest = 1.0;
    for (const Eigen::Vector3d& vertex : mapped.mesh.vertices_map) nearest = std::min(nearest, (vertex - on).norm());
    errors.complete += nearest < 0.01;
    asked.col(static_cast<Eigen::Index>(i)) = on + clearance(rng) * samples[i].normal_map.cast<double>();
  }
  errors.complete /= static_cast<double>(samples.size());
  const QueryResult answers = mapped.snapshot->query(asked);
  for (Eigen::Index i = 0; i < asked.cols(); ++i) {
    const double error = answers.euclidean_distance[i] - distance(asked.col(i));
    errors.clearance_rms_m += error * error;
    errors.missed += error > 0.02;
  }
  errors.clearance_rms_m = std::sqrt(errors.clearance_rms_m / static_cast<double>(asked.cols()));
  errors.missed /= static_cast<double>(asked.cols());
  return errors;
}

double cylinderDistance(double along, double across, double half_length, double radius) {
  const double a = std::abs(along) - half_length, b = across - radius;
  return std::hypot(std::max(a, 0.0), std::max(b, 0.0)) + std::min(0.0, std::max(a, b));
}

/// The side of a cylinder of `length_m` about the z axis from z = 0 on.
std::vector<SurfacePoint> sideOf(double radius_m, double low_m, double high_m) {
  std::vector<SurfacePoint> samples;
  for (double z = low_m; z <= high_m; z += 0.005) {
    for (int i = 0; i < 24; ++i) {
      const Eigen::Vector3d n(std::cos(M_PI / 12.0 * i), std::sin(M_PI / 12.0 * i), 0.0);
      samples.push_back(gpis_mapping_test::surfacePoint(radius_m * n + Eigen::Vector3d(0.0, 0.0, z), n));
    }
  }
  return samples;
}

Errors errorsOfRod(double diameter_m) {
  const double radius = 0.5 * diameter_m, height = 0.25;
  const Distance distance = [=](const Eigen::Vector3d& x) {
    return std::min(x.z(), cylinderDistance(x.z() - 0.5 * height, x.head<2>().norm(), 0.5 * height, radius));
  };
  return errorsOf(mapOf(distance), distance, sideOf(radius, 0.05, 0.22), 0.05, 0.03);
}

TEST(Shapes, RodsOfASpacingAndMoreAreMapped) {
  // The prior mean of 4.5 cm takes in both sides of a rod and pulls its surface inwards: by 2.5 mm at 2 and 3 cm.
  for (const double diameter : {0.02, 0.03, 0.05}) {
    SCOPED_TRACE(diameter);
    const Errors errors = errorsOfRod(diameter);
    EXPECT_LT(errors.rms_m, diameter < 0.04 ? 0.006 : 0.003);
    EXPECT_GT(errors.complete, diameter < 0.025 ? 0.5 : 0.9);
    EXPECT_EQ(errors.missed, 0.0);
  }
}

TEST(Shapes, ThinRodsAreNotMapped) {
  // The local plane needs 5 x 5 pixels of one surface, 8.5 mm here: documented in docs/method.md, Limits.
  for (const double diameter : {0.008, 0.01}) EXPECT_EQ(errorsOfRod(diameter).complete, 0.0) << diameter;
}

TEST(Shapes, SpheresAreMapped) {
  for (const double radius : {0.05, 0.1}) {
    SCOPED_TRACE(radius);
    const Eigen::Vector3d center(0.0, 0.0, radius);
    const Distance distance = [=](const Eigen::Vector3d& x) { return std::min(x.z(), (x - center).norm() - radius); };
    std::vector<SurfacePoint> samples;
    for (const SurfacePoint& point : gpis_mapping_test::sampleSphere(center, radius, 0.01)) {
      if (point.position_map.z() > 0.7 * radius) samples.push_back(point);
    }
    const Errors errors = errorsOf(mapOf(distance), distance, samples, radius + 0.03, 0.7 * radius);
    // A chord of 2 cm lies 1 mm inside a sphere of 5 cm and 0.5 mm inside one of 10 cm; as much again for noise.
    EXPECT_LT(errors.rms_m, 1e-4 / radius);
    EXPECT_GT(errors.complete, 0.97);
    EXPECT_LT(errors.clearance_rms_m, 1e-4 / radius);
  }
}

TEST(Shapes, LyingCylindersAreMapped) {
  for (const double radius : {0.05, 0.08}) {
    SCOPED_TRACE(radius);
    const Distance distance = [=](const Eigen::Vector3d& x) {
      return std::min(x.z(), cylinderDistance(x.x(), std::hypot(x.y(), x.z() - radius), 0.15, radius));
    };
    std::vector<SurfacePoint> samples;
    for (double x = -0.13; x <= 0.13; x += 0.01) {
      for (double angle = 0.3; angle < M_PI - 0.3; angle += 0.1) {
        const Eigen::Vector3d n(0.0, std::cos(angle), std::sin(angle));
        samples.push_back(gpis_mapping_test::surfacePoint(Eigen::Vector3d(x, 0.0, radius) + radius * n, n));
      }
    }
    const Errors errors = errorsOf(mapOf(distance), distance, samples, 0.13, 0.7 * radius);
    EXPECT_LT(errors.rms_m, 6e-5 / radius);  // bent one way only: half a sphere's, and a tenth more
    EXPECT_GT(errors.complete, 0.97);
  }
}

TEST(Shapes, NoiseSharedByNeighboursDeletesAndDoublesNothing) {
  const Eigen::Vector3d center(0.0, 0.0, 0.1);
  const Distance distance = [=](const Eigen::Vector3d& x) { return std::min(x.z(), (x - center).norm() - 0.1); };
  std::vector<SurfacePoint> samples;
  for (const SurfacePoint& point : gpis_mapping_test::sampleSphere(center, 0.1, 0.01)) {
    if (point.position_map.z() > 0.07) samples.push_back(point);
  }
  for (const double share : {0.15, 0.5, 0.8}) {
    SCOPED_TRACE(share);
    const Mapped mapped = mapOf(distance, share);
    const Errors errors = errorsOf(mapped, distance, samples, 0.3, -0.1);
    // Patches of 8 px agree: of a noise of 1.9 mm twelve looks leave 0.5 mm, beside the 0.5 mm of the sphere.
    EXPECT_LT(errors.rms_m, 0.001);
    EXPECT_LT(errors.largest_m, 0.02);  // a double would lie beyond the least tolerance, 12 mm, and a voxel
    EXPECT_LT(mapped.deleted, 0.01 * static_cast<double>(mapped.snapshot->numPoints()));
  }
}

}  // namespace
}  // namespace gpis_mapping
