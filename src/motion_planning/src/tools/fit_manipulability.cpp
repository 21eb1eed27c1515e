// SPDX-License-Identifier: BSD-3-Clause
// Samples what the arm reaches with the tool on a face (eq 12), fits the sectors (eq 13), writes them as YAML.
#include <algorithm>
#include <cstdio>
#include <exception>
#include <iomanip>
#include <iostream>
#include <iterator>
#include <memory>
#include <optional>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <boost/program_options.hpp>
#include <interactive_mapping_common/files/atomic_file.h>
#include <nlohmann/json.hpp>
#include <ros/package.h>

#include "motion_planning/collision_checker.h"
#include "motion_planning/manipulability_sector.h"

namespace motion_planning {
namespace {

namespace po = boost::program_options;

struct Options {
  std::string urdf;
  std::string out;
  std::string samples;
  ManipulabilityConfig config;
  bool is_quiet{false};
};

std::string packageFile(const std::string& package, const std::string& path) {
  const std::string folder = ros::package::getPath(package);
  return folder.empty() ? std::string() : folder + path;
}

/// Nothing when only help was asked for.
std::optional<Options> parseCommandLine(int argc, char** argv) {
  Options options;
  options.urdf = packageFile("mp700_ur5e_description", "/urdf/mp700_ur5e.urdf");
  ManipulabilityConfig& config = options.config;
  po::options_description description("Options");
  description.add_options()("help,h", "show this text")                                                               //
      ("urdf", po::value(&options.urdf)->default_value(options.urdf), "the robot")                                    //
      ("out", po::value(&options.out)->required(), "the sectors: YAML, overwritten")                                  //
      ("samples", po::value(&options.samples), "what is reached (an even part of it): CSV, for plot_manipulability")  //
      ("joint-step", po::value(&config.joint_step_rad)->default_value(config.joint_step_rad, "10 deg"), "[rad]")      //
      ("min-manipulability", po::value(&config.min_manipulability_m3)->default_value(config.min_manipulability_m3),
       "threshold of Yoshikawa's measure [m^3]")                                                      //
      ("cone", po::value(&config.cone_rad)->default_value(config.cone_rad, "30 deg"), "[rad]")        //
      ("facing", po::value(&config.facing_rad)->default_value(config.facing_rad, "45 deg"), "[rad]")  //
      ("max-half-angle", po::value(&config.max_half_angle_rad)->default_value(config.max_half_angle_rad, "90 deg"),
       "of sectors [rad]")                                                                                      //
      ("cell", po::value(&config.cell_m)->default_value(config.cell_m), "[m]")                                  //
      ("min-density", po::value(&config.min_density)->default_value(config.min_density), "[0, 1]")              //
      ("min-fill", po::value(&config.min_fill)->default_value(config.min_fill), "of the sector, [0.05, 0.95]")  //
      ("quiet,q", po::bool_switch(&options.is_quiet), "no progress on stderr");
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv).options(description).run(), values);
  if (values.count("help") > 0) {
    std::cout
        << "Usage: fit_manipulability --out FILE [options]\n"
           "Where the arm can pick: samples its joint space, keeps postures with the tool on a top or side face,\n"
           "enough manipulability and no contact of the robot with itself or the floor, and fits an annulus sector\n"
           "for each kind of face. The last line is a summary in JSON.\n\n"
        << description;
    return std::nullopt;
  }
  po::notify(values);
  if (options.urdf.empty()) {
    throw std::invalid_argument("package mp700_ur5e_description is not found by ROS: give --urdf");
  }
  if (options.out.empty()) throw std::invalid_argument("--out is empty, must be a file to write");
  return options;
}

/// A picture needs no more.
constexpr std::size_t kMaxWritten = 400000;

