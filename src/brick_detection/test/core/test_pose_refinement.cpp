// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/pose_refinement.h"

#include <cmath>
#include <functional>

#include <gmock/gmock.h>

#include "support/brick_scene.h"

namespace brick_detection {
namespace {

/// Central differences of a function of the pose by a step of it.
Eigen::MatrixXd differences(const std::function<Eigen::VectorXd(const Eigen::Isometry3d&)>& function,
                            const Eigen::Isometry3d& pose) {
  constexpr double kStep = 1e-6;
  Eigen::MatrixXd jacobian(function(pose).size(), 6);
  for (int i = 0; i < 6; ++i) {
    const Vector6d step = kStep * Vector6d::Unit(i);
    jacobian.col(i) = (function(moved(pose, step)) - function(moved(pose, -step))) / (2.0 * kStep);
  }
  return jacobian;
}

DepthPlane planeAt(const Eigen::Vector3d& middle, const Eigen::Vector3d& normal) {
  DepthPlane plane;
  plane.normal = normal.normalized();
  plane.middle = middle;
  plane.d_m = -plane.normal.dot(middle);
  plane.axis_u = plane.normal.unitOrthogonal();
  plane.axis_v = plane.normal.cross(plane.axis_u);
  plane.shared_offset_m = 0.001;
  plane.covariance = Eigen::Vector3d(1e-4, 2e-4, 5e-6).asDiagonal();
  return plane;
}

TEST(PoseSteps, TakeOnePoseToTheOther) {
  std::mt19937 engine(1);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Isometry3d from = Eigen::Translation3d(1, 2, 3) * Eigen::Isometry3d(anyRotation(engine));
    const Eigen::Isometry3d to = Eigen::Translation3d(-1, 0, 2) * Eigen::Isometry3d(anyRotation(engine));
    EXPECT_TRUE(moved(from, stepBetween(from, to)).isApprox(to, 1e-12));
    EXPECT_LE(stepBetween(from, to).tail<3>().norm(), M_PI + 1e-12);
  }
  // Small turns keep their digits.
  Vector6d small;
  small << 0, 0, 0, 1e-9, -2e-9, 3e-9;
  const Eigen::Isometry3d from(anyRotation(engine));
  EXPECT_LT((stepBetween(from, moved(from, small)) - small).norm(), 1e-15);  // rounding of the rotation matrix
}

TEST(PoseSteps, TurnAboutTheAxesOfTheTargetFrame) {
  const Eigen::Isometry3d pose = makePose({1, 2, 3}, {0.3, -0.2, 0.9});
  Vector6d step;
  step << 0.1, 0.2, 0.3, 0.0, 0.0, 0.5;
  const Eigen::Isometry3d expected =
      Eigen::Translation3d(1.1, 2.2, 3.3) *
      Eigen::Isometry3d(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ()) * pose.linear());
  EXPECT_TRUE(moved(pose, step).isApprox(expected, 1e-12));
}

TEST(PoseJacobians, AreThoseOfCentralDifferences) {
  std::mt19937 engine(2);
  std::normal_distribution<double> normal;
  CameraModel camera = testCamera();
  camera.distortion = Distortion::kPlumbBob;
  camera.coefficients = {0.1, -0.2, 0.002, -0.001, 0.0};
  for (int i = 0; i < 50; ++i) {
    const Eigen::Isometry3d pose =
        Eigen::Translation3d(0.2 * normal(engine), 0.2 * normal(engine), 1.5) * Eigen::Isometry3d(anyRotation(engine));
    const auto point = measurePoint({0.1, -0.05, 0.15}, {300.0 + 50.0 * normal(engine), 200.0}, camera);
    ASSERT_TRUE(point);
    Eigen::Matrix<double, 2, 6> by_pose;
    pointResidual(*point, pose, &by_pose);
    const auto residualOfPoint = [&point](const auto& T) -> Eigen::VectorXd { return pointResidual(*point, T); };
    // Error of central differences: third derivative (some 1e3 px) times 1e-12, rounding 1e-13 / 1e-6.
    EXPECT_LT((by_pose - differences(residualOfPoint, pose)).cwiseAbs().maxCoeff(), 1e-5);

    PlaneMeasurement plane;
    plane.p_body = {0.15, 0.01, -0.02};
    plane.n_body = {1.0, 0.0, 0.0};
    // As far off as a bad start may be.
    plane.plane = planeAt(pose * plane.p_body + 0.02 * Eigen::Vector3d::Random(),
                          pose.linear() * plane.n_body + 0.3 * Eigen::Vector3d::Random());
    Eigen::Matrix<double, 3, 6> plane_by_pose;
    planeResidual(plane, pose, &plane_by_pose);
    const auto residualOfPlane = [&plane](const auto& T) -> Eigen::VectorXd { return planeResidual(plane, T); };
    EXPECT_LT((plane_by_pose - differences(residualOfPlane, pose)).cwiseAbs().maxCoeff(), 1e-7);
  }
}

