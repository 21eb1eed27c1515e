// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/brick_tracker.h"

#include <cmath>
#include <limits>

#include <gmock/gmock.h>

#include "support/brick_scene.h"

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickFace;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Optional;
using testing::SizeIs;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Matrix6d diagonal(double std_m, double std_rad) {
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(std_m * std_m), Eigen::Vector3d::Constant(std_rad * std_rad);
  return variances.asDiagonal();
}

/// A camera at a height of 1.4 m, looking down at the pile in the map's origin from a direction.
Eigen::Isometry3d cameraFrom(double azimuth_rad, double distance_m = 1.5) {
  const Eigen::Vector3d p(distance_m * std::cos(azimuth_rad), distance_m * std::sin(azimuth_rad), 1.4);
  const Eigen::Vector3d z = -p.normalized();
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.linear() << x, z.cross(x), z;
  T_map_camera.translation() = p;
  return T_map_camera;
}

class Tracker : public testing::Test {
 protected:
  BrickSighting sight(int id, const Eigen::Isometry3d& T_map_brick, const Eigen::Isometry3d& T_map_camera,
                      bool has_duplicate = false) const {
    BrickSighting sighting;
    sighting.brick_id = id;
    sighting.T_camera_brick = T_map_camera.inverse() * T_map_brick;
    sighting.covariance = detection_;
    sighting.faces = {BrickFace::kPlusZ};
    sighting.has_duplicate = has_duplicate;
    return sighting;
  }

  /// An exact look at bricks of one id, each second one after the last.
  std::vector<std::optional<std::size_t>> look(int id, const std::vector<Eigen::Isometry3d>& T_map_bricks,
                                               double azimuth_rad = 0.0) {
    std::vector<BrickSighting> sightings;
    for (const Eigen::Isometry3d& T_map_brick : T_map_bricks) {
      sightings.push_back(sight(id, T_map_brick, cameraFrom(azimuth_rad), T_map_bricks.size() > 1));
    }
    return tracker_.addLook(now_s_ += 1.0, cameraFrom(azimuth_rad), sightings);
  }

  Matrix6d detection_ = diagonal(0.002, 0.005);
  mp700_ur5e_description::BrickCatalogue catalogue_ = testCatalogue();
  BrickTrackerConfig config_;
  BrickTracker tracker_{catalogue_, config_};
  double now_s_{10.0};
  Eigen::Isometry3d here_ = makePose({0.1, 0.0, 0.1}, {0.0, 0.0, 0.4});
  Eigen::Isometry3d there_ = makePose({-0.4, 0.3, 0.1}, {0.0, 0.0, -1.0});
  Eigen::Isometry3d elsewhere_ = makePose({0.3, -0.5, 0.1}, {0.2, 0.0, 2.0});
};

TEST_F(Tracker, KnowsABrickAfterOneLook) {
  EXPECT_THAT(tracker_.bricks(), IsEmpty());
  EXPECT_THAT(look(5, {here_}), ElementsAre(Optional(0u)));
  ASSERT_THAT(tracker_.bricks(), SizeIs(1));
  const TrackedBrick& brick = tracker_.bricks()[0];
  EXPECT_EQ(brick.id, 5);
  EXPECT_EQ(brick.instance, 0);
  EXPECT_FALSE(brick.has_duplicate);
  EXPECT_TRUE(brick.T_map_brick.isApprox(here_, 1e-9));
  EXPECT_EQ(brick.num_looks, 1);
  EXPECT_EQ(brick.first_seen_s, now_s_);
  EXPECT_EQ(brick.last_seen_s, now_s_);
  EXPECT_THAT(brick.faces_seen, ElementsAre(false, false, false, false, true, false));
}

