// SPDX-License-Identifier: BSD-3-Clause
// Problems are what they claim to be: truth is possible, the map is a map of it, and the same seeds give the same.
#include "planning_problems/planning_problems.h"

#include <algorithm>
#include <set>

#include <gmock/gmock.h>

#include "planning_problems/convex_distance.h"
#include "planning_problems/exact_checker.h"
#include "problem_files.h"

namespace experiments {
namespace {

using motion_planning::ArmVector;
using simulated_world::BrickPlacement;

class PlanningProblems : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    maker_ = new ProblemMaker(problemFiles(), SurveyConfig{});
    for (const std::uint64_t seed : {1U, 2U, 3U, 4U, 5U}) {
      for (PlanningProblem& problem : maker_->problemsOfPile(seed)) problems_->push_back(problem);
    }
  }
  static void TearDownTestSuite() {
    problems_->clear();
    delete maker_;
  }

  static double distanceToTruth(const Stand& stand, const Eigen::Vector3d& p_map) {
    double nearest_m = std::abs((stand.T_map_base.inverse() * p_map).z());
    for (const BrickPlacement& brick : stand.bricks) {
      const Eigen::Vector3d p = brick.T_map_brick.inverse() * p_map;
      const Eigen::Vector3d outside = (p.cwiseAbs() - 0.5 * brick.type.size_m);
      const double distance = outside.maxCoeff() > 0.0 ? outside.cwiseMax(0.0).norm() : -outside.maxCoeff();
      nearest_m = std::min(nearest_m, distance);
    }
    return nearest_m;
  }

  static ProblemMaker* maker_;
  static std::vector<PlanningProblem>* problems_;
};
ProblemMaker* PlanningProblems::maker_ = nullptr;
std::vector<PlanningProblem>* PlanningProblems::problems_ = new std::vector<PlanningProblem>;

TEST_F(PlanningProblems, EachSceneGivesSome) {
  std::set<std::string> scenes;
  std::set<std::string> names;
  for (const PlanningProblem& problem : *problems_) {
    scenes.insert(problem.stand->scene);
    EXPECT_TRUE(names.insert(problem.name).second) << problem.name << " twice";
    EXPECT_FALSE(problem.target.faces.empty()) << problem.name;
    ASSERT_NE(problem.target.type, nullptr);
  }
  EXPECT_EQ(scenes.size(), 5U);
  EXPECT_GE(problems_->size(), 40U);  // of the 5 x 4 x 4 that are asked for
}

TEST_F(PlanningProblems, RobotStandsFreeAtItsStandoff) {
  std::set<const Stand*> stands;
  for (const PlanningProblem& problem : *problems_) {
    const Stand& stand = *problem.stand;
    if (!stands.insert(&stand).second) continue;
    ExactChecker checker(maker_->robot(), stand.bricks, stand.T_map_base);
    EXPECT_THAT(checker.overlaps(maker_->stowed()), ::testing::IsEmpty()) << problem.name;
    // What lies before the front edge of config/base_profile.yaml, 5 cm wider than the robot to each side, is free up to
    // the stand-off and no farther.
    const auto bricksWithin = [&](double ahead_m) {
      Solid lane{mp700_ur5e_description::Box{Eigen::Vector3d(ahead_m, 0.73, 4.0)}, Eigen::Isometry3d::Identity()};
      lane.T_world_shape = stand.T_map_base * Eigen::Translation3d(0.296 + 0.5 * ahead_m, 0.0, 0.0);
      return std::count_if(stand.bricks.begin(), stand.bricks.end(), [&](const BrickPlacement& brick) {
        const Solid solid{mp700_ur5e_description::Box{brick.type.size_m}, brick.T_map_brick};
        return convexDistance(lane, solid).lower_m <= 0.0;  // not shown to be apart
      });
    };
    EXPECT_EQ(bricksWithin(stand.standoff_m - 0.001), 0) << problem.name;
    EXPECT_GE(bricksWithin(stand.standoff_m + 0.001), 1) << problem.name;
    EXPECT_GE(stand.standoff_m, 0.05);
    EXPECT_LE(stand.standoff_m, 0.25);
  }
  EXPECT_GE(stands.size(), 12U);
}

