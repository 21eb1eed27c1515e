// SPDX-License-Identifier: BSD-3-Clause
// Eye to hand against made-up robots whose answer is known. What images do to the samples is not here: integration_tests has it.
#include "brick_detection/hand_eye.h"

#include <cmath>
#include <random>

#include <Eigen/Cholesky>
#include <gmock/gmock.h>

namespace brick_detection {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

using Random = std::mt19937_64;

Eigen::Vector3d gaussian3(Random* random, double std) {
  std::normal_distribution<double> normal(0.0, std);
  const double x = normal(*random);
  const double y = normal(*random);
  return {x, y, normal(*random)};
}

Eigen::Matrix3d rotation(const Eigen::Vector3d& r) {
  return r.norm() == 0.0 ? Eigen::Matrix3d::Identity() : Eigen::AngleAxisd(r.norm(), r.normalized()).toRotationMatrix();
}

Eigen::Isometry3d pose(const Eigen::Vector3d& t, const Eigen::Vector3d& r) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = t;
  T.linear() = rotation(r);
  return T;
}

/// As a pose's covariance means it: t + dt, exp(dr) R.
Eigen::Isometry3d moved(const Eigen::Isometry3d& T, const Vector6d& change) {
  Eigen::Isometry3d result = T;
  result.translation() += change.head<3>();
  result.linear() = rotation(change.tail<3>()) * T.linear();
  return result;
}

Vector6d difference(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to) {
  const Eigen::AngleAxisd turn(Eigen::Matrix3d(to.linear() * from.linear().transpose()));
  return (Vector6d() << to.translation() - from.translation(), turn.angle() * turn.axis()).finished();
}

/// A camera on a mast that looks down, a target beside the tool's axis, the tool somewhere before the robot.
struct Rig {
  Eigen::Isometry3d T_base_camera{pose({0.05, 0.24, 1.6}, {-1.9, 0.4, -0.3})};
  Eigen::Isometry3d T_tool_target{pose({0.02, -0.03, 0.2}, {0.3, -2.0, 0.5})};
  std::vector<HandEyeSample> samples;
};

/// Samples without error, the tool turned by `tilt_rad` (standard deviation about each axis).
Rig exactRig(int count, Random* random, double tilt_rad = 0.4) {
  Rig rig;
  for (int i = 0; i < count; ++i) {
    HandEyeSample sample;
    sample.T_base_tool = pose(Eigen::Vector3d(0.7, 0.0, 0.7) + gaussian3(random, 0.15), gaussian3(random, tilt_rad)) *
                         pose(Eigen::Vector3d::Zero(), {0.0, M_PI, 0.0});
    sample.T_camera_target = rig.T_base_camera.inverse() * sample.T_base_tool * rig.T_tool_target;
    rig.samples.push_back(sample);
  }
  return rig;
}

/// Covariances as tags have them: poor along the line of sight and in tilt, and unlike from sample to sample; noise of
/// `factor` times it.
void addNoise(Rig* rig, double factor, Random* random) {
  std::uniform_real_distribution<double> level(0.3, 3.0);
  for (HandEyeSample& sample : rig->samples) {
    Vector6d std;
    std << 0.0005, 0.0005, 0.002, 0.006, 0.006, 0.002;
    std *= level(*random);
    Matrix6d mix = Matrix6d::Identity();
    mix(0, 4) = 0.05;  // tilt and place go together
    mix(1, 3) = -0.05;
    sample.covariance = mix * std.cwiseAbs2().asDiagonal() * mix.transpose();
    Vector6d white;
    white << gaussian3(random, 1.0), gaussian3(random, 1.0);
    const Matrix6d factor_of = sample.covariance.llt().matrixL();
    sample.T_camera_target = moved(sample.T_camera_target, factor * factor_of * white);
  }
}

/// For runs on noise: that some of it is large is their subject.
HandEyeConfig tolerant(double arm_std_m, double arm_std_rad) {
  HandEyeConfig config;
  config.arm_std_m = arm_std_m;
  config.arm_std_rad = arm_std_rad;
  config.max_residual_m = 0.1;
  config.max_residual_rad = 0.2;
  return config;
}

