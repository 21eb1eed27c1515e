// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/mission_config.h"

#include <fstream>
#include <limits>
#include <sstream>
#include <type_traits>

#include <gmock/gmock.h>

namespace pick_mission {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(MissionConfig, DefaultsAreValid) {
  EXPECT_THAT(MissionConfig{}.validate(), IsEmpty());
}

TEST(MissionConfig, EachNumberThatIsNoneOrFarOutIsNamed) {
  MissionConfig defaults;
  int keys = 0;
  visitMissionFields(defaults, [&](const std::string& key, auto& value) {
    using Value = std::decay_t<decltype(value)>;
    if constexpr (std::is_same_v<Value, bool>) return;
    ++keys;
    MissionConfig config;
    visitMissionFields(config, [&](const std::string& other, auto& bad) {
      if (other != key) return;
      using Bad = std::decay_t<decltype(bad)>;
      if constexpr (std::is_same_v<Bad, int>) bad = -2;
      if constexpr (std::is_same_v<Bad, double>) bad = std::numeric_limits<double>::quiet_NaN();
      if constexpr (std::is_same_v<Bad, std::vector<double>>) bad[1] = 1e6;
    });
    EXPECT_THAT(config.validate(), Contains(testing::StartsWith(key + " = "))) << key;
  });
  EXPECT_EQ(keys, 29);
}

TEST(MissionConfig, SurveyNeedsAsManyOfEach) {
  MissionConfig config;
  config.survey_y_m.push_back(0.0);
  EXPECT_THAT(config.validate(), Contains(HasSubstr("2, 3, 2 values, must be as many of each")));
  config.survey_x_m.clear();
  config.survey_y_m.clear();
  config.survey_yaw_rad.clear();
  EXPECT_THAT(config.validate(), IsEmpty()) << "no survey is fine";
}

TEST(MissionConfig, WaitsAreShorterThanTheLimitOfAnAction) {
  MissionConfig config;
  config.fade_wait_s = config.action_timeout_s;
  EXPECT_THAT(config.validate(), Contains(HasSubstr("views/fade_wait_s")));
  config.fade_wait_s = config.action_timeout_s - 1.0;
  EXPECT_THAT(config.validate(), IsEmpty());
}

TEST(MissionConfig, ReadmeTableHasEveryKeyWithItsDefault) {
  std::ifstream file(std::string(PICK_MISSION_DIR) + "/README.md");
  std::stringstream text;
  text << file.rdbuf();
  MissionConfig config;
  visitMissionFields(config, [&](const std::string& key, const auto& value) {
    using Value = std::decay_t<decltype(value)>;
    std::ostringstream row;
    row << "| `" << key << "` | ";
    if constexpr (std::is_same_v<Value, std::vector<double>>) {
      row << "[";
      for (std::size_t i = 0; i < value.size(); ++i) row << (i == 0 ? "" : ", ") << value[i];
      row << "]";
    } else {
      row << std::boolalpha << value;
    }
    row << " |";
    EXPECT_THAT(text.str(), HasSubstr(row.str()));
  });
}

}  // namespace
}  // namespace pick_mission
