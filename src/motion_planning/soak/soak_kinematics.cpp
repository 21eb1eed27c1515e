// SPDX-License-Identifier: BSD-3-Clause
// Inverse kinematics by the million: every pose comes from a posture, so that a solution exists, and every answer is
// checked. A tenth of the postures are next to singularities, a tenth are on limits. Fails on a residual over the
// tolerance, a joint beyond its limits, a number that is not finite, or a pose without a solution.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <exception>
#include <iostream>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>

#include "motion_planning/arm_kinematics.h"

namespace motion_planning {
namespace {

namespace po = boost::program_options;

struct Options {
  std::uint64_t count{1000000};
  std::uint64_t seed{1};
  std::string urdf{URDF_FILE};
};

std::optional<Options> parseCommandLine(int argc, char** argv) {
  Options options;
  po::options_description description("Options");
  description.add_options()("help,h", "show this text")                                          //
      ("count", po::value(&options.count)->default_value(options.count), "poses to solve")       //
      ("seed", po::value(&options.seed)->default_value(options.seed), "of the random postures")  //
      ("urdf", po::value(&options.urdf)->default_value(options.urdf), "the robot");
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv).options(description).run(), values);
  if (values.count("help") > 0) {
    std::cout << "Usage: soak_kinematics [options]\n" << description;
    return std::nullopt;
  }
  po::notify(values);
  return options;
}

class PostureSource {
 public:
  PostureSource(const ArmLimits& limits, std::uint64_t seed) : limits_(limits), rng_(seed) {}

  ArmVector next() {
    ArmVector q;
    for (int i = 0; i < 6; ++i) {
      q[i] = draw(std::max(limits_.lower_rad[i], -2.0 * M_PI), std::min(limits_.upper_rad[i], 2.0 * M_PI));
    }
    const double kind = draw(0.0, 1.0);
    // From a degree down to what doubles do not tell from nothing.
    const double away_rad = std::pow(10.0, draw(-14.0, -2.0));
    if (kind < 0.05) q[2] = away_rad;                 // elbow straight
    if (kind >= 0.03 && kind < 0.1) q[4] = away_rad;  // wrist aligned
    if (kind >= 0.1 && kind < 0.2) {
      const auto joint = static_cast<Eigen::Index>(draw(0.0, 6.0));
      const double limit_rad = draw(0.0, 1.0) < 0.5 ? limits_.lower_rad[joint] : limits_.upper_rad[joint];
      if (std::isfinite(limit_rad)) q[joint] = limit_rad;
    }
    return q;
  }

  double draw(double low, double high) { return std::uniform_real_distribution<double>(low, high)(rng_); }

 private:
  ArmLimits limits_;
  std::mt19937_64 rng_;
};

int run(int argc, char** argv) {
  const std::optional<Options> options = parseCommandLine(argc, argv);
  if (!options) return 0;
  const ArmKinematics arm(mp700_ur5e_description::RobotModel::load(options->urdf));
  PostureSource source(arm.limits(), options->seed);
  std::uint64_t solved = 0, solutions = 0, beyond_limits = 0, not_finite = 0, over_tolerance = 0;
  std::uint64_t generating_found = 0;
  double worst_m = 0.0, worst_rad = 0.0;
  std::vector<float> times_us;
  times_us.reserve(options->count);
  for (std::uint64_t i = 0; i < options->count; ++i) {
    const ArmVector q = source.next();
    const Eigen::Isometry3d goal = arm.tipPose(q);
    ArmVector near_rad = source.next();
    const auto start = std::chrono::steady_clock::now();
    const std::vector<ArmVector> found = arm.inverse(goal, near_rad);
    times_us.push_back(std::chrono::duration<float, std::micro>(std::chrono::steady_clock::now() - start).count());
    if (!found.empty()) ++solved;
    solutions += found.size();
    bool is_generating_found = false;
    for (const ArmVector& solution : found) {
      if (!solution.allFinite()) {
        ++not_finite;
        continue;
      }
      if (!arm.isWithinLimits(solution)) ++beyond_limits;
      const Eigen::Isometry3d reached = arm.tipPose(solution);
      const double error_m = (reached.translation() - goal.translation()).norm();
      const double error_rad = (reached.linear() - goal.linear()).norm() / std::sqrt(2.0);  // of a small rotation
      worst_m = std::max(worst_m, error_m);
      worst_rad = std::max(worst_rad, error_rad);
      // 1.001: both sides round.
      if (error_m > 1.001 * ArmKinematics::kIkPositionTolerance_m ||
          error_rad > 1.001 * ArmKinematics::kIkRotationTolerance_rad) {
        ++over_tolerance;
      }
      double distance_rad = 0.0;
      for (int joint = 0; joint < 6; ++joint) {
        distance_rad = std::max(distance_rad, std::abs(std::remainder(solution[joint] - q[joint], 2.0 * M_PI)));
      }
      // Branches of a stretched arm count as one within 1e-3 rad.
      is_generating_found = is_generating_found || distance_rad < 3e-3;
    }
    if (is_generating_found) ++generating_found;
  }
  std::sort(times_us.begin(), times_us.end());
  const auto quantile = [&](double share) {
    return times_us.empty() ? 0.0f
                            : times_us[static_cast<std::size_t>(share * static_cast<double>(times_us.size() - 1))];
  };
  const bool is_passed = solved == options->count && beyond_limits == 0 && not_finite == 0 && over_tolerance == 0;
  const nlohmann::json summary = {{"count", options->count},
                                  {"solved", solved},
                                  {"unsolved", options->count - solved},
                                  {"solutions", solutions},
                                  {"generating_posture_found", generating_found},
                                  {"worst_position_error_m", worst_m},
                                  {"worst_rotation_error_rad", worst_rad},
                                  {"over_tolerance", over_tolerance},
                                  {"beyond_limits", beyond_limits},
                                  {"not_finite", not_finite},
                                  {"median_us", quantile(0.5)},
                                  {"p99_us", quantile(0.99)},
                                  {"max_us", quantile(1.0)},
                                  {"passed", is_passed}};
  std::cout << summary.dump() << std::endl;
  return is_passed ? 0 : 1;
}

}  // namespace
}  // namespace motion_planning

int main(int argc, char** argv) {
  try {
    return motion_planning::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "soak_kinematics: " << error.what() << '\n';
    return 2;
  }
}