TEST(HandEye, ExactSamplesGiveTheExactAnswer) {
  Random random(1);
  for (const int count : {8, 15, 40}) {
    const Rig rig = exactRig(count, &random);
    const HandEyeResult result = solveHandEye(rig.samples, HandEyeConfig());
    ASSERT_TRUE(result.isGood()) << result.reason;
    // Rounding alone: poses of a metre, turned by about a radian, in double precision.
    EXPECT_LT(difference(rig.T_base_camera, result.T_base_camera).norm(), 1e-9) << count;
    EXPECT_LT(difference(rig.T_tool_target, result.T_tool_target).norm(), 1e-9) << count;
    EXPECT_LT(result.rms_m, 1e-9);
    EXPECT_LT(result.rms_rad, 1e-9);
    EXPECT_LT(result.leave_one_out_rms_m, 1e-9);
    EXPECT_EQ(result.num_used, count);
    EXPECT_EQ(result.residuals.size(), static_cast<std::size_t>(count));
  }
}

TEST(HandEye, TurnsUpToHalfARevolutionAreFine) {
  Random random(2);
  const Rig rig = exactRig(20, &random, 2.0);
  const HandEyeResult result = solveHandEye(rig.samples, HandEyeConfig());
  ASSERT_TRUE(result.isGood()) << result.reason;
  EXPECT_LT(difference(rig.T_base_camera, result.T_base_camera).norm(), 1e-9);
}

TEST(HandEye, JacobianMatchesCentralDifferences) {
  Random random(3);
  for (const double off : {0.0, 1e-4, 0.01, 0.5, 2.5}) {  // residuals from none to large
    Rig rig = exactRig(1, &random);
    Vector6d change;
    change << gaussian3(&random, 0.1), gaussian3(&random, 1.0).normalized() * off;
    rig.samples[0].T_camera_target = moved(rig.samples[0].T_camera_target, change);
    Matrix6x12d J;
    handEyeResidual(rig.samples[0], rig.T_base_camera, rig.T_tool_target, &J);
    for (int i = 0; i < 12; ++i) {
      constexpr double kStep = 1e-6;
      const auto at = [&](double step) {
        Eigen::Matrix<double, 12, 1> d = Eigen::Matrix<double, 12, 1>::Zero();
        d[i] = step;
        return handEyeResidual(rig.samples[0], moved(rig.T_base_camera, d.head<6>()),
                               moved(rig.T_tool_target, d.tail<6>()), nullptr);
      };
      // Central differences: step^2 of the third derivative, and rounding by the step, 1e-10.
      EXPECT_LT((J.col(i) - (at(kStep) - at(-kStep)) / (2.0 * kStep)).norm(), 1e-8)
          << "off " << off << ", column " << i;
    }
  }
}

TEST(HandEye, ResidualIsTheErrorOfTheSamplesPose) {
  Random random(4);
  for (const double angle : {0.0, 1e-9, 0.1, 1.0, 2.5, 3.1}) {
    for (int i = 0; i < 10; ++i) {
      Rig rig = exactRig(1, &random);
      Vector6d change;
      change << gaussian3(&random, 0.03), gaussian3(&random, 1.0).normalized() * angle;
      // The sample's truth is t + dt, exp(dr) R.
      rig.samples[0].T_camera_target.translation() -= change.head<3>();
      rig.samples[0].T_camera_target.linear() = rotation(-change.tail<3>()) * rig.samples[0].T_camera_target.linear();
      // Rounding, and near half a revolution an angle's sine is small.
      EXPECT_LT((handEyeResidual(rig.samples[0], rig.T_base_camera, rig.T_tool_target, nullptr) - change).norm(), 1e-11)
          << angle;
    }
  }
}

/// Mean of the squared error of T_base_camera in units of its covariance (NEES) and of the noise factor over many runs.
struct Consistency {
  double nees{0.0};
  double noise_factor{0.0};
};
constexpr int kRuns = 200;

