// SPDX-License-Identifier: BSD-3-Clause
// A judge that finds nothing must not be one that sees nothing: a pick that is right by construction passes, and each way
// of spoiling it is told.
#include "planning_problems/plan_judge.h"

#include <functional>

#include <gmock/gmock.h>

#include "problem_files.h"

namespace experiments {
namespace {

using motion_planning::ArmVector;
using motion_planning::JointPath;
using motion_planning::JointTrajectory;
using ::testing::AnyOf;
using ::testing::Contains;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kTipHeight_m = 0.2;  // top of a brick on the ground

class PlanJudge : public ::testing::Test {
 protected:
  void SetUp() override {
    arm_ = std::make_shared<motion_planning::ArmKinematics>(maker_->robot());
    stand_ = std::make_shared<Stand>();
    stand_->bricks = {brickAt(0, {0.60, 0.0, 0.1}), brickAt(1, {0.60, 0.35, 0.1}), brickAt(2, {0.60, -0.35, 0.1})};
    problem_.stand = stand_;
    problem_.target.brick_id = 0;
    problem_.target.T_map_brick = stand_->bricks[0].T_map_brick;
    problem_.target.type = &types_.type("brick");
    problem_.target.faces = {mp700_ur5e_description::BrickFace::kPlusZ};
    for (int i = 0; i < 6; ++i) {
      limits_.velocity_rad_s[i] = planner_.speed.velocity_scale * arm_->limits().velocity_rad_s[i];
      limits_.acceleration_rad_s2[i] = planner_.speed.acceleration_rad_s2;
    }
    // Over the brick, down, up, and over the robot's back with the tool down all the way: tip poses on a way that leaves
    // mast and container alone, and the branch that goes on from the last.
    ArmVector q = maker_->stowed();
    const JointPath above = path({tip(0.60, 0.0, kTipHeight_m + 0.10)}, &q, 1);
    plan_.approach = timed({maker_->stowed(), above.back()});
    plan_.contact = timed(path({tip(0.60, 0.0, kTipHeight_m)}, &q, 40, above.back()));
    const ArmVector down = q;
    plan_.lift = timed(path({tip(0.60, 0.0, kTipHeight_m + 0.12)}, &q, 40, down));
    const ArmVector up = q;
    // High enough for the brick to pass over the deck.
    JointPath carry = path({tip(0.60, 0.0, 1.00)}, &q, 40, up);
    const Eigen::Isometry3d T_base_container = maker_->containerGoal().place->T_base_place;
    ArmVector turned = q;
    turned[0] -= M_PI;    // about the right side: the mast is on the left
    turned[5] += M_PI_2;  // the brick crosswise, as it lies in its place
    carry.push_back(turned);
    q = turned;
    const Eigen::Vector3d place = T_base_container.translation();
    Eigen::Isometry3d over = tip(place.x(), place.y(), place.z() + 0.2 + 0.03);
    over.rotate(Eigen::AngleAxisd(-M_PI_2, Eigen::Vector3d::UnitZ()));
    for (const ArmVector& next : path({over}, &q, 40, turned)) carry.push_back(next);
    plan_.stow = timed(carry);
  }

  static simulated_world::BrickPlacement brickAt(int id, const Eigen::Vector3d& xyz_m) {
    simulated_world::BrickPlacement brick;
    brick.id = id;
    brick.type = {"brick", Eigen::Vector3d(0.3, 0.2, 0.2), 1.0, 0.6};
    brick.T_map_brick.translation() = xyz_m;
    return brick;
  }

  static Eigen::Isometry3d tip(double x, double y, double z) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() << x, y, z;
    T.linear() = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()).matrix();
    return T;
  }

