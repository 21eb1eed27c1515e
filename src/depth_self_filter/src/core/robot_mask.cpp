// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter/robot_mask.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/config/schema.h>

namespace depth_self_filter {
namespace {

using depth_camera::CameraModel;
using depth_camera::DepthImage;
using mp700_ur5e_description::BodyShape;
using mp700_ur5e_description::Box;
using mp700_ur5e_description::Cylinder;
using mp700_ur5e_description::RobotModel;
using mp700_ur5e_description::Shape;
using mp700_ur5e_description::Sphere;

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// Padding leaves at least this share of the gap between a shape and the optical centre.
constexpr double kGapShare = 0.5;
/// A prism of so many sides about a cylinder, for its silhouette: 8 % more than its diameter at most.
constexpr int kPrismSides = 8;
/// Pixels on both ends of a shadow are half hidden.
constexpr int kShadowEdge_px = 2;
constexpr double kMaxBrickEdge_m = 2.0;

double circumradius(const Shape& shape) {
  if (const auto* box = std::get_if<Box>(&shape)) return 0.5 * box->size_m.norm();
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    return std::hypot(cylinder->radius_m, 0.5 * cylinder->length_m);
  }
  return std::get<Sphere>(shape).radius_m;
}

Shape padded(const Shape& shape, double padding_m) {
  if (const auto* box = std::get_if<Box>(&shape)) {
    return Box{box->size_m + Eigen::Vector3d::Constant(2.0 * padding_m)};
  }
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    return Cylinder{cylinder->radius_m + padding_m, cylinder->length_m + 2.0 * padding_m};
  }
  return Sphere{std::get<Sphere>(shape).radius_m + padding_m};
}

/// From a point in the shape's frame to its surface [m]; 0 inside.
double distanceTo(const Shape& shape, const Eigen::Vector3d& p) {
  if (const auto* box = std::get_if<Box>(&shape)) return (p.cwiseAbs() - 0.5 * box->size_m).cwiseMax(0.0).norm();
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    return std::hypot(std::max(0.0, p.head<2>().norm() - cylinder->radius_m),
                      std::max(0.0, std::abs(p.z()) - 0.5 * cylinder->length_m));
  }
  return std::max(0.0, p.norm() - std::get<Sphere>(shape).radius_m);
}

/// Corners and edges of a convex body that encloses a shape.
struct Hull {
  std::vector<Eigen::Vector3d> corners;
  std::vector<std::pair<int, int>> edges;
};

Hull boxHull(const Eigen::Vector3d& half_m) {
  Hull hull;
  for (int i = 0; i < 8; ++i) {
    hull.corners.emplace_back((i & 1) != 0 ? half_m.x() : -half_m.x(), (i & 2) != 0 ? half_m.y() : -half_m.y(),
                              (i & 4) != 0 ? half_m.z() : -half_m.z());
    for (const int axis : {1, 2, 4}) {
      if ((i & axis) == 0) hull.edges.emplace_back(i, i | axis);
    }
  }
  return hull;
}

Hull hullOf(const Shape& shape) {
  if (const auto* box = std::get_if<Box>(&shape)) return boxHull(0.5 * box->size_m);
  if (const auto* sphere = std::get_if<Sphere>(&shape)) return boxHull(Eigen::Vector3d::Constant(sphere->radius_m));
  const auto& cylinder = std::get<Cylinder>(shape);
  Hull hull;
  const double corner_m = cylinder.radius_m / std::cos(M_PI / kPrismSides);
  for (int i = 0; i < kPrismSides; ++i) {
    const double angle = 2.0 * M_PI * i / kPrismSides;
    for (const double side : {-0.5, 0.5}) {
      hull.corners.emplace_back(corner_m * std::cos(angle), corner_m * std::sin(angle), side * cylinder.length_m);
    }
    const int next = (i + 1) % kPrismSides;
    hull.edges.emplace_back(2 * i, 2 * i + 1);
    hull.edges.emplace_back(2 * i, 2 * next);
    hull.edges.emplace_back(2 * i + 1, 2 * next + 1);
  }
  return hull;
}

/// The rays of a row of pixels in a shape's frame: origin + depth * (first + u * step). Single precision: 1e-7 of some
/// metres, where paddings are millimetres, and four pixels at a time.
struct RowRays {
  std::array<float, 3> origin;
  std::array<float, 3> first;
  std::array<float, 3> step;

