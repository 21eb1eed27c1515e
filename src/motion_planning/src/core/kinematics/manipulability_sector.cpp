// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/manipulability_sector.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <optional>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/files/yaml_map.h>
#include <interactive_mapping_common/formatted.h>
#include <mp700_ur5e_description/robot_names.h>

namespace motion_planning {
namespace {

using interactive_mapping::Interval;
using interactive_mapping::YamlMap;

constexpr double kDegree = M_PI / 180.0;

/// Steps round a full circle: even, so that a half circle is whole bins.
int stepsPerTurn(double step_rad) {
  return 2 * std::max(1, static_cast<int>(std::lround(M_PI / step_rad)));
}

/// Angles in the middle of steps: no joint starts out on a singularity.
std::vector<double> anglesOf(const ArmLimits& limits, int joint, double step_rad) {
  double lower = limits.lower_rad[joint], upper = limits.upper_rad[joint];
  int count = stepsPerTurn(step_rad);
  if (upper - lower >= 2.0 * M_PI) {
    // Any turn will do; the one about zero is taken where it can be.
    lower = std::clamp(-M_PI, lower, upper - 2.0 * M_PI);
    upper = lower + 2.0 * M_PI;
  } else {
    count = std::max(1, static_cast<int>(std::ceil((upper - lower) / step_rad)));
  }
  std::vector<double> angles;
  for (int i = 0; i < count; ++i) angles.push_back(lower + (upper - lower) * (i + 0.5) / count);
  return angles;
}

double tiltFromUp(const Eigen::Vector3d& direction) {
  return std::acos(std::clamp(direction.normalized().z(), -1.0, 1.0));
}

/// Between two headings in the plane, [0, pi].
double headingBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::abs(std::remainder(std::atan2(a.y(), a.x()) - std::atan2(b.y(), b.x()), 2.0 * M_PI));
}

/// `normal` of the face the tool touches, against its axis; `softness_rad` is added to cones.
std::optional<ApproachKind> kindOf(const Eigen::Vector3d& point_armbase, const Eigen::Vector3d& normal_armbase,
                                   const ManipulabilityConfig& config, double softness_rad = 0.0) {
  const double tilt_rad = tiltFromUp(normal_armbase);
  if (tilt_rad <= config.cone_rad + softness_rad) return ApproachKind::kTop;
  if (std::abs(tilt_rad - M_PI_2) > config.cone_rad + softness_rad) return std::nullopt;
  if (headingBetween(-normal_armbase, point_armbase) > config.facing_rad + softness_rad) return std::nullopt;
  return ApproachKind::kSide;
}

/// Cells over |bearing|, radius and height, with the number of samples in each.
class ReachGrid {
 public:
  ReachGrid(const std::vector<ReachSample>& samples, ApproachKind kind, const ManipulabilityConfig& config)
      : cell_m_(config.cell_m), num_bearings_(stepsPerTurn(config.joint_step_rad) / 2) {
    double max_radius_m = 0.0;
    bool is_first = true;
    int top = 0;
    for (const ReachSample& sample : samples) {
      if (sample.kind != kind) continue;
      max_radius_m = std::max(max_radius_m, sample.tip_armbase.head<2>().norm());
      const int layer = layerOf(sample.tip_armbase.z());
      bottom_ = is_first ? layer : std::min(bottom_, layer);
      top = is_first ? layer : std::max(top, layer);
      is_first = false;
    }
    if (is_first) return;
    num_radii_ = static_cast<int>(max_radius_m / cell_m_) + 1;
    num_heights_ = top - bottom_ + 1;
    counts_.resize(2u * static_cast<std::size_t>(num_bearings_ * num_radii_ * num_heights_));
    for (const ReachSample& sample : samples) {
      if (sample.kind != kind) continue;
      const Eigen::Vector3d& p = sample.tip_armbase;
      const double bearing_rad = std::atan2(p.y(), p.x());
      const int bearing = std::min(static_cast<int>(std::abs(bearing_rad) / M_PI * num_bearings_), num_bearings_ - 1);
      const int radius = static_cast<int>(p.head<2>().norm() / cell_m_);
      ++counts_[index(bearing, radius, layerOf(p.z()) - bottom_, bearing_rad < 0.0)];
    }
    std::vector<int> filled;
    for (const int count : counts_) {
      if (count > 0) filled.push_back(count);
    }
    std::nth_element(filled.begin(), filled.begin() + static_cast<std::ptrdiff_t>(filled.size() / 2), filled.end());
    min_count_ = std::max(1.0, config.min_density * filled[filled.size() / 2]);
  }

