// SPDX-License-Identifier: BSD-3-Clause
#include "support/tag_renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>

#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h10.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagCircle21h7.h>
#include <apriltag/tagCircle49h12.h>
#include <apriltag/tagCustom48h12.h>
#include <apriltag/tagStandard41h12.h>
#include <apriltag/tagStandard52h13.h>
}

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickCatalogue;
using mp700_ur5e_description::BrickFace;
using mp700_ur5e_description::BrickTag;
using mp700_ur5e_description::BrickType;
using mp700_ur5e_description::kBrickFaces;
using mp700_ur5e_description::kNumBrickFaces;
using mp700_ur5e_description::TagLayout;

const Eigen::Vector3d kPaperRgb(0.92, 0.92, 0.92);
const Eigen::Vector3d kInkRgb(0.06, 0.06, 0.06);
const Eigen::Vector3d kPlateRgb(0.55, 0.56, 0.58);
constexpr double kNoHit = std::numeric_limits<double>::infinity();

using AprilTagFamily = std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)>;

AprilTagFamily aprilTagFamily(const std::string& name) {
  if (name == "tag36h11") return {tag36h11_create(), tag36h11_destroy};
  if (name == "tag16h5") return {tag16h5_create(), tag16h5_destroy};
  if (name == "tag25h9") return {tag25h9_create(), tag25h9_destroy};
  if (name == "tag36h10") return {tag36h10_create(), tag36h10_destroy};
  if (name == "tagCircle21h7") return {tagCircle21h7_create(), tagCircle21h7_destroy};
  if (name == "tagCircle49h12") return {tagCircle49h12_create(), tagCircle49h12_destroy};
  if (name == "tagCustom48h12") return {tagCustom48h12_create(), tagCustom48h12_destroy};
  if (name == "tagStandard41h12") return {tagStandard41h12_create(), tagStandard41h12_destroy};
  if (name == "tagStandard52h13") return {tagStandard52h13_create(), tagStandard52h13_destroy};
  return {nullptr, nullptr};
}

void requireId(const std::string& family, int id, int num_ids) {
  if (id >= 0 && id < num_ids) return;
  throw std::invalid_argument("tag of family " + family + ": id = " + std::to_string(id) + ", must be in [0, " +
                              std::to_string(num_ids - 1) + "]");
}

/// A tag laid on a face, ready for looking up the colour at a point of the camera frame.
struct LaidTag {
  Eigen::Isometry3d T_tag_camera;
  cv::Mat cells;
  double cell_m{0.0};
  double half_paper_m{0.0};
  double bend_m{0.0};
  Eigen::Vector2d bend_across{Eigen::Vector2d::UnitX()};

  /// Where a ray that meets the face at p meets the label, in the tag's frame.
  Eigen::Vector3d onLabel(const Eigen::Vector3d& p, const Eigen::Vector3d& direction) const {
    if (bend_m == 0.0) return p;
    Eigen::Vector3d on_label = p;
    for (int i = 0; i < 8; ++i) {  // height and slope are small: converges by a factor of ten a round
      const double s = std::clamp(on_label.head<2>().dot(bend_across) / half_paper_m, -1.5, 1.5);
      const double height_m = bend_m > 0.0 ? bend_m * std::max(0.0, 1.0 - s * s) : -bend_m * s * s;
      on_label = p + direction * (height_m / direction.z());
    }
    return on_label;
  }
};

struct Face {
  Eigen::Isometry3d T_face_camera;
  double light{1.0};
  double half_plate_m{0.0};  // 0: none
  std::vector<LaidTag> tags;
};

struct Box {
  Eigen::Isometry3d T_box_camera;
  Eigen::Vector3d half_m;
  Eigen::Vector3d color_rgb;
  std::array<Face, kNumBrickFaces> faces;
  cv::Rect roi;  // pixels that may show it
};

struct Hit {
  double z_m{kNoHit};  // along the optical axis, rays having z = 1
  int object{-1};      // -1: background, -2: ground, otherwise index of the box
  int face{0};
};

