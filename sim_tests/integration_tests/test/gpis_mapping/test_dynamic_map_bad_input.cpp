// SPDX-License-Identifier: BSD-3-Clause
// What cannot be used is refused and harms nothing; where nothing is known, nothing is answered.
#include <functional>
#include <stdexcept>

#include <gtest/gtest.h>

#include "support/map_on_scene.h"

namespace synthetic_depth {
namespace test {
namespace {

Scene boxScene() {
  Scene scene = makeLooks({{1.1, 0.3, 0.8}, {1.1, -0.3, 0.8}, {1.0, 0.0, 0.9}}, {0.0, 0.0, 0.1});
  scene.boxes = {makeBox(0, {0.0, 0.0, 0.1}, {0.1, 0.1, 0.1}, {0.0, 0.0, 0.3})};
  addAxialNoise(&scene);
  return scene;
}

bool areFinite(const std::vector<SurfacePoint>& points) {
  return std::all_of(points.begin(), points.end(), [](const SurfacePoint& p) {
    return p.position_map.allFinite() && p.normal_map.allFinite() && std::abs(p.normal_map.norm() - 1.0f) < 1e-3f &&
           std::isfinite(p.variance_m2) && p.variance_m2 > 0.0f && std::isfinite(p.normal_variance) &&
           p.normal_variance > 0.0f;
  });
}

TEST(DynamicMapBadInput, IsRefusedAndLeavesTheMapAsItWas) {
  const Scene scene = boxScene();
  const gpis_mapping::CameraModel camera = mapCamera(scene);
  const DepthImage image = toDepthImage(measureDepth(scene, 1));
  const Eigen::Isometry3d pose = scene.cameraInMap(1);
  const double stamp_s = scene.stampSeconds(1);
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 0);
  const std::vector<SurfacePoint> before = pointsOf(map);
  const std::shared_ptr<const MapSnapshot> snapshot = map.snapshot();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();