TEST_F(Tracker, CovarianceOfOneLookIsDetectionPlusCameraPlusFloorInTheMap) {
  // Detection bad along the line of sight alone: where that is in the map, the camera's pose says.
  detection_(2, 2) = 0.05 * 0.05;
  look(5, {here_}, 0.7);
  const Eigen::Isometry3d T_map_camera = cameraFrom(0.7);
  Matrix6d expected = detection_;
  const Eigen::Matrix3d R = T_map_camera.linear();
  expected.topLeftCorner<3, 3>() = R * detection_.topLeftCorner<3, 3>() * R.transpose();
  expected += diagonal(config_.floor_std_m, config_.floor_std_rad);
  // The camera's part by numbers: how the brick moves when the camera does.
  Eigen::Matrix<double, 6, 6> by_camera;
  for (int i = 0; i < 6; ++i) {
    const Eigen::Isometry3d shifted = moved(T_map_camera, 1e-6 * Vector6d::Unit(i));
    by_camera.col(i) = stepBetween(here_, shifted * T_map_camera.inverse() * here_) / 1e-6;
  }
  expected += by_camera * diagonal(config_.camera_std_m, config_.camera_std_rad) * by_camera.transpose();
  EXPECT_LT((tracker_.bricks()[0].covariance - expected).cwiseAbs().maxCoeff(), 1e-9);  // difference quotient
}

/// Mean squared error of a brick's pose, normalised by its covariance, over campaigns of looks from a few standpoints. The
/// camera's pose is off by another error at each standpoint, which all looks from there share. At the last one the
/// localisation is right, at the others it is off.
double meanNormalisedError(const BrickTrackerConfig& config, const Matrix6d& detection, int num_standpoints,
                           int looks_each, int num_campaigns) {
  std::mt19937 engine(13);
  const Matrix6d camera_error = diagonal(config.camera_std_m, config.camera_std_rad);
  const Matrix6d drift = diagonal(config.localisation_std_m, config.localisation_std_rad);
  const Matrix6d floor = diagonal(config.floor_std_m, config.floor_std_rad);
  const Eigen::Isometry3d truth = makePose({0.1, -0.2, 0.1}, {0.3, 0.2, 0.4});
  double sum = 0.0;
  for (int campaign = 0; campaign < num_campaigns; ++campaign) {
    BrickTracker tracker(testCatalogue(), config);
    const Eigen::Isometry3d shown = moved(truth, drawFrom(floor, engine));  // calibration: the same in all looks
    double stamp_s = 0.0;
    for (int k = 0; k < num_standpoints; ++k) {
      const Eigen::Isometry3d T_map_camera = cameraFrom(0.9 * k);
      Eigen::Isometry3d believed = moved(T_map_camera, drawFrom(camera_error, engine));
      if (k + 1 < num_standpoints) believed = moved(believed, drawFrom(drift, engine));
      for (int i = 0; i < looks_each; ++i) {
        BrickSighting sighting;
        sighting.brick_id = 1;
        sighting.T_camera_brick = moved(T_map_camera.inverse() * shown, drawFrom(detection, engine));
        sighting.covariance = detection;
        tracker.addLook(stamp_s += 0.1, believed, {sighting});
      }
    }
    if (tracker.bricks().size() != 1u) {
      ADD_FAILURE() << tracker.bricks().size() << " bricks";
      return 0.0;
    }
    const TrackedBrick& brick = tracker.bricks()[0];
    const Vector6d off = stepBetween(brick.T_map_brick, truth);
    sum += off.dot(brick.covariance.ldlt().solve(off));
  }
  return sum / num_campaigns;
}

// The mean over 300 of chi-squares with six degrees of freedom has a standard deviation of 0.2: four of them. The gate cuts
// nothing to speak of.
constexpr double kLeastNormalised = 5.2;
constexpr double kMostNormalised = 6.8;

TEST_F(Tracker, CovarianceStaysHonestOverManyStandpoints) {
  for (const int num_standpoints : {1, 2, 6}) {
    const double error = meanNormalisedError(config_, detection_, num_standpoints, config_.looks_per_standpoint, 300);
    EXPECT_GT(error, kLeastNormalised) << num_standpoints;
    EXPECT_LT(error, kMostNormalised) << num_standpoints;
  }
}