/// Identifies a convex patch of one colour (mixed like boost::hash_combine).
void mix(std::uint64_t value, std::uint64_t* region) {
  *region ^= value + 0x9e3779b97f4a7c15ULL + (*region << 6) + (*region >> 2);
}

class Tracer {
 public:
  explicit Tracer(const RenderScene& scene) : scene_(scene) {
    for (const RenderBrick& brick : scene.bricks) {
      Box box = makeBox(brick.T_camera_brick, brick.type.size_m, brick.type.color_rgb);
      for (const BrickFace face : brick.type.plate_faces) {
        box.faces[static_cast<std::size_t>(face)].half_plate_m = 0.5 * brick.type.plate_edge_m;
      }
      for (const auto& [id, tag] : brick.tags) {
        LaidTag laid;
        laid.T_tag_camera = (brick.T_camera_brick * tag.T_brick_tag).inverse();
        laid.cells = tagCells(scene.family, id);
        laid.cell_m = tag.black_border_edge_m / TagLayout::blackCells(scene.family);
        laid.half_paper_m = (0.5 * laid.cells.cols + scene.margin_cells) * laid.cell_m;
        laid.bend_m = brick.label_bend_m;
        laid.bend_across = {-std::sin(brick.label_bend_axis_rad), std::cos(brick.label_bend_axis_rad)};
        box.faces[static_cast<std::size_t>(tag.face)].tags.push_back(std::move(laid));
      }
      boxes_.push_back(std::move(box));
    }
    for (const RenderBox& box : scene.boxes) {
      boxes_.push_back(makeBox(box.T_camera_box, box.size_m, box.color_rgb));
    }
    if (scene.T_camera_ground) {
      T_ground_camera_ = scene.T_camera_ground->inverse();
      ground_light_ = light(scene.T_camera_ground->linear().col(2));
    }
  }

  /// What the ray (x, y, 1) meets first. Boxes that cannot be seen at `pixel` are not looked at if it is given.
  Hit cast(const Eigen::Vector2d& bearing, const cv::Point* pixel) const {
    const Eigen::Vector3d ray(bearing.x(), bearing.y(), 1.0);
    Hit hit;
    for (std::size_t i = 0; i < boxes_.size(); ++i) {
      const Box& box = boxes_[i];
      if (pixel && !box.roi.contains(*pixel)) continue;
      const Eigen::Vector3d direction = box.T_box_camera.linear() * ray;
      const Eigen::Vector3d& eye = box.T_box_camera.translation();
      double enter = 0.0;
      double leave = kNoHit;
      int face = -1;
      for (int axis = 0; axis < 3; ++axis) {
        const double inverse = 1.0 / direction[axis];
        double near = (-box.half_m[axis] - eye[axis]) * inverse;
        double far = (box.half_m[axis] - eye[axis]) * inverse;
        int near_face = 2 * axis + 1;  // of -axis
        if (near > far) {
          std::swap(near, far);
          near_face = 2 * axis;
        }
        if (near > enter) {
          enter = near;
          face = near_face;
        }
        leave = std::min(leave, far);
      }
      if (face >= 0 && enter < leave && enter < hit.z_m) hit = {enter, static_cast<int>(i), face};
    }
    if (T_ground_camera_) {
      const double z_m = -T_ground_camera_->translation().z() / T_ground_camera_->linear().row(2).dot(ray);
      if (z_m > 0.0 && z_m < hit.z_m) hit = {z_m, -2, 0};
    }
    return hit;
  }

