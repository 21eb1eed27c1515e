// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/params.h"

#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <ros/ros.h>

#include "interactive_mapping_common/testing/temporary_folder.h"

namespace interactive_mapping_ros {
namespace {

using interactive_mapping::Fields;
using interactive_mapping::toYaml;
using test_support::messageOf;
using testing::ElementsAre;
using testing::HasSubstr;

struct Example {
  double reach_m{0.5};
  int count{3};
  bool enabled{true};
  std::string frame{"map"};
  std::vector<std::string> names{"as", "before"};
  std::vector<double> weights{1.5, 2.5};

  static void fields(Example& c, Fields& f) {
    f("reach_m", c.reach_m, 0.1, 2.0, "m", "");
    f("count", c.count, 1, 10, "", "");
    f("enabled", c.enabled, "");
    f("frame", c.frame, "");
    f("names", c.names, "");
    f("weights", c.weights, -10.0, 10.0, "", "");
  }
};

TEST(Params, MissingOnesKeepTheirDefault) {
  EXPECT_EQ(toYaml(loadParams<Example>(ros::NodeHandle("~none"))), toYaml(Example()));
}

TEST(Params, AreReadWithTheTypesOfTheServer) {
  ros::NodeHandle nh("~good");
  nh.setParam("reach_m", 1);  // an integer will do for a number
  nh.setParam("count", 7);
  nh.setParam("enabled", false);
  nh.setParam("frame", "5");
  nh.setParam("names", std::vector<std::string>{"one", "", "true"});
  nh.setParam("weights", std::vector<double>{0.25, -3.0, 1e-9});
  nh.setParam("diagnostic_period", 0.5);
  nh.setParam("theirs/a", 1);
  const Example params = loadParams<Example>(nh, {"theirs"});
  EXPECT_EQ(params.reach_m, 1.0);
  EXPECT_EQ(params.count, 7);
  EXPECT_FALSE(params.enabled);
  EXPECT_EQ(params.frame, "5");
  EXPECT_THAT(params.names, ElementsAre("one", "", "true"));
  EXPECT_THAT(params.weights, ElementsAre(0.25, -3.0, 1e-9));
}

TEST(Params, OneMessageNamesAllThatIsWrongByItsFullName) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("reach_m", "1.0");
  nh.setParam("count", 3.0);
  nh.setParam("enabled", 1);
  nh.setParam("frame", 5);
  nh.setParam("names", "one");
  nh.setParam("weights", std::vector<double>{0.5, 11.0});
  nh.setParam("reach", 1.0);
  const std::string message = messageOf<std::invalid_argument>([&nh] {
    loadParams<Example>(nh, {}, [](const Example&) { return std::vector<std::string>{"frame is not known"}; });
  });
  const std::string ns = nh.getNamespace() + "/";
  for (const std::string& problem : std::vector<std::string>{
           "reach_m = '1.0', must be a number", "count = 3, must be a whole number",
           "enabled = 1, must be true or false", "frame = 5, must be a text", "names = 'one', must be a list of texts",
           "weights = [0.5, 11], must be in [-10, 10]", "reach is unknown", "frame is not known"}) {
    EXPECT_THAT(message, HasSubstr(ns + problem));
  }
}

}  // namespace
}  // namespace interactive_mapping_ros