TEST_F(Tracker, CovarianceStaysHonestWhenStandingStillForLong) {
  // Here the looks' own errors are independent, and the mean is somewhat better than is claimed.
  const double error = meanNormalisedError(config_, detection_, 1, 100, 300);
  EXPECT_GT(error, 4.5);
  EXPECT_LT(error, kMostNormalised);
}

TEST_F(Tracker, StandingStillDoesNotMakeSure) {
  look(5, {here_});
  const Matrix6d first = tracker_.bricks()[0].covariance;
  for (int i = 0; i < 4; ++i) look(5, {here_});
  const Matrix6d fifth = tracker_.bricks()[0].covariance;
  for (int i = 0; i < 200; ++i) look(5, {here_});
  const Matrix6d last = tracker_.bricks()[0].covariance;
  EXPECT_LT(fifth.trace(), first.trace());
  EXPECT_LT((last - fifth).norm(), 1e-9 * fifth.norm());
  EXPECT_GT(last(0, 0), std::pow(config_.camera_std_m, 2) + std::pow(config_.floor_std_m, 2));
  // A view from elsewhere does.
  look(5, {here_}, 1.5);
  EXPECT_LT(tracker_.bricks()[0].covariance.trace(), 0.9 * last.trace());
  // And coming back is no new view.
  const auto goAndComeBack = [&](int times) {
    for (int i = 0; i < times; ++i) {
      look(5, {here_}, 0.0);
      look(5, {here_}, 1.5);
    }
    return tracker_.bricks()[0].covariance;
  };
  const Matrix6d both = goAndComeBack(3);
  EXPECT_LT((goAndComeBack(50) - both).norm(), 1e-9 * both.norm());
}

// What is picked is picked from where the robot stands: there the brick is where it was seen last, whatever the localisation
// was when it was seen from elsewhere.
TEST_F(Tracker, FollowsTheLocalisationAsItDrifts) {
  for (int i = 0; i < 5; ++i) look(5, {here_}, 0.0);
  Vector6d off = Vector6d::Zero();
  off(0) = 0.015;
  look(5, {moved(here_, off)}, 1.5);
  const auto error_m = [&] {
    return (tracker_.bricks()[0].T_map_brick.translation() - moved(here_, off).translation()).norm();
  };
  EXPECT_LT(error_m(), 0.004);
  for (int i = 0; i < 5; ++i) {  // where the robot stays
    off(1) += 0.003;
    look(5, {moved(here_, off)}, 1.5);
  }
  EXPECT_LT(error_m(), 0.006);
  ASSERT_THAT(tracker_.bricks(), SizeIs(1));
}

TEST_F(Tracker, NoNumberOfStandpointsGoesBelowTheFloor) {
  for (int i = 0; i < 100; ++i) look(5, {here_}, 0.3 * i);
  const Matrix6d covariance = tracker_.bricks()[0].covariance;
  for (int i = 0; i < 6; ++i) {
    EXPECT_GT(covariance(i, i), std::pow(i < 3 ? config_.floor_std_m : config_.floor_std_rad, 2)) << i;
  }
  EXPECT_EQ(tracker_.bricks()[0].num_looks, 100);
}

TEST_F(Tracker, TheBetterLookWeighsMore) {
  // One good look and one poor, as far apart as the poor one's error allows. The localisation does not drift.
  config_.localisation_std_m = config_.localisation_std_rad = 0.0;
  tracker_ = BrickTracker(catalogue_, config_);
  Vector6d off = Vector6d::Zero();
  off(0) = 0.02;
  look(5, {here_}, 0.0);
  detection_ = diagonal(0.02, 0.05);
  look(5, {moved(here_, off)}, 1.5);
  const double moved_m = (tracker_.bricks()[0].T_map_brick.translation() - here_.translation()).norm();
  EXPECT_GT(moved_m, 0.0);
  EXPECT_LT(moved_m, 0.005);
}

