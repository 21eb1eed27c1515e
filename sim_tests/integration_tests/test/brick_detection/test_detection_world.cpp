// SPDX-License-Identifier: BSD-3-Clause
// Bricks of the simulated world, found while the robot drives up to them, against the truth; with the map in the loop.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <future>
#include <limits>
#include <map>
#include <optional>
#include <set>

#include <geometry_msgs/Twist.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/BrickArray.h>
#include <interactive_mapping_msgs/BrickDetectionUpdate.h>
#include <interactive_mapping_msgs/DetectBricks.h>
#include <mp700_ur5e_description/brick_types.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>
#include <visualization_msgs/MarkerArray.h>

#include "simulated_world/InjectFault.h"

namespace integration_tests {
namespace {

using node_tests::call;
using node_tests::waitUntil;

using interactive_mapping_msgs::Brick;
using interactive_mapping_msgs::BrickArray;
using interactive_mapping_msgs::BrickFace;
using interactive_mapping_msgs::DetectBricks;
using Update = interactive_mapping_msgs::BrickDetectionUpdate;
namespace description = mp700_ur5e_description;

constexpr double kDrive_s = 120.0;  // wall time for 25 images with map and physics on a busy machine

Eigen::Isometry3d toIsometry(const geometry_msgs::Pose& pose) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z)
                   .toRotationMatrix();
  T.translation() << pose.position.x, pose.position.y, pose.position.z;
  return T;
}

class DetectionWorld : public testing::Test {
 protected:
  static void SetUpTestSuite() { world_ = new World; }
  static void TearDownTestSuite() {
    delete world_;
    world_ = nullptr;
  }

  struct World {
    World() : listener(tf) {
      ros::NodeHandle nh;
      drive = nh.advertise<geometry_msgs::Twist>("cmd_vel", 1);
      subscribers.push_back(nh.subscribe<visualization_msgs::MarkerArray>(
          "/simulated_world/truth", 10, [this](const visualization_msgs::MarkerArray::ConstPtr& markers) {
            for (const visualization_msgs::Marker& marker : markers->markers) {
              if (marker.action == visualization_msgs::Marker::ADD) truth[marker.id] = toIsometry(marker.pose);
            }
          }));
      subscribers.push_back(nh.subscribe<Update>("/brick_detection/update", 100,
                                                 [this](const Update::ConstPtr& update) { onUpdate(*update); }));
      subscribers.push_back(nh.subscribe<BrickArray>("/brick_detection/bricks", 100,
                                                     [this](const BrickArray::ConstPtr& array) { bricks = *array; }));
      subscribers.push_back(
          nh.subscribe<sensor_msgs::Image>("/camera/aligned_depth_to_color/image_raw", 10,
                                           [this](const sensor_msgs::ImageConstPtr& image) { depth = image; }));
      subscribers.push_back(nh.subscribe<sensor_msgs::CameraInfo>(
          "/camera/color/camera_info", 10, [this](const sensor_msgs::CameraInfoConstPtr& message) { info = message; }));
    }

    void onUpdate(const Update& update) {
      updates.push_back(update);
      geometry_msgs::Twist twist;
      twist.linear.x = speed_m_s;
      drive.publish(twist);
    }

    tf2_ros::Buffer tf;
    tf2_ros::TransformListener listener;
    std::vector<ros::Subscriber> subscribers;
    ros::Publisher drive;
    double speed_m_s{0.0};
    std::map<int, Eigen::Isometry3d> truth;
    std::vector<Update> updates;
    BrickArray bricks;
    sensor_msgs::ImageConstPtr depth;
    sensor_msgs::CameraInfoConstPtr info;
  };