  /// Colour of what was hit, and which patch of even colour it is.
  Eigen::Vector3d look(const Eigen::Vector2d& bearing, const Hit& hit, std::uint64_t* region) const {
    *region = 0;
    mix(static_cast<std::uint64_t>(hit.object + 2), region);
    if (hit.object == -1) return scene_.background_rgb;
    if (hit.object == -2) return scene_.ground_rgb * ground_light_;
    mix(static_cast<std::uint64_t>(hit.face), region);
    const Box& box = boxes_[static_cast<std::size_t>(hit.object)];
    const Face& face = box.faces[static_cast<std::size_t>(hit.face)];
    const Eigen::Vector3d p_camera = hit.z_m * Eigen::Vector3d(bearing.x(), bearing.y(), 1.0);
    Eigen::Vector3d color = box.color_rgb;
    if (face.half_plate_m > 0.0) {
      const Eigen::Vector2d p = (face.T_face_camera * p_camera).head<2>();
      mix(sector(p.x(), face.half_plate_m) * 3 + sector(p.y(), face.half_plate_m), region);
      if (p.cwiseAbs().maxCoeff() < face.half_plate_m) color = kPlateRgb;
    }
    for (const LaidTag& tag : face.tags) {
      const Eigen::Vector2d p =
          tag.onLabel(tag.T_tag_camera * p_camera, tag.T_tag_camera.linear() * p_camera).head<2>();
      mix(sector(p.x(), tag.half_paper_m) * 3 + sector(p.y(), tag.half_paper_m), region);
      if (p.cwiseAbs().maxCoeff() >= tag.half_paper_m) continue;
      const double half_cells = 0.5 * tag.cells.cols;
      const int column = static_cast<int>(std::floor(p.x() / tag.cell_m + half_cells));
      const int row = static_cast<int>(std::floor(half_cells - p.y() / tag.cell_m));
      mix(static_cast<std::uint64_t>((column + 1000) * 4096 + row + 1000), region);
      const bool is_cell = column >= 0 && column < tag.cells.cols && row >= 0 && row < tag.cells.rows;
      color = is_cell && tag.cells.at<std::uint8_t>(row, column) == 0 ? kInkRgb : kPaperRgb;
    }
    return color * face.light;
  }

  /// Along the optical axis, to a bent label where there is one.
  double depthOf(const Eigen::Vector2d& bearing, const Hit& hit) const {
    if (hit.object < 0) return hit.z_m;
    const Eigen::Vector3d p_camera = hit.z_m * bearing.homogeneous();
    const Box& box = boxes_[static_cast<std::size_t>(hit.object)];
    for (const LaidTag& tag : box.faces[static_cast<std::size_t>(hit.face)].tags) {
      const Eigen::Vector3d p = tag.onLabel(tag.T_tag_camera * p_camera, tag.T_tag_camera.linear() * p_camera);
      if (p.head<2>().cwiseAbs().maxCoeff() < tag.half_paper_m) return (tag.T_tag_camera.inverse() * p).z();
    }
    return hit.z_m;
  }

  const std::vector<Box>& boxes() const { return boxes_; }

 private:
  static std::uint64_t sector(double x, double half) { return x < -half ? 0U : (x < half ? 1U : 2U); }

  double light(const Eigen::Vector3d& n_camera) const {
    const double diffuse = std::max(0.0, n_camera.dot(scene_.light_camera.normalized()));
    return scene_.ambient + (1.0 - scene_.ambient) * diffuse;
  }

  Box makeBox(const Eigen::Isometry3d& T_camera_box, const Eigen::Vector3d& size_m,
              const Eigen::Vector3d& color_rgb) const {
    Box box;
    box.T_box_camera = T_camera_box.inverse();
    box.half_m = 0.5 * size_m;
    box.color_rgb = color_rgb;
    BrickType type;
    type.size_m = size_m;
    for (const BrickFace face : kBrickFaces) {
      const Eigen::Isometry3d T_camera_face = T_camera_box * tagPose(type, face);
      box.faces[static_cast<std::size_t>(face)].T_face_camera = T_camera_face.inverse();
      box.faces[static_cast<std::size_t>(face)].light = light(T_camera_face.linear().col(2));
    }
    const cv::Rect image(0, 0, scene_.camera.width_px + 1, scene_.camera.height_px + 1);
    box.roi = image;
    Eigen::AlignedBox2d seen;
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector3d sign(corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0, corner & 4 ? 1.0 : -1.0);
      const Eigen::Vector2d pixel = scene_.camera.project(T_camera_box * box.half_m.cwiseProduct(sign));
      if (!pixel.allFinite()) return box;  // reaches behind the camera: anywhere
      seen.extend(pixel);
    }
    // Distortion bends edges outward between their corners.
    const double slack = 4.0 + (scene_.camera.distortion == Distortion::kNone ? 0.0 : 0.1 * seen.sizes().maxCoeff());
    const Eigen::Vector2d low = (seen.min().array() - slack).max(0.0).min(20000.0);
    const Eigen::Vector2d high = (seen.max().array() + slack).max(0.0).min(20000.0);
    box.roi = cv::Rect(cv::Point(static_cast<int>(low.x()), static_cast<int>(low.y())),
                       cv::Point(static_cast<int>(high.x()) + 1, static_cast<int>(high.y()) + 1)) &
              image;
    return box;
  }

  const RenderScene& scene_;
  std::vector<Box> boxes_;
  std::optional<Eigen::Isometry3d> T_ground_camera_;
  double ground_light_{1.0};
};