  RowRays(const Eigen::Isometry3d& T_shape_camera, const CameraModel& camera, int v) {
    const Eigen::Vector3d at_zero =
        T_shape_camera.linear() * Eigen::Vector3d(-camera.cx / camera.fx, (v - camera.cy) / camera.fy, 1.0);
    const Eigen::Vector3d per_px = T_shape_camera.linear().col(0) / camera.fx;
    for (int i = 0; i < 3; ++i) {
      const auto axis = static_cast<std::size_t>(i);
      origin[axis] = static_cast<float>(T_shape_camera.translation()[i]);
      first[axis] = static_cast<float>(at_zero[i]);
      step[axis] = static_cast<float>(per_px[i]);
    }
  }
};

/// Depths between which a ray is between two planes at -half and +half of an axis.
inline void clipSlab(float origin, float direction, float half, float* enter, float* leave) {
  // A ray along the planes meets them at 1e12 and more, or not at all: no 0 / 0.
  constexpr float kLeast = 1e-12F;
  const float inverse = 1.0F / (std::abs(direction) < kLeast ? kLeast : direction);
  const float a = (-half - origin) * inverse;
  const float b = (half - origin) * inverse;
  *enter = std::max(*enter, std::min(a, b));
  *leave = std::min(*leave, std::max(a, b));
}

/// Depths between which a ray is within `radius` of the origin, given a = d.d, b = o.d, c = o.o - r^2 and the square of
/// o x d. The discriminant as a r^2 - |o x d|^2: b^2 - a c would lose most digits of a thin shape far away.
inline void clipRound(float a, float b, float c, float cross2, float radius, float* enter, float* leave) {
  constexpr float kLeast = 1e-12F;  // a ray along the axis: inside for good, or never
  const float discriminant = a < kLeast ? -c : a * radius * radius - cross2;
  const float inverse = 1.0F / std::max(a, kLeast);
  const float root = std::sqrt(std::max(0.0F, discriminant));
  const float near = a < kLeast ? -kInfinity : (-b - root) * inverse;
  const float far = a < kLeast ? kInfinity : (-b + root) * inverse;
  *enter = std::max(*enter, discriminant < 0.0F ? kInfinity : near);
  *leave = std::min(*leave, discriminant < 0.0F ? -kInfinity : far);
}

/// entry[u] becomes the depth at which the ray enters the shape, if that is less. clip(o, d, enter, leave) narrows the
/// interval; no branches, so that the compiler can take several pixels at a time.
template <typename Clip>
inline void enterRow(const RowRays& rays, int left, int right, float* entry, Clip clip) {
  const std::array<float, 3> o = rays.origin;
  const std::array<float, 3> d0 = rays.first;
  const std::array<float, 3> dd = rays.step;
  for (int u = left; u <= right; ++u) {
    const auto x = static_cast<float>(u);
    const float d[3] = {d0[0] + x * dd[0], d0[1] + x * dd[1], d0[2] + x * dd[2]};
    float enter = static_cast<float>(kNear_m);
    float leave = kInfinity;
    clip(o, d, &enter, &leave);
    const float depth = leave >= enter ? enter : kInfinity;
    entry[u] = std::min(entry[u], depth);
  }
}

}  // namespace

std::string whyNotHeld(const RobotModel& robot, const HeldBrick& brick) {
  std::ostringstream text;
  if (!robot.hasFrame(brick.frame)) {
    text << "the brick is held by frame '" << brick.frame << "', must be a link of the URDF";
  } else if (!brick.T_frame_brick.matrix().allFinite() ||
             !brick.T_frame_brick.linear().isUnitary(1e-6)) {  // rounding of a quaternion
    text << "the brick's pose is not finite or no rotation";
  } else if (!brick.size_m.allFinite() || brick.size_m.minCoeff() <= 0.0 || brick.size_m.maxCoeff() > kMaxBrickEdge_m) {
    text << "the brick's edges are " << brick.size_m.transpose() << " m, must be in (0, " << kMaxBrickEdge_m << "] m";
  }
  return text.str();
}

RobotMask::RobotMask(std::shared_ptr<const RobotModel> robot, const RobotMaskConfig& config)
    : robot_(std::move(robot)), config_(config) {
  interactive_mapping::requireValid("impossible mask:", config);
  if (!robot_) throw std::invalid_argument("no robot");
}