  struct Case {
    std::string name;
    std::function<void(DepthImage*, gpis_mapping::CameraModel*, Eigen::Isometry3d*, double*)> spoil;
  };
  using Camera = gpis_mapping::CameraModel;
  const std::vector<Case> cases = {
      {"image wider than camera", [](DepthImage* i, Camera*, auto*, double*) { i->width += 1; }},
      {"width and height swapped", [](DepthImage* i, Camera*, auto*, double*) { std::swap(i->width, i->height); }},
      {"a value missing", [](DepthImage* i, Camera*, auto*, double*) { i->depth_m.pop_back(); }},
      {"no values", [](DepthImage* i, Camera*, auto*, double*) { i->depth_m.clear(); }},
      {"camera of another size",
       [](DepthImage*, Camera* c, auto*, double*) {
         c->width = 640;
         c->height = 480;
       }},
      {"camera without width", [](DepthImage*, Camera* c, auto*, double*) { c->width = 0; }},
      {"negative height", [](DepthImage*, Camera* c, auto*, double*) { c->height = -240; }},
      {"zero focal length", [](DepthImage*, Camera* c, auto*, double*) { c->fx = 0.0; }},
      {"negative focal length", [](DepthImage*, Camera* c, auto*, double*) { c->fy = -262.5; }},
      {"NaN focal length", [nan](DepthImage*, Camera* c, auto*, double*) { c->fx = nan; }},
      {"infinite principal point", [infinity](DepthImage*, Camera* c, auto*, double*) { c->cx = infinity; }},
      {"NaN position", [nan](DepthImage*, Camera*, Eigen::Isometry3d* p, double*) { p->translation().y() = nan; }},
      {"infinite position",
       [infinity](DepthImage*, Camera*, Eigen::Isometry3d* p, double*) { p->translation().x() = infinity; }},
      {"NaN rotation", [nan](DepthImage*, Camera*, Eigen::Isometry3d* p, double*) { p->matrix()(1, 2) = nan; }},
      {"scaled rotation", [](DepthImage*, Camera*, Eigen::Isometry3d* p, double*) { p->linear() *= 1.01; }},
      {"mirror", [](DepthImage*, Camera*, Eigen::Isometry3d* p, double*) { p->linear().col(0) *= -1.0; }},
      {"zero rotation", [](DepthImage*, Camera*, Eigen::Isometry3d* p, double*) { p->linear().setZero(); }},
      {"camera of less than a pixel's focal length", [](DepthImage*, Camera* c, auto*, double*) { c->fx = 1e-300; }},
      {"camera of endless focal length", [](DepthImage*, Camera* c, auto*, double*) { c->fy = 1e300; }},
      {"principal point far away", [](DepthImage*, Camera* c, auto*, double*) { c->cy = -1e9; }},
      {"stamp beyond all calendars", [](DepthImage*, Camera*, auto*, double* t) { *t = -1e300; }},
      {"NaN stamp", [nan](DepthImage*, Camera*, auto*, double* t) { *t = nan; }},
      {"infinite stamp", [infinity](DepthImage*, Camera*, auto*, double* t) { *t = infinity; }},
  };
  for (const Case& bad : cases) {
    DepthImage bad_image = image;
    gpis_mapping::CameraModel bad_camera = camera;
    Eigen::Isometry3d bad_pose = pose;
    double bad_stamp_s = stamp_s;
    bad.spoil(&bad_image, &bad_camera, &bad_pose, &bad_stamp_s);
    EXPECT_THROW(map.update(bad_image, bad_camera, bad_pose, bad_stamp_s), std::invalid_argument) << bad.name;
    EXPECT_TRUE(areIdentical(before, pointsOf(map))) << bad.name;
    EXPECT_EQ(map.snapshot(), snapshot) << bad.name;
    EXPECT_EQ(map.contents().num_updates, 1u) << bad.name;
  }
  // And goes on as if nothing had been.
  GpisMap undisturbed(mapConfig(scene));
  feedFrames(&undisturbed, scene, 0, 2);
  feedFrames(&map, scene, 1, 2);
  EXPECT_TRUE(areIdentical(pointsOf(map), pointsOf(undisturbed)));
}

TEST(DynamicMapBadInput, LoadedNormalsThatClaimToBeExactStayUnitVectors) {
  const Scene scene = boxScene();
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 0);
  gpis_mapping::MapContents contents = map.contents();
  for (SurfacePoint& point : contents.points) point.normal_variance = 0.0f;
  GpisMap loaded(std::move(contents));
  feedFrames(&loaded, scene, 1, 2);
  for (const SurfacePoint& point : pointsOf(loaded)) ASSERT_NEAR(point.normal_map.norm(), 1.0f, 1e-3f);
}

TEST(DynamicMapBadInput, PointsThatCameTogetherBecomeOne) {
  // Two points of one face on one spot, and a third of another face, as years of looks may leave them.
  const Scene scene = boxScene();
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 2);
  gpis_mapping::MapContents contents = map.contents();
  const double half_spacing_m = 0.5 * contents.config.surface.spacing_m;
  const auto original = std::find_if(contents.points.begin(), contents.points.end(), [&](const SurfacePoint& p) {
    // On the box's top, well inside its cell, so that what is added belongs to that cell too.
    const auto& cells = contents.config.cells;
    const Eigen::Vector3d q = (p.position_map - cells.center(cells.at(p.position_map))) / cells.size_m;
    return p.position_map.z() > 0.19 && q.cwiseAbs().maxCoeff() < 0.3 && p.num_looks == 3;
  });
  ASSERT_NE(original, contents.points.end());
  const Eigen::Vector3d place = original->position_map;
  SurfacePoint beside = *original;
  beside.position_map += Eigen::Vector3d(0.6 * half_spacing_m, 0.0, 0.0);
  beside.num_looks = 1;
  SurfacePoint other_face = beside;
  other_face.normal_map = Eigen::Vector3f::UnitX();
  const std::size_t before = contents.points.size();
  contents.points.push_back(beside);
  contents.points.push_back(other_face);
  GpisMap crowded(std::move(contents));
  for (int look = 0; look < 8; ++look) feedFrames(&crowded, scene, 2, 2);  // in one of them it is the cell's turn
  std::size_t num_same_face = 0;
  for (const SurfacePoint& point : pointsOf(crowded)) {
    if ((point.position_map - place).norm() > half_spacing_m || point.normal_map.z() < 0.5f) continue;
    ++num_same_face;
    EXPECT_GE(point.num_looks, 3);  // the better known one stays
  }
  EXPECT_EQ(num_same_face, 1u);
  EXPECT_GT(pointsOf(crowded).size(), before - before / 20);  // and nothing else goes with it
}

TEST(DynamicMapBadInput, ConstantImagesNeverCrashOrProduceBadPoints) {
  const Scene scene = boxScene();
  for (const bool is_empty : {true, false}) {
    for (const float value : {kNaN, kInfinity, -kInfinity, 0.0f, -1.0f, 1e-30f, 1e30f, 0.25f, 2.0f}) {
      GpisMap map(mapConfig(scene));
      if (!is_empty) feedFrames(&map, scene, 0, 1);
      const std::vector<SurfacePoint> before = pointsOf(map);
      for (int look = 0; look < 2; ++look) feed(&map, scene, 2, constantImage(scene, value));
      const std::vector<SurfacePoint> after = pointsOf(map);
      EXPECT_TRUE(areFinite(after)) << value;
      const bool says_nothing = std::isnan(value) || value == -kInfinity || value == -1.0f || value == 1e-30f;
      if (says_nothing) {
        EXPECT_TRUE(areIdentical(before, after)) << value;
      }
      if (value == 0.0f) {  // holes of the sensor, from where it had measured little of this before
        EXPECT_GE(after.size() + before.size() / 50, before.size()) << value;
      }
      if (value == kInfinity || value == 1e30f) {  // nothing within reach: what is in view is gone
        EXPECT_LT(after.size(), before.size() / 4 + 1) << value;
      }
      EXPECT_EQ(map.snapshot()->numPoints(), after.size());
    }
  }
}

