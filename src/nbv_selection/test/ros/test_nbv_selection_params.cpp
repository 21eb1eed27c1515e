// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection_ros/nbv_selection_params.h"

#include <gmock/gmock.h>
#include <ros/ros.h>

#include <interactive_mapping_common_ros/testing/params_contract.h>
#include "nbv_selection_ros/strategy_params.h"

namespace nbv_selection_ros {
namespace {

using params_contract::Contract;
using params_contract::flattened;
using params_contract::messageOf;
using params_contract::readText;
using params_contract::Values;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

const std::string kConfigDir = std::string(NBV_SELECTION_DIR) + "/config/";

XmlRpc::XmlRpcValue listOf(const std::vector<std::string>& texts) {
  XmlRpc::XmlRpcValue list;
  list.setSize(static_cast<int>(texts.size()));
  for (int i = 0; i < list.size(); ++i) list[i] = texts[static_cast<std::size_t>(i)];
  return list;
}

const Contract kNodeContract = {NBV_SELECTION_DIR,
                                "config/nbv_selection.yaml",
                                toYaml(NbvSelectionParams()),
                                [](const ros::NodeHandle& nh) { return toYaml(loadNbvSelectionParams(nh)); },
                                {"seed", "max_attempts", "input/occupied_from"},
                                {{"map_frame", "world"},
                                 {"base_frame", "platform"},
                                 {"base_profile_file", "/profile.yaml"},
                                 {"sectors_file", "/sectors.yaml"},
                                 {"strategies", listOf({"one", "other"})}}};

// Other weights, each another, that sum to 1 as well.
const std::map<std::string, XmlRpc::XmlRpcValue> kOtherThanDefault = {
    {"plugin", "nbv_selection/Other"}, {"removed_factor", "frontier"}, {"manipulability/approach", "from_arm_base"},
    {"weights/manipulability", 0.2},   {"weights/pick_order", 0.16},   {"weights/travel", 0.22},
    {"weights/uncertainty", 0.12},     {"weights/frontier", 0.3}};

const Contract kGpisContract = {NBV_SELECTION_DIR,
                                "config/nbv_selection.yaml",
                                toYaml(GpisStrategyParams()),
                                [](const ros::NodeHandle& nh) { return toYaml(loadGpisStrategyParams(nh)); },
                                {},
                                kOtherThanDefault};

const Contract kOctomapContract = {NBV_SELECTION_DIR,
                                   "config/octomap_strategies.yaml",
                                   toYaml(OctomapStrategyParams()),
                                   [](const ros::NodeHandle& nh) { return toYaml(loadOctomapStrategyParams(nh)); },
                                   {},
                                   kOtherThanDefault};

/// The values of one strategy's section as a file has them.
Values inSection(const std::string& section, const std::string& plugin, const std::string& default_yaml) {
  Values values;
  for (const auto& [key, value] : flattened(default_yaml)) values[section + "/" + key] = value;
  values[section + "/plugin"] = plugin;
  return values;
}

TEST(NbvSelectionParams, ShippedFileHasEveryKeyWithItsDefault) {
  Values expected = flattened(toYaml(NbvSelectionParams()));
  expected.merge(inSection("gpis", "nbv_selection/Gpis", toYaml(GpisStrategyParams())));
  EXPECT_EQ(flattened(readText(kConfigDir + "nbv_selection.yaml")), expected);
}

TEST(NbvSelectionParams, ShippedFileOfTheBaselinesHasEveryKeyWithItsDefault) {
  const std::string defaults = toYaml(OctomapStrategyParams());
  Values expected = inSection("octomap_gradient_frontier", "nbv_selection/OctomapGradientFrontier", defaults);
  expected.merge(inSection("octomap_random", "nbv_selection/OctomapRandom", defaults));
  EXPECT_EQ(flattened(readText(kConfigDir + "octomap_strategies.yaml")), expected);
}

TEST(NbvSelectionParams, ShippedFilesLoadAsTheDefaults) {
  NbvSelectionParams expected;
  expected.base_profile_file = "/profile.yaml";  // what a launch file has to give
  expected.sectors_file = "/sectors.yaml";
  EXPECT_EQ(toYaml(loadNbvSelectionParams(ros::NodeHandle("~shipped"))), toYaml(expected));
  GpisStrategyParams gpis;
  gpis.plugin = "nbv_selection/Gpis";
  EXPECT_EQ(toYaml(loadGpisStrategyParams(ros::NodeHandle("~shipped/gpis"))), toYaml(gpis));
  OctomapStrategyParams octomap;
  octomap.plugin = "nbv_selection/OctomapGradientFrontier";
  EXPECT_EQ(toYaml(loadOctomapStrategyParams(ros::NodeHandle("~shipped/octomap_gradient_frontier"))), toYaml(octomap));
  octomap.plugin = "nbv_selection/OctomapRandom";
  EXPECT_EQ(toYaml(loadOctomapStrategyParams(ros::NodeHandle("~shipped/octomap_random"))), toYaml(octomap));
}

TEST(NbvSelectionParams, EveryKeyIsReadIntoItsOwnField) {
  params_contract::expectEveryKeyIsReadIntoItsOwnField(kNodeContract, ros::NodeHandle("~changed"));
  params_contract::expectEveryKeyIsReadIntoItsOwnField(kGpisContract, ros::NodeHandle("~changed_gpis"));
  params_contract::expectEveryKeyIsReadIntoItsOwnField(kOctomapContract, ros::NodeHandle("~changed_octomap"));
}

TEST(NbvSelectionParams, ReadmeTablesHaveEveryKeyWithItsDefault) {
  const std::string readme = readText(std::string(NBV_SELECTION_DIR) + "/README.md");
  std::size_t rows = 0;
  // The table of strategies has gpis' section, without its name.
  params_contract::forEachScalar(
      YAML::LoadFile(kConfigDir + "nbv_selection.yaml"), "", [&](const std::string& key, const YAML::Node& value) {
        const std::string section = "gpis/";
        const bool is_gpis = key.compare(0, section.size(), section) == 0;
        const std::string text = params_contract::textOf(value);
        const std::string row =
            "| `" + (is_gpis ? key.substr(section.size()) : key) + "` | " + (text.empty() ? "\"\"" : text) + " |";
        EXPECT_NE(readme.find(row), std::string::npos) << row;
        ++rows;
      });
  EXPECT_EQ(rows, flattened(toYaml(NbvSelectionParams())).size() + flattened(toYaml(GpisStrategyParams())).size());
}

TEST(NbvSelectionParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("base_profile_file", "profile.yaml");
  nh.setParam("sectors_file", "/sectors.yaml");
  nh.setParam("map_frame", "/map");
  nh.setParam("base_frame", "");
  nh.setParam("strategies", listOf({"gpis", "a/b", "gpis", "9th"}));
  nh.setParam("colour", true);
  nh.setParam("seed", 1.5);
  nh.setParam("input/max_grid_age_s", 0.05);  // 0: static
  nh.setParam("input/max_pose_age_s", "long");
  nh.setParam("input/map_weight_s", 1.0);
  nh.setParam("failures/radius_m", -1.0);
  nh.setParam("cost/select_s", 61.0);
  nh.setParam("max_attempts", 0);
  nh.setParam("left_over/spacing_m", 0.1);  // no plugin: no strategy's section
  const std::string message = messageOf(kNodeContract, nh);
  EXPECT_THAT(message, HasSubstr("/wrong/base_profile_file = 'profile.yaml', must be the absolute path"));
  EXPECT_THAT(message, Not(HasSubstr("sectors_file")));
  EXPECT_THAT(message, HasSubstr("/wrong/map_frame = '/map', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/base_frame = '', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/strategies holds 'a/b', must be letters, digits and underscores"));
  EXPECT_THAT(message, HasSubstr("/wrong/strategies holds '9th', must be"));
  EXPECT_THAT(message, HasSubstr("/wrong/strategies holds 'gpis' twice, must be once"));
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, AllOf(HasSubstr("/wrong/seed = "), HasSubstr("must be a whole number")));
  EXPECT_THAT(message, HasSubstr("/wrong/input/max_grid_age_s = 0.05 s, must be in [0.1, 3600] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/max_pose_age_s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/map_weight_s is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/failures/radius_m = -1 m"));
  EXPECT_THAT(message, HasSubstr("/wrong/cost/select_s = 61 s, must be in [0, 60] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/max_attempts = 0"));
  EXPECT_THAT(message, HasSubstr("/wrong/left_over is unknown"));
}

TEST(NbvSelectionParams, AStrategyIsWantedAndAListOfTexts) {
  ros::NodeHandle nh("~no_list");
  nh.setParam("base_profile_file", "/profile.yaml");
  nh.setParam("sectors_file", "/sectors.yaml");
  EXPECT_EQ(messageOf(kNodeContract, nh), "");
  nh.setParam("strategies", "gpis");
  EXPECT_THAT(messageOf(kNodeContract, nh), AllOf(HasSubstr("/no_list/strategies"), HasSubstr("a list of texts")));
  XmlRpc::XmlRpcValue mixed = listOf({"gpis", ""});
  mixed[1] = 7;
  nh.setParam("strategies", mixed);
  EXPECT_THAT(messageOf(kNodeContract, nh), AllOf(HasSubstr("/no_list/strategies"), HasSubstr("a list of texts")));
  XmlRpc::XmlRpcValue none;
  none.setSize(0);
  nh.setParam("strategies", none);
  EXPECT_THAT(messageOf(kNodeContract, nh), HasSubstr("/no_list/strategies = [], must be at least one"));
}

TEST(NbvSelectionParams, FramesMustDiffer) {
  NbvSelectionParams params;
  params.base_profile_file = params.sectors_file = "/file.yaml";
  EXPECT_THAT(params.validate(), IsEmpty());
  params.base_frame = params.map_frame;
  EXPECT_THAT(params.validate(), ElementsAre("base_frame = 'map', must be another frame than map_frame"));
}

/// What the sections have in common, wrong in each of them.
void expectWrongStrategyIsRefused(const Contract& contract, const std::string& name) {
  ros::NodeHandle nh("~" + name);
  nh.setParam("plugin", "nbv_selection/Any");
  nh.setParam("removed_factor", "weather");
  nh.setParam("manipulability/approach", "sideways");
  nh.setParam("manipulability/band_m", "narrow");
  nh.setParam("weight/travel", 0.2);
  nh.setParam("imaginary_share", 1.5);
  nh.setParam("gamma_per_s", 2.0);
  nh.setParam("outline/cell_size_m", 0.0);
  nh.setParam("segments/spacing_m", -0.1);
  nh.setParam("ground/max_tilt_rad", 3.0);
  nh.setParam("logistic/frontier/l", "one");
  const std::string message = messageOf(contract, nh);
  EXPECT_THAT(message, HasSubstr("/" + name + "/removed_factor = 'weather'"));
  EXPECT_THAT(message, HasSubstr("manipulability, pick_order, travel, uncertainty, frontier, failure_penalty"));
  EXPECT_THAT(message,
              HasSubstr("/" + name + "/manipulability/approach = 'sideways', must be sector or from_arm_base"));
  EXPECT_THAT(message, AllOf(HasSubstr("/" + name + "/manipulability/band_m = "), HasSubstr("must be a number")));
  EXPECT_THAT(message, HasSubstr("/" + name + "/weight is unknown"));
  EXPECT_THAT(message, HasSubstr("/" + name + "/imaginary_share = 1.5, must be in [0.01, 1]"));
  EXPECT_THAT(message, HasSubstr("/" + name + "/gamma_per_s = 2"));
  EXPECT_THAT(message, HasSubstr("/" + name + "/outline/cell_size_m = 0 m"));
  EXPECT_THAT(message, HasSubstr("/" + name + "/segments/spacing_m = -0.1 m"));
  EXPECT_THAT(message, HasSubstr("/" + name + "/ground/max_tilt_rad = 3 rad"));
  EXPECT_THAT(message, HasSubstr("/" + name + "/logistic/frontier/l = "));
}

TEST(StrategyParams, OneMessageNamesEveryProblemWithValueAndRange) {
  expectWrongStrategyIsRefused(kGpisContract, "wrong_gpis");
  expectWrongStrategyIsRefused(kOctomapContract, "wrong_octomap");
  ros::NodeHandle gpis("~other_gpis");
  gpis.setParam("occupancy/alpha_1_m", 0.0);
  gpis.setParam("octomap/gradient_step_m", 0.1);
  EXPECT_THAT(messageOf(kGpisContract, gpis),
              AllOf(HasSubstr("/other_gpis/occupancy/alpha_1_m = 0 1/m"), HasSubstr("/other_gpis/octomap is unknown")));
  ros::NodeHandle octomap("~other_octomap");
  octomap.setParam("octomap/surface_band_m", 0.0);
  octomap.setParam("occupancy/alpha_1_m", 100.0);
  EXPECT_THAT(messageOf(kOctomapContract, octomap), AllOf(HasSubstr("/other_octomap/octomap/surface_band_m = 0 m"),
                                                          HasSubstr("/other_octomap/occupancy is unknown")));
}

TEST(StrategyParams, WeightsThatDoNotSumToOneAreRefusedWithTheirSum) {
  ros::NodeHandle nh("~heavy");
  nh.setParam("weights/travel", 0.5);  // 0.25 too much
  EXPECT_THAT(messageOf(kGpisContract, nh), HasSubstr("/heavy/weights: their sum = 1.25, must be 1"));
  EXPECT_THAT(messageOf(kOctomapContract, nh), HasSubstr("/heavy/weights: their sum = 1.25, must be 1"));
  nh.setParam("weights/manipulability", 0.0);
  EXPECT_EQ(messageOf(kGpisContract, nh), "");
}

TEST(StrategyParams, AFactorIsRemovedAndTheOthersShareItsWeight) {
  ros::NodeHandle nh("~ablation");
  nh.setParam("removed_factor", "travel");  // 0.25: the others grow by 1 / 0.75
  nh.setParam("manipulability/approach", "from_arm_base");
  const GpisStrategyParams params = loadGpisStrategyParams(nh);
  using nbv_selection::Factor;
  EXPECT_EQ(params.selector.utility.of(Factor::kTravel).weight, 0.25) << "as read, for who prints it";
  const nbv_selection::ViewSelectorConfig effective = params.effective();
  EXPECT_EQ(effective.utility.of(Factor::kTravel).weight, 0.0);
  EXPECT_NEAR(effective.utility.of(Factor::kFrontier).weight, 1.0 / 3.0, 1e-12);
  EXPECT_NEAR(effective.utility.of(Factor::kPickOrder).weight, 0.2, 1e-12);
  EXPECT_EQ(effective.manipulability.weight, nbv_selection::ApproachWeight::kFromArmBase);
  EXPECT_TRUE(effective.utility.use_failures);
  nh.setParam("removed_factor", "failure_penalty");
  nh.setParam("manipulability/approach", "sector");
  EXPECT_FALSE(loadGpisStrategyParams(nh).effective().utility.use_failures);
  EXPECT_EQ(loadGpisStrategyParams(nh).effective().manipulability.weight, nbv_selection::ApproachWeight::kSector);
}

TEST(StrategyParams, WhatHasAllTheWeightCannotBeRemoved) {
  ros::NodeHandle nh("~only");
  for (const char* factor : {"manipulability", "pick_order", "uncertainty", "frontier"}) {
    nh.setParam(std::string("weights/") + factor, 0.0);
  }
  nh.setParam("weights/travel", 1.0);
  EXPECT_EQ(messageOf(kGpisContract, nh), "");
  nh.setParam("removed_factor", "travel");
  EXPECT_THAT(messageOf(kGpisContract, nh), HasSubstr("/only/removed_factor = 'travel'"));
}

}  // namespace
}  // namespace nbv_selection_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_nbv_selection_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