TEST_F(Tracker, BelievesThatABrickHasMovedOnceEnoughLooksAgree) {
  look(5, {here_});
  look(5, {here_}, 1.0);
  EXPECT_THAT(look(5, {there_}), ElementsAre(std::nullopt));
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(here_, 1e-6));
  EXPECT_EQ(tracker_.bricks()[0].num_looks, 2);
  EXPECT_THAT(look(5, {there_}), ElementsAre(Optional(0u)));
  ASSERT_THAT(tracker_.bricks(), SizeIs(1)) << "nowhere twice";
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(there_, 1e-6));
  EXPECT_EQ(tracker_.bricks()[0].instance, 0);
  EXPECT_EQ(tracker_.bricks()[0].num_looks, 4);
  EXPECT_FALSE(tracker_.bricks()[0].has_duplicate);
  EXPECT_EQ(tracker_.bricks()[0].last_seen_s, now_s_);
  EXPECT_EQ(tracker_.bricks()[0].first_seen_s, 11.0);
}

TEST_F(Tracker, DoesNotBelieveAWrongLookNorTwoThatDisagree) {
  look(5, {here_});
  look(5, {there_});
  look(5, {here_});
  look(5, {there_});
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(here_, 1e-6)) << "the look at the old place comes between";
  look(5, {elsewhere_});
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(here_, 1e-6)) << "there and elsewhere are two places";
  look(5, {elsewhere_});
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(elsewhere_, 1e-6));
}

TEST_F(Tracker, ToldToBelieveAtOnceItDoes) {
  config_.moved_looks = 1;
  tracker_ = BrickTracker(catalogue_, config_);
  look(5, {here_});
  EXPECT_THAT(look(5, {there_}), ElementsAre(Optional(0u)));
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(there_, 1e-6));
}

TEST_F(Tracker, FromOneStandpointTellsASmallMoveThatTheCamerasErrorWouldHide) {
  // 18 mm are within what the camera's pose may be off by between two standpoints (0.003 rad at 2 m, twice), not within
  // what two looks from one standpoint differ by.
  Vector6d off = Vector6d::Zero();
  off(0) = 0.018;
  look(5, {here_});
  EXPECT_THAT(look(5, {moved(here_, off)}), ElementsAre(std::nullopt));
  tracker_.clear();
  look(5, {here_});
  EXPECT_THAT(look(5, {moved(here_, off)}, 1.5), ElementsAre(Optional(0u)));
}

TEST_F(Tracker, TwoPlacesInOneImageAreTwoInstances) {
  EXPECT_THAT(look(5, {here_, there_}), ElementsAre(Optional(0u), Optional(1u)));
  ASSERT_THAT(tracker_.bricks(), SizeIs(2));
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(tracker_.bricks()[i].id, 5);
    EXPECT_EQ(tracker_.bricks()[i].instance, i);
    EXPECT_TRUE(tracker_.bricks()[i].has_duplicate);
  }
  // The number stays with the place, whatever the order and whatever is in view.
  EXPECT_THAT(look(5, {there_, here_}), ElementsAre(Optional(1u), Optional(0u)));
  EXPECT_THAT(look(5, {there_}), ElementsAre(Optional(1u)));
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(here_, 1e-6));
  EXPECT_TRUE(tracker_.bricks()[1].T_map_brick.isApprox(there_, 1e-6));
  EXPECT_TRUE(tracker_.bricks()[1].has_duplicate) << "the other is still known";
}

TEST_F(Tracker, ASecondCarrierThatAppearsLaterIsANewInstance) {
  look(5, {here_});
  EXPECT_FALSE(tracker_.bricks()[0].has_duplicate);
  EXPECT_THAT(look(5, {there_, here_}), ElementsAre(Optional(1u), Optional(0u)));
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(here_, 1e-6));
  EXPECT_TRUE(tracker_.bricks()[0].has_duplicate);
}