  /// Straight to each pose in `pieces`, from `from` on, by the branch next to the last; `q` becomes the end.
  JointPath path(const std::vector<Eigen::Isometry3d>& poses, ArmVector* q, int pieces,
                 const std::optional<ArmVector>& from = {}) const {
    JointPath result;
    if (from) result.push_back(*from);
    for (const Eigen::Isometry3d& goal : poses) {
      const Eigen::Isometry3d start = arm_->tipPose(*q);
      for (int k = 1; k <= pieces; ++k) {
        Eigen::Isometry3d T = goal;
        if (from) {  // turned as at the start: only the place changes
          T.linear() = start.linear();
          T.translation() += (1.0 - static_cast<double>(k) / pieces) * (start.translation() - goal.translation());
        }
        const std::vector<ArmVector> solutions = arm_->inverse(T, *q);
        if (solutions.empty()) throw std::logic_error("the test's own way is out of reach");
        *q = solutions.front();
        result.push_back(*q);
      }
    }
    return result;
  }

  JointTrajectory timed(const JointPath& way) const {
    motion_planning::TimingConfig timing;
    timing.max_deviation_rad = 1e-4;  // the way is the test's own: straight is meant to be straight
    return motion_planning::timeParametrize(way, limits_, timing);
  }

  PlanVerdict judge() const { return judgePick(*maker_, problem_, plan_, planner_); }

  static void faster(JointTrajectory* trajectory, double factor) {
    for (auto& point : trajectory->points) {
      point.time_s /= factor;
      point.velocity_rad_s *= factor;
      point.acceleration_rad_s2 *= factor * factor;
    }
  }

  std::unique_ptr<ProblemMaker> maker_ = std::make_unique<ProblemMaker>(problemFiles(), SurveyConfig{});
  mp700_ur5e_description::BrickCatalogue types_ =
      mp700_ur5e_description::loadBrickTypes(problemFiles().description + "/config/bricks.yaml");
  std::shared_ptr<motion_planning::ArmKinematics> arm_;
  std::shared_ptr<Stand> stand_;
  PlanningProblem problem_;
  motion_planning::PickPlan plan_;
  motion_planning::MotionPlannerConfig planner_;
  motion_planning::MotionLimits limits_;
};

auto inPhase(const std::string& phase, const std::string& first) {
  return Contains(::testing::AllOf(Field(&Collision::phase, phase), Field(&Collision::first, HasSubstr(first))));
}

TEST_F(PlanJudge, LetsPassWhatIsRight) {
  const PlanVerdict verdict = judge();
  EXPECT_TRUE(verdict.isGood()) << verdict.describe();
  EXPECT_GT(verdict.looks, 1000U);
  EXPECT_LT(verdict.contact_error_m, 1e-4);
  EXPECT_LT(verdict.lift_overlap_m, 1e-3);
  EXPECT_GT(verdict.max_speed_share, 0.5);
  EXPECT_LE(verdict.max_speed_share, 1.001);
  EXPECT_GT(verdict.path_rad, M_PI);
  // The held brick's side is 15 cm from its middle, the next brick 20 cm; the magnet is higher.
  EXPECT_GT(verdict.clearance_m, 0.05);
}

TEST_F(PlanJudge, SeesABrickInTheApproach) {
  const Eigen::Isometry3d T = arm_->tipPose(plan_.approach.sample(0.5 * plan_.approach.duration()).position_rad);
  stand_->bricks.push_back(brickAt(3, T.translation()));
  EXPECT_THAT(judge().collisions, inPhase("approach", "magnet"));
}

