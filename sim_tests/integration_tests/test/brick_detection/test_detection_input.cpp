// SPDX-License-Identifier: BSD-3-Clause
// Node brick_detection on rendered images: what is found, what is refused and why, what ~detect answers.
#include <algorithm>
#include <cmath>
#include <future>
#include <limits>
#include <memory>

#include <interactive_mapping_msgs/AttachedBrick.h>
#include <std_srvs/Trigger.h>
#include <visualization_msgs/MarkerArray.h>

#include "brick_camera.h"

namespace integration_tests {
namespace {

using Parts = std::vector<std::string>;

const mp700_ur5e_description::BrickCatalogue& catalogue() {
  static const mp700_ur5e_description::BrickCatalogue kCatalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  return kCatalogue;
}

/// Bricks 3 and 7 side by side, seen from 0.9 m.
const std::vector<PlacedBrick>& twoBricks() {
  static const std::vector<PlacedBrick> kBricks = {{3, standing({0.0, 0.22, 0.1}, 0.3)},
                                                   {7, standing({0.05, -0.25, 0.1}, -0.5)}};
  return kBricks;
}

const Eigen::Isometry3d& cameraPose() {
  static const Eigen::Isometry3d kPose = lookingAt({-0.65, 0.1, 0.75}, {0.0, 0.0, 0.1});
  return kPose;
}

const brick_detection::RenderedView& viewOfTwo() {
  static const brick_detection::RenderedView kView =
      renderBricks(catalogue(), twoBricks(), smallCamera(), cameraPose());
  return kView;
}

BrickFrame frameOfTwo() {
  return toFrame(viewOfTwo(), smallCamera(), cameraPose());
}

BrickCamera& camera(const std::string& node) {
  static std::map<std::string, std::unique_ptr<BrickCamera>> cameras;
  std::unique_ptr<BrickCamera>& of_node = cameras[node];
  if (!of_node) {
    of_node = std::make_unique<BrickCamera>(node);
    // A node that looks on call only says nothing about a probe.
    EXPECT_TRUE(node == "/on_call" ? of_node->isThere() : of_node->connect()) << node;
  }
  return *of_node;
}

void clear(BrickCamera* live) {
  std_srvs::Trigger trigger;
  ASSERT_TRUE(call(live->node() + "/clear", trigger));
  ASSERT_TRUE(trigger.response.success);
}

/// A node that has nothing against good images, and no bricks.
BrickCamera& fresh(const std::string& node) {
  BrickCamera& live = camera(node);
  const DetectionUpdate update = live.lookUntil(frameOfTwo(), DetectionUpdate::ACCEPTED);
  EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::ACCEPTED) << update.message;
  clear(&live);
  return live;
}

void expectRefused(const DetectionUpdate& update, int status, const Parts& parts) {
  EXPECT_EQ(static_cast<int>(update.status), status) << update.message;
  for (const std::string& part : parts) EXPECT_PRED2(has, update.message, part);
  EXPECT_TRUE(update.bricks_seen.empty());
}

void expectSeesBoth(const DetectionUpdate& update, const std::string& what) {
  EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::ACCEPTED) << what << ": " << update.message;
  EXPECT_EQ(update.bricks_seen, (std::vector<std::int32_t>{3, 7})) << what;
}

/// Rendered with half a pixel of blur and 2 grey levels of noise, depth exact: corners within 0.1 px make 1 mm across at
/// 0.9 m with f = 400 px, depth holds the range. Five times that.
void expectAt(const Brick& brick, const Eigen::Isometry3d& T_map_brick) {
  const Eigen::Isometry3d T = toIsometry(brick.pose.pose);
  EXPECT_LT((T.translation() - T_map_brick.translation()).norm(), 0.005) << "brick " << brick.id;
  EXPECT_LT(angleBetween(T, T_map_brick), 0.017) << "brick " << brick.id;
}