template <typename Disturb>
Consistency consistency(const HandEyeConfig& config, const Disturb& disturb) {
  Random random(5);
  Consistency mean;
  for (int run = 0; run < kRuns; ++run) {
    Rig rig = exactRig(15, &random);
    disturb(&rig, &random);
    const HandEyeResult result = solveHandEye(rig.samples, config);
    EXPECT_TRUE(result.isGood()) << result.reason;
    const Vector6d error = difference(result.T_base_camera, rig.T_base_camera);
    mean.nees += error.dot(result.covariance.llt().solve(error)) / kRuns;
    mean.noise_factor += result.noise_factor / kRuns;
  }
  return mean;
}

// NEES of 200 runs: 6 +- 0.25 (one sigma) were the noise known. Its variance is estimated from 78 residuals, to 16 %, and
// taken where it is above 1: 6 % too wide on average. Four sigma to each side.
constexpr double kLowestNees = 6.0 * 0.94 - 1.0;
constexpr double kHighestNees = 6.0 + 1.0;

TEST(HandEye, ErrorsAreAsTheCovarianceSays) {
  const Consistency mean =
      consistency(tolerant(0.0, 0.0), [](Rig* rig, Random* random) { addNoise(rig, 1.0, random); });
  EXPECT_GT(mean.nees, kLowestNees);
  EXPECT_LT(mean.nees, kHighestNees);
  // 0.08 per run by 78 degrees of freedom, 0.006 over the runs; outliers' share of the tail is far below it.
  EXPECT_NEAR(mean.noise_factor, 1.0, 0.02);
}

TEST(HandEye, CovarianceHoldsWhenTheSamplesPromiseTooMuch) {
  const Consistency mean =
      consistency(tolerant(0.0, 0.0), [](Rig* rig, Random* random) { addNoise(rig, 3.0, random); });
  // Here the variance is always the estimated one: 6 * 78 / 76, no bias to the wide side.
  EXPECT_GT(mean.nees, 6.2 - 1.0);
  EXPECT_LT(mean.nees, 6.2 + 1.0);
  EXPECT_NEAR(mean.noise_factor, 3.0, 0.06);
}

TEST(HandEye, CovarianceHoldsTheArmsShare) {
  const Consistency mean = consistency(tolerant(0.002, 0.004), [](Rig* rig, Random* random) {
    addNoise(rig, 1.0, random);
    for (HandEyeSample& sample : rig->samples) {  // the target is not quite where the arm says
      Vector6d change;
      change << gaussian3(random, 0.002), gaussian3(random, 0.004);
      sample.T_camera_target = moved(sample.T_camera_target, change);
    }
  });
  EXPECT_GT(mean.nees, kLowestNees);
  EXPECT_LT(mean.nees, kHighestNees);
  EXPECT_NEAR(mean.noise_factor, 1.0, 0.02);
}

/// An error of each sample that fades over the next ones (autoregressive), as a lens or an arm has it along a path.
void addDependentNoise(Rig* rig, double kept, Random* random) {
  Vector6d white = Vector6d::Zero();
  for (std::size_t i = 0; i < rig->samples.size(); ++i) {
    Vector6d fresh;
    fresh << gaussian3(random, 1.0), gaussian3(random, 1.0);
    white = i == 0 ? fresh : Vector6d(kept * white + std::sqrt(1.0 - kept * kept) * fresh);
    Vector6d std;
    std << 0.001, 0.001, 0.003, 0.006, 0.006, 0.003;
    rig->samples[i].covariance = std.cwiseAbs2().asDiagonal();
    rig->samples[i].T_camera_target = moved(rig->samples[i].T_camera_target, std.cwiseProduct(white));
  }
}

TEST(HandEye, CovarianceHoldsForSamplesThatDependOnEachOther) {
  for (const double kept : {0.0, 0.7, 0.8}) {
    Random random(18);
    double nees = 0.0;
    double as_if_independent = 0.0;
    constexpr int kDependentRuns = 40;
    for (int run = 0; run < kDependentRuns; ++run) {
      Rig rig = exactRig(120, &random);
      addDependentNoise(&rig, kept, &random);
      const HandEyeResult result = solveHandEye(rig.samples, tolerant(0.0, 0.0));
      ASSERT_TRUE(result.isGood()) << result.reason;
      const Vector6d error = difference(result.T_base_camera, rig.T_base_camera);
      nees += error.dot(result.covariance.llt().solve(error)) / kDependentRuns;
      as_if_independent +=
          std::pow(result.dependence_factor, 2) * error.dot(result.covariance.llt().solve(error)) / kDependentRuns;
    }
    // Ten blocks know the variance to a third, and see only a part of what is alike over most of a block.
    EXPECT_LT(nees, 6.0 * 2.0) << kept;
    EXPECT_GT(nees, 6.0 * 0.7) << kept;
    if (kept > 0.5) {
      EXPECT_GT(as_if_independent, 6.0 * 1.3) << kept << ": a test that cannot fail";
    }
  }
}

