// SPDX-License-Identifier: BSD-3-Clause
// The arm's kinematics beside KDL's: same chain, same postures, one thread.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_lma.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <mp700_ur5e_description/robot_names.h>

#include "motion_planning/arm_kinematics.h"
#include "support/urdf_text.h"

namespace motion_planning {
namespace {

using mp700_ur5e_description::RobotModel;

const ArmKinematics& shipped() {
  static const ArmKinematics kArm(RobotModel::load(kUrdfFile));
  return kArm;
}

/// Off by what a factory calibration may be: the closed form alone does not do.
const ArmKinematics& calibratedArm() {
  static const ArmKinematics kArm(RobotModel::parse(calibrated(readFile(kUrdfFile), 0.0005, 0.002, 1), "calibrated"));
  return kArm;
}

const KDL::Chain& kdlChain() {
  static const KDL::Chain kChain =
      shipped().robot().chain(mp700_ur5e_description::kBaseFrame, mp700_ur5e_description::kMagnetTipFrame);
  return kChain;
}

constexpr std::size_t kPostures = 1024;

const std::vector<ArmVector>& postures() {
  static const std::vector<ArmVector> kResult = [] {
    std::mt19937_64 rng(1);
    std::uniform_real_distribution<double> angle(-M_PI, M_PI);
    std::vector<ArmVector> result(kPostures);
    for (ArmVector& q : result) q = ArmVector::NullaryExpr([&](Eigen::Index) { return angle(rng); });
    return result;
  }();
  return kResult;
}

void BM_TipPose(benchmark::State& state) {
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(shipped().tipPose(postures()[i++ % kPostures]));
}
BENCHMARK(BM_TipPose);

void BM_TipPoseKdl(benchmark::State& state) {
  KDL::ChainFkSolverPos_recursive solver(kdlChain());
  KDL::JntArray q(6);
  KDL::Frame frame;
  std::size_t i = 0;
  for (auto _ : state) {
    q.data = postures()[i++ % kPostures];
    solver.JntToCart(q, frame);
    benchmark::DoNotOptimize(frame);
  }
}
BENCHMARK(BM_TipPoseKdl);

void BM_Jacobian(benchmark::State& state) {
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(shipped().jacobian(postures()[i++ % kPostures]));
}
BENCHMARK(BM_Jacobian);

void BM_JacobianKdl(benchmark::State& state) {
  KDL::ChainJntToJacSolver solver(kdlChain());
  KDL::JntArray q(6);
  KDL::Jacobian jacobian(6);
  std::size_t i = 0;
  for (auto _ : state) {
    q.data = postures()[i++ % kPostures];
    solver.JntToJac(q, jacobian);
    benchmark::DoNotOptimize(jacobian);
  }
}
BENCHMARK(BM_JacobianKdl);

void BM_Manipulability(benchmark::State& state) {
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(shipped().manipulability(postures()[i++ % kPostures]));
}
BENCHMARK(BM_Manipulability);

/// Counts what is found, and the median and the 99th percentile of single calls, clock included.
template <typename Solve>
void inverse(const ArmKinematics& arm, const Solve& solve, benchmark::State* state) {
  std::vector<Eigen::Isometry3d> goals;
  for (const ArmVector& q : postures()) goals.push_back(arm.tipPose(q));
  std::size_t i = 0, found = 0, solved = 0;
  std::vector<double> times_us;
  for (auto _ : *state) {
    const auto start = std::chrono::steady_clock::now();
    const std::size_t count = solve(goals[i % kPostures]);
    times_us.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count());
    found += count;
    solved += count > 0 ? 1 : 0;
    ++i;
  }
  std::sort(times_us.begin(), times_us.end());
  state->counters["median_us"] = times_us[times_us.size() / 2];
  state->counters["p99_us"] = times_us[times_us.size() * 99 / 100];
  state->counters["solved_percent"] = 100.0 * static_cast<double>(solved) / static_cast<double>(i);
  state->counters["branches"] = static_cast<double>(found) / static_cast<double>(i);
}

void BM_InverseAllBranches(benchmark::State& state) {
  const ArmVector near_rad = ArmVector::Zero();
  inverse(
      shipped(), [&](const Eigen::Isometry3d& goal) { return shipped().inverse(goal, near_rad).size(); }, &state);
}
BENCHMARK(BM_InverseAllBranches)->Unit(benchmark::kMicrosecond);

void BM_InverseAllBranchesCalibrated(benchmark::State& state) {
  const ArmVector near_rad = ArmVector::Zero();
  inverse(
      calibratedArm(), [&](const Eigen::Isometry3d& goal) { return calibratedArm().inverse(goal, near_rad).size(); },
      &state);
}
BENCHMARK(BM_InverseAllBranchesCalibrated)->Unit(benchmark::kMicrosecond);

/// Levenberg-Marquardt from zero: one solution or none, limits not looked at.
void BM_InverseKdlLma(benchmark::State& state) {
  KDL::ChainIkSolverPos_LMA solver(kdlChain(), 1e-6);
  KDL::JntArray start(6), end(6);
  inverse(
      shipped(),
      [&](const Eigen::Isometry3d& goal) -> std::size_t {
        KDL::Frame frame;
        for (int row = 0; row < 3; ++row) {
          frame.p[row] = goal.translation()[row];
          for (int col = 0; col < 3; ++col) frame.M(row, col) = goal.linear()(row, col);
        }
        return solver.CartToJnt(start, frame, end) >= 0 ? 1 : 0;
      },
      &state);
}
BENCHMARK(BM_InverseKdlLma)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace motion_planning