/// A call of ~detect that waits in a thread of its own.
std::future<DetectBricks::Response> detectLater(const std::string& node, double timeout_s) {
  return std::async(std::launch::async, [node, timeout_s] {
    DetectBricks service;
    service.request.timeout = ros::Duration(timeout_s);
    EXPECT_TRUE(call(node + "/detect", service));
    return service.response;
  });
}

bool isReady(const std::future<DetectBricks::Response>& answer) {
  return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
}

TEST(DetectionInput, BricksAreWhereTheyAre) {
  BrickCamera& live = fresh("/patient");
  const DetectionUpdate update = live.look(frameOfTwo());
  expectSeesBoth(update, "rgb8");
  EXPECT_TRUE(update.has_depth);
  EXPECT_EQ(update.message, "");
  EXPECT_EQ(update.header.frame_id, "map");
  EXPECT_GT(update.total_ms, 0.0F);
  EXPECT_NEAR(update.total_ms, update.detect_ms + update.pose_ms + update.track_ms, 1e-3);
  for (const auto& tag : update.tags) EXPECT_EQ(tag.status, interactive_mapping_msgs::TagSighting::USED) << tag.id;

  const BrickArray bricks = live.bricks.awaitStamp(update.header.stamp);
  ASSERT_EQ(bricks.bricks.size(), 2u);
  EXPECT_EQ(bricks.header.frame_id, "map");
  for (std::size_t i = 0; i < 2; ++i) {
    const Brick& brick = bricks.bricks[i];
    EXPECT_EQ(brick.id, twoBricks()[i].id);
    expectAt(brick, twoBricks()[i].T_map_brick);
    EXPECT_FALSE(brick.has_duplicate);
    EXPECT_EQ(brick.type, "brick");
    EXPECT_DOUBLE_EQ(brick.size.x, 0.3);
    EXPECT_GT(brick.pose.covariance[0], 0.0);
    EXPECT_FALSE(brick.faces_seen.empty());
    // No map: the neighbour and the way up rank the faces. The top comes first, and nothing comes from below.
    ASSERT_FALSE(brick.graspable_faces.empty());
    EXPECT_EQ(brick.graspable_faces.front().face, interactive_mapping_msgs::BrickFace::PLUS_Z);
    EXPECT_EQ(brick.graspable_faces.front().unknown_share, 1.0F);
    EXPECT_NEAR(brick.graspable_faces.front().pose.position.z, 0.2, 0.005);
    for (const auto& face : brick.graspable_faces) {
      EXPECT_NE(face.face, interactive_mapping_msgs::BrickFace::MINUS_Z);
    }
  }
}

TEST(DetectionInput, EveryEncodingOfAColourImageWillDo) {
  BrickCamera& live = fresh("/patient");
  for (const char* encoding : {"bgr8", "rgba8", "bgra8", "mono8"}) {
    BrickFrame frame = frameOfTwo();
    frame.color = toColorMessage(viewOfTwo().color, encoding);
    expectSeesBoth(live.look(frame), encoding);
  }
  // The grey image as a Bayer mosaic: every colour the same, half the resolution at most.
  BrickFrame frame = frameOfTwo();
  frame.color = toColorMessage(viewOfTwo().color, "mono8");
  frame.color.encoding = "bayer_rggb8";
  expectSeesBoth(live.look(frame), "bayer_rggb8");
}