  int numBearings() const { return num_bearings_; }
  int numRadii() const { return num_radii_; }
  int numHeights() const { return num_heights_; }
  double bearing(int index) const { return M_PI * index / num_bearings_; }
  double radius(int index) const { return cell_m_ * index; }
  double height(int index) const { return cell_m_ * (bottom_ + index); }

  /// Share of a cell's two sides, left and right, that is reached: 0, 1/2 or 1.
  double reached(int bearing, int radius, int height) const {
    double sides = 0.0;
    for (const bool is_right : {false, true}) {
      if (counts_[index(bearing, radius, height, is_right)] >= min_count_) sides += 0.5;
    }
    return sides;
  }
  /// Of both sides, up to a factor common to all cells.
  double volume(int radius) const { return radius + 0.5; }

 private:
  int layerOf(double height_m) const { return static_cast<int>(std::floor(height_m / cell_m_)); }
  std::size_t index(int bearing, int radius, int height, bool is_right) const {
    return 2u * static_cast<std::size_t>((bearing * num_radii_ + radius) * num_heights_ + height) + (is_right ? 1 : 0);
  }

  double cell_m_;
  int num_bearings_;
  int num_radii_{0};
  int num_heights_{0};
  int bottom_{0};
  double min_count_{1.0};
  std::vector<int> counts_;
};

/// Cells [first, last) in each direction.
struct CellBox {
  int bearings{0};  // from straight ahead
  int first_radius{0};
  int last_radius{0};
  int first_height{0};
  int last_height{0};
};

/// The box of largest sum of volume x (reached - min_fill): for each width and each pair of radii, the best run of heights
/// (Kadane's algorithm).
CellBox largestBox(const ReachGrid& grid, double min_fill, double max_half_angle_rad) {
  const auto num_heights = static_cast<std::size_t>(grid.numHeights());
  std::vector<std::vector<double>> gain(static_cast<std::size_t>(grid.numRadii()), std::vector<double>(num_heights));
  CellBox best;
  double best_sum = 0.0;
  for (int bearing = 0; bearing < grid.numBearings(); ++bearing) {
    if (grid.bearing(bearing + 1) > max_half_angle_rad + 1e-9) break;  // rounding of half a circle
    for (int radius = 0; radius < grid.numRadii(); ++radius) {
      for (int height = 0; height < grid.numHeights(); ++height) {
        gain[static_cast<std::size_t>(radius)][static_cast<std::size_t>(height)] +=
            grid.volume(radius) * (grid.reached(bearing, radius, height) - min_fill);
      }
    }
    for (int first = 0; first < grid.numRadii(); ++first) {
      std::vector<double> column(num_heights, 0.0);
      for (int last = first; last < grid.numRadii(); ++last) {
        double sum = 0.0;
        int start = 0;
        for (int height = 0; height < grid.numHeights(); ++height) {
          const auto row = static_cast<std::size_t>(height);
          column[row] += gain[static_cast<std::size_t>(last)][row];
          if (sum <= 0.0) {
            sum = 0.0;
            start = height;
          }
          sum += column[row];
          if (sum > best_sum) {
            best_sum = sum;
            best = {bearing + 1, first, last + 1, start, height + 1};
          }
        }
      }
    }
  }
  return best;
}

std::string text(double value) {
  return interactive_mapping::formatted("%.3g", value);
}

std::string between(const std::string& what, double value, double low, double high, const std::string& unit) {
  return what + " = " + text(value) + " " + unit + ", must be in [" + text(low) + ", " + text(high) + "] " + unit;
}

/// A key of the YAML file, where its number goes, and what it may be.
struct Field {
  const char* key;
  double* value;
  Interval allowed;
};

std::vector<Field> fieldsOf(AnnulusSector* sector) {
  constexpr double kFar_m = 2.0;  // an arm of two metres reaches nothing beyond
  return {{"min_radius_m", &sector->min_radius_m, {0.0, kFar_m, "m"}},
          {"max_radius_m", &sector->max_radius_m, {sector->min_radius_m, kFar_m, "m"}},
          {"min_height_m", &sector->min_height_m, {-kFar_m, kFar_m, "m"}},
          {"max_height_m", &sector->max_height_m, {sector->min_height_m, kFar_m, "m"}},
          {"half_angle_rad", &sector->half_angle_rad, {0.0, M_PI + 1e-9, "rad"}}};
}

std::vector<Field> fieldsOf(ManipulabilityConfig* config) {
  return {
      {"joint_step_rad", &config->joint_step_rad, {0.05, M_PI_4, "rad"}},  // finer takes hours, coarser leaves holes
      {"min_manipulability_m3", &config->min_manipulability_m3, {0.0, 1.0, "m^3"}},
      {"cone_rad", &config->cone_rad, {0.0, M_PI_4, "rad"}},  // wider, and a posture comes to tops and sides alike
      {"facing_rad", &config->facing_rad, {0.0, M_PI, "rad"}},
      // below: no bin of the coarsest step
      {"max_half_angle_rad", &config->max_half_angle_rad, {M_PI_4, M_PI + 1e-9, "rad"}},
      {"cell_m", &config->cell_m, {0.01, 0.5, "m"}},
      {"min_density", &config->min_density, {0.0, 1.0}},
      {"min_fill", &config->min_fill, {0.05, 0.95}}};
}

template <typename Target>
void read(YamlMap map, Target* target) {
  // What a field may be depends on those before it.
  for (std::size_t i = 0; i < fieldsOf(target).size(); ++i) {
    const Field field = fieldsOf(target)[i];
    *field.value = map.number(field.key, field.allowed);
  }
  map.finish();
}

}  // namespace