  static std::optional<Eigen::Isometry3d> poseOf(const std::string& frame, const ros::Time& stamp) {
    try {
      const auto transform = world_->tf.lookupTransform("map", frame, stamp).transform;
      geometry_msgs::Pose pose;
      pose.position.x = transform.translation.x;
      pose.position.y = transform.translation.y;
      pose.position.z = transform.translation.z;
      pose.orientation = transform.rotation;
      return toIsometry(pose);
    } catch (const tf2::TransformException&) {
      return std::nullopt;
    }
  }

  /// Waits for so many more accepted looks.
  static bool awaitLooks(int number) {
    const auto accepted = [] {
      return std::count_if(world_->updates.begin(), world_->updates.end(),
                           [](const Update& update) { return update.status == Update::ACCEPTED; });
    };
    const auto before = accepted();
    return waitUntil([&] { return accepted() >= before + number; }, kDrive_s);
  }

  /// Every brick that is reported is there. Acceptance: 1 cm and 2 degrees up to 1.5 m from the camera. Farther away
  /// a corner's pixel and the depth's noise are so much coarser, the latter with the square of the distance.
  static void expectAllTrue(const Eigen::Isometry3d& T_map_camera) {
    for (const Brick& brick : world_->bricks.bricks) {
      ASSERT_EQ(world_->truth.count(brick.id), 1u) << "brick " << brick.id;
      EXPECT_FALSE(brick.has_duplicate) << brick.id;
      const Eigen::Isometry3d& T_truth = world_->truth.at(brick.id);
      const Eigen::Isometry3d T_error = T_truth.inverse() * toIsometry(brick.pose.pose);
      const double distance_m = (T_truth.translation() - T_map_camera.translation()).norm();
      const double coarser = std::pow(std::max(1.0, distance_m / 1.5), 2);
      EXPECT_LT(T_error.translation().norm(), 0.010 * coarser) << "brick " << brick.id << " at " << distance_m << " m";
      EXPECT_LT(Eigen::AngleAxisd(T_error.linear()).angle(), coarser * 2.0 * M_PI / 180.0)
          << "brick " << brick.id << " at " << distance_m << " m";
    }
  }

  /// Bricks with a tag that is wholly in view, with every side of at least `min_side_px`: by the truth, and by the depth
  /// image for what hides it.
  static std::set<int> bricksInView(const Eigen::Isometry3d& T_map_camera, double min_side_px) {
    const Eigen::Isometry3d T_camera_map = T_map_camera.inverse();
    std::set<int> ids;
    for (const auto& [id, T_map_brick] : world_->truth) {
      for (const description::BrickFace face : description::kBrickFaces) {
        const Eigen::Isometry3d T_camera_tag =
            T_camera_map * T_map_brick * description::tagPose(catalogue_.typeOf(id), face);
        if (T_camera_tag.linear().col(2).dot(T_camera_tag.translation()) >= 0.0) continue;  // seen from behind
        const double half = 0.5 * catalogue_.tags.black_border_edge_m;
        std::vector<Eigen::Vector2d> corners;
        bool is_visible = true;
        for (const auto& [x, y] :
             {std::make_pair(-1, 1), std::make_pair(1, 1), std::make_pair(1, -1), std::make_pair(-1, -1)}) {
          const Eigen::Vector3d p = T_camera_tag * Eigen::Vector3d(half * x, half * y, 0.0);
          const Eigen::Vector2d pixel(world_->info->K[0] * p.x() / p.z() + world_->info->K[2],
                                      world_->info->K[4] * p.y() / p.z() + world_->info->K[5]);
          corners.push_back(pixel);
          const int u = static_cast<int>(std::lround(pixel.x()));
          const int v = static_cast<int>(std::lround(pixel.y()));
          // The white margin round the border belongs to the tag: 15 mm, 5 px at 1.5 m.
          constexpr int kMargin_px = 8;
          is_visible &= p.z() > 0.0 && u >= kMargin_px && v >= kMargin_px &&
                        u < static_cast<int>(world_->info->width) - kMargin_px &&
                        v < static_cast<int>(world_->info->height) - kMargin_px;
          if (!is_visible) break;
          std::uint16_t raw_mm = 0;
          std::memcpy(&raw_mm,
                      &world_->depth
                           ->data[static_cast<std::size_t>(v) * world_->depth->step + 2u * static_cast<std::size_t>(u)],
                      2);
          // Noise of the depth at 2 m is 15 mm; what hides a brick stands at least half a brick before it. A hole (0)
          // hides nothing, and says nothing: such a tag is not asked for.
          is_visible &= std::abs(0.001 * raw_mm - p.z()) < 0.06;
        }
        if (!is_visible) continue;
        double side_px = std::numeric_limits<double>::infinity();
        for (std::size_t i = 0; i < 4; ++i) side_px = std::min(side_px, (corners[(i + 1) % 4] - corners[i]).norm());
        if (side_px >= min_side_px) ids.insert(id);
      }
    }
    return ids;
  }