TEST(DetectionInput, PicturesAndMarkersShowWhatIsFound) {
  BrickCamera& live = fresh("/patient");
  Latest<sensor_msgs::Image> picture("/patient/image");
  Latest<visualization_msgs::MarkerArray> markers("/patient/markers");
  // A publisher hears of its subscriber some time after that has asked.
  DetectionUpdate update;
  for (int i = 0; i < 100 && !picture.hasCome(); ++i) {
    update = live.look(frameOfTwo());
    waitUntil([&] { return picture.hasCome(); }, 0.1);
  }
  const sensor_msgs::Image& image = picture.awaitStamp(update.header.stamp);
  EXPECT_EQ(image.encoding, "bgr8");
  EXPECT_EQ(image.width, frameOfTwo().color.width);
  const auto count = [](const visualization_msgs::MarkerArray& array, const std::string& ns, int action) {
    return std::count_if(array.markers.begin(), array.markers.end(), [&](const visualization_msgs::Marker& marker) {
      return marker.ns == ns && marker.action == action;
    });
  };
  const visualization_msgs::MarkerArray shown = markers.await([&](const visualization_msgs::MarkerArray& array) {
    return count(array, "bricks", visualization_msgs::Marker::ADD) == 2;
  });
  EXPECT_EQ(count(shown, "ids", visualization_msgs::Marker::ADD), 2);
  EXPECT_EQ(count(shown, "uncertainty", visualization_msgs::Marker::ADD), 2);
  EXPECT_GT(count(shown, "faces", visualization_msgs::Marker::ADD), 2);
  clear(&live);
  markers.await([&](const visualization_msgs::MarkerArray& array) {
    return count(array, "bricks", visualization_msgs::Marker::DELETE) == 2 &&
           count(array, "bricks", visualization_msgs::Marker::ADD) == 0;
  });
}

TEST(DetectionInput, TwoBricksWithOneIdAreBothReported) {
  BrickCamera& live = fresh("/patient");
  const std::vector<PlacedBrick> bricks = {{5, standing({0.0, 0.22, 0.1}, 0.3)},
                                           {5, standing({0.05, -0.25, 0.1}, -0.5)}};
  const BrickFrame frame =
      toFrame(renderBricks(catalogue(), bricks, smallCamera(), cameraPose()), smallCamera(), cameraPose());
  DetectionUpdate update;
  for (int i = 0; i < 2; ++i) {
    update = live.look(frame);
    EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::ACCEPTED) << update.message;
    EXPECT_EQ(update.bricks_seen, (std::vector<std::int32_t>{5, 5}));
  }
  const BrickArray known = live.bricks.awaitStamp(update.header.stamp);
  ASSERT_EQ(known.bricks.size(), 2u);
  EXPECT_NE(known.bricks[0].instance, known.bricks[1].instance);
  for (const Brick& brick : known.bricks) {
    EXPECT_EQ(brick.id, 5);
    EXPECT_TRUE(brick.has_duplicate);
    const bool is_first = brick.pose.pose.position.y > 0.0;
    expectAt(brick, bricks[is_first ? 0 : 1].T_map_brick);
  }
  EXPECT_LT(known.bricks[0].pose.pose.position.y * known.bricks[1].pose.pose.position.y, 0.0);  // one is each of them
  EXPECT_TRUE(waitUntil([&] { return live.diagnosticValue("bricks", "ids carried by several") == "5"; }));
  EXPECT_EQ(live.diagnostic("bricks").level, diagnostic_msgs::DiagnosticStatus::WARN);
}

TEST(DetectionInput, ImagesOfAnotherKindAreRefused) {
  BrickCamera& live = fresh("/patient");
  BrickFrame frame = frameOfTwo();
  frame.color.encoding = "16UC1";
  expectRefused(live.look(frame), DetectionUpdate::WRONG_ENCODING, {"encoding is '16UC1'", "rgb8"});

  frame = frameOfTwo();
  frame.color.data.resize(frame.color.data.size() / 2);
  expectRefused(live.look(frame), DetectionUpdate::MALFORMED_IMAGE, {"too few", "480 x 360 px"});
  frame = frameOfTwo();
  frame.color.step = 100;
  expectRefused(live.look(frame), DetectionUpdate::MALFORMED_IMAGE, {"step 100"});
  frame = frameOfTwo();
  frame.color.width = frame.color.height = 0;
  frame.color.data.clear();
  expectRefused(live.look(frame), DetectionUpdate::MALFORMED_IMAGE, {"size is 0 x 0 px"});
  frame = frameOfTwo();
  frame.color.width = 0xFFFFFFFF;
  frame.color.height = 0xFFFFFFFF;
  expectRefused(live.look(frame), DetectionUpdate::MALFORMED_IMAGE, {"size is 4294967295"});
  frame = frameOfTwo();
  frame.color.header.frame_id = "";
  expectRefused(live.look(frame), DetectionUpdate::MALFORMED_IMAGE, {"frame_id is empty"});
  frame.color.header.frame_id = "map";
  expectRefused(live.look(frame), DetectionUpdate::MALFORMED_IMAGE, {"is the map's frame"});

  expectSeesBoth(live.look(frameOfTwo()), "after all that");
  EXPECT_TRUE(waitUntil([&] {
    return live.diagnosticValue("input", "last left out") ==
           "malformed image: " + live.updates[live.updates.size() - 2].message;
  }));
}