void writeSamples(const std::string& path, const std::vector<ReachSample>& samples) {
  interactive_mapping::AtomicFile file(path);
  file.write("kind,x,y,z,manipulability\n");
  std::vector<ReachSample> some;
  std::mt19937_64 rng(1);  // every n-th would beat with the steps of the joints
  std::sample(samples.begin(), samples.end(), std::back_inserter(some), kMaxWritten, rng);
  for (const ReachSample& sample : some) {
    std::ostringstream line;
    line << std::setprecision(5) << toString(sample.kind) << ',' << sample.tip_armbase.x() << ','
         << sample.tip_armbase.y() << ',' << sample.tip_armbase.z() << ',' << sample.manipulability_m3 << '\n';
    file.write(line.str());
  }
  file.commit();
}

/// Of one kind: the sector, how well it fits, and the spread of manipulability among the samples.
nlohmann::json summaryOf(const std::vector<ReachSample>& samples, ApproachKind kind, const SectorFit& fit) {
  std::vector<double> manipulability_m3;
  for (const ReachSample& sample : samples) {
    if (sample.kind == kind) manipulability_m3.push_back(sample.manipulability_m3);
  }
  std::sort(manipulability_m3.begin(), manipulability_m3.end());
  const auto quantile = [&](double share) {
    return manipulability_m3[static_cast<std::size_t>(share * static_cast<double>(manipulability_m3.size() - 1))];
  };
  const AnnulusSector& sector = fit.sector;
  return {{"samples", manipulability_m3.size()},
          {"radius_m", {sector.min_radius_m, sector.max_radius_m}},
          {"height_m", {sector.min_height_m, sector.max_height_m}},
          {"half_angle_rad", sector.half_angle_rad},
          {"volume_m3", sector.volume()},
          {"fill", fit.fill},
          {"share_of_reach", fit.share_of_reach},
          {"manipulability_quartiles_m3", {quantile(0.25), quantile(0.5), quantile(0.75)}},
          {"max_manipulability_m3", quantile(1.0)}};
}

int run(int argc, char** argv) {
  const std::optional<Options> options = parseCommandLine(argc, argv);
  if (!options) return 0;
  const auto robot = mp700_ur5e_description::RobotModel::load(options->urdf);
  const auto arm = std::make_shared<ArmKinematics>(robot);
  // Nothing mapped: the robot and the floor it stands on.
  const CollisionSceneBuilder scene_builder{CollisionSceneConfig()};
  const CollisionChecker checker(arm, scene_builder.scene(), Eigen::Isometry3d::Identity());
  const auto isFree = [&](const ArmVector& joints_rad) { return checker.isFree(joints_rad); };
  const auto report = [&](double share) {
    if (!options->is_quiet) std::fprintf(stderr, "\rsampling %3.0f %%%s", 100.0 * share, share < 1.0 ? "" : "\n");
  };
  const std::vector<ReachSample> samples = sampleReach(*arm, options->config, isFree, report);
  if (!options->samples.empty()) writeSamples(options->samples, samples);

  const SectorFit top = fitSector(samples, ApproachKind::kTop, options->config);
  const SectorFit side = fitSector(samples, ApproachKind::kSide, options->config);
  ManipulabilitySectors sectors;
  sectors.top = top.sector;
  sectors.side = side.sector;
  sectors.config = options->config;
  sectors.urdf_checksum = robot->checksum();
  const std::string yaml = sectors.toYaml();
  ManipulabilitySectors::parse(yaml, options->out, *robot);  // what is written can be read
  interactive_mapping::AtomicFile file(options->out);
  file.write(yaml);
  file.commit();

  const nlohmann::json summary = {{"out", options->out},
                                  {"urdf_checksum", robot->checksum()},
                                  {"top", summaryOf(samples, ApproachKind::kTop, top)},
                                  {"side", summaryOf(samples, ApproachKind::kSide, side)}};
  std::cout << summary.dump() << std::endl;
  return 0;
}

}  // namespace
}  // namespace motion_planning

int main(int argc, char** argv) {
  try {
    return motion_planning::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "fit_manipulability: " << error.what() << '\n';
    return 1;
  }
}
