// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/marker_sightings.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickCatalogue;
using mp700_ur5e_description::BrickFace;
using mp700_ur5e_description::tagPose;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

const BrickCatalogue& catalogue() {
  static const BrickCatalogue kCatalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  return kCatalogue;
}

Eigen::Isometry3d brickAt(double x, double turn_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << x, 0.1, 1.0;
  T.rotate(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d(1.0, 2.0, -0.5).normalized()));
  return T;
}

MarkerObservation markerOf(int brick_id, BrickFace face, const Eigen::Isometry3d& T_camera_brick) {
  return {catalogue().tagId(brick_id, face), T_camera_brick * tagPose(catalogue().typeOf(brick_id), face)};
}

TEST(MarkerSightings, AMarkerTellsWhereItsBrickIs) {
  const Eigen::Isometry3d T_camera_brick = brickAt(0.2, 1.0);
  for (const BrickFace face : mp700_ur5e_description::kBrickFaces) {
    const auto result = sightingsOfMarkers({markerOf(7, face, T_camera_brick)}, catalogue(), MarkerConfig());
    ASSERT_THAT(result.bricks, SizeIs(1));
    EXPECT_EQ(result.bricks[0].brick_id, 7);
    EXPECT_LT((result.bricks[0].T_camera_brick.matrix() - T_camera_brick.matrix()).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_THAT(result.bricks[0].faces, ElementsAre(face));
    EXPECT_FALSE(result.bricks[0].has_depth);
    EXPECT_FALSE(result.bricks[0].has_duplicate);
    ASSERT_THAT(result.tags, SizeIs(1));
    EXPECT_EQ(result.tags[0].status, TagStatus::kUsed);
    EXPECT_EQ(result.tags[0].face, face);
  }
}

// The covariance is what errors of that size make of the brick's pose: the marker's turn moves the brick's middle, half
// a brick away. Of 2000 draws the mean of the normalised squared error of 6 degrees of freedom is 6 +- 0.08 (1 sigma).
TEST(MarkerSightings, CovarianceIsThatOfTheErrors) {
  MarkerConfig config;
  config.position_std_m = 0.004;
  config.rotation_std_rad = 0.02;
  std::mt19937 engine(1);
  std::normal_distribution<double> normal;
  const auto draw = [&](double std_dev) -> Eigen::Vector3d {
    return std_dev * Eigen::Vector3d(normal(engine), normal(engine), normal(engine));
  };
  const Eigen::Isometry3d T_camera_brick = brickAt(0.2, 1.0);
  for (const std::vector<BrickFace>& faces :
       {std::vector<BrickFace>{BrickFace::kPlusX}, std::vector<BrickFace>{BrickFace::kPlusX, BrickFace::kPlusZ}}) {
    double sum = 0.0;
    constexpr int kDraws = 2000;
    for (int i = 0; i < kDraws; ++i) {
      std::vector<MarkerObservation> markers;
      for (const BrickFace face : faces) {
        MarkerObservation marker = markerOf(7, face, T_camera_brick);
        const Eigen::Vector3d turn = draw(config.rotation_std_rad);
        marker.T_camera_tag.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()) * marker.T_camera_tag.linear();
        marker.T_camera_tag.translation() += draw(config.position_std_m);
        markers.push_back(marker);
      }
      config.same_brick_m = 0.5;  // no draw is to be left out
      config.same_brick_rad = 1.0;
      const auto result = sightingsOfMarkers(markers, catalogue(), config);
      ASSERT_THAT(result.bricks, SizeIs(1));
      const Eigen::AngleAxisd turned(T_camera_brick.linear() * result.bricks[0].T_camera_brick.linear().transpose());
      Eigen::Matrix<double, 6, 1> error;
      error << T_camera_brick.translation() - result.bricks[0].T_camera_brick.translation(),
          turned.angle() * turned.axis();
      sum += error.dot(result.bricks[0].covariance.inverse() * error);
    }
    EXPECT_NEAR(sum / kDraws, 6.0, 0.4) << faces.size() << " markers";
  }
}

TEST(MarkerSightings, MarkersThatContradictEachOtherAreBricksWithOneId) {
  const Eigen::Isometry3d T_one = brickAt(0.2, 1.0);
  const Eigen::Isometry3d T_other = brickAt(-0.3, 1.0);
  const auto result =
      sightingsOfMarkers({markerOf(7, BrickFace::kPlusZ, T_one), markerOf(7, BrickFace::kPlusX, T_other),
                          markerOf(7, BrickFace::kPlusX, T_one)},
                         catalogue(), MarkerConfig());
  ASSERT_THAT(result.bricks, SizeIs(2));
  for (const BrickSighting& brick : result.bricks) EXPECT_TRUE(brick.has_duplicate);
  EXPECT_THAT(result.bricks[0].faces, ElementsAre(BrickFace::kPlusX, BrickFace::kPlusZ));
  EXPECT_LT((result.bricks[0].T_camera_brick.matrix() - T_one.matrix()).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_LT((result.bricks[1].T_camera_brick.matrix() - T_other.matrix()).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(MarkerSightings, OneMarkerTwiceIsNeverOneBrick) {
  const MarkerObservation marker = markerOf(7, BrickFace::kPlusZ, brickAt(0.2, 1.0));
  const auto result = sightingsOfMarkers({marker, marker}, catalogue(), MarkerConfig());
  ASSERT_THAT(result.bricks, SizeIs(2));
  EXPECT_TRUE(result.bricks[0].has_duplicate);
}

TEST(MarkerSightings, ATurnedMarkerIsOfAnotherBrick) {
  const Eigen::Isometry3d T_one = brickAt(0.2, 1.0);
  const auto result =
      sightingsOfMarkers({markerOf(7, BrickFace::kPlusZ, T_one), markerOf(7, BrickFace::kPlusX, brickAt(0.2, 1.5))},
                         catalogue(), MarkerConfig());
  EXPECT_THAT(result.bricks, SizeIs(2));
}

TEST(MarkerSightings, UnknownAndBrokenMarkersAreToldAndNotUsed) {
  MarkerObservation unknown = markerOf(7, BrickFace::kPlusZ, brickAt(0.2, 1.0));
  unknown.id = 100000;
  MarkerObservation broken = markerOf(8, BrickFace::kPlusZ, brickAt(0.2, 1.0));
  broken.T_camera_tag.translation().x() = std::numeric_limits<double>::quiet_NaN();
  MarkerObservation squeezed = markerOf(9, BrickFace::kPlusZ, brickAt(0.2, 1.0));
  squeezed.T_camera_tag.linear() *= 0.9;
  const auto result = sightingsOfMarkers({unknown, broken, squeezed}, catalogue(), MarkerConfig());
  EXPECT_THAT(result.bricks, IsEmpty());
  ASSERT_THAT(result.tags, SizeIs(3));
  EXPECT_EQ(result.tags[0].status, TagStatus::kUnknownId);
  EXPECT_EQ(result.tags[0].brick_id, -1);
  EXPECT_EQ(result.tags[1].status, TagStatus::kInconsistent);
  EXPECT_EQ(result.tags[2].status, TagStatus::kInconsistent);
}

TEST(MarkerSightings, ImpossibleSettingsAreNamed) {
  MarkerConfig config;
  config.rotation_std_rad = 0.0;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              ElementsAre("rotation_std_rad = 0 rad, must be in [0.0001, 1] rad"));
  EXPECT_THROW(sightingsOfMarkers({}, catalogue(), config), std::invalid_argument);
}

}  // namespace
}  // namespace brick_detection