std::vector<PlacedShape> RobotMask::place(const Eigen::Isometry3d& T_root_camera, const Eigen::VectorXd& positions_rad,
                                          const std::optional<HeldBrick>& brick) const {
  if (!positions_rad.allFinite()) throw std::invalid_argument("joint positions are not finite");
  if (!T_root_camera.matrix().allFinite() || !T_root_camera.linear().isUnitary(1e-6)) {
    throw std::invalid_argument("the camera's pose is not finite or no rotation");
  }
  std::vector<Eigen::Isometry3d> T_root_body;
  robot_->bodyPoses(positions_rad, &T_root_body);
  const Eigen::Isometry3d T_camera_root = T_root_camera.inverse();
  std::vector<PlacedShape> placed;
  const auto add = [&](const Shape& shape, const Eigen::Isometry3d& T_camera_shape, double base_padding_m) {
    const Eigen::Vector3d center = T_camera_shape.translation();
    const double gap_m = distanceTo(shape, T_camera_shape.linear().transpose() * -center);
    if (gap_m <= 0.0) return;  // the optical centre is inside
    const double wanted_m = base_padding_m + config_.padding_rad * (center.norm() + circumradius(shape));
    placed.push_back({padded(shape, std::min(wanted_m, kGapShare * gap_m)), T_camera_shape});
  };
  for (const BodyShape& shape : robot_->shapes()) {
    add(shape.shape, T_camera_root * T_root_body[shape.body] * shape.T_body_shape, config_.padding_m);
  }
  if (brick) {
    const std::string problem = whyNotHeld(*robot_, *brick);
    if (!problem.empty()) throw std::invalid_argument(problem);
    add(Box{brick->size_m},
        T_camera_root * T_root_body[robot_->bodyOf(brick->frame)] * robot_->poseInBody(brick->frame) *
            brick->T_frame_brick,
        config_.brick_padding_m);
  }
  return placed;
}

bool RobotMask::findSpans(const PlacedShape& placed, const CameraModel& camera) {
  const Hull hull = hullOf(placed.shape);
  std::vector<Eigen::Vector3d> corners;
  bool is_before = false;
  for (const Eigen::Vector3d& corner : hull.corners) {
    corners.push_back(placed.T_camera_shape * corner);
    is_before = is_before || corners.back().z() >= kNear_m;
  }
  if (!is_before) return false;

  std::fill(spans_.begin(), spans_.end(), Span{camera.width, -1});
  bool is_seen = false;
  const auto toPixel = [&camera](const Eigen::Vector3d& p) {
    return Eigen::Vector2d(camera.fx * p.x() / p.z() + camera.cx, camera.fy * p.y() / p.z() + camera.cy);
  };
  const auto clampColumn = [&camera](double u) {
    return static_cast<int>(std::clamp(u, -1.0, static_cast<double>(camera.width)));
  };
  // Widens the spans by an edge of the outline. The outline is convex, and the hull's edges hold it: in a row, the leftmost
  // and the rightmost edge say where it begins and ends. Rows are taken half a pixel to both sides, and ends a pixel
  // wider: rays decide later, and what these spans hold too much does no harm.
  const auto addEdge = [&](const Eigen::Vector3d& p, const Eigen::Vector3d& q) {
    Eigen::Vector2d a = toPixel(p);
    Eigen::Vector2d b = toPixel(q);
    if (a.y() > b.y()) std::swap(a, b);
    if (!(b.y() >= -0.5) || !(a.y() <= camera.height - 0.5)) return;
    const int first = static_cast<int>(std::max(0.0, std::ceil(a.y() - 0.5)));
    const int last = static_cast<int>(std::min(camera.height - 1.0, std::floor(b.y() + 0.5)));
    const double slope = b.y() > a.y() ? (b.x() - a.x()) / (b.y() - a.y()) : 0.0;
    for (int v = first; v <= last; ++v) {
      double low = a.x();
      double high = b.x();
      if (v - 0.5 > a.y()) low = a.x() + slope * (v - 0.5 - a.y());
      if (v + 0.5 < b.y()) high = a.x() + slope * (v + 0.5 - a.y());
      Span& span = spans_[static_cast<std::size_t>(v)];
      span.left = std::min(span.left, clampColumn(std::floor(std::min(low, high)) - 1.0));
      span.right = std::max(span.right, clampColumn(std::ceil(std::max(low, high)) + 1.0));
    }
    is_seen = true;
  };
  std::vector<Eigen::Vector3d> cut;  // where edges cross the plane of the least depth
  for (const auto& [i, j] : hull.edges) {
    Eigen::Vector3d p = corners[static_cast<std::size_t>(i)];
    Eigen::Vector3d q = corners[static_cast<std::size_t>(j)];
    if (p.z() < q.z()) std::swap(p, q);
    if (p.z() < kNear_m) continue;
    if (q.z() < kNear_m) {
      q = p + (q - p) * ((p.z() - kNear_m) / (p.z() - q.z()));
      q.z() = kNear_m;
      cut.push_back(q);
    }
    addEdge(p, q);
  }
  for (std::size_t i = 0; i < cut.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) addEdge(cut[i], cut[j]);
  }
  return is_seen;
}