TEST(HandEye, AnotherBaseFrameMovesTheAnswerWithIt) {
  Random random(6);
  Rig rig = exactRig(12, &random);
  addNoise(&rig, 1.0, &random);
  const HandEyeResult before = solveHandEye(rig.samples, HandEyeConfig());
  const Eigen::Isometry3d T_new_base = pose({3.0, -2.0, 0.5}, {0.2, 1.0, -2.0});
  const Eigen::Isometry3d T_tool_new = pose({0.1, 0.0, -0.2}, {1.0, 0.3, 0.7});
  for (HandEyeSample& sample : rig.samples) sample.T_base_tool = T_new_base * sample.T_base_tool * T_tool_new;
  const HandEyeResult after = solveHandEye(rig.samples, HandEyeConfig());
  ASSERT_TRUE(before.isGood() && after.isGood());
  // Both are at the same minimum, found to the square root of rounding at worst.
  EXPECT_LT(difference(T_new_base * before.T_base_camera, after.T_base_camera).norm(), 1e-7);
  EXPECT_LT(difference(T_tool_new.inverse() * before.T_tool_target, after.T_tool_target).norm(), 1e-7);
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = T_new_base.linear();
  turn.bottomRightCorner<3, 3>() = T_new_base.linear();
  const Matrix6d expected = turn * before.covariance * turn.transpose();
  EXPECT_LT((after.covariance - expected).norm(), 1e-5 * expected.norm());
}

TEST(HandEye, OutliersAreFoundAndDoNotCount) {
  Random random(7);
  Rig rig = exactRig(15, &random);
  addNoise(&rig, 1.0, &random);
  std::vector<HandEyeSample> good;
  for (std::size_t i = 0; i < rig.samples.size(); ++i) {
    if (i != 2 && i != 3 && i != 11) good.push_back(rig.samples[i]);
  }
  rig.samples[2].T_camera_target = pose({0.5, 0.0, 0.0}, Eigen::Vector3d::Zero()) * rig.samples[2].T_camera_target;
  // A tag's second pose: where it should be, turned.
  rig.samples[3].T_camera_target = rig.samples[3].T_camera_target * pose(Eigen::Vector3d::Zero(), {1.2, 0.0, 0.0});
  // Of another image: the arm was still at the next pose.
  rig.samples[11].T_base_tool = rig.samples[12].T_base_tool;
  const HandEyeResult result = solveHandEye(rig.samples, HandEyeConfig());
  ASSERT_TRUE(result.isGood()) << result.reason;
  for (std::size_t i = 0; i < rig.samples.size(); ++i) {
    EXPECT_EQ(result.residuals[i].is_outlier, i == 2 || i == 3 || i == 11) << i;
  }
  EXPECT_EQ(result.num_used, 12);
  EXPECT_NEAR(result.residuals[2].translation_m, 0.5, 0.02);
  const HandEyeResult without = solveHandEye(good, HandEyeConfig());
  // The same minimum, see above.
  EXPECT_LT(difference(without.T_base_camera, result.T_base_camera).norm(), 1e-7);
  EXPECT_LT((without.covariance - result.covariance).norm(), 1e-5 * without.covariance.norm());
}

TEST(HandEye, AThirdOfTheSamplesMayBeWild) {
  Random random(16);
  for (int run = 0; run < 10; ++run) {
    Rig rig = exactRig(18, &random);
    addNoise(&rig, 1.0, &random);
    for (std::size_t i = 0; i < rig.samples.size(); i += 3) {
      rig.samples[i].T_camera_target = pose(gaussian3(&random, 1.0), gaussian3(&random, 1.0));
    }
    const HandEyeResult result = solveHandEye(rig.samples, tolerant(0.0005, 0.0005));
    ASSERT_TRUE(result.isGood()) << result.reason;
    for (std::size_t i = 0; i < rig.samples.size(); ++i) EXPECT_EQ(result.residuals[i].is_outlier, i % 3 == 0) << i;
  }
}

