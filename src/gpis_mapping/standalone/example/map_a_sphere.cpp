// SPDX-License-Identifier: BSD-3-Clause
// Maps a sphere from synthetic depth images, asks the map, writes a mesh: map_a_sphere OUT.ply
// Ends with exit code 1 if an answer is not that of the sphere.
#include <cmath>
#include <cstdio>
#include <exception>
#include <limits>
#include <memory>

#include <gpis_mapping/gpis_map.h>
#include <gpis_mapping/mesh_extractor.h>
#include <gpis_mapping/ply.h>

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kRadius_m = 0.3;
const Eigen::Vector3d kCenter_map(0.4, -0.2, 0.5);

/// A camera at `eye_map` that looks at `target_map`: z forward, x right, y down.
Eigen::Isometry3d lookAt(const Eigen::Vector3d& eye_map, const Eigen::Vector3d& target_map) {
  const Eigen::Vector3d z = (target_map - eye_map).normalized();
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.linear() << x, z.cross(x), z;
  T_map_camera.translation() = eye_map;
  return T_map_camera;
}

/// The exact depth of the sphere [m]; +Inf beside it: nothing within reach.
gpis_mapping::DepthImage render(const gpis_mapping::CameraModel& camera, const Eigen::Isometry3d& T_map_camera) {
  gpis_mapping::DepthImage image{camera.width, camera.height, {}};
  const Eigen::Vector3d center = T_map_camera.inverse() * kCenter_map;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector3d ray = camera.ray(u, v);  // 1 along z: its multiple is the depth
      const double a = ray.squaredNorm(), b = ray.dot(center);
      const double root = b * b - a * (center.squaredNorm() - kRadius_m * kRadius_m);
      image.depth_m.push_back(root > 0.0 ? static_cast<float>((b - std::sqrt(root)) / a)
                                         : std::numeric_limits<float>::infinity());
    }
  }
  return image;
}

int failures = 0;

void check(const char* what, double value, double low, double high) {
  const bool holds = value >= low && value <= high;  // false for NaN
  std::printf("%s %s = %.6g, must be in [%g, %g]\n", holds ? "ok    " : "FAILED", what, value, low, high);
  if (!holds) ++failures;
}

void mapASphere(const char* ply_path) {
  gpis_mapping::GpisMap map{gpis_mapping::GpisConfig{}};
  const gpis_mapping::CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  constexpr int kNumImages = 8;
  for (int i = 0; i < kNumImages; ++i) {
    const double azimuth = 2.0 * kPi * i / kNumImages;
    const Eigen::Vector3d eye_map = kCenter_map + Eigen::Vector3d(std::cos(azimuth), std::sin(azimuth), 0.4);
    const Eigen::Isometry3d T_map_camera = lookAt(eye_map, kCenter_map);
    map.update(render(camera, T_map_camera), camera, T_map_camera, 2.0 * i);
  }

  // Two circles of points about the sphere where it was seen well: 2 cm outside and inside.
  const std::shared_ptr<const gpis_mapping::MapSnapshot> now = map.snapshot();
  constexpr int kNumPoints = 72;
  for (const double offset_m : {0.02, -0.02}) {
    gpis_mapping::Points3d points_map(3, kNumPoints), outward(3, kNumPoints);
    for (int i = 0; i < kNumPoints; ++i) {
      const double azimuth = 2.0 * kPi * i / kNumPoints;
      outward.col(i) << std::cos(0.3) * std::cos(azimuth), std::cos(0.3) * std::sin(azimuth), std::sin(0.3);
      points_map.col(i) = kCenter_map + (kRadius_m + offset_m) * outward.col(i);
    }
    const gpis_mapping::QueryResult answers = now->query(points_map);
    const double prior = std::pow(map.config().signalStd(), 2);
    std::printf("%.2f m %s the sphere:\n", std::abs(offset_m), offset_m > 0.0 ? "outside" : "inside");
    // Exact depth and poses; between points 2 cm apart a sphere of 30 cm is 0.2 mm off its chord. 2 mm has room for the
    // field's curvature off the surface.
    check("largest error of the distance [m]", (answers.distance.array() - offset_m).abs().maxCoeff(), 0.0, 0.002);
    const Eigen::VectorXd cosines = outward.cwiseProduct(answers.gradient).colwise().sum();
    check("least gradient along the normal", cosines.minCoeff(), 0.95, 1.05);
    check("least variance [m^2]", answers.variance.minCoeff(), 1e-12, prior);
    check("greatest variance [m^2]", answers.variance.maxCoeff(), 1e-12, prior);
  }

  gpis_mapping::MeshExtractor extractor(map.config());
  extractor.update(*now);
  const gpis_mapping::TriangleMesh mesh = extractor.mesh();
  double worst_m = mesh.vertices_map.empty() ? std::numeric_limits<double>::infinity() : 0.0;
  for (const Eigen::Vector3d& p : mesh.vertices_map) {
    worst_m = std::max(worst_m, std::abs((p - kCenter_map).norm() - kRadius_m));
  }
  std::printf("%zu vertices, %zu triangles:\n", mesh.vertices_map.size(), mesh.triangles.size());
  // Its rim was seen at a slant, with the images' noise model.
  check("largest distance of a vertex from the sphere [m]", worst_m, 0.0, 0.005);
  // The sphere has 1.13 m^2, of which the cameras see all but the caps; an edge of marching cubes is about 1 cm.
  check("triangles", static_cast<double>(mesh.triangles.size()), 5000.0, 100000.0);
  gpis_mapping::writePly(mesh, ply_path);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: map_a_sphere OUT.ply\n");
    return 2;
  }
  try {
    mapASphere(argv[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "map_a_sphere: %s\n", error.what());
    return 1;
  }
  return failures == 0 ? 0 : 1;
}