/// Bearings of the pixels' corners: (row, column) is the upper left one of pixel (column, row).
cv::Mat_<cv::Vec2d> cornerBearings(const CameraModel& camera) {
  cv::Mat_<cv::Vec2d> pixels(camera.height_px + 1, camera.width_px + 1);
  for (int row = 0; row < pixels.rows; ++row) {
    for (int column = 0; column < pixels.cols; ++column) pixels(row, column) = {column - 0.5, row - 0.5};
  }
  if (camera.distortion == Distortion::kNone) {
    for (cv::Vec2d& pixel : pixels) {
      pixel = {(pixel[0] - camera.cx_px) / camera.fx_px, (pixel[1] - camera.cy_px) / camera.fy_px};
    }
    return pixels;
  }
  const cv::Matx33d matrix(camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0);
  const cv::Mat list = pixels.reshape(2, 1);
  cv::Mat straight;
  if (camera.distortion == Distortion::kEquidistant) {
    cv::fisheye::undistortPoints(list, straight, matrix, camera.coefficients);
  } else {
    cv::undistortPoints(list, straight, matrix, camera.coefficients, cv::noArray(), cv::noArray(),
                        cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-9));
  }
  return straight.reshape(2, pixels.rows);
}

/// Points of the unit square whose projections on both axes are evenly spread (Hammersley's set): an edge along a row of
/// pixels is met as finely as a slanted one.
std::vector<Eigen::Vector2d> samplePoints(int count) {
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < count; ++i) {
    double inverse = 0.0;
    double digit = 0.5;
    for (int rest = i; rest > 0; rest /= 2, digit *= 0.5) inverse += digit * (rest % 2);
    points.emplace_back((i + 0.5) / count, inverse + 0.5 / count);
  }
  return points;
}

cv::Vec3f toBgr(const Eigen::Vector3d& rgb) {
  return {static_cast<float>(255.0 * rgb.z()), static_cast<float>(255.0 * rgb.y()),
          static_cast<float>(255.0 * rgb.x())};
}