TEST(DynamicMapBadInput, RandomGarbageNeverCrashesOrProducesBadPoints) {
  const Scene scene = boxScene();
  GpisMap map(mapConfig(scene));
  SeededRandom random(71);
  const std::vector<float> odd = {kNaN, kInfinity, -kInfinity, 0.0f, -0.0f, -2.0f, 1e-38f, 1e-45f, 3e38f, 0.2499f};
  for (int frame = 0; frame < 12; ++frame) {
    DepthImage image = constantImage(scene, 0.0f);
    // Share of odd values from none to all, and runs of equal length as well as single pixels.
    const double share = frame / 11.0;
    const int run = frame % 3 == 0 ? 1 : 7 * frame;
    for (std::size_t i = 0; i < image.depth_m.size();) {
      const bool is_odd = random.uniform() < share;
      const float value = is_odd ? odd[random.next() % odd.size()] : static_cast<float>(random.uniform(0.1, 5.0));
      for (int k = 0; k < run && i < image.depth_m.size(); ++k, ++i) {
        image.depth_m[i] = is_odd ? value : value + static_cast<float>(0.002 * random.normal());
      }
    }
    ASSERT_NO_THROW(feed(&map, scene, frame % 3, image)) << "image " << frame;
    EXPECT_TRUE(areFinite(pointsOf(map))) << "image " << frame;
    const QueryResult answers =
        map.snapshot()->query(randomPointsInMap(scene, 72, 500, {-1.0, -1.0, -1.0}, {1.5, 1.0, 1.0}));
    for (Eigen::Index i = 0; i < answers.distance.size(); ++i) EXPECT_FALSE(std::isinf(answers.distance[i]));
    for (const Eigen::Vector3d& p : meshOf(*map.snapshot()).vertices_map) ASSERT_TRUE(p.allFinite());
  }
  // Looking at the real world again clears it away: what was invented in free space is seen past.
  feedFrames(&map, scene, 0, 2);
  feedFrames(&map, scene, 0, 2);
  const SceneDistance truth(scene, 2);
  std::size_t num_invented = 0;
  const std::vector<SurfacePoint> points = pointsOf(map);
  const DepthImage seen = toDepthImage(renderDepth(scene, 2));
  for (const SurfacePoint& point : points) {
    const Pixel pixel = project(scene, 2, point.position_map, 4.0);
    // In view, in front of everything within 4 px by more than 10 cm: no edge or tolerance can spare it.
    num_invented += pixel.inside && !anyPixelNear(seen, pixel, 4.0, [&](float z) { return z < pixel.z_m + 0.1f; });
  }
  EXPECT_EQ(num_invented, 0u);
}

TEST(DynamicMapBadInput, EmptyMapAnswersNothing) {
  const Scene scene = boxScene();
  const GpisMap map(mapConfig(scene));
  const Eigen::Matrix3Xd points = randomPointsInMap(scene, 73, 100, {-5.0, -5.0, -5.0}, {5.0, 5.0, 5.0});
  gpis_mapping::QueryOptions options;
  options.variance_gradient = true;
  const QueryResult answers = map.snapshot()->query(points, options);
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    EXPECT_TRUE(std::isnan(answers.distance[i]));
    EXPECT_TRUE(std::isnan(answers.variance[i]));
    EXPECT_TRUE(std::isnan(answers.euclidean_distance[i]));
    EXPECT_EQ(answers.state[static_cast<std::size_t>(i)], SpaceState::kUnknown);
  }
  EXPECT_EQ(map.snapshot()->numPoints(), 0u);
  EXPECT_TRUE(meshOf(*map.snapshot()).vertices_map.empty());
  EXPECT_EQ(map.snapshot()->query(Eigen::Matrix3Xd(3, 0)).distance.size(), 0);
}

TEST(DynamicMapBadInput, UnseenSpaceHasNoDistanceAndIsUnknown) {
  const Scene scene = boxScene();
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 2);
  const double reach_m = map.config().query.unknown_reach_m;
  std::vector<Eigen::Vector3d> places;
  for (const Eigen::Vector3d& p :
       {Eigen::Vector3d(8.0, 0.0, 1.0),                                              // behind the cameras
        Eigen::Vector3d(0.0, 0.0, -1.0),                                             // under the ground
        Eigen::Vector3d(0.0, 0.0, -reach_m - 0.05), Eigen::Vector3d(1.1, 0.0, 3.0),  // above them
        Eigen::Vector3d(-50.0, 20.0, 5.0)}) {
    places.push_back(scene.T_map_scene * p);
  }
  places.emplace_back(std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0);
  places.emplace_back(0.0, std::numeric_limits<double>::infinity(), 0.0);
  places.emplace_back(1e300, 0.0, 0.0);
  for (const Eigen::Vector3d& place : places) {
    const Answer answer = ask(*map.snapshot(), place);
    EXPECT_TRUE(std::isnan(answer.distance)) << place.transpose() << ": " << answer.distance;
    EXPECT_EQ(answer.state, SpaceState::kUnknown) << place.transpose();
  }
  // Where it has one, it has: a little above the ground before the box.
  EXPECT_NEAR(ask(*map.snapshot(), scene.T_map_scene * Eigen::Vector3d(0.3, 0.0, 0.03)).distance, 0.03, 0.005);
}

}  // namespace
}  // namespace test
}  // namespace synthetic_depth
