// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/brick_detector.h"

#include <cmath>
#include <functional>
#include <stdexcept>

#include <gmock/gmock.h>

#include "support/tag_renderer.h"

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickCatalogue;
using mp700_ur5e_description::BrickFace;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

const BrickCatalogue& catalogue() {
  static const BrickCatalogue kCatalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  return kCatalogue;
}

BrickCatalogue alvarCatalogue() {
  BrickCatalogue alvar = catalogue();
  alvar.tags.family = "ALVAR_5X5";
  return alvar;
}

Eigen::Isometry3d standing(double x, double y, double z, double yaw_rad) {
  Eigen::Isometry3d T_map_brick = Eigen::Isometry3d::Identity();
  T_map_brick.translation() << x, y, z;
  T_map_brick.rotate(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  return T_map_brick;
}

/// 0.9 m from the origin, 45 degrees down along x.
Eigen::Isometry3d cameraPose() {
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.translation() << -0.65, 0.0, 0.75;
  T_map_camera.linear() << 0.0, -std::sqrt(0.5), std::sqrt(0.5), -1.0, 0.0, 0.0, 0.0, -std::sqrt(0.5), -std::sqrt(0.5);
  return T_map_camera;
}

/// A brick that another program has seen.
std::vector<MarkerObservation> markersOf(const std::vector<std::pair<int, Eigen::Isometry3d>>& bricks) {
  std::vector<MarkerObservation> markers;
  for (const auto& [id, T_map_brick] : bricks) {
    const Eigen::Isometry3d T_camera_brick = cameraPose().inverse() * T_map_brick;
    markers.push_back({catalogue().tagId(id, BrickFace::kPlusZ),
                       T_camera_brick * tagPose(catalogue().typeOf(id), BrickFace::kPlusZ)});
  }
  return markers;
}

std::vector<int> idsOf(const std::vector<TrackedBrick>& bricks) {
  std::vector<int> ids;
  for (const TrackedBrick& brick : bricks) ids.push_back(brick.id);
  return ids;
}

bool isInside(const Eigen::Vector3d& p_map, const Eigen::Isometry3d& T_map_brick) {
  const Eigen::Vector3d p = T_map_brick.inverse() * p_map;
  return (p.cwiseAbs().array() <= 0.5 * catalogue().types.front().size_m.array()).all();
}

/// What a map would say of which only this is known.
std::vector<SpaceState> answers(const BrickDetector::MapQuestion& question,
                                const std::function<SpaceState(const Eigen::Vector3d&)>& state) {
  std::vector<SpaceState> states;
  for (Eigen::Index i = 0; i < question.points_map.cols(); ++i) states.push_back(state(question.points_map.col(i)));
  return states;
}

TEST(BrickDetector, FindsRenderedBricksInTheMap) {
  BrickDetector detector(catalogue(), BrickDetectionConfig());
  EXPECT_TRUE(detector.decodesImages());
  RenderScene scene;
  scene.camera.width_px = 480;
  scene.camera.height_px = 360;
  scene.camera.fx_px = scene.camera.fy_px = 400.0;
  scene.camera.cx_px = 239.5;
  scene.camera.cy_px = 179.5;
  const Eigen::Isometry3d T_map_brick = standing(0.0, 0.0, 0.1, 0.4);
  scene.bricks = {catalogueBrick(catalogue(), 12, cameraPose().inverse() * T_map_brick)};
  const RenderedView view = render(scene, RenderEffects(), 1);
  double stamp_s = 10.0;
  for (const cv::Mat& image : {view.color, view.grey}) {
    const BrickDetector::Look look = detector.look(image, view.depth_m, scene.camera, cameraPose(), stamp_s++);
    ASSERT_THAT(look.found.bricks, SizeIs(1));
    ASSERT_THAT(look.seen, SizeIs(1));
    EXPECT_EQ(look.seen[0], std::optional<std::size_t>(0));
    EXPECT_TRUE(look.has_depth);
    EXPECT_GT(look.detect_ms, 0.0);
    EXPECT_GT(look.pose_ms, 0.0);
  }
  ASSERT_THAT(idsOf(detector.bricks()), ElementsAre(12));
  EXPECT_EQ(detector.bricks()[0].num_looks, 2);
  // Neither blur nor noise: the corners are good to 0.05 px, 0.1 mm; depth is exact.
  EXPECT_LT((detector.bricks()[0].T_map_brick.translation() - T_map_brick.translation()).norm(), 0.002);
  EXPECT_FALSE(detector.look(view.grey, cv::Mat(), scene.camera, cameraPose(), stamp_s).has_depth);
}

TEST(BrickDetector, RefusesWhatIsNoImageAndKeepsWhatItKnows) {
  BrickDetector detector(catalogue(), BrickDetectionConfig());
  detector.addMarkers(markersOf({{3, standing(0.0, 0.0, 0.1, 0.0)}}), cameraPose(), 1.0);
  CameraModel camera;
  camera.width_px = 64;
  camera.height_px = 48;
  camera.fx_px = camera.fy_px = 50.0;
  camera.cx_px = 32.0;
  camera.cy_px = 24.0;
  EXPECT_THROW(detector.look(cv::Mat(), cv::Mat(), camera, cameraPose(), 2.0), std::invalid_argument);
  EXPECT_THROW(detector.look(cv::Mat(48, 64, CV_16UC1), cv::Mat(), camera, cameraPose(), 2.0), std::invalid_argument);
  EXPECT_THROW(
      detector.look(cv::Mat::zeros(48, 64, CV_8UC1), cv::Mat::zeros(20, 20, CV_32FC1), camera, cameraPose(), 2.0),
      std::invalid_argument);
  EXPECT_THAT(idsOf(detector.bricks()), ElementsAre(3));
}

TEST(BrickDetector, LeavesAlvarsTagsToAnother) {
  BrickDetector detector(alvarCatalogue(), BrickDetectionConfig());
  EXPECT_FALSE(detector.decodesImages());
  EXPECT_THROW(detector.look(cv::Mat::zeros(48, 64, CV_8UC1), cv::Mat(), CameraModel(), cameraPose(), 1.0),
               std::invalid_argument);
  const auto look = detector.addMarkers(markersOf({{3, standing(0.0, 0.0, 0.1, 0.0)}}), cameraPose(), 1.0);
  EXPECT_THAT(look.seen, SizeIs(1));
  EXPECT_THAT(idsOf(detector.bricks()), ElementsAre(3));
}

TEST(BrickDetector, AsksAboutTheInsideOfBricksAndTheWaysToThem) {
  BrickDetector detector(catalogue(), BrickDetectionConfig());
  EXPECT_EQ(detector.mapQuestion().points_map.cols(), 0);
  const Eigen::Isometry3d T_one = standing(0.0, 0.3, 0.1, 0.0);
  const Eigen::Isometry3d T_other = standing(0.0, -0.3, 0.1, 0.5);
  detector.addMarkers(markersOf({{3, T_one}, {4, T_other}}), cameraPose(), 1.0);
  const BrickDetector::MapQuestion question = detector.mapQuestion();
  int inside_one = 0;
  int inside_other = 0;
  int above = 0;
  for (Eigen::Index i = 0; i < question.points_map.cols(); ++i) {
    const Eigen::Vector3d p = question.points_map.col(i);
    inside_one += isInside(p, T_one) ? 1 : 0;
    inside_other += isInside(p, T_other) ? 1 : 0;
    above += p.z() > 0.2 ? 1 : 0;
  }
  const int samples = BrickDetectionConfig().tracker.inside_samples;
  EXPECT_EQ(inside_one, samples * samples * samples);
  EXPECT_EQ(inside_other, samples * samples * samples);
  EXPECT_GT(above, 2 * 9);  // the ways from above, at least
}

TEST(BrickDetector, DropsABrickWhosePlaceIsFreeAndNoOther) {
  BrickDetector detector(catalogue(), BrickDetectionConfig());
  const Eigen::Isometry3d T_gone = standing(0.0, 0.3, 0.1, 0.0);
  detector.addMarkers(markersOf({{3, T_gone}, {4, standing(0.0, -0.3, 0.1, 0.5)}}), cameraPose(), 1.0);
  const BrickDetector::MapQuestion question = detector.mapQuestion();
  const auto states = answers(question, [&](const Eigen::Vector3d& p) {
    return isInside(p, T_gone) ? SpaceState::kFree : SpaceState::kOccupied;
  });
  EXPECT_THAT(detector.takeMapAnswer(question, states, 0.5), IsEmpty());  // the map's last image is older than the look
  EXPECT_THAT(detector.takeMapAnswer(question, states, 2.0), ElementsAre(3));
  EXPECT_THAT(idsOf(detector.bricks()), ElementsAre(4));
  EXPECT_THAT(detector.takeMapAnswer(question, states, 3.0), IsEmpty());
}

TEST(BrickDetector, AnAnswerSaysNothingOfABrickThatCameMeanwhile) {
  BrickDetector detector(catalogue(), BrickDetectionConfig());
  detector.addMarkers(markersOf({{3, standing(0.0, 0.3, 0.1, 0.0)}}), cameraPose(), 1.0);
  const BrickDetector::MapQuestion question = detector.mapQuestion();
  detector.addMarkers(markersOf({{2, standing(0.0, -0.3, 0.1, 0.0)}}), cameraPose(), 2.0);
  const auto all_free = answers(question, [](const Eigen::Vector3d&) { return SpaceState::kFree; });
  EXPECT_THAT(detector.takeMapAnswer(question, all_free, 3.0), ElementsAre(3));
  EXPECT_THAT(idsOf(detector.bricks()), ElementsAre(2));
}

TEST(BrickDetector, RefusesAnAnswerOfAnotherSize) {
  BrickDetector detector(catalogue(), BrickDetectionConfig());
  detector.addMarkers(markersOf({{3, standing(0.0, 0.3, 0.1, 0.0)}}), cameraPose(), 1.0);
  EXPECT_THROW(detector.takeMapAnswer(detector.mapQuestion(), {SpaceState::kFree}, 2.0), std::invalid_argument);
}

TEST(BrickDetector, FacesAreRankedByTheMapsAnswer) {
  BrickDetector detector(catalogue(), BrickDetectionConfig());
  const Eigen::Isometry3d T_map_brick = standing(0.0, 0.0, 0.1, 0.0);
  detector.addMarkers(markersOf({{3, T_map_brick}}), cameraPose(), 1.0);
  // Nobody has asked: all is unknown, and from above is easiest.
  std::vector<FaceAccess> faces = detector.graspableFaces(0);
  ASSERT_FALSE(faces.empty());
  EXPECT_EQ(faces.front().face, BrickFace::kPlusZ);
  EXPECT_EQ(faces.front().unknown_share, 1.0);

  // Something stands over it and behind it; it is free before its -x face and unknown at its sides.
  const BrickDetector::MapQuestion question = detector.mapQuestion();
  const auto states = answers(question, [&](const Eigen::Vector3d& p) {
    if (isInside(p, T_map_brick) || p.z() > 0.2 || p.x() > 0.15) return SpaceState::kOccupied;
    return p.x() < -0.15 ? SpaceState::kFree : SpaceState::kUnknown;
  });
  EXPECT_THAT(detector.takeMapAnswer(question, states, 2.0), IsEmpty());
  faces = detector.graspableFaces(0);
  ASSERT_THAT(faces, SizeIs(1));
  EXPECT_EQ(faces[0].face, BrickFace::kMinusX);
  EXPECT_EQ(faces[0].free_share, 1.0);

  // The map is gone: all is unknown again until it answers anew.
  detector.forgetMap();
  faces = detector.graspableFaces(0);
  ASSERT_FALSE(faces.empty());
  EXPECT_EQ(faces.front().face, BrickFace::kPlusZ);
  EXPECT_EQ(faces.front().unknown_share, 1.0);
  EXPECT_THAT(detector.takeMapAnswer(question, states, 2.5), IsEmpty());

  // A neighbour that was found since stands there, whatever the map said.
  detector.addMarkers(markersOf({{3, T_map_brick}, {4, standing(-0.35, 0.0, 0.1, 0.0)}}), cameraPose(), 3.0);
  EXPECT_THAT(detector.graspableFaces(0), IsEmpty());
  detector.clear();
  EXPECT_THAT(detector.bricks(), IsEmpty());
}

TEST(BrickDetectionConfig, NamesEveryProblemWithItsSection) {
  BrickDetectionConfig config;
  config.access.min_clear = 2.0;
  config.alvar.position_std_m = 0.0;
  config.pose.corner_std_px = -1.0;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              testing::UnorderedElementsAre(HasSubstr("pose/corner_std_px"), HasSubstr("alvar/position_std_m"),
                                            HasSubstr("access/min_clear")));
  EXPECT_THROW(BrickDetector(catalogue(), config), std::invalid_argument);
}

}  // namespace
}  // namespace brick_detection