void trace(const RenderScene& scene, const Tracer& tracer, cv::Mat_<cv::Vec3f>* light, cv::Mat_<float>* depth_m) {
  const CameraModel& camera = scene.camera;
  const cv::Mat_<cv::Vec2d> bearings = cornerBearings(camera);
  const auto bearingAt = [&](int row, int column) {
    return Eigen::Vector2d(bearings(row, column)[0], bearings(row, column)[1]);
  };
  std::vector<std::uint64_t> corner_regions(bearings.total());
  const auto regionAt = [&](int row, int column) -> std::uint64_t& {
    return corner_regions[static_cast<std::size_t>(row) * static_cast<std::size_t>(bearings.cols) +
                          static_cast<std::size_t>(column)];
  };
  for (int row = 0; row < bearings.rows; ++row) {
    for (int column = 0; column < bearings.cols; ++column) {
      const cv::Point pixel(column, row);
      tracer.look(bearingAt(row, column), tracer.cast(bearingAt(row, column), &pixel), &regionAt(row, column));
    }
  }
  // A pixel whose corners see one convex patch sees nothing else, unless a box's corner pokes in.
  cv::Mat_<std::uint8_t> has_tip = cv::Mat_<std::uint8_t>::zeros(camera.height_px, camera.width_px);
  for (const Box& box : tracer.boxes()) {
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector3d sign(corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0, corner & 4 ? 1.0 : -1.0);
      const Eigen::Vector2d seen = camera.project(box.T_box_camera.inverse() * box.half_m.cwiseProduct(sign));
      const cv::Rect2d image(-0.5, -0.5, camera.width_px, camera.height_px);
      if (!image.contains({seen.x(), seen.y()})) continue;
      has_tip(static_cast<int>(seen.y() + 0.5), static_cast<int>(seen.x() + 0.5)) = 1;
    }
  }
  const std::vector<Eigen::Vector2d> samples = samplePoints(scene.samples);
  light->create(camera.height_px, camera.width_px);
  depth_m->create(camera.height_px, camera.width_px);
  for (int row = 0; row < camera.height_px; ++row) {
    for (int column = 0; column < camera.width_px; ++column) {
      const cv::Point pixel(column, row);
      const Eigen::Vector2d top_left = bearingAt(row, column);
      const Eigen::Vector2d top_right = bearingAt(row, column + 1);
      const Eigen::Vector2d bottom_left = bearingAt(row + 1, column);
      const Eigen::Vector2d bottom_right = bearingAt(row + 1, column + 1);
      const Eigen::Vector2d middle = 0.25 * (top_left + top_right + bottom_left + bottom_right);
      const Hit hit = tracer.cast(middle, &pixel);
      (*depth_m)(row, column) = std::isfinite(hit.z_m) ? static_cast<float>(tracer.depthOf(middle, hit))
                                                       : std::numeric_limits<float>::quiet_NaN();
      std::uint64_t region = 0;
      Eigen::Vector3d color = tracer.look(middle, hit, &region);
      const bool is_even = has_tip(row, column) == 0 && regionAt(row, column) == region &&
                           regionAt(row, column + 1) == region && regionAt(row + 1, column) == region &&
                           regionAt(row + 1, column + 1) == region;
      if (!is_even) {
        color.setZero();
        for (const Eigen::Vector2d& sample : samples) {
          const Eigen::Vector2d bearing =
              (1.0 - sample.y()) * ((1.0 - sample.x()) * top_left + sample.x() * top_right) +
              sample.y() * ((1.0 - sample.x()) * bottom_left + sample.x() * bottom_right);
          color += tracer.look(bearing, tracer.cast(bearing, &pixel), &region);
        }
        color /= static_cast<double>(samples.size());
      }
      (*light)(row, column) = toBgr(color);
    }
  }
}

cv::Mat motionKernel(const Eigen::Vector2d& motion_px) {
  const int half = static_cast<int>(std::ceil(0.5 * motion_px.cwiseAbs().maxCoeff()));
  cv::Mat_<float> kernel = cv::Mat_<float>::zeros(2 * half + 3, 2 * half + 3);
  const int steps = 8 * half + 8;
  for (int i = 0; i <= steps; ++i) {
    const Eigen::Vector2d at =
        (static_cast<double>(i) / steps - 0.5) * motion_px + Eigen::Vector2d::Constant(half + 1.0);
    const int column = static_cast<int>(std::floor(at.x()));
    const int row = static_cast<int>(std::floor(at.y()));
    const auto dx = static_cast<float>(at.x() - column);
    const auto dy = static_cast<float>(at.y() - row);
    kernel(row, column) += (1.0F - dx) * (1.0F - dy);
    kernel(row, std::min(column + 1, kernel.cols - 1)) += dx * (1.0F - dy);
    kernel(std::min(row + 1, kernel.rows - 1), column) += (1.0F - dx) * dy;
    kernel(std::min(row + 1, kernel.rows - 1), std::min(column + 1, kernel.cols - 1)) += dx * dy;
  }
  return kernel / cv::sum(kernel)[0];
}

cv::Mat_<float> normalNoise(const cv::Size& size, cv::RNG* random) {
  cv::Mat_<float> noise(size);
  random->fill(noise, cv::RNG::NORMAL, 0.0, 1.0);
  return noise;
}