TEST_F(Tracker, ABadLookBesideTheBrickMakesNoSecondOne) {
  // As it was seen: one face's tag half hidden, 107 mm off. Two bricks of 0.2 m are never that near to each other.
  Vector6d off = Vector6d::Zero();
  off.head<3>() << 0.052, -0.046, -0.082;
  const Eigen::Isometry3d bad = moved(here_, off);
  look(5, {here_});
  look(5, {here_});
  for (int i = 0; i < 2; ++i) {
    EXPECT_THAT(look(5, {here_, bad}), ElementsAre(Optional(0u), std::nullopt));
    EXPECT_THAT(tracker_.bricks(), SizeIs(1));
  }
  look(5, {here_});
  ASSERT_THAT(tracker_.bricks(), SizeIs(1));
  EXPECT_FALSE(tracker_.bricks()[0].has_duplicate);
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(here_, 1e-6));
}

TEST_F(Tracker, OfTwoWithinEachOtherInTheFirstImageTheOneThatIsSeenAgainStays) {
  Vector6d off = Vector6d::Zero();
  off(2) = -0.1;
  look(5, {moved(here_, off), here_});
  look(5, {here_});
  ASSERT_THAT(tracker_.bricks(), SizeIs(1));
  EXPECT_FALSE(tracker_.bricks()[0].has_duplicate);
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(here_, 1e-6));
}

TEST_F(Tracker, ASecondCarrierThatIsNotSeenAgainBesideTheFirstIsNone) {
  look(5, {here_});
  look(5, {here_, there_});
  EXPECT_THAT(tracker_.bricks(), SizeIs(2));
  look(6, {elsewhere_});
  EXPECT_THAT(tracker_.bricks(), SizeIs(3)) << "an image of others says nothing";
  tracker_.addLook(now_s_ += 1.0, cameraFrom(0.0), {sight(5, here_, cameraFrom(0.0), true)});
  EXPECT_THAT(tracker_.bricks(), SizeIs(3)) << "it was there, and was refused";
  look(5, {here_});
  ASSERT_THAT(tracker_.bricks(), SizeIs(2));
  EXPECT_FALSE(tracker_.bricks()[0].has_duplicate);
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(here_, 1e-6));
}

TEST_F(Tracker, OneThatIsSeenBesideARefusedCarrierIsANewInstance) {
  look(5, {here_});
  const auto indices = tracker_.addLook(now_s_ += 1.0, cameraFrom(0.0), {sight(5, there_, cameraFrom(0.0), true)});
  EXPECT_THAT(indices, ElementsAre(Optional(1u)));
  EXPECT_THAT(tracker_.bricks(), SizeIs(2));
}

TEST_F(Tracker, ALoneSightingThatIsADuplicateMakesOne) {
  tracker_.addLook(now_s_ += 1.0, cameraFrom(0.0), {sight(5, here_, cameraFrom(0.0), true)});
  ASSERT_THAT(tracker_.bricks(), SizeIs(1));
  EXPECT_TRUE(tracker_.bricks()[0].has_duplicate);
}

TEST_F(Tracker, OfTwoInstancesTheOneThatIsNotSeenHasMoved) {
  look(5, {here_, there_});
  look(5, {here_, elsewhere_});
  look(5, {elsewhere_, here_});
  ASSERT_THAT(tracker_.bricks(), SizeIs(2));
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(here_, 1e-6));
  EXPECT_TRUE(tracker_.bricks()[1].T_map_brick.isApprox(elsewhere_, 1e-6));
}

TEST_F(Tracker, WhatIsNotSeenStays) {
  look(5, {here_});
  for (int i = 0; i < 20; ++i) look(6, {there_}, 0.3 * i);
  tracker_.addLook(now_s_ += 1.0, cameraFrom(0.0), {});
  ASSERT_THAT(tracker_.bricks(), SizeIs(2));
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(here_, 1e-6));
  EXPECT_EQ(tracker_.bricks()[0].num_looks, 1);
}