TEST(HandEye, LeaveOneOutIsWhatTheOthersPredict) {
  Random random(8);
  Rig rig = exactRig(10, &random);
  addNoise(&rig, 1.0, &random);
  const HandEyeResult all = solveHandEye(rig.samples, HandEyeConfig());
  ASSERT_TRUE(all.isGood()) << all.reason;
  ASSERT_EQ(all.num_used, 10);
  double sum_m2 = 0.0;
  double sum_rad2 = 0.0;
  for (std::size_t i = 0; i < rig.samples.size(); ++i) {
    std::vector<HandEyeSample> others = rig.samples;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    const HandEyeResult result = solveHandEye(others, HandEyeConfig());
    ASSERT_EQ(result.num_used, 9);
    const Eigen::Isometry3d error = (result.T_base_camera * rig.samples[i].T_camera_target).inverse() *
                                    rig.samples[i].T_base_tool * result.T_tool_target;
    sum_m2 += error.translation().squaredNorm();
    sum_rad2 += std::pow(Eigen::AngleAxisd(error.linear()).angle(), 2);
  }
  EXPECT_NEAR(all.leave_one_out_rms_m, std::sqrt(sum_m2 / 10), 1e-7);
  EXPECT_NEAR(all.leave_one_out_rms_rad, std::sqrt(sum_rad2 / 10), 1e-7);
  EXPECT_GT(all.leave_one_out_rms_m, all.rms_m);
}

TEST(HandEye, TooFewSamplesAreRefused) {
  Random random(9);
  const Rig rig = exactRig(7, &random);
  const HandEyeResult result = solveHandEye(rig.samples, HandEyeConfig());
  EXPECT_EQ(result.failure, HandEyeFailure::kTooFewSamples);
  EXPECT_THAT(result.reason, HasSubstr("7, at least 8"));
  EXPECT_EQ(solveHandEye({}, HandEyeConfig()).failure, HandEyeFailure::kTooFewSamples);
}

TEST(HandEye, TooLittleRotationIsRefused) {
  Random random(10);
  const Rig rig = exactRig(15, &random, 0.05);
  const HandEyeResult result = solveHandEye(rig.samples, HandEyeConfig());
  EXPECT_EQ(result.failure, HandEyeFailure::kTooLittleRotation);
  EXPECT_THAT(result.reason, HasSubstr("Tilt"));
}

// Turns the shoulder alone, as one who has not read the manual would: the camera's height is then unknown.
Rig oneAxisRig(Random* random) {
  Rig rig = exactRig(15, random, 0.0);
  std::uniform_real_distribution<double> angle(-1.0, 1.0);
  for (HandEyeSample& sample : rig.samples) {
    sample.T_base_tool.linear() = rotation({0.0, 0.0, angle(*random)}) * sample.T_base_tool.linear();
    sample.T_camera_target = rig.T_base_camera.inverse() * sample.T_base_tool * rig.T_tool_target;
  }
  return rig;
}

TEST(HandEye, RotationAboutOneAxisIsRefused) {
  Random random(11);
  const HandEyeResult result = solveHandEye(oneAxisRig(&random).samples, HandEyeConfig());
  EXPECT_EQ(result.failure, HandEyeFailure::kOneAxisOnly);
  EXPECT_THAT(result.reason, HasSubstr("second axis"));
}

TEST(HandEye, ASecondAxisThatOnlyAnOutlierHasDoesNotCount) {
  Random random(12);
  Rig rig = oneAxisRig(&random);
  for (HandEyeSample& sample : rig.samples) {  // not quite one axis: the answer is there, if poor
    sample.T_base_tool.linear() = rotation(gaussian3(&random, 0.03)) * sample.T_base_tool.linear();
    sample.T_camera_target = rig.T_base_camera.inverse() * sample.T_base_tool * rig.T_tool_target;
  }
  rig.samples[4].T_base_tool.linear() = rotation({0.8, 0.0, 0.0}) * rig.samples[4].T_base_tool.linear();
  const HandEyeResult result = solveHandEye(rig.samples, HandEyeConfig());
  EXPECT_EQ(result.failure, HandEyeFailure::kOneAxisOnly) << result.reason;
  EXPECT_THAT(result.reason, HasSubstr("1 outliers"));
}