/// Of unit variance, alike over about `length_px`.
cv::Mat_<float> smoothNoise(const cv::Size& size, double length_px, cv::RNG* random) {
  cv::Mat_<float> noise = normalNoise(size, random);
  if (length_px <= 1.0) return noise;
  cv::GaussianBlur(noise, noise, cv::Size(), 0.5 * length_px, 0.5 * length_px, cv::BORDER_REFLECT);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(noise, mean, deviation);
  return noise / deviation[0];
}

cv::Mat toImage(cv::Mat_<cv::Vec3f> light, const RenderEffects& effects, cv::RNG* random) {
  for (int row = 0; row < light.rows; ++row) {
    for (int column = 0; column < light.cols; ++column) {
      const double gradient = 1.0 + effects.light_gradient.x() * ((column + 0.5) / light.cols - 0.5) +
                              effects.light_gradient.y() * ((row + 0.5) / light.rows - 0.5);
      double factor = std::max(0.0, effects.exposure * gradient);
      const Eigen::Vector2d pixel(column, row);
      if (!effects.shadow_normal.isZero()) {
        const double in_px = effects.shadow_normal.dot(pixel - effects.shadow_px);
        const double share = std::clamp(0.5 + in_px / effects.shadow_width_px, 0.0, 1.0);
        factor *= 1.0 - share * (1.0 - effects.shadow_factor);
      }
      light(row, column) *= static_cast<float>(factor);
      if (effects.glare > 0.0) {
        const double off = (pixel - effects.glare_px).squaredNorm() / std::pow(effects.glare_radius_px, 2);
        light(row, column) += cv::Vec3f::all(static_cast<float>(255.0 * effects.glare * std::exp(-off)));
      }
    }
  }
  if (!effects.motion_px.isZero()) cv::filter2D(light, light, -1, motionKernel(effects.motion_px));
  if (effects.blur_sigma_px > 0.0) {
    // The default kernel for 8 bits would be cut at 3 sigma; floats are cut at 4.
    cv::GaussianBlur(light, light, cv::Size(), effects.blur_sigma_px, effects.blur_sigma_px, cv::BORDER_REFLECT);
  }
  if (effects.gamma != 1.0) {
    cv::Mat scaled = light / 255.0F;
    cv::pow(scaled, 1.0 / effects.gamma, scaled);
    light = scaled * 255.0F;
  }
  light = light * effects.contrast + cv::Scalar::all(127.5 * (1.0 - effects.contrast) + effects.brightness);
  if (effects.noise_std > 0.0 || effects.shot_noise > 0.0) {
    const cv::Mat_<float> noise = normalNoise(light.size(), random);
    for (int row = 0; row < light.rows; ++row) {
      for (int column = 0; column < light.cols; ++column) {
        cv::Vec3f& value = light(row, column);
        const float signal = std::max(0.0F, (value[0] + value[1] + value[2]) / 3.0F);
        const double deviation = std::sqrt(effects.noise_std * effects.noise_std + effects.shot_noise * signal);
        value += cv::Vec3f::all(static_cast<float>(deviation) * noise(row, column));
      }
    }
  }
  cv::Mat image;
  light.convertTo(image, CV_8UC3);
  return image;
}

void spoilDepth(const RenderEffects& effects, cv::RNG* random, cv::Mat_<float>* depth_m) {
  if (effects.depth_noise > 0.0) {
    const cv::Mat_<float> noise = smoothNoise(depth_m->size(), effects.depth_noise_px, random);
    for (int row = 0; row < depth_m->rows; ++row) {
      for (int column = 0; column < depth_m->cols; ++column) {
        const double inverse = 1.0 / (*depth_m)(row, column) + effects.depth_noise * noise(row, column);
        (*depth_m)(row, column) = inverse > 0.0 ? static_cast<float>(1.0 / inverse) : std::nanf("");
      }
    }
  }
  if (effects.depth_holes > 0.0) {
    constexpr double kHolePx = 8.0;
    const cv::Mat_<float> field = smoothNoise(depth_m->size(), kHolePx, random);
    std::vector<float> sorted(field.begin(), field.end());
    const auto rank = static_cast<std::ptrdiff_t>(std::min(1.0, effects.depth_holes) * (sorted.size() - 1.0));
    std::nth_element(sorted.begin(), sorted.begin() + rank, sorted.end());
    const float limit = sorted[static_cast<std::size_t>(rank)];
    depth_m->setTo(std::numeric_limits<float>::quiet_NaN(), field <= limit);
  }
}