TEST(PlaneResidual, IsTiltAndOffsetOfTheMeasuredPlane) {
  const DepthPlane measured = planeAt({0.1, 0.0, 1.0}, {0.0, 0.3, -1.0});
  PlaneMeasurement measurement;
  measurement.plane = measured;
  measurement.n_body = Eigen::Vector3d::UnitZ();
  // The body's plane: the measured one, turned by 0.01 about u, -0.02 about v, moved by 3 mm along the normal.
  const Eigen::Quaterniond turn = Eigen::AngleAxisd(0.01, measured.axis_u) * Eigen::AngleAxisd(-0.02, measured.axis_v);
  const Eigen::Vector3d normal = turn * measured.normal;
  const Eigen::Isometry3d pose =
      Eigen::Translation3d(measured.middle + 0.003 * measured.normal) *
      Eigen::Isometry3d(Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), normal));
  const Eigen::Vector3d residual = planeResidual(measurement, pose);
  EXPECT_LT((residual - Eigen::Vector3d(0.01, -0.02, 0.003)).norm(), 3e-4);  // second order: 0.02^2
}

TEST(MeasurePoint, TurnsBearingsToPixelsWithTheLens) {
  CameraModel camera = testCamera();
  camera.distortion = Distortion::kPlumbBob;
  camera.coefficients = {0.1, -0.2, 0.002, -0.001, 0.0};
  const Eigen::Isometry3d pose = makePose({0.5, 0.35, 1.0});  // near the corner of the image
  const Eigen::Vector2d pixel = camera.project(pose.translation());
  const auto point = measurePoint(Eigen::Vector3d::Zero(), pixel + Eigen::Vector2d(0.3, -0.4), camera);
  ASSERT_TRUE(point);
  EXPECT_LT((pointResidual(*point, pose) - Eigen::Vector2d(-0.3, 0.4)).norm(), 1e-3);  // second order in the lens
  EXPECT_FALSE(measurePoint(Eigen::Vector3d::Zero(), {std::nan(""), 0.0}, camera));
}

TEST(RefinePose, FindsTheExactPoseFromAfar) {
  const CameraModel camera = testCamera();
  const Eigen::Isometry3d truth = makePose({0.1, -0.1, 1.2}, {2.8, 0.3, 0.4});
  PoseProblem problem;
  for (const Eigen::Vector3d& corner : tagCorners(0.12)) {
    problem.points.push_back(*measurePoint(corner, camera.project(truth * corner), camera));
  }
  Vector6d off;
  off << 0.05, -0.04, 0.2, 0.1, -0.1, 0.2;
  const auto refined = refinePose(problem, moved(truth, off));
  ASSERT_TRUE(refined);
  EXPECT_LT(stepBetween(truth, refined->T_camera_body).norm(), 1e-8);
  EXPECT_LT(refined->cost, 1e-10);
}

TEST(RefinePose, NoNumberOfPlanesRemovesTheOffsetThatTheyShare) {
  const CameraModel camera = testCamera();
  const Eigen::Isometry3d truth = makePose({0.0, 0.0, 1.2}, {M_PI, 0.0, 0.0});
  PoseProblem problem;
  for (const Eigen::Vector3d& corner : tagCorners(0.12)) {
    problem.points.push_back(*measurePoint(corner, camera.project(truth * corner), camera, 5.0));  // the planes decide
  }
  PlaneMeasurement plane;
  plane.plane = planeAt(truth.translation(), truth.linear() * plane.n_body);
  plane.plane.shared_offset_m = 0.004;
  plane.plane.covariance(2, 2) = 0.003 * 0.003 + 0.004 * 0.004;
  for (const int num : {1, 4, 16}) {
    problem.planes.assign(num, plane);
    const auto refined = refinePose(problem, truth);
    ASSERT_TRUE(refined);
    // The corners know the distance to some 20 mm and take next to nothing from it.
    EXPECT_NEAR(std::sqrt(refined->covariance(2, 2)), std::sqrt(0.004 * 0.004 + 0.003 * 0.003 / num), 1e-4) << num;
  }
}

TEST(RefinePose, FollowsThePlaneWhereThePointsAreWeak) {
  const CameraModel camera = testCamera();
  const Eigen::Isometry3d truth = makePose({0.0, 0.0, 1.2}, {M_PI, 0.0, 0.0});
  PoseProblem problem;
  for (const Eigen::Vector3d& corner : tagCorners(0.12)) {
    problem.points.push_back(*measurePoint(corner, camera.project(truth * corner), camera, 5.0));
  }
  PlaneMeasurement plane;
  plane.plane = planeAt(truth.translation() + Eigen::Vector3d(0.0, 0.0, 0.004), truth.linear() * plane.n_body);
  plane.plane.covariance(2, 2) = 2e-6;
  problem.planes.push_back(plane);
  const auto refined = refinePose(problem, truth);
  ASSERT_TRUE(refined);
  EXPECT_NEAR(refined->T_camera_body.translation().z(), 1.204, 2e-4);  // the points pull by a hundredth
}

TEST(RefinePose, SaysNothingWhenThePoseIsNotDetermined) {
  const CameraModel camera = testCamera();
  const Eigen::Isometry3d pose = makePose({0.1, -0.1, 1.2}, {2.8, 0.3, 0.4});
  PoseProblem problem;
  EXPECT_FALSE(refinePose(problem, pose)) << "nothing measured";
  for (const double x : {-0.05, 0.0, 0.05, 0.1}) {
    const Eigen::Vector3d point(x, 0.0, 0.0);
    problem.points.push_back(*measurePoint(point, camera.project(pose * point), camera));
  }
  EXPECT_FALSE(refinePose(problem, pose)) << "points on a line leave the turn about it open";
  EXPECT_FALSE(refinePose(problem, makePose({0.0, 0.0, -1.0}))) << "behind the camera";
}

}  // namespace
}  // namespace brick_detection