TEST_F(Tracker, BricksAreInOrderOfIdAndInstance) {
  look(9, {here_, there_});
  look(2, {elsewhere_});
  std::vector<std::pair<int, int>> order;
  for (const TrackedBrick& brick : tracker_.bricks()) order.emplace_back(brick.id, brick.instance);
  EXPECT_THAT(order, ElementsAre(std::make_pair(2, 0), std::make_pair(9, 0), std::make_pair(9, 1)));
  EXPECT_THAT(look(9, {there_, here_}), ElementsAre(Optional(2u), Optional(1u)));
}

TEST_F(Tracker, InsidePointsAreAGridBelowTheFaces) {
  look(5, {here_});
  look(6, {there_});
  const std::vector<Eigen::Matrix3Xd> points = tracker_.insidePoints();
  ASSERT_THAT(points, SizeIs(2));
  ASSERT_EQ(points[0].cols(), 64);
  const Eigen::Vector3d half_m = 0.5 * catalogue_.types.front().size_m;
  const Eigen::Matrix3Xd points_brick = here_.inverse() * points[0];
  // To 1e-9: fusion ends where rounding does.
  const Eigen::Vector3d most = points_brick.rowwise().maxCoeff();
  const Eigen::Vector3d least = points_brick.rowwise().minCoeff();
  EXPECT_LT((most - (half_m.array() - 0.02).matrix()).norm(), 1e-9);
  EXPECT_LT((least + most).norm(), 1e-9);
  EXPECT_LT(points_brick.rowwise().mean().norm(), 1e-9);
  for (int i = 0; i < 64; ++i) {
    for (int k = 0; k < i; ++k) EXPECT_GT((points[0].col(i) - points[0].col(k)).norm(), 0.05);  // 0.16 m / 3
  }
}

TEST_F(Tracker, DropsABrickWhoseInsideTheMapHasSeenFreeSince) {
  look(5, {here_});
  look(6, {there_});
  look(7, {elsewhere_});
  EXPECT_THAT(tracker_.dropFree({0.49, 1.0, 1.0}, 12.5), ElementsAre(6)) << "7 was seen after the map's image";
  EXPECT_THAT(tracker_.bricks(), SizeIs(2));
  EXPECT_THAT(tracker_.dropFree({0.0, 1.0}, 13.0), IsEmpty()) << "7 was seen in the map's image";
  EXPECT_THAT(tracker_.dropFree({0.5, 1.0}, 13.1), ElementsAre(5, 7));
  EXPECT_THAT(tracker_.bricks(), IsEmpty());
  EXPECT_THAT(tracker_.dropFree({}, 14.0), IsEmpty());
  // Seen again it is the same brick, at once.
  EXPECT_THAT(look(6, {elsewhere_}), ElementsAre(Optional(0u)));
  EXPECT_EQ(tracker_.bricks()[0].instance, 0);
  EXPECT_EQ(tracker_.bricks()[0].num_looks, 1);
}

TEST_F(Tracker, TheLastOfTwoIsNoDuplicateAnyMore) {
  look(5, {here_, there_});
  tracker_.dropFree({1.0, 0.0}, now_s_ + 1.0);
  ASSERT_THAT(tracker_.bricks(), SizeIs(1));
  EXPECT_EQ(tracker_.bricks()[0].instance, 1);
  look(5, {there_});
  EXPECT_FALSE(tracker_.bricks()[0].has_duplicate);
  EXPECT_EQ(tracker_.bricks()[0].instance, 1) << "the number stays with the place";
}

TEST_F(Tracker, ABrickInTheHandIsNotPartOfTheWorld) {
  look(5, {here_});
  EXPECT_TRUE(tracker_.attach(5, here_.translation()));
  EXPECT_THAT(tracker_.bricks(), IsEmpty());
  EXPECT_THAT(look(5, {there_}), ElementsAre(std::nullopt));
  EXPECT_THAT(look(5, {there_}), ElementsAre(std::nullopt));
  EXPECT_THAT(tracker_.bricks(), IsEmpty());
  // Let go: at its place with the first look, not held back as one that has moved.
  tracker_.detach();
  EXPECT_THAT(look(5, {elsewhere_}), ElementsAre(Optional(0u)));
  ASSERT_THAT(tracker_.bricks(), SizeIs(1));
  EXPECT_TRUE(tracker_.bricks()[0].T_map_brick.isApprox(elsewhere_, 1e-6));
  EXPECT_EQ(tracker_.bricks()[0].num_looks, 1);
}