TEST(DetectionInput, CameraInfoMustFit) {
  BrickCamera& live = fresh("/patient");
  BrickFrame frame = frameOfTwo();
  frame.info.width = 640;
  frame.info.height = 480;
  expectRefused(live.lookUntil(frame, DetectionUpdate::SIZE_MISMATCH), DetectionUpdate::SIZE_MISMATCH,
                {"image is 480 x 360 px", "says 640 x 480 px", "/patient_in/color/camera_info"});
  // The same image from a camera of twice the size that bins.
  frame = frameOfTwo();
  frame.info.binning_x = frame.info.binning_y = 2;
  frame.info.width *= 2;
  frame.info.height *= 2;
  for (const std::size_t k : {0U, 4U}) frame.info.K[k] *= 2.0;
  for (const std::size_t k : {2U, 5U}) frame.info.K[k] = 2.0 * frame.info.K[k] + 0.5;
  expectSeesBoth(live.lookUntil(frame, DetectionUpdate::ACCEPTED), "binned");
  frame.info.binning_x = frame.info.binning_y = 4;
  expectRefused(live.lookUntil(frame, DetectionUpdate::SIZE_MISMATCH), DetectionUpdate::SIZE_MISMATCH,
                {"image is 480 x 360 px", "says 240 x 180 px, by its ROI and binning of 960 x 720 px"});
  frame = frameOfTwo();
  frame.info.K[0] = 0.0;
  expectRefused(live.lookUntil(frame, DetectionUpdate::BAD_CAMERA_INFO), DetectionUpdate::BAD_CAMERA_INFO,
                {"camera info: "});
  frame.info = frameOfTwo().info;
  frame.info.K[2] = std::numeric_limits<double>::quiet_NaN();
  expectSeesBoth(live.lookUntil(frameOfTwo(), DetectionUpdate::ACCEPTED), "between");
  expectRefused(live.lookUntil(frame, DetectionUpdate::BAD_CAMERA_INFO), DetectionUpdate::BAD_CAMERA_INFO,
                {"camera info: "});
  frame.info = frameOfTwo().info;
  frame.info.distortion_model = "fancy";
  expectSeesBoth(live.lookUntil(frameOfTwo(), DetectionUpdate::ACCEPTED), "between");
  expectRefused(live.lookUntil(frame, DetectionUpdate::BAD_CAMERA_INFO), DetectionUpdate::BAD_CAMERA_INFO,
                {"distortion_model is 'fancy'", "plumb_bob"});
  expectSeesBoth(live.lookUntil(frameOfTwo(), DetectionUpdate::ACCEPTED), "after all that");
}