  static const description::BrickCatalogue catalogue_;
  static World* world_;
};
const description::BrickCatalogue DetectionWorld::catalogue_ = description::loadBrickTypes(BRICKS_YAML);
DetectionWorld::World* DetectionWorld::world_ = nullptr;

TEST_F(DetectionWorld, BricksAreWhereTheyAreWhileTheRobotDrivesUp) {
  // The first image may find no transform yet: tf is on its way while the clock stands.
  ASSERT_TRUE(awaitLooks(1));
  ASSERT_TRUE(waitUntil([] { return !world_->truth.empty() && world_->info && world_->depth; }));
  EXPECT_EQ(world_->truth.size(), 10u);
  world_->speed_m_s = 0.4;
  std::size_t looked_at = 0;
  const bool has_arrived = waitUntil(
      [&] {
        const std::optional<Eigen::Isometry3d> base = poseOf("base_link", ros::Time(0));
        if (world_->updates.size() > looked_at && !world_->bricks.bricks.empty()) {
          looked_at = world_->updates.size();
          const auto camera = poseOf("camera_color_optical_frame", ros::Time(0));
          if (camera) expectAllTrue(*camera);
        }
        return base && base->translation().x() > -0.95;
      },
      kDrive_s);
  world_->speed_m_s = 0.0;
  ASSERT_TRUE(has_arrived);
  // Braked to a stop within a second, five images.
  ASSERT_TRUE(awaitLooks(10));
  const Update last = world_->updates.back();
  ASSERT_EQ(static_cast<int>(last.status), Update::ACCEPTED) << last.message;
  EXPECT_TRUE(last.has_depth) << last.message;
  const auto camera = poseOf("camera_color_optical_frame", ros::Time(0));
  ASSERT_TRUE(camera);
  expectAllTrue(*camera);

  const std::set<int> in_view = bricksInView(*camera, 30.0);
  EXPECT_GE(in_view.size(), 4u);  // at least the near row's, or this test says little
  std::set<int> known;
  for (const Brick& brick : world_->bricks.bricks) known.insert(brick.id);
  for (const int id : in_view) EXPECT_EQ(known.count(id), 1u) << "brick " << id;
  // Refused ones come with the start alone.
  for (std::size_t i = 5; i < world_->updates.size(); ++i) {
    EXPECT_EQ(static_cast<int>(world_->updates[i].status), Update::ACCEPTED) << world_->updates[i].message;
  }
}

TEST_F(DetectionWorld, DetectAnswersWithAnImageOfAfterTheCall) {
  const ros::Time called = ros::Time::now();
  std::future<DetectBricks::Response> answer = std::async(std::launch::async, [] {
    DetectBricks service;
    service.request.timeout = ros::Duration(10.0);
    EXPECT_TRUE(call("/brick_detection/detect", service));
    return service.response;
  });
  EXPECT_TRUE(waitUntil([&] { return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }));
  const DetectBricks::Response response = answer.get();
  EXPECT_EQ(static_cast<int>(response.status), DetectBricks::Response::OK) << response.message;
  EXPECT_GT(response.update.header.stamp, called);
  EXPECT_FALSE(response.bricks.bricks.empty());
}