bool AnnulusSector::contains(const Eigen::Vector3d& p) const {
  const double radius_m = p.head<2>().norm();
  return radius_m >= min_radius_m && radius_m <= max_radius_m && p.z() >= min_height_m && p.z() <= max_height_m &&
         std::abs(std::atan2(p.y(), p.x())) <= half_angle_rad;
}

double AnnulusSector::volume() const {
  return half_angle_rad * (max_radius_m * max_radius_m - min_radius_m * min_radius_m) * (max_height_m - min_height_m);
}

std::vector<std::string> ManipulabilityConfig::validate() const {
  ManipulabilityConfig copy = *this;  // the fields are also read into
  interactive_mapping::RangeCheck check;
  for (const auto& [key, value, allowed] : fieldsOf(&copy)) {
    check(key, *value, allowed.low, allowed.high, allowed.unit.c_str());
  }
  return check.problems();
}

std::vector<ReachSample> sampleReach(const ArmKinematics& arm, const ManipulabilityConfig& config,
                                     const std::function<bool(const ArmVector&)>& is_free,
                                     const std::function<void(double)>& progress) {
  interactive_mapping::refuseIfAny("impossible fit:", config.validate());
  const Eigen::Isometry3d T_armbase_base =
      arm.robot()
          .framePose(mp700_ur5e_description::kArmBaseFrame, arm.robotPositions(ArmVector::Zero()))
          .inverse(Eigen::Isometry);
  std::array<std::vector<double>, 5> angles;
  for (int joint = 0; joint < 5; ++joint) {
    angles[static_cast<std::size_t>(joint)] = anglesOf(arm.limits(), joint, config.joint_step_rad);
  }
  // The kind depends on the pan angle only as far as a calibrated pan axis is not plumb: tenths of a degree.
  constexpr double kPlumb_rad = 0.02;

  std::vector<ReachSample> samples;
  ArmVector q = ArmVector::Zero();
  q[5] = std::clamp(0.0, arm.limits().lower_rad[5], arm.limits().upper_rad[5]);
  const auto kindAt = [&](const Eigen::Isometry3d& T_armbase_tip, double softness_rad) {
    return kindOf(T_armbase_tip.translation(), -T_armbase_tip.linear().col(2), config, softness_rad);
  };
  for (std::size_t lift = 0; lift < angles[1].size(); ++lift) {
    if (progress) progress(static_cast<double>(lift) / static_cast<double>(angles[1].size()));
    q[1] = angles[1][lift];
    for (const double elbow : angles[2]) {
      q[2] = elbow;
      for (const double wrist_1 : angles[3]) {
        q[3] = wrist_1;
        for (const double wrist_2 : angles[4]) {
          q[4] = wrist_2;
          q[0] = angles[0].front();
          if (!kindAt(T_armbase_base * arm.tipPose(q), kPlumb_rad)) continue;
          const double manipulability_m3 = arm.manipulability(q);  // whatever the pan angle
          if (manipulability_m3 < config.min_manipulability_m3) continue;
          for (const double pan : angles[0]) {
            q[0] = pan;
            const Eigen::Isometry3d T_armbase_tip = T_armbase_base * arm.tipPose(q);
            const std::optional<ApproachKind> kind = kindAt(T_armbase_tip, 0.0);
            if (kind && is_free(q)) samples.push_back({T_armbase_tip.translation(), manipulability_m3, *kind});
          }
        }
      }
    }
  }
  if (progress) progress(1.0);
  return samples;
}