TEST(DetectionInput, DepthMustBeRegisteredToTheColourImage) {
  BrickCamera& live = fresh("/patient");
  BrickFrame frame = frameOfTwo();
  frame.depth = toImageMessage(cv::Mat(240, 320, CV_32FC1, cv::Scalar(1.0)), "32FC1");
  expectRefused(live.look(frame), DetectionUpdate::SIZE_MISMATCH,
                {"320 x 240 px", "480 x 360 px", "registers to the colour image"});
  frame = frameOfTwo();
  frame.depth.header.frame_id = "camera_depth_optical_frame";
  const DetectionUpdate update = live.look(frame);
  EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::ACCEPTED) << update.message;
  EXPECT_FALSE(update.has_depth);
  EXPECT_PRED2(has, update.message, "'camera_depth_optical_frame'");
  EXPECT_PRED2(has, update.message, "registers to the colour image");
  // Registered, and under a name of the driver's own: tf has it at the colour camera's place.
  tf2_msgs::TFMessage edge;
  edge.transforms.resize(1);
  edge.transforms[0].header.frame_id = kCameraFrame;
  edge.transforms[0].child_frame_id = "camera_aligned_depth_to_color_frame";
  edge.transforms[0].transform.rotation.x = edge.transforms[0].transform.rotation.y = 0.5;
  edge.transforms[0].transform.rotation.z = edge.transforms[0].transform.rotation.w = 0.5;
  frame.depth.header.frame_id = edge.transforms[0].child_frame_id;
  DetectionUpdate with_depth;
  for (int i = 0; i < 200 && !with_depth.has_depth; ++i) {  // tf comes by a connection of its own
    edge.transforms[0].header.stamp = live.nextStamp();
    live.publish(edge);
    with_depth = live.look(frame);
  }
  EXPECT_TRUE(with_depth.has_depth) << with_depth.message;
  expectSeesBoth(live.look(frameOfTwo()), "after all that");
}

TEST(DetectionInput, DepthThatSaysNothingIsDoneWithout) {
  BrickCamera& live = fresh("/patient");
  BrickFrame frame = frameOfTwo();
  frame.depth =
      toImageMessage(cv::Mat(360, 480, CV_32FC1, cv::Scalar(std::numeric_limits<float>::quiet_NaN())), "32FC1");
  DetectionUpdate update = live.look(frame);
  EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::ACCEPTED) << update.message;
  EXPECT_FALSE(update.has_depth);
  EXPECT_PRED2(has, update.message, "without depth: no pixel of the depth image holds one");
  frame.depth.encoding = "rgb8";
  update = live.look(frame);
  EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::ACCEPTED) << update.message;
  EXPECT_FALSE(update.has_depth);
  EXPECT_PRED2(has, update.message, "without depth: encoding is 'rgb8'");
  EXPECT_TRUE(live.look(frameOfTwo()).has_depth);
}

// As with wrong units: the depth denies every tag, and somebody must be told.
TEST(DetectionInput, DepthThatDeniesEveryTagIsTold) {
  BrickCamera& live = fresh("/patient");
  BrickFrame frame = frameOfTwo();
  frame.depth = toImageMessage(cv::Mat(360, 480, CV_32FC1, cv::Scalar(0.2)), "32FC1");
  const DetectionUpdate update = live.look(frame);
  EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::ACCEPTED) << update.message;
  EXPECT_TRUE(update.bricks_seen.empty());
  EXPECT_PRED2(has, update.message, "contradict the depth image: is it registered");
  EXPECT_TRUE(live.look(frameOfTwo()).message.empty());
}

TEST(DetectionInput, DepthBelongsToTheNearestStamp) {
  BrickCamera& live = fresh("/patient");
  // An unusable one at the moment of the image would be told of: the one 5 ms beside it is not at that moment.
  BrickFrame frame = frameOfTwo();
  const cv::Mat nothing(360, 480, CV_32FC1, cv::Scalar(0.0));
  frame.setStamp(live.nextStamp());
  const ros::Time stamp = frame.color.header.stamp;
  sensor_msgs::Image far = toImageMessage(nothing, "32FC1");
  far.header.stamp = stamp - ros::Duration(0.019);
  live.publishDepth(far);
  frame.depth.header.stamp = stamp + ros::Duration(0.005);
  DetectionUpdate update = live.lookAsIs(frame);
  expectSeesBoth(update, "5 ms beside");
  EXPECT_TRUE(update.has_depth) << update.message;

  frame.setStamp(live.nextStamp() + ros::Duration(0.1));
  frame.depth.header.stamp = frame.color.header.stamp + ros::Duration(0.03);
  update = live.lookAsIs(frame);
  EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::ACCEPTED) << update.message;
  EXPECT_FALSE(update.has_depth);
  EXPECT_PRED2(has, update.message, "the nearest is off by 0.030 s");
}

