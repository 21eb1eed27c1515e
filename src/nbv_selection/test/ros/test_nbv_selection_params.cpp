// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection_ros/nbv_selection_params.h"

#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <interactive_mapping_common_ros/params.h>
#include <ros/ros.h>

#include "nbv_selection_ros/strategy_params.h"

namespace nbv_selection_ros {
namespace {

using interactive_mapping::Fields;
using interactive_mapping::problemsOf;
using interactive_mapping::toYaml;
using interactive_mapping_ros::loadParams;
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

std::string messageOf(const std::function<void()>& load) {
  return test_support::messageOf<std::invalid_argument>(load);
}

/// The node with its default strategy.
struct NodeFile {
  NbvSelectionParams node;
  GpisStrategyParams gpis;

  static void fields(NodeFile& c, Fields& f) {
    NbvSelectionParams::fields(c.node, f);
    f.section("gpis", c.gpis);
  }
};

/// The strategies this work is compared with.
struct BaselinesFile {
  OctomapStrategyParams gradient_frontier;
  OctomapStrategyParams random;

  static void fields(BaselinesFile& c, Fields& f) {
    f.section("octomap_gradient_frontier", c.gradient_frontier);
    f.section("octomap_random", c.random);
  }
};

TEST(NbvSelectionParams, ShippedFilesAreWhatTheFieldsSay) {
  NodeFile node;
  node.gpis.plugin = "nbv_selection/Gpis";
  test_support::expectShippedFile(kConfigDir + "nbv_selection.yaml", node);
  BaselinesFile baselines;
  baselines.gradient_frontier.plugin = baselines.random.plugin = "nbv_selection/Octomap";
  baselines.random.selector.choice = nbv_selection::Choice::kRandomCandidate;
  test_support::expectShippedFile(kConfigDir + "octomap_strategies.yaml", baselines);
}

TEST(NbvSelectionParams, ShippedFilesLoadAsTheDefaults) {
  NbvSelectionParams expected;
  expected.base_profile_file = "/profile.yaml";  // what a launch file has to give
  expected.sectors_file = "/sectors.yaml";
  EXPECT_EQ(toYaml(loadNbvSelectionParams(ros::NodeHandle("~shipped"))), toYaml(expected));
  GpisStrategyParams gpis;
  gpis.plugin = "nbv_selection/Gpis";
  EXPECT_EQ(toYaml(loadParams<GpisStrategyParams>(ros::NodeHandle("~shipped/gpis"))), toYaml(gpis));
  OctomapStrategyParams octomap;
  octomap.plugin = "nbv_selection/Octomap";
  EXPECT_EQ(toYaml(loadParams<OctomapStrategyParams>(ros::NodeHandle("~shipped/octomap_gradient_frontier"))),
            toYaml(octomap));
  octomap.selector.choice = nbv_selection::Choice::kRandomCandidate;
  EXPECT_EQ(toYaml(loadParams<OctomapStrategyParams>(ros::NodeHandle("~shipped/octomap_random"))), toYaml(octomap));
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
  const std::string message = messageOf([&] { loadNbvSelectionParams(nh); });
  EXPECT_THAT(message, HasSubstr("/wrong/base_profile_file = 'profile.yaml', must be the absolute path"));
  EXPECT_THAT(message, Not(HasSubstr("sectors_file =")));
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
  const auto load = [&nh] { return messageOf([&nh] { loadNbvSelectionParams(nh); }); };
  EXPECT_EQ(load(), "");
  nh.setParam("strategies", "gpis");
  EXPECT_THAT(load(), AllOf(HasSubstr("/no_list/strategies"), HasSubstr("a list of texts")));
  XmlRpc::XmlRpcValue mixed = listOf({"gpis", ""});
  mixed[1] = 7;
  nh.setParam("strategies", mixed);
  EXPECT_THAT(load(), AllOf(HasSubstr("/no_list/strategies"), HasSubstr("a list of texts")));
  XmlRpc::XmlRpcValue none;
  none.setSize(0);
  nh.setParam("strategies", none);
  EXPECT_THAT(load(), HasSubstr("/no_list/strategies = [], must be at least one"));
}

TEST(NbvSelectionParams, FramesMustDiffer) {
  NbvSelectionParams params;
  params.base_profile_file = params.sectors_file = "/file.yaml";
  EXPECT_THAT(problemsOf(params), IsEmpty());
  params.base_frame = params.map_frame;
  EXPECT_THAT(problemsOf(params), ElementsAre("base_frame = 'map', must be another frame than map_frame"));
}

/// What the sections have in common, wrong in each of them.
template <typename Params>
void expectWrongStrategyIsRefused(const std::string& name) {
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
  const std::string message = messageOf([&] { loadParams<Params>(nh); });
  EXPECT_THAT(message, HasSubstr("/" + name + "/removed_factor = 'weather'"));
  EXPECT_THAT(message, HasSubstr("manipulability, pick_order, travel, uncertainty, frontier, failure_penalty"));
  EXPECT_THAT(message,
              HasSubstr("/" + name + "/manipulability/approach = 'sideways', must be one of sector, from_arm_base"));
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
  expectWrongStrategyIsRefused<GpisStrategyParams>("wrong_gpis");
  expectWrongStrategyIsRefused<OctomapStrategyParams>("wrong_octomap");
  ros::NodeHandle gpis("~other_gpis");
  gpis.setParam("occupancy/alpha_1_m", 0.0);
  gpis.setParam("octomap/gradient_step_m", 0.1);
  EXPECT_THAT(messageOf([&] { loadParams<GpisStrategyParams>(gpis); }),
              AllOf(HasSubstr("/other_gpis/occupancy/alpha_1_m = 0 1/m"), HasSubstr("/other_gpis/octomap is unknown")));
  ros::NodeHandle octomap("~other_octomap");
  octomap.setParam("octomap/surface_band_m", 0.0);
  octomap.setParam("occupancy/alpha_1_m", 100.0);
  EXPECT_THAT(messageOf([&] { loadParams<OctomapStrategyParams>(octomap); }),
              AllOf(HasSubstr("/other_octomap/octomap/surface_band_m = 0 m"),
                    HasSubstr("/other_octomap/occupancy is unknown")));
}

TEST(StrategyParams, WeightsThatDoNotSumToOneAreRefusedWithTheirSum) {
  ros::NodeHandle nh("~heavy");
  nh.setParam("weights/travel", 0.5);  // 0.1 too much
  EXPECT_THAT(messageOf([&] { loadParams<GpisStrategyParams>(nh); }),
              HasSubstr("/heavy/weights: their sum = 1.100000, must be 1"));
  EXPECT_THAT(messageOf([&] { loadParams<OctomapStrategyParams>(nh); }),
              HasSubstr("/heavy/weights: their sum = 1.100000, must be 1"));
  nh.setParam("weights/frontier", 0.1);  // 0.1 less
  EXPECT_EQ(messageOf([&] { loadParams<GpisStrategyParams>(nh); }), "");
}

TEST(StrategyParams, AFactorIsRemovedAndTheOthersShareItsWeight) {
  ros::NodeHandle nh("~ablation");
  nh.setParam("removed_factor", "travel");  // 0.4: the others grow by 1 / 0.6
  nh.setParam("manipulability/approach", "from_arm_base");
  const GpisStrategyParams params = loadParams<GpisStrategyParams>(nh);
  using nbv_selection::Factor;
  EXPECT_EQ(params.selector.utility.of(Factor::kTravel).weight, 0.4) << "as read, for who prints it";
  const nbv_selection::ViewSelectorConfig effective = params.effective();
  EXPECT_EQ(effective.utility.of(Factor::kTravel).weight, 0.0);
  EXPECT_NEAR(effective.utility.of(Factor::kFrontier).weight, 0.2 / 0.6, 1e-12);
  EXPECT_NEAR(effective.utility.of(Factor::kPickOrder).weight, 0.1 / 0.6, 1e-12);
  EXPECT_EQ(effective.manipulability.weight, nbv_selection::ApproachWeight::kFromArmBase);
  EXPECT_TRUE(effective.utility.use_failures);
  nh.setParam("removed_factor", "failure_penalty");
  nh.setParam("manipulability/approach", "sector");
  EXPECT_FALSE(loadParams<GpisStrategyParams>(nh).effective().utility.use_failures);
  EXPECT_EQ(loadParams<GpisStrategyParams>(nh).effective().manipulability.weight,
            nbv_selection::ApproachWeight::kSector);
}

TEST(StrategyParams, WhatHasAllTheWeightCannotBeRemoved) {
  ros::NodeHandle nh("~only");
  for (const char* factor : {"manipulability", "pick_order", "uncertainty", "frontier"}) {
    nh.setParam(std::string("weights/") + factor, 0.0);
  }
  nh.setParam("weights/travel", 1.0);
  EXPECT_EQ(messageOf([&] { loadParams<GpisStrategyParams>(nh); }), "");
  nh.setParam("removed_factor", "travel");
  EXPECT_THAT(messageOf([&] { loadParams<GpisStrategyParams>(nh); }), HasSubstr("/only/removed_factor = 'travel'"));
}

/// A strategy of another package, with a map of its own.
struct ForeignParams : StrategyParams {
  double reach_m{2.0};

  static void fields(ForeignParams& c, Fields& f) {
    StrategyParams::fields(c, f);
    f("reach_m", c.reach_m, 0.1, 10.0, "m", "of its map");
  }
};

TEST(StrategyParams, ForeignStrategyAddsItsOwnKeys) {
  ros::NodeHandle nh("~foreign");
  nh.setParam("plugin", "my_views/Nearest");
  nh.setParam("reach_m", 3.0);
  nh.setParam("min_utility", 0.1);
  const ForeignParams params = loadParams<ForeignParams>(nh);
  EXPECT_EQ(params.reach_m, 3.0);
  EXPECT_EQ(params.effective().utility.min_utility, 0.1);
  nh.setParam("reach_m", 30.0);
  nh.setParam("octomap/gradient_step_m", 0.1);
  EXPECT_THAT(
      messageOf([&] { loadParams<ForeignParams>(nh); }),
      AllOf(HasSubstr("/foreign/reach_m = 30 m, must be in [0.1, 10] m"), HasSubstr("/foreign/octomap is unknown")));
}

}  // namespace
}  // namespace nbv_selection_ros