SectorFit fitSector(const std::vector<ReachSample>& samples, ApproachKind kind, const ManipulabilityConfig& config) {
  interactive_mapping::refuseIfAny("impossible fit:", config.validate());
  const ReachGrid grid(samples, kind, config);
  const CellBox box = largestBox(grid, config.min_fill, config.max_half_angle_rad);
  if (box.bearings == 0) {
    throw std::runtime_error(std::string("no sector for ") + toString(kind) + " faces: nowhere is " +
                             text(config.min_fill) + " of the volume reached");
  }
  SectorFit fit;
  fit.sector = {grid.radius(box.first_radius), grid.radius(box.last_radius), grid.height(box.first_height),
                grid.height(box.last_height), grid.bearing(box.bearings)};
  double inside = 0.0, reached_inside = 0.0, reached = 0.0;
  for (int bearing = 0; bearing < grid.numBearings(); ++bearing) {
    for (int radius = 0; radius < grid.numRadii(); ++radius) {
      for (int height = 0; height < grid.numHeights(); ++height) {
        const double volume = grid.volume(radius) * grid.reached(bearing, radius, height);
        reached += volume;
        if (bearing >= box.bearings || radius < box.first_radius || radius >= box.last_radius ||
            height < box.first_height || height >= box.last_height) {
          continue;
        }
        reached_inside += volume;
        inside += grid.volume(radius);
      }
    }
  }
  fit.fill = reached_inside / inside;
  fit.share_of_reach = reached_inside / reached;
  return fit;
}