TEST(DetectionInput, DepthThatDoesNotComeIsNotWaitedForLong) {
  BrickCamera& live = fresh("/hasty");
  BrickFrame frame = frameOfTwo();
  frame.depth.data.clear();
  // So much later that the depth of the look before does not belong to it.
  frame.setStamp(live.nextStamp() + ros::Duration(0.1));
  const DetectionUpdate update = live.lookAsIs(frame);
  EXPECT_EQ(static_cast<int>(update.status), DetectionUpdate::ACCEPTED) << update.message;
  EXPECT_FALSE(update.has_depth);
  EXPECT_PRED2(has, update.message, "without depth: ");
  EXPECT_GE(update.wait_ms, 50.0F);  // its depth_timeout_s
  EXPECT_TRUE(waitUntil([&] { return std::atol(live.diagnosticValue("input", "without depth").c_str()) > 0; }));
  EXPECT_PRED2(has, live.diagnosticValue("input", "last without depth"), "without depth");
}

TEST(DetectionInput, WithoutTransformThereIsNoLook) {
  BrickCamera& live = fresh("/hasty");
  BrickFrame frame = frameOfTwo();
  frame.color.header.frame_id = frame.depth.header.frame_id = frame.info.header.frame_id = "eye_on_the_moon";
  expectRefused(live.lookUntil(frame, DetectionUpdate::NO_TRANSFORM), DetectionUpdate::NO_TRANSFORM,
                {"'eye_on_the_moon'", "'map'", "tf_timeout_s"});
  // Half a turn, which no camera makes between two images.
  frame = frameOfTwo();
  frame.transform = toTransformMessage(cameraPose() * Eigen::AngleAxisd(3.0, Eigen::Vector3d::UnitZ()));
  expectSeesBoth(live.lookUntil(frameOfTwo(), DetectionUpdate::ACCEPTED), "between");
  expectRefused(live.look(frame), DetectionUpdate::POSE_JUMP, {"rad"});
  expectSeesBoth(live.lookUntil(frameOfTwo(), DetectionUpdate::ACCEPTED), "after all that");
}

TEST(DetectionInput, StampsMustRiseAndBeOfNow) {
  BrickCamera& live = fresh("/patient");
  BrickFrame frame = frameOfTwo();
  frame.setStamp(ros::Time());
  expectRefused(live.lookAsIs(frame), DetectionUpdate::MALFORMED_IMAGE, {"stamp is 0"});
  frame.color.header.stamp = ros::Time::now() + ros::Duration(100.0);
  expectRefused(live.lookAsIs(frame), DetectionUpdate::STAMP_IN_FUTURE, {"ahead of ROS time", "max_future_s"});
  const ros::Time now = live.nextStamp();
  frame.setStamp(now);
  expectSeesBoth(live.lookAsIs(frame), "now");
  frame.setStamp(now - ros::Duration(0.1));
  expectRefused(live.lookAsIs(frame), DetectionUpdate::TIME_RAN_BACK, {"0.100 s before the last one"});
  EXPECT_EQ(live.bricks.awaitStamp(now).bricks.size(), 2u);

  // By a lot: what is known is of a time that is yet to come.
  frame.setStamp(now - ros::Duration(1000.0));
  expectRefused(live.lookAsIs(frame), DetectionUpdate::TIME_RAN_BACK, {"looped bag", "forgotten", "all bricks"});
  EXPECT_TRUE(live.bricks.awaitStamp(now - ros::Duration(1000.0)).bricks.empty());
  // A transform of the old time may come only now, by a connection of its own: that costs one image.
  ros::Time stamp = now - ros::Duration(999.9);
  frame.setStamp(stamp);
  DetectionUpdate update = live.lookAsIs(frame);
  if (update.status == DetectionUpdate::NO_TRANSFORM) {
    stamp += ros::Duration(0.1);
    frame.setStamp(stamp);
    update = live.lookAsIs(frame);
  }
  expectSeesBoth(update, "in the new time");
  EXPECT_EQ(live.bricks.awaitStamp(stamp).bricks.size(), 2u);
}