TEST_F(Tracker, AnImageFromBeforeLettingGoStillShowsTheHand) {
  look(5, {here_});
  tracker_.attach(5, here_.translation());
  tracker_.detach(now_s_ + 1.5);
  EXPECT_THAT(look(5, {there_}), ElementsAre(std::nullopt));
  EXPECT_THAT(tracker_.bricks(), IsEmpty());
  EXPECT_THAT(look(5, {elsewhere_}), ElementsAre(Optional(0u)));
}

TEST_F(Tracker, OfSeveralWithOneIdTheNearestGoesToTheHandAndComesBackAsItself) {
  look(5, {here_, there_, elsewhere_});
  EXPECT_TRUE(tracker_.attach(5, there_.translation() + Eigen::Vector3d(0.05, 0.0, 0.0)));
  ASSERT_THAT(tracker_.bricks(), SizeIs(2));
  EXPECT_EQ(tracker_.bricks()[0].instance, 0);
  EXPECT_EQ(tracker_.bricks()[1].instance, 2);
  EXPECT_TRUE(tracker_.bricks()[0].has_duplicate);
  // The others stay in sight; what is in the hand is nobody's new place.
  const Eigen::Isometry3d in_hand = makePose({0.0, 0.6, 0.8});
  for (int i = 0; i < 3; ++i) {
    EXPECT_THAT(look(5, {here_, in_hand}), ElementsAre(Optional(0u), std::nullopt));
  }
  EXPECT_EQ(tracker_.bricks()[0].num_looks, 4);
  tracker_.detach(now_s_);
  const Eigen::Isometry3d put = makePose({0.0, 0.6, 0.1});
  EXPECT_THAT(look(5, {put}), ElementsAre(Optional(1u)));
  ASSERT_THAT(tracker_.bricks(), SizeIs(3));
  EXPECT_EQ(tracker_.bricks()[1].instance, 1);
  EXPECT_TRUE(tracker_.bricks()[1].T_map_brick.isApprox(put, 1e-6));
}

TEST_F(Tracker, OneOfTwoInTheHandLeavesADuplicate) {
  look(5, {here_, there_});
  tracker_.attach(5, here_.translation());
  look(5, {there_});
  ASSERT_THAT(tracker_.bricks(), SizeIs(1));
  EXPECT_TRUE(tracker_.bricks()[0].has_duplicate) << "the one in the hand carries the id, too";
}

TEST_F(Tracker, TwoThatWereLetGoBothComeBackAsThemselves) {
  look(5, {here_, there_});
  tracker_.attach(5, here_.translation());
  tracker_.detach();
  tracker_.attach(5, there_.translation());
  tracker_.detach();
  EXPECT_THAT(tracker_.bricks(), IsEmpty());
  look(5, {here_});
  ASSERT_THAT(tracker_.bricks(), SizeIs(1));
  EXPECT_EQ(tracker_.bricks()[0].instance, 0);
  EXPECT_TRUE(tracker_.bricks()[0].has_duplicate) << "the other was let go, and is somewhere";
  look(5, {here_, elsewhere_});
  ASSERT_THAT(tracker_.bricks(), SizeIs(2));
  EXPECT_EQ(tracker_.bricks()[1].instance, 1);
  // Both at once.
  tracker_.attach(5, here_.translation());
  tracker_.detach();
  tracker_.attach(5, elsewhere_.translation());
  tracker_.detach();
  EXPECT_THAT(look(5, {there_, here_}), ElementsAre(Optional(0u), Optional(1u)));
  EXPECT_THAT(tracker_.bricks(), SizeIs(2));
}