bool ManipulabilitySectors::admits(const Eigen::Vector3d& point_base, const Eigen::Vector3d& normal_base,
                                   const Eigen::Isometry3d& T_base_armbase, std::string* why_not) const {
  const auto reject = [&](const std::string& reason) {
    if (why_not != nullptr) *why_not = reason;
    return false;
  };
  constexpr double kUnit = 1e-3;  // a normal that is off by more was not meant to be one
  if (!point_base.allFinite() || !(std::abs(normal_base.norm() - 1.0) <= kUnit)) {
    return reject("the face's point is not finite or its normal not of unit length");
  }
  const Eigen::Vector3d point = T_base_armbase.inverse(Eigen::Isometry) * point_base;
  const Eigen::Vector3d normal = T_base_armbase.linear().transpose() * normal_base;
  const double tilt_rad = tiltFromUp(normal);
  const bool is_top = tilt_rad <= config.cone_rad;
  const bool is_between = !is_top && tilt_rad < M_PI_2 - config.cone_rad;
  if (tilt_rad > M_PI_2 + config.cone_rad) {
    return reject("the face points " + text(tilt_rad / kDegree) + " deg away from up, must be at most " +
                  text(90.0 + config.cone_rad / kDegree) + " deg");
  }
  const double facing_rad = is_between ? 2.0 * config.facing_rad : config.facing_rad;
  if (const double aside_rad = headingBetween(-normal, point); !is_top && aside_rad > facing_rad) {
    return reject("the side face points " + text(aside_rad / kDegree) + " deg away from the arm, must be within " +
                  text(facing_rad / kDegree) + " deg");
  }
  const auto isWithin = [&](ApproachKind kind) {
    const AnnulusSector& sector = of(kind);
    if (sector.contains(point)) return true;
    const std::string face = std::string(toString(kind)) + " face: ";
    const double radius_m = point.head<2>().norm();
    if (!(radius_m >= sector.min_radius_m && radius_m <= sector.max_radius_m)) {
      return reject(face +
                    between("radius from the arm's axis", radius_m, sector.min_radius_m, sector.max_radius_m, "m"));
    }
    if (!(point.z() >= sector.min_height_m && point.z() <= sector.max_height_m)) {
      return reject(face +
                    between("height above the arm's foot", point.z(), sector.min_height_m, sector.max_height_m, "m"));
    }
    const double limit_deg = sector.half_angle_rad / kDegree;
    return reject(face + between("bearing", std::atan2(point.y(), point.x()) / kDegree, -limit_deg, limit_deg, "deg"));
  };
  // Between the cones the arm's posture is between those of the two kinds.
  if ((is_top || is_between) && !isWithin(ApproachKind::kTop)) return false;
  return is_top || isWithin(ApproachKind::kSide);
}

std::string ManipulabilitySectors::toYaml() const {
  // Copies: the fields are also read into.
  ManipulabilityConfig config_copy = config;
  AnnulusSector top_copy = top, side_copy = side;
  std::ostringstream out;
  const auto write = [&](const char* key, const std::vector<Field>& fields, int digits) {
    out << key << ":\n" << std::setprecision(digits);
    for (const Field& field : fields) out << "  " << field.key << ": " << *field.value << "\n";
  };
  out << "# Where the arm can pick: see motion_planning/manipulability_sector.h. Made by fit_manipulability from the "
         "URDF\n"
         "# whose checksum this is; not to be edited.\n"
         "urdf_checksum: \""
      << urdf_checksum << "\"\n";
  write("config", fieldsOf(&config_copy), 15);
  out << "# Frame ur5e_base_link. Of the tip: distance from the arm's axis, height above its foot, bearing from "
         "ahead.\n";
  write("top", fieldsOf(&top_copy), 9);
  write("side", fieldsOf(&side_copy), 9);
  return out.str();
}

ManipulabilitySectors ManipulabilitySectors::parse(const std::string& yaml, const std::string& name,
                                                   const mp700_ur5e_description::RobotModel& robot) {
  ManipulabilitySectors result;
  interactive_mapping::readYaml(yaml, name, [&](YamlMap& file, std::vector<std::string>& problems) {
    result.urdf_checksum = file.word("urdf_checksum");
    read(file.map("config"), &result.config);
    read(file.map("top"), &result.top);
    read(file.map("side"), &result.side);
    file.finish();
    if (!result.urdf_checksum.empty() && result.urdf_checksum != robot.checksum()) {
      problems.push_back("urdf_checksum = " + result.urdf_checksum + ", must be " + robot.checksum() +
                         ": the robot has changed since; run: rosparam get -p robot_description > robot.urdf && "
                         "rosrun motion_planning fit_manipulability --urdf robot.urdf --out " +
                         name);
    }
  });
  return result;
}

ManipulabilitySectors ManipulabilitySectors::load(const std::string& path,
                                                  const mp700_ur5e_description::RobotModel& robot) {
  return parse(interactive_mapping::readTextFile(path), path, robot);
}

}  // namespace motion_planning
