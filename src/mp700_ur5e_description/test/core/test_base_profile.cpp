// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/base_profile.h"

#include <stdexcept>

#include <gtest/gtest.h>

#include "support/shipped_file.h"

namespace mp700_ur5e_description {
namespace {

const std::string kFile = DESCRIPTION_DIR "/config/base_profile.yaml";

std::string changed(const std::string& from, const std::string& to) {
  return test::changedFile(kFile, from, to);
}

std::string refusal(const std::string& text) {
  return test::refusalBy([&text] { parseBaseProfile(text, "profile.yaml"); });
}

TEST(BaseProfile, ReadsShippedFile) {
  const BaseProfile profile = loadBaseProfile(kFile);
  EXPECT_DOUBLE_EQ(profile.drive.wheel_radius_m, 0.2675 / 2.0);
  EXPECT_DOUBLE_EQ(profile.drive.track_m, 0.507);
  EXPECT_EQ(profile.drive.encoder_ticks_per_wheel_turn, 120000);
  EXPECT_DOUBLE_EQ(profile.limits.forward_m_per_s, 0.8);
  EXPECT_DOUBLE_EQ(profile.limits.backward_m_per_s, 0.1);
  EXPECT_DOUBLE_EQ(profile.limits.turn_rad_per_s, 0.6);
  EXPECT_DOUBLE_EQ(profile.limits.linear_m_per_s2, 0.2);
  EXPECT_DOUBLE_EQ(profile.limits.turn_rad_per_s2, 0.6);
  EXPECT_DOUBLE_EQ(profile.limits.stop_m_per_s2, 1.0);
  EXPECT_DOUBLE_EQ(profile.rating.linear_m_per_s, 1.5);
  EXPECT_DOUBLE_EQ(profile.rating.linear_m_per_s2, 2.4);
  EXPECT_DOUBLE_EQ(profile.body.mass_kg, 156.0);
  EXPECT_EQ(profile.body.footprint_m.size(), 6U);
  EXPECT_EQ(profile.scanner.frame, "lidar_1_link");
  EXPECT_DOUBLE_EQ(profile.scanner.range_max_m, 29.0);
}

TEST(BaseProfile, RefusesUnknownKey) {
  EXPECT_NE(refusal(changed("  track_m", "  tracks_m")).find("drive/tracks_m is unknown; known here: "),
            std::string::npos);
}

TEST(BaseProfile, RefusesMissingKeyAndSection) {
  EXPECT_NE(
      refusal(changed("  mass_kg: 156.0", "")).find("body/mass_kg = (missing), must be a number in (0, 10000] kg"),
      std::string::npos);
  EXPECT_NE(refusal("{}").find("drive = (missing), must be a map"), std::string::npos);
}

TEST(BaseProfile, RefusesAnOmnidirectionalBaseByName) {
  EXPECT_NE(refusal(changed("kind: differential", "kind: omnidirectional"))
                .find("drive/kind = omnidirectional, must be differential: nothing here drives a base sideways"),
            std::string::npos);
}

TEST(BaseProfile, RefusesWrongTypes) {
  EXPECT_NE(refusal(changed("0.507", "wide")).find("drive/track_m = wide, must be a number in (0, 10] m"),
            std::string::npos);
  EXPECT_NE(refusal(changed("0.507", "\"0.507\"")).find("drive/track_m"), std::string::npos) << "a quoted number";
  EXPECT_NE(refusal(changed("0.507", ".nan")).find("drive/track_m"), std::string::npos);
  EXPECT_NE(refusal(changed("120000", "0.5")).find("encoder_ticks_per_wheel_turn = 0.5, must be an integer"),
            std::string::npos);
  EXPECT_NE(refusal(changed("[-0.555, 0.305]", "[-0.555]")).find("body/footprint_m"), std::string::npos);
  EXPECT_NE(refusal("[1, 2]").find("the file"), std::string::npos);
  EXPECT_NE(refusal("a: [").find("not valid YAML"), std::string::npos);
}

TEST(BaseProfile, RefusesImpossibleValues) {
  EXPECT_NE(refusal(changed("0.507", "-0.5")).find("drive/track_m = -0.5, must be a number in (0, 10] m"),
            std::string::npos);
  EXPECT_NE(refusal(changed("range_max_m: 29.0", "range_max_m: 0.005"))
                .find("scanner/range_min_m = 0.01 m, must be below range_max_m = 0.005 m"),
            std::string::npos);
  EXPECT_NE(refusal(changed("min_angle_rad: -1.6", "min_angle_rad: 2.6")).find("must be below max_angle_rad"),
            std::string::npos);
  EXPECT_NE(refusal(changed("forward_m_per_s: 0.8", "forward_m_per_s: 1.8")).find("at most rating/linear_m_per_s"),
            std::string::npos);
  EXPECT_NE(refusal(changed("linear_m_per_s2: 0.2", "linear_m_per_s2: 2.5")).find("at most rating/linear_m_per_s2"),
            std::string::npos);
  EXPECT_NE(refusal(changed("stop_m_per_s2: 1.0", "stop_m_per_s2: 0.1"))
                .find("limits/stop_m_per_s2 = 0.1 m/s^2, must be at least limits/linear_m_per_s2 = 0.2"),
            std::string::npos);
  EXPECT_NE(refusal(changed("stop_m_per_s2: 1.0", "stop_m_per_s2: 2.5")).find("at most rating/linear_m_per_s2"),
            std::string::npos);
}

TEST(BaseProfile, RefusesFootprintThatIsNotConvexAndCounterClockwise) {
  EXPECT_NE(
      refusal(changed("[[0.296, 0.296], [-0.045, 0.305]", "[[-0.045, 0.305], [0.296, 0.296]")).find("footprint_m"),
      std::string::npos)
      << "crossed";
  EXPECT_NE(refusal(changed("[-0.555, -0.315]", "[0.2, 0.2]")).find("convex"), std::string::npos) << "dented";
  EXPECT_NE(
      refusal(
          changed(
              "[[0.296, 0.296], [-0.045, 0.305], [-0.555, 0.305], [-0.555, -0.315], [-0.045, -0.315], [0.296, -0.296]]",
              "[[0.296, -0.296], [-0.555, -0.315], [-0.555, 0.305], [0.296, 0.296]]"))
          .find("counter-clockwise"),
      std::string::npos);
}

TEST(BaseProfile, ListsEveryProblemWithTheFilesName) {
  std::string text = changed("0.507", "wide");
  text.replace(text.find("29.0"), 4, "-290");
  const std::string message = refusal(text);
  EXPECT_NE(message.find("profile.yaml: drive/track_m"), std::string::npos) << message;
  EXPECT_NE(message.find("profile.yaml: scanner/range_max_m"), std::string::npos) << message;
}

TEST(BaseProfile, NamesTheFileThatIsNotThere) {
  try {
    loadBaseProfile("/nowhere/profile.yaml");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/profile.yaml: cannot be read"), std::string::npos);
  }
}

}  // namespace
}  // namespace mp700_ur5e_description