TEST_F(PlanJudge, SeesAGrazeThatIsShorterThanThePlannersStep) {
  // A brick into which the magnet dips by 0.5 mm in the middle of the approach, for a fraction of the way.
  const double half = 0.5 * plan_.approach.duration();
  const Eigen::Isometry3d T = arm_->tipPose(plan_.approach.sample(half).position_rad);
  const Eigen::Vector3d ahead =
      arm_->tipPose(plan_.approach.sample(half + 0.02).position_rad).translation() - T.translation();
  // The plane in which the tip's centre moves at that time: a brick's edge is held into the way from aside.
  const Eigen::Vector3d aside = ahead.cross(Eigen::Vector3d::UnitZ()).normalized();
  simulated_world::BrickPlacement thin = brickAt(3, T.translation() + (0.03 + 0.1 - 0.0005) * aside);
  thin.type.size_m = {0.002, 0.2, 0.002};  // along x: the way; y: aside
  thin.T_map_brick.linear().col(0) = ahead.normalized();
  thin.T_map_brick.linear().col(1) = aside;
  thin.T_map_brick.linear().col(2) = ahead.normalized().cross(aside);
  thin.T_map_brick.translation() +=
      0.02 * arm_->tipPose(plan_.approach.sample(half).position_rad).linear().col(2) * -1.0;
  stand_->bricks.push_back(thin);
  EXPECT_THAT(judge().collisions, inPhase("approach", "magnet"));
}

TEST_F(PlanJudge, SeesTheMagnetInTheTargetTooEarlyOrTooDeep) {
  stand_->bricks[0].T_map_brick.translation().z() += 0.01;  // it is higher than the plan believes
  const PlanVerdict verdict = judge();
  EXPECT_THAT(verdict.collisions, inPhase("contact", "magnet"));
}

TEST_F(PlanJudge, SeesTheMagnetSlideAlongTheTargetBeforeItIsWhereItBelongs) {
  // Half a millimetre deep, as at the end, but from 3 cm aside on.
  ArmVector q = plan_.contact.points.front().position_rad;
  const JointPath aside = path({tip(0.57, 0.0, kTipHeight_m + 0.10)}, &q, 1);
  plan_.contact =
      timed(path({tip(0.57, 0.0, kTipHeight_m - 0.0005), tip(0.60, 0.0, kTipHeight_m - 0.0005)}, &q, 40, aside.back()));
  const PlanVerdict verdict = judge();
  EXPECT_THAT(verdict.collisions, inPhase("contact", "magnet")) << verdict.describe();
  EXPECT_LT(verdict.contact_error_m, 0.001);
}

TEST_F(PlanJudge, SeesContactBesideThePlate) {
  problem_.target.T_map_brick.translation().x() += 0.06;
  stand_->bricks[0].T_map_brick = problem_.target.T_map_brick;
  EXPECT_THAT(judge().faults, Contains(HasSubstr("magnet's edge from the plate's middle")));
}

TEST_F(PlanJudge, SeesContactThatDoesNotReachThePlate) {
  problem_.target.T_map_brick.translation().z() -= 0.005;
  stand_->bricks[0].T_map_brick = problem_.target.T_map_brick;
  EXPECT_THAT(judge().faults, Contains(HasSubstr("tip to face")));
}

TEST_F(PlanJudge, SeesTheHeldBrickPushANeighbour) {
  stand_->bricks[1].T_map_brick.translation().y() = 0.19;  // 10 mm into the target
  EXPECT_THAT(judge().collisions, inPhase("lift", "held"));
}

TEST_F(PlanJudge, SeesTheHeldBrickHitSomethingOnTheWayHome) {
  ArmVector q = plan_.stow.sample(0.6 * plan_.stow.duration()).position_rad;
  stand_->bricks.push_back(brickAt(3, arm_->tipPose(q).translation() - Eigen::Vector3d(0.0, 0.0, 0.1)));
  EXPECT_THAT(judge().collisions, inPhase("stow", "held"));
}

TEST_F(PlanJudge, SeesTheArmInTheMast) {
  // Round by the left side, low: the mast stands there.
  ArmVector q = plan_.stow.points.front().position_rad;
  ArmVector left = q;
  left[0] += M_PI;
  plan_.stow = timed({q, left});
  EXPECT_THAT(judge().collisions, Contains(Field(&Collision::first, "camera_mast")));
}