TEST_F(PlanningProblems, NothingLiesOnTheTarget) {
  for (const PlanningProblem& problem : *problems_) {
    // A needle 30 cm up from the middle of the brick meets no other.
    const Eigen::Vector3d middle = problem.target.T_map_brick.translation();
    const Solid needle{mp700_ur5e_description::Cylinder{0.001, 0.3},
                       Eigen::Isometry3d(Eigen::Translation3d(middle + Eigen::Vector3d(0.0, 0.0, 0.15)))};
    for (const BrickPlacement& brick : problem.stand->bricks) {
      if (brick.id == problem.target.brick_id) continue;
      const Solid solid{mp700_ur5e_description::Box{brick.type.size_m}, brick.T_map_brick};
      EXPECT_GT(convexDistance(needle, solid).upper_m, 0.0) << problem.name << ", brick " << brick.id;
    }
  }
}

TEST_F(PlanningProblems, FacesAreOrderedUpwardFirst) {
  for (const PlanningProblem& problem : *problems_) {
    const Eigen::Matrix3d R = problem.target.T_map_brick.linear();
    double highest = -2.0;
    for (const auto face : mp700_ur5e_description::kBrickFaces) {
      highest = std::max(highest, (R * mp700_ur5e_description::faceNormal(face)).z());
    }
    EXPECT_NEAR((R * mp700_ur5e_description::faceNormal(problem.target.faces.front())).z(), highest, 1e-12);
    for (const auto face : problem.target.faces) {
      EXPECT_GT((R * mp700_ur5e_description::faceNormal(face)).z(), -0.5) << problem.name;  // none that looks down
    }
  }
}

TEST_F(PlanningProblems, MapIsThatOfTheTruth) {
  for (const PlanningProblem& problem : *problems_) {
    const Stand& stand = *problem.stand;
    ASSERT_GT(stand.surface.triangles.size(), 3000U) << problem.name;
    ASSERT_EQ(stand.surface.normals_map.size(), stand.surface.vertices_map.size());
    std::size_t near = 0;
    std::size_t inside_reach = 0;
    std::size_t on_target = 0;
    for (const Eigen::Vector3d& vertex : stand.surface.vertices_map) {
      if ((stand.T_map_base.inverse() * vertex).head<2>().norm() > 1.5) continue;
      ++inside_reach;
      near += distanceToTruth(stand, vertex) < 0.015;
      const Eigen::Vector3d p = problem.target.T_map_brick.inverse() * vertex;
      on_target += ((p.cwiseAbs() - 0.5 * problem.target.type->size_m).maxCoeff() < 0.015);
    }
    // 3 sigma at 2 m is 20 mm for a single pixel; the map fuses many. Rounded edges and feet of bricks are the rest.
    EXPECT_GT(static_cast<double>(near), 0.97 * static_cast<double>(inside_reach)) << problem.name;
    // Its top alone, 0.3 m x 0.2 m, has some 270 vertices at 1/7 of 0.1 m.
    EXPECT_GT(on_target, 150U) << problem.name;
  }
}

TEST_F(PlanningProblems, SameSeedSameProblem) {
  const ProblemMaker again(problemFiles(), SurveyConfig{});
  const std::vector<PlanningProblem> second = again.problemsOfPile(1);
  ASSERT_FALSE(second.empty());
  for (std::size_t i = 0; i < second.size(); ++i) {
    const PlanningProblem& first = (*problems_)[i];
    EXPECT_EQ(first.name, second[i].name);
    EXPECT_TRUE(first.stand->T_map_base.matrix() == second[i].stand->T_map_base.matrix());
    EXPECT_TRUE(first.target.T_map_brick.matrix() == second[i].target.T_map_brick.matrix());
    EXPECT_EQ(first.target.faces, second[i].target.faces);
    EXPECT_EQ(first.stand->surface.triangles, second[i].stand->surface.triangles);
    EXPECT_EQ(first.stand->surface.vertices_map, second[i].stand->surface.vertices_map);
  }
}

TEST(SurveyConfig, RefusesTheImpossible) {
  SurveyConfig config;
  config.approach_looks = config.arc_looks = config.stand_looks = 0;
  config.depth_noise_per_m = -1.0;
  EXPECT_THAT(config.validate(), ::testing::ElementsAre(::testing::HasSubstr("looks in all"),
                                                        ::testing::HasSubstr("depth_noise_per_m = -1")));
  EXPECT_THROW(ProblemMaker(problemFiles(), config), std::invalid_argument);
}

}  // namespace
}  // namespace experiments