TEST(DetectionInput, ATransformOfTheOldTimeDoesNotLockTheNewOut) {
  BrickCamera& live = fresh("/hasty");
  BrickFrame frame = frameOfTwo();
  const ros::Time old = live.nextStamp();
  ros::Time stamp = old - ros::Duration(1000.0);
  frame.setStamp(stamp);
  expectRefused(live.lookAsIs(frame), DetectionUpdate::TIME_RAN_BACK, {"forgotten"});
  tf2_msgs::TFMessage late;
  late.transforms.push_back(frame.transform);
  late.transforms.front().header.stamp = old;
  live.publish(late);
  DetectionUpdate update;
  // It costs the first image; more only where this node's short patience ends before its transform is there.
  for (int i = 0; i < 20 && (i == 0 || update.status == DetectionUpdate::NO_TRANSFORM); ++i) {
    stamp += ros::Duration(0.1);
    frame.setStamp(stamp);
    update = live.lookAsIs(frame);
  }
  expectSeesBoth(update, "in the new time");
}

TEST(DetectionInput, ABrickInTheHandIsNotInTheWorld) {
  BrickCamera& live = fresh("/patient");
  ros::Publisher hand =
      ros::NodeHandle().advertise<interactive_mapping_msgs::AttachedBrick>("/patient_in/attached_brick", 1, true);
  expectSeesBoth(live.look(frameOfTwo()), "before");
  interactive_mapping_msgs::AttachedBrick attached;
  attached.header.frame_id = "map";
  attached.header.stamp = ros::Time::now();
  attached.is_attached = 1;
  attached.id = 7;
  hand.publish(attached);
  const BrickArray left = live.bricks.await([](const BrickArray& bricks) { return bricks.bricks.size() == 1; });
  EXPECT_EQ(left.bricks.front().id, 3);
  DetectionUpdate update = live.look(frameOfTwo());
  EXPECT_EQ(update.bricks_dropped, std::vector<std::int32_t>{7});
  EXPECT_EQ(live.bricks.awaitStamp(update.header.stamp).bricks.size(), 1u);
  EXPECT_TRUE(waitUntil([&] { return live.diagnosticValue("bricks", "in the hand") == "7"; }));

  // Of an id that no brick has: told in the log, and no reason to end.
  interactive_mapping_msgs::AttachedBrick unknown = attached;
  unknown.id = -5;
  hand.publish(unknown);
  attached.header.stamp = ros::Time::now();
  attached.is_attached = 0;
  hand.publish(attached);
  EXPECT_TRUE(waitUntil([&] { return live.diagnosticValue("bricks", "in the hand") == "none"; }));
  update = live.look(frameOfTwo());
  EXPECT_TRUE(update.bricks_dropped.empty());
  EXPECT_EQ(live.bricks.awaitStamp(update.header.stamp).bricks.size(), 2u);
}

TEST(DetectionService, AnswersWithAnImageOfAfterTheCall) {
  BrickCamera& live = fresh("/patient");
  const ros::Time called = ros::Time::now();
  std::future<DetectBricks::Response> first = detectLater("/patient", 20.0);
  std::future<DetectBricks::Response> second = detectLater("/patient", 20.0);
  // Exposed before the calls: says nothing to them. It would have to be kept from arriving later than they.
  BrickFrame before = frameOfTwo();
  before.setStamp(called - ros::Duration(0.001));
  EXPECT_EQ(static_cast<int>(live.lookAsIs(before).status), DetectionUpdate::ACCEPTED);
  EXPECT_FALSE(isReady(first));
  EXPECT_FALSE(isReady(second));
  while (!isReady(first) || !isReady(second)) live.look(frameOfTwo());
  for (std::future<DetectBricks::Response>* answer : {&first, &second}) {
    const DetectBricks::Response response = answer->get();
    EXPECT_EQ(static_cast<int>(response.status), DetectBricks::Response::OK) << response.message;
    EXPECT_TRUE(response.success);
    EXPECT_GT(response.update.header.stamp, called);
    EXPECT_EQ(response.bricks.header.stamp, response.update.header.stamp);
    ASSERT_EQ(response.bricks.bricks.size(), 2u);
    expectAt(response.bricks.bricks[0], twoBricks()[0].T_map_brick);
  }
}

