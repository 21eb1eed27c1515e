// SPDX-License-Identifier: BSD-3-Clause
// The judge of endless runs: it must see a leak, and must not cry wolf.
#include <gtest/gtest.h>

#include "soak/endurance.h"
#include "synthetic_depth/seeded_random.h"

namespace soak {
namespace {

/// 200 readings of a healthy run: memory rises at the start, then varies by half a percent.
std::vector<Reading> healthyRun() {
  synthetic_depth::SeededRandom random(5);
  std::vector<Reading> readings;
  for (std::uint64_t i = 1; i <= 200; ++i) {
    const double warm = i < 15 ? 0.05 * static_cast<double>(i) : 0.75;
    const double noise = 1.0 + 0.005 * random.normal();
    Reading r;
    r.frame = 500 * i;
    r.resident_mb = 140.0 * warm / 0.75;
    r.heap_used_mb = 57.0 * noise;
    r.points = static_cast<std::size_t>(2000.0 * noise);
    r.cells = 330;
    r.chunks = 44;
    r.mesh_pieces = 330;
    r.inserted = 1000 * i;
    r.deleted = 990 * i;
    readings.push_back(r);
  }
  return readings;
}

std::string problemsOf(const std::vector<Reading>& readings) {
  std::string text;
  for (const std::string& problem : judge(readings).problems) text += problem + "; ";
  return text;
}

TEST(Endurance, AHealthyRunPasses) {
  EXPECT_EQ(problemsOf(healthyRun()), "");
}

TEST(Endurance, ALeakOfAPointPerFrameIsSeen) {
  std::vector<Reading> readings = healthyRun();
  for (Reading& r : readings) r.heap_used_mb += 64e-6 * static_cast<double>(r.frame);
  EXPECT_NE(problemsOf(readings).find("heap in use [MB] grew"), std::string::npos);
}

TEST(Endurance, CellsThatAreNeverGivenBackAreSeen) {
  std::vector<Reading> readings = healthyRun();
  for (Reading& r : readings) r.cells += r.frame / 2000;
  EXPECT_NE(problemsOf(readings).find("cells grew"), std::string::npos);
}

TEST(Endurance, AStepInTheLastHalfIsSeen) {
  std::vector<Reading> readings = healthyRun();
  for (Reading& r : readings) r.resident_mb += r.frame > 60000 ? 20.0 : 0.0;
  EXPECT_NE(problemsOf(readings).find("resident memory [MB] grew"), std::string::npos);
}

TEST(Endurance, SingleSpikesDoNotMatter) {
  std::vector<Reading> readings = healthyRun();
  for (std::size_t i = 100; i < readings.size(); i += 7) readings[i].resident_mb *= 1.5;
  EXPECT_EQ(problemsOf(readings), "");
}

TEST(Endurance, ReadingsSurviveTheirFile) {
  const std::string csv = toCsv(healthyRun());
  EXPECT_EQ(toCsv(fromCsv(csv)), csv);
  EXPECT_THROW(fromCsv("header\n1,2,3\n"), std::invalid_argument);
}

TEST(Endurance, AMapThatStandsStillIsNoProof) {
  std::vector<Reading> readings = healthyRun();
  for (Reading& r : readings) r.inserted = r.deleted = 5;
  EXPECT_NE(problemsOf(readings).find("no point was deleted"), std::string::npos);
}

TEST(Endurance, AFewReadingsAreNoProof) {
  std::vector<Reading> readings = healthyRun();
  readings.resize(12);
  EXPECT_NE(problemsOf(readings).find("must be at least 20"), std::string::npos);
}

}  // namespace
}  // namespace soak