TEST(HandEye, ALooseTargetIsRefused) {
  Random random(13);
  struct Slack {
    double std_m, std_rad;
  };
  for (const auto& [std_m, std_rad] : {Slack{0.02, 0.0}, Slack{0.0, 0.1}}) {  // it hangs differently each time
    Rig rig = exactRig(16, &random);
    for (HandEyeSample& sample : rig.samples) {
      sample.T_camera_target = sample.T_camera_target * pose(gaussian3(&random, std_m), gaussian3(&random, std_rad));
    }
    const HandEyeResult result = solveHandEye(rig.samples, HandEyeConfig());
    EXPECT_EQ(result.failure, HandEyeFailure::kResidualTooBig) << std_m << " m: " << result.reason;
    EXPECT_THAT(result.reason, HasSubstr("loose"));
    EXPECT_EQ(result.residuals.size(), 16U) << "they show where it happened";
  }
}

TEST(HandEye, SamplesOfWhichTooFewAgreeAreRefused) {
  Random random(17);
  Rig rig = exactRig(10, &random);
  addNoise(&rig, 1.0, &random);
  for (std::size_t i = 0; i < 3; ++i) {
    rig.samples[i].T_camera_target = pose(gaussian3(&random, 1.0), gaussian3(&random, 1.0));
  }
  const HandEyeResult result = solveHandEye(rig.samples, tolerant(0.0005, 0.0005));
  EXPECT_EQ(result.failure, HandEyeFailure::kSamplesDisagree) << result.reason;
  EXPECT_THAT(result.reason, HasSubstr("only 7 of 10 agree"));
}

TEST(HandEye, ATargetThatSlippedHalfWayIsRefused) {
  Random random(14);
  Rig rig = exactRig(14, &random);
  addNoise(&rig, 1.0, &random);
  for (std::size_t i = 7; i < rig.samples.size(); ++i) {
    rig.samples[i].T_camera_target = rig.samples[i].T_camera_target * pose({0.05, 0.02, 0.0}, {0.0, 0.0, 0.3});
  }
  const HandEyeResult result = solveHandEye(rig.samples, HandEyeConfig());
  EXPECT_FALSE(result.isGood()) << "rms " << result.rms_m;
  EXPECT_THAT(result.reason, HasSubstr("loose"));
}

TEST(HandEye, ImpossibleInputThrows) {
  Random random(15);
  const Rig rig = exactRig(8, &random);
  const auto refusal = [](const std::vector<HandEyeSample>& samples, const HandEyeConfig& config) -> std::string {
    try {
      solveHandEye(samples, config);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  std::vector<HandEyeSample> bad = rig.samples;
  bad[3].T_camera_target.translation().x() = std::nan("");
  EXPECT_THAT(refusal(bad, HandEyeConfig()), HasSubstr("sample 3: T_camera_target"));
  bad = rig.samples;
  bad[5].T_base_tool.linear() *= 1.01;
  EXPECT_THAT(refusal(bad, HandEyeConfig()), HasSubstr("sample 5: T_base_tool"));
  bad = rig.samples;
  bad[1].covariance(2, 2) = -1e-6;
  EXPECT_THAT(refusal(bad, HandEyeConfig()), HasSubstr("sample 1: the covariance"));
  HandEyeConfig config;
  config.min_samples = 3;
  config.outlier_chi2 = 1.0;
  EXPECT_THAT(refusal(rig.samples, config), HasSubstr("min_samples = 3, must be in [4, 1000]"));
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              ElementsAre(HasSubstr("min_samples"), HasSubstr("outlier_chi2")));
  EXPECT_TRUE(interactive_mapping::problemsOf(HandEyeConfig()).empty());
}

}  // namespace
}  // namespace brick_detection