void RobotMask::enter(const PlacedShape& placed, const CameraModel& camera) {
  if (!findSpans(placed, camera)) return;
  const Eigen::Isometry3d T_shape_camera = placed.T_camera_shape.inverse();
  for (int v = 0; v < camera.height; ++v) {
    const Span& span = spans_[static_cast<std::size_t>(v)];
    const int left = std::max(0, span.left);
    const int right = std::min(camera.width - 1, span.right);
    if (left > right) continue;
    first_row_ = std::min(first_row_, v);
    last_row_ = std::max(last_row_, v);
    const RowRays rays(T_shape_camera, camera, v);
    float* entry = entryRow(v);
    if (const auto* box = std::get_if<Box>(&placed.shape)) {
      const Eigen::Vector3f half = (0.5 * box->size_m).cast<float>();
      const std::array<float, 3> h = {half.x(), half.y(), half.z()};
      enterRow(rays, left, right, entry, [h](const auto& o, const float* d, float* enter, float* leave) {
        clipSlab(o[0], d[0], h[0], enter, leave);
        clipSlab(o[1], d[1], h[1], enter, leave);
        clipSlab(o[2], d[2], h[2], enter, leave);
      });
    } else if (const auto* cylinder = std::get_if<Cylinder>(&placed.shape)) {
      const auto r = static_cast<float>(cylinder->radius_m);
      const auto h = static_cast<float>(0.5 * cylinder->length_m);
      enterRow(rays, left, right, entry, [r, h](const auto& o, const float* d, float* enter, float* leave) {
        const float cross = o[0] * d[1] - o[1] * d[0];
        clipRound(d[0] * d[0] + d[1] * d[1], o[0] * d[0] + o[1] * d[1], o[0] * o[0] + o[1] * o[1] - r * r,
                  cross * cross, r, enter, leave);
        clipSlab(o[2], d[2], h, enter, leave);
      });
    } else {
      const auto r = static_cast<float>(std::get<Sphere>(placed.shape).radius_m);
      enterRow(rays, left, right, entry, [r](const auto& o, const float* d, float* enter, float* leave) {
        const float cx = o[1] * d[2] - o[2] * d[1];
        const float cy = o[2] * d[0] - o[0] * d[2];
        const float cz = o[0] * d[1] - o[1] * d[0];
        clipRound(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], o[0] * d[0] + o[1] * d[1] + o[2] * d[2],
                  o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - r * r, cx * cx + cy * cy + cz * cz, r, enter, leave);
      });
    }
  }
}

void RobotMask::spreadEntries(int width, int height) {
  const int edge = config_.edge_px;
  first_row_ = std::max(0, first_row_ - edge);
  last_row_ = std::min(height - 1, last_row_ + edge);
  if (edge == 0 || first_row_ > last_row_) return;
  // The least of a square window: along rows, then along columns.
  for (int v = first_row_; v <= last_row_; ++v) {
    const float* in = entryRow(v);
    float* out = &spread_m_[static_cast<std::size_t>(v) * stride_ + edge];
    std::copy_n(in, width, out);
    for (int shift = -edge; shift <= edge; ++shift) {
      for (int u = 0; u < width; ++u) out[u] = std::min(out[u], in[u + shift]);
    }
  }
  for (int v = first_row_; v <= last_row_; ++v) {
    float* out = entryRow(v);
    for (int w = std::max(first_row_, v - edge); w <= std::min(last_row_, v + edge); ++w) {
      const float* in = &spread_m_[static_cast<std::size_t>(w) * stride_ + edge];
      for (int u = 0; u < width; ++u) out[u] = std::min(out[u], in[u]);
    }
  }
}

MaskStatistics RobotMask::blank(const CameraModel& camera, DepthImage* image) {
  const auto sigmas = static_cast<float>(config_.noise_sigmas);
  const float a = sigmas * static_cast<float>(config_.noise.a_m);
  const float b = sigmas * static_cast<float>(config_.noise.b);
  const float c = sigmas * static_cast<float>(config_.noise.c_per_m);
  std::size_t robot_px = 0;
  std::size_t masked_px = 0;
  for (int v = first_row_; v <= last_row_; ++v) {
    const float* entry = entryRow(v);
    float* depth = &image->depth_m[static_cast<std::size_t>(v) * camera.width];
    int robot_in_row = 0;
    int masked_in_row = 0;
    for (int u = 0; u < camera.width; ++u) {
      const float e = entry[u];
      const float z = depth[u];
      const bool is_robot = e < kInfinity;
      // False for NaN and, outside the silhouette, by Inf - Inf.
      const bool is_before = (z > 0.0F) & (z < e - (a + (b + c * e) * e));
      const bool is_masked = is_robot & !is_before;
      depth[u] = is_masked ? kNaN : z;
      robot_in_row += is_robot ? 1 : 0;
      masked_in_row += is_masked ? 1 : 0;
    }
    robot_px += static_cast<std::size_t>(robot_in_row);
    masked_px += static_cast<std::size_t>(masked_in_row);
  }
  MaskStatistics statistics;
  statistics.masked_px = masked_px;
  statistics.in_front_px = robot_px - masked_px;
  return statistics;
}