TEST_F(DetectionWorld, TheMapSaysWhichFacesCanBeReached) {
  // Where the arm hides nothing.
  world_->speed_m_s = -0.4;
  const bool is_back = waitUntil(
      [] {
        const std::optional<Eigen::Isometry3d> base = poseOf("base_link", ros::Time(0));
        return base && base->translation().x() < -1.3;
      },
      kDrive_s);
  world_->speed_m_s = 0.0;
  ASSERT_TRUE(is_back);
  ASSERT_TRUE(awaitLooks(10));
  const auto accessOf = [](int id, int face_name) -> const BrickFace* {
    for (const Brick& brick : world_->bricks.bricks) {
      if (brick.id != id) continue;
      for (const BrickFace& face : brick.graspable_faces) {
        if (face.face == face_name) return &face;
      }
    }
    return nullptr;
  };
  // Nothing is on bricks 8 and 9, and the map has looked at the space above them from the whole way.
  for (const int id : {8, 9}) {
    EXPECT_TRUE(waitUntil([&] {
      const BrickFace* top = accessOf(id, BrickFace::PLUS_Z);
      return top != nullptr && top->free_share > 0.9F;
    })) << id;
  }
  // All bricks are turned by 90 degrees: their +y faces the robot. Before those of the back row stands the front row, 4 cm
  // away.
  bool has_back = false;
  for (const int id : {4, 5, 6, 7}) {
    has_back |= accessOf(id, BrickFace::PLUS_Z) != nullptr;
    EXPECT_EQ(accessOf(id, BrickFace::PLUS_Y), nullptr) << id;
  }
  EXPECT_TRUE(has_back);  // or the above says nothing
  for (const int id : {8, 9}) EXPECT_NE(accessOf(id, BrickFace::PLUS_Y), nullptr) << id;
}

TEST_F(DetectionWorld, ABrickThatIsTakenAwayVanishes) {
  const auto isKnown = [](int id) {
    return std::any_of(world_->bricks.bricks.begin(), world_->bricks.bricks.end(),
                       [id](const Brick& brick) { return brick.id == id; });
  };
  ASSERT_TRUE(isKnown(8));
  const std::size_t known = world_->bricks.bricks.size();
  const std::size_t before = world_->updates.size();
  simulated_world::InjectFault fault;
  fault.request.kind = "move_brick";
  fault.request.brick_id = 8;
  fault.request.pose.position.x = -1.0;
  fault.request.pose.position.y = 3.0;  // to the robot's left, out of view
  fault.request.pose.position.z = 0.1;
  fault.request.pose.orientation.w = 1.0;
  ASSERT_TRUE(call("/simulated_world/inject_fault", fault));
  ASSERT_TRUE(fault.response.success) << fault.response.message;
  EXPECT_TRUE(waitUntil([&] { return !isKnown(8); }, kDrive_s));
  const auto dropped = [&] {
    for (std::size_t i = before; i < world_->updates.size(); ++i) {
      const auto& ids = world_->updates[i].bricks_dropped;
      if (std::count(ids.begin(), ids.end(), 8) > 0) return true;
    }
    return false;
  };
  EXPECT_TRUE(waitUntil(dropped));
  // The map's next update sees it gone; the moment of the fault, the answer and the message take an image each.
  EXPECT_LE(world_->updates.size(), before + 8);
  ASSERT_TRUE(awaitLooks(5));
  EXPECT_FALSE(isKnown(8));
  EXPECT_GE(world_->bricks.bricks.size(), known - 1);  // it alone, and what it hid may have come
  for (const Update& update : world_->updates) {
    for (const int id : update.bricks_dropped) EXPECT_EQ(id, 8);
  }
}

}  // namespace
}  // namespace integration_tests