TEST_F(PlanJudge, SeesLimitsBroken) {
  faster(&plan_.approach, 1.05);
  const PlanVerdict verdict = judge();
  EXPECT_THAT(verdict.faults, Contains(AnyOf(HasSubstr("approach: speed"), HasSubstr("approach: acceleration"))));
  EXPECT_NEAR(std::max(verdict.max_speed_share, std::sqrt(verdict.max_acceleration_share)), 1.05, 0.01);
}

TEST_F(PlanJudge, SeesAJumpBetweenPhases) {
  for (auto& point : plan_.lift.points) point.position_rad[5] += 0.001;
  EXPECT_THAT(judge().faults, Contains(HasSubstr("lift: jump")));
}

TEST_F(PlanJudge, SeesMotionAtAnEnd) {
  plan_.contact.points.back().velocity_rad_s[2] = 0.1;
  EXPECT_THAT(judge().faults, Contains(HasSubstr("contact: speed at an end")));
}

TEST_F(PlanJudge, SeesAMissingPhase) {
  plan_.lift.points.clear();
  EXPECT_THAT(judge().faults, Contains("lift: empty"));
}

TEST_F(PlanJudge, SeesATiltedLoad) {
  ArmVector q = plan_.stow.points.back().position_rad;
  ArmVector tilted = q;
  tilted[4] += 0.7;
  JointPath way = {q, tilted, q};
  JointTrajectory swing = timed(way);
  const double start_s = plan_.stow.duration();
  for (std::size_t i = 1; i < swing.points.size(); ++i) {
    swing.points[i].time_s += start_s;
    plan_.stow.points.push_back(swing.points[i]);
  }
  EXPECT_THAT(judge().faults, Contains(HasSubstr("stow: tilt")));
}

TEST_F(PlanJudge, SeesABrickThatEndsBesideTheContainer) {
  plan_.stow = timed({plan_.stow.points.front().position_rad});
  EXPECT_THAT(judge().faults, Contains(HasSubstr("beside its place")));
}

TEST_F(PlanJudge, SeesABrickThatEndsTooLowOverTheContainer) {
  ArmVector q = plan_.stow.points.back().position_rad;
  const ArmVector from = q;
  Eigen::Isometry3d T = arm_->tipPose(q);
  T.translation().z() -= 0.02;  // from 30 mm over the opening to 10 mm; 20 mm are asked for
  const JointTrajectory down = timed(path({T}, &q, 10, from));
  const double start_s = plan_.stow.duration();
  for (std::size_t i = 1; i < down.points.size(); ++i) {
    plan_.stow.points.push_back(down.points[i]);
    plan_.stow.points.back().time_s += start_s;
  }
  EXPECT_THAT(judge().faults, Contains(HasSubstr("stow: height over the opening = 0.01")));
}

TEST_F(PlanJudge, FollowsWhatACubicSwingsBetweenPointsOfOnePlace) {
  const std::size_t before = judge().looks;
  // Out and back within a second, between two points at the same joint angles.
  motion_planning::TrajectoryPoint end = plan_.approach.points.back();
  plan_.approach.points.back().velocity_rad_s[0] = 1.0;
  end.time_s += 1.0;
  plan_.approach.points.push_back(end);
  // A way of at most 1 rad/s for 1 s.
  const auto pieces = static_cast<std::size_t>(1.0 / JudgeConfig().step_rad);
  EXPECT_GE(judge().looks, before + pieces);
}

TEST_F(PlanJudge, ReachIsJudgedLikeAPlanWithoutPhases) {
  const JointPath way = {maker_->stowed(), plan_.approach.points.back().position_rad,
                         plan_.contact.points.back().position_rad};
  const PlanVerdict verdict = judgeReach(*maker_, problem_, way);
  EXPECT_TRUE(verdict.isGood()) << verdict.describe();
  const Eigen::Isometry3d T = arm_->tipPose(0.5 * (way[0] + way[1]));
  stand_->bricks.push_back(brickAt(3, T.translation()));
  EXPECT_THAT(judgeReach(*maker_, problem_, way).collisions, inPhase("reach", "magnet"));
}

}  // namespace
}  // namespace experiments