std::vector<RenderedTag> visibleTags(const RenderScene& scene, const Tracer& tracer) {
  constexpr int kGrid = 24;  // share of visibility to 0.2 %
  std::vector<RenderedTag> tags;
  for (std::size_t index = 0; index < scene.bricks.size(); ++index) {
    for (const auto& [id, laid] : scene.bricks[index].tags) {
      RenderedTag tag;
      tag.id = id;
      tag.brick_index = index;
      tag.T_camera_tag = scene.bricks[index].T_camera_brick * laid.T_brick_tag;
      tag.corner_edge_m =
          laid.black_border_edge_m * TagLayout::borderCells(scene.family) / TagLayout::blackCells(scene.family);
      if (tag.T_camera_tag.linear().col(2).dot(tag.T_camera_tag.translation()) >= 0.0) continue;
      const double half_m = 0.5 * tag.corner_edge_m;
      const auto pixelOf = [&](double x, double y) {
        return scene.camera.project(tag.T_camera_tag * Eigen::Vector3d(x, y, 0.0));
      };
      tag.corners_px = {pixelOf(-half_m, half_m), pixelOf(half_m, half_m), pixelOf(half_m, -half_m),
                        pixelOf(-half_m, -half_m)};
      if (!std::all_of(tag.corners_px.begin(), tag.corners_px.end(), [](const auto& c) { return c.allFinite(); })) {
        continue;
      }
      tag.shortest_side_px = kNoHit;
      for (std::size_t i = 0; i < 4; ++i) {
        tag.shortest_side_px = std::min(tag.shortest_side_px, (tag.corners_px[i] - tag.corners_px[(i + 1) % 4]).norm());
      }
      int num_seen = 0;
      for (int i = 0; i < kGrid * kGrid; ++i) {
        const double x = half_m * ((2.0 * (i % kGrid) + 1.0) / kGrid - 1.0);
        const double y = half_m * ((2.0 * (i / kGrid) + 1.0) / kGrid - 1.0);
        const Eigen::Vector3d p_camera = tag.T_camera_tag * Eigen::Vector3d(x, y, 0.0);
        const Eigen::Vector2d pixel = pixelOf(x, y);
        const bool is_inside = pixel.x() >= -0.5 && pixel.y() >= -0.5 && pixel.x() < scene.camera.width_px - 0.5 &&
                               pixel.y() < scene.camera.height_px - 0.5;
        if (is_inside && tracer.cast(p_camera.hnormalized(), nullptr).z_m > p_camera.z() - 1e-6) ++num_seen;
      }
      tag.visible_share = static_cast<double>(num_seen) / (kGrid * kGrid);
      tags.push_back(tag);
    }
  }
  return tags;
}

}  // namespace

cv::Mat tagCells(const std::string& family, int id) {
  static const std::map<std::string, int> kDictionaries = {{"DICT_4X4_1000", cv::aruco::DICT_4X4_1000},
                                                           {"DICT_5X5_1000", cv::aruco::DICT_5X5_1000},
                                                           {"DICT_6X6_1000", cv::aruco::DICT_6X6_1000}};
  if (const auto known = kDictionaries.find(family); known != kDictionaries.end()) {
    const cv::Ptr<cv::aruco::Dictionary> dictionary = cv::aruco::getPredefinedDictionary(known->second);
    requireId(family, id, dictionary->bytesList.rows);
    cv::Mat cells;
    dictionary->drawMarker(id, dictionary->markerSize + 2, cells, 1);
    return cells;
  }
  const AprilTagFamily april_tags = aprilTagFamily(family);
  if (!april_tags) throw std::invalid_argument("family = " + family + ", must be one that this library can draw");
  requireId(family, id, static_cast<int>(april_tags->ncodes));
  const std::unique_ptr<image_u8_t, void (*)(image_u8_t*)> image(
      apriltag_to_image(april_tags.get(), static_cast<std::uint32_t>(id)), image_u8_destroy);
  const cv::Mat all(image->height, image->width, CV_8UC1, image->buf, static_cast<std::size_t>(image->stride));
  // Families without data outside the border are drawn with a white ring, which is part of the margin here.
  const int ring = april_tags->reversed_border ? 0 : (april_tags->total_width - april_tags->width_at_border) / 2;
  return all(cv::Rect(ring, ring, all.cols - 2 * ring, all.rows - 2 * ring)).clone();
}