std::size_t RobotMask::blankShadows(const CameraModel& camera, DepthImage* image) const {
  if (config_.baseline_m <= 0.0) return 0;
  // Before the farthest background there is, the shadow is as wide as the robot's disparity.
  const auto disparity = static_cast<float>(camera.fx * config_.baseline_m);
  const auto border = static_cast<std::size_t>(config_.edge_px);
  std::size_t shadow_px = 0;
  for (int v = first_row_; v <= last_row_; ++v) {
    const float* entry = &entry_m_[static_cast<std::size_t>(v) * stride_ + border];
    float* depth = &image->depth_m[static_cast<std::size_t>(v) * camera.width];
    // To both sides: the image does not say on which of them the second viewpoint is. What is left of a shadow's width at a
    // pixel, going right, then going left.
    for (const int step : {1, -1}) {
      float reach_px = 0.0F;
      for (int u = step > 0 ? 0 : camera.width - 1; u >= 0 && u < camera.width; u += step) {
        reach_px -= 1.0F;
        if (entry[u] < kInfinity) {
          if (std::isnan(depth[u])) reach_px = std::max(reach_px, disparity / entry[u] + kShadowEdge_px);
        } else if (depth[u] == 0.0F && reach_px >= 0.0F) {
          depth[u] = kNaN;
          ++shadow_px;
        }
      }
    }
  }
  return shadow_px;
}

MaskStatistics RobotMask::apply(const CameraModel& camera, const Eigen::Isometry3d& T_root_camera,
                                const Eigen::VectorXd& positions_rad, const std::optional<HeldBrick>& brick,
                                DepthImage* image) {
  interactive_mapping::refuseIfAny("impossible camera:", camera.validate());
  depth_camera::requireFits(*image, camera);
  const std::vector<PlacedShape> placed = place(T_root_camera, positions_rad, brick);
  stride_ = static_cast<std::size_t>(camera.width + 2 * config_.edge_px);
  const std::size_t size = stride_ * static_cast<std::size_t>(camera.height);
  entry_m_.assign(size, kInfinity);
  spread_m_.resize(size);
  spans_.resize(static_cast<std::size_t>(camera.height));
  first_row_ = camera.height;
  last_row_ = -1;
  for (const PlacedShape& shape : placed) enter(shape, camera);
  if (first_row_ > last_row_) return {};
  spreadEntries(camera.width, camera.height);
  MaskStatistics statistics = blank(camera, image);
  statistics.shadow_px = blankShadows(camera, image);
  return statistics;
}

bool movesShapes(const RobotModel& robot, std::size_t joint) {
  const RobotModel::Joint& moving = robot.joints()[joint];
  if (std::isfinite(moving.lower_rad) || std::isfinite(moving.upper_rad)) return true;
  constexpr double kSame = 1e-6;  // digits of angles in URDFs
  std::vector<Eigen::Isometry3d> before;
  std::vector<Eigen::Isometry3d> after;
  Eigen::VectorXd positions_rad = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot.joints().size()));
  robot.bodyPoses(positions_rad, &before);
  positions_rad[static_cast<Eigen::Index>(joint)] = 1.0;
  robot.bodyPoses(positions_rad, &after);
  for (const BodyShape& shape : robot.shapes()) {
    const Eigen::Isometry3d T_before = before[shape.body] * shape.T_body_shape;
    const Eigen::Isometry3d T_after = after[shape.body] * shape.T_body_shape;
    if (!T_before.translation().isApprox(T_after.translation(), kSame) &&
        (T_before.translation() - T_after.translation()).norm() > kSame) {
      return true;
    }
    if (std::holds_alternative<Box>(shape.shape) && !T_before.linear().isApprox(T_after.linear(), kSame)) return true;
    if (std::holds_alternative<Cylinder>(shape.shape) &&
        T_before.linear().col(2).cross(T_after.linear().col(2)).norm() > kSame) {
      return true;
    }
  }
  return false;
}

}  // namespace depth_self_filter