TEST(DetectionService, TellsBricksOfThisLookFromThoseKnown) {
  BrickCamera& live = fresh("/patient");
  live.look(frameOfTwo());
  const BrickFrame one =
      toFrame(renderBricks(catalogue(), {twoBricks()[0]}, smallCamera(), cameraPose()), smallCamera(), cameraPose());
  std::future<DetectBricks::Response> answer = detectLater("/patient", 20.0);
  while (!isReady(answer)) live.look(one);
  const DetectBricks::Response response = answer.get();
  ASSERT_EQ(response.bricks.bricks.size(), 1u);
  EXPECT_EQ(response.bricks.bricks.front().id, 3);
  EXPECT_EQ(live.bricks.awaitStamp(live.updates.back().header.stamp).bricks.size(), 2u);  // no look shows it gone
}

TEST(DetectionService, SaysThatNoImageCame) {
  camera("/patient");
  const DetectBricks::Response response = detectLater("/patient", 0.2).get();
  EXPECT_EQ(static_cast<int>(response.status), DetectBricks::Response::NO_IMAGE);
  EXPECT_FALSE(response.success);
  EXPECT_PRED2(has, response.message, "/patient_in/color/image_raw");
  EXPECT_PRED2(has, response.message, "0.200 s");
}

TEST(DetectionService, SaysWhyImagesWereRefused) {
  BrickCamera& live = fresh("/patient");
  BrickFrame bad = frameOfTwo();
  bad.color.encoding = "16UC1";
  std::future<DetectBricks::Response> answer = detectLater("/patient", 0.5);
  while (!isReady(answer)) live.look(bad);
  const DetectBricks::Response response = answer.get();
  EXPECT_EQ(static_cast<int>(response.status), DetectBricks::Response::REFUSED);
  EXPECT_EQ(static_cast<int>(response.update.status), DetectionUpdate::WRONG_ENCODING);
  EXPECT_PRED2(has, response.message, "wrong encoding");
}

TEST(DetectionService, ImagesAreLookedAtOnCallOnly) {
  BrickCamera& live = camera("/on_call");
  const auto unwanted = [&] { return std::atol(live.diagnosticValue("input", "not asked for").c_str()); };
  BrickFrame frame = frameOfTwo();
  EXPECT_TRUE(waitUntil([&] {
    frame.setStamp(live.nextStamp());
    live.publish(frame);
    return unwanted() >= 3;
  }));
  EXPECT_TRUE(live.updates.empty());
  std::future<DetectBricks::Response> answer = detectLater("/on_call", 0.0);  // the node's own: 20 s
  EXPECT_TRUE(waitUntil([&] {
    frame.setStamp(live.nextStamp());
    live.publish(frame);
    return isReady(answer);
  }));
  const DetectBricks::Response response = answer.get();
  EXPECT_EQ(static_cast<int>(response.status), DetectBricks::Response::OK) << response.message;
  EXPECT_EQ(response.bricks.bricks.size(), 2u);
  EXPECT_FALSE(response.update.has_depth);
  ASSERT_TRUE(waitUntil([&] { return !live.updates.empty(); }));
  // Images that were under way when the call was answered may have been looked at, too; later ones must not be.
  const ros::Time answered = live.nextStamp();
  const long before = unwanted();
  EXPECT_TRUE(waitUntil([&] {
    frame.setStamp(live.nextStamp());
    live.publish(frame);
    return unwanted() >= before + 3;
  }));
  for (const DetectionUpdate& update : live.updates) EXPECT_LT(update.header.stamp, answered);
}

}  // namespace
}  // namespace integration_tests