RenderBrick catalogueBrick(const BrickCatalogue& catalogue, int brick_id, const Eigen::Isometry3d& T_camera_brick) {
  RenderBrick brick;
  brick.type = catalogue.typeOf(brick_id);
  brick.T_camera_brick = T_camera_brick;
  for (const mp700_ur5e_description::LabelledBrick& labelled : catalogue.bricks) {
    if (labelled.id == brick_id) brick.tags = labelled.tags;
  }
  if (brick_id < catalogue.maxBricks()) {
    for (const BrickFace face : kBrickFaces) {
      const int tag_id = catalogue.tagId(brick_id, face);
      brick.tags[tag_id] = *catalogue.brickOfTag(tag_id);
    }
  }
  return brick;
}

RenderBrick tagBoard(int tag_id, double black_border_edge_m, double board_edge_m,
                     const Eigen::Isometry3d& T_camera_tag) {
  constexpr double kThickness = 0.01;
  RenderBrick board;
  board.type.name = "board";
  board.type.size_m = {board_edge_m, board_edge_m, kThickness};
  board.type.plate_faces.clear();
  board.type.color_rgb = kPlateRgb;
  BrickTag tag;
  tag.face = BrickFace::kPlusZ;
  tag.black_border_edge_m = black_border_edge_m;
  tag.T_brick_tag = tagPose(board.type, tag.face);
  board.tags[tag_id] = tag;
  board.T_camera_brick = T_camera_tag * tag.T_brick_tag.inverse();
  return board;
}

RenderedView render(const RenderScene& scene, const RenderEffects& effects, std::uint32_t seed) {
  const std::vector<std::string> problems = scene.camera.validate();
  if (!problems.empty()) throw std::invalid_argument("camera: " + problems.front());
  const Tracer tracer(scene);
  cv::RNG random(seed + 0x9e3779b9ULL);  // cv::RNG would take 0 for something else
  cv::Mat_<cv::Vec3f> light;
  cv::Mat_<float> depth_m;
  trace(scene, tracer, &light, &depth_m);
  RenderedView view;
  view.color = toImage(light, effects, &random);
  cv::cvtColor(view.color, view.grey, cv::COLOR_BGR2GRAY);
  spoilDepth(effects, &random, &depth_m);
  view.depth_m = depth_m;
  view.tags = visibleTags(scene, tracer);
  return view;
}

Eigen::Isometry3d poseSeenAt(const CameraModel& camera, const Eigen::Vector2d& pixel, double distance_m,
                             double tilt_rad, double tilt_axis_rad, double roll_rad) {
  const Eigen::Vector3d towards = camera.bearing(pixel).homogeneous().normalized();
  // A frame that looks back along the ray, x right and y up in the image.
  Eigen::Matrix3d R_camera_facing;
  R_camera_facing.col(2) = -towards;
  R_camera_facing.col(0) = Eigen::Vector3d::UnitY().cross(towards).normalized();
  R_camera_facing.col(1) = R_camera_facing.col(2).cross(R_camera_facing.col(0));
  Eigen::Isometry3d T_camera_tag = Eigen::Isometry3d::Identity();
  T_camera_tag.translation() = distance_m * towards;
  T_camera_tag.linear() =
      R_camera_facing *
      Eigen::AngleAxisd(tilt_rad, Eigen::Vector3d(std::cos(tilt_axis_rad), std::sin(tilt_axis_rad), 0.0)) *
      Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitZ());
  return T_camera_tag;
}

}  // namespace brick_detection