TEST_F(Tracker, TakesAnUnknownBrickInHandToo) {
  EXPECT_FALSE(tracker_.attach(5, here_.translation()));
  EXPECT_THAT(look(5, {there_}), ElementsAre(std::nullopt));
  tracker_.detach();
  EXPECT_THAT(look(5, {there_}), ElementsAre(Optional(0u)));
  tracker_.detach();  // nothing in the hand
  EXPECT_THAT(tracker_.bricks(), SizeIs(1));
}

TEST_F(Tracker, ForgetsEverythingButTheHand) {
  look(5, {here_});
  look(6, {there_});
  tracker_.attach(6, there_.translation());
  tracker_.clear();
  EXPECT_THAT(tracker_.bricks(), IsEmpty());
  now_s_ = 0.0;  // time may begin anew
  EXPECT_THAT(look(5, {elsewhere_}), ElementsAre(Optional(0u)));
  EXPECT_THAT(look(6, {there_}), ElementsAre(std::nullopt));
}

TEST_F(Tracker, RefusesBadInputAndChangesNothing) {
  look(5, {here_});
  const Eigen::Isometry3d camera = cameraFrom(0.0);
  const BrickSighting good = sight(6, there_, camera);
  EXPECT_THROW(tracker_.addLook(now_s_ - 0.1, camera, {good}), std::invalid_argument);
  EXPECT_THROW(tracker_.addLook(kNan, camera, {good}), std::invalid_argument);
  Eigen::Isometry3d bad_pose = camera;
  bad_pose.translation().x() = kNan;
  EXPECT_THROW(tracker_.addLook(now_s_, bad_pose, {good}), std::invalid_argument);
  bad_pose = camera;
  bad_pose.linear() *= 1.1;
  EXPECT_THROW(tracker_.addLook(now_s_, bad_pose, {good}), std::invalid_argument);
  BrickSighting bad = good;
  bad.T_camera_brick.translation().z() = kNan;
  EXPECT_THROW(tracker_.addLook(now_s_, camera, {good, bad}), std::invalid_argument);
  bad = good;
  bad.covariance.setZero();
  EXPECT_THROW(tracker_.addLook(now_s_, camera, {good, bad}), std::invalid_argument);
  bad = good;
  bad.brick_id = 100000;
  EXPECT_THROW(tracker_.addLook(now_s_, camera, {good, bad}), std::invalid_argument);
  EXPECT_THROW(tracker_.dropFree({}, 20.0), std::invalid_argument);
  EXPECT_THROW(tracker_.dropFree({1.1}, 20.0), std::invalid_argument);
  EXPECT_THROW(tracker_.dropFree({kNan}, 20.0), std::invalid_argument);
  EXPECT_THROW(tracker_.dropFree({1.0}, kNan), std::invalid_argument);
  EXPECT_THROW(tracker_.attach(100000, here_.translation()), std::invalid_argument);
  EXPECT_THROW(tracker_.attach(5, {0.0, kNan, 0.0}), std::invalid_argument);
  EXPECT_THAT(tracker_.bricks(), SizeIs(1));
  EXPECT_EQ(tracker_.bricks()[0].num_looks, 1);
  EXPECT_NO_THROW(tracker_.addLook(now_s_, camera, {good})) << "two looks may have one stamp";
}

TEST(BrickTrackerConfig, SaysWhatIsWrong) {
  EXPECT_THAT(interactive_mapping::problemsOf(BrickTrackerConfig()), IsEmpty());
  BrickTrackerConfig config;
  config.camera_std_m = -0.1;
  config.gate_chi2 = kNan;
  config.moved_looks = 0;
  EXPECT_THAT(
      interactive_mapping::problemsOf(config),
      ElementsAre(HasSubstr("camera_std_m = -0.1 m, must be in [0, 1] m"), HasSubstr("gate_chi2 = nan, must be in ["),
                  HasSubstr("moved_looks = 0 looks, must be in [1, 100] looks")));
  EXPECT_THROW(BrickTracker(testCatalogue(), config), std::invalid_argument);
}

}  // namespace
}  // namespace brick_detection
