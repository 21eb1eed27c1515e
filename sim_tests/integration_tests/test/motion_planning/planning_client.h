// SPDX-License-Identifier: BSD-3-Clause
// What the tests of node motion_planning share: a robot and a map that are topics only, and a client of its actions.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include <actionlib/client/simple_action_client.h>
#include <geometry_msgs/TransformStamped.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/PathMonitorState.h>
#include <interactive_mapping_msgs/PlanArmAction.h>
#include <interactive_mapping_msgs/PlanPickAction.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <interactive_mapping_msgs/WatchTrajectory.h>
#include <mp700_ur5e_description/arm_pose.h>
#include <mp700_ur5e_description/robot_names.h>
#include <ros/callback_queue.h>
#include <ros/spinner.h>
#include <sensor_msgs/JointState.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include "support/box_world.h"

namespace integration_tests {

using node_tests::call;
using node_tests::has;
using node_tests::Latest;
using node_tests::waitUntil;

using interactive_mapping_msgs::PathMonitorState;
using interactive_mapping_msgs::PlanArmAction;
using interactive_mapping_msgs::PlanArmGoal;
using interactive_mapping_msgs::PlanArmResult;
using interactive_mapping_msgs::PlanOutcome;
using interactive_mapping_msgs::PlanPickAction;
using interactive_mapping_msgs::PlanPickGoal;
using interactive_mapping_msgs::PlanPickResult;
using interactive_mapping_msgs::WatchTrajectory;
using motion_planning::ArmVector;
using motion_planning::BoxWorld;
using ArmGoalMessage = interactive_mapping_msgs::ArmGoal;

/// Joint states and tf of a robot that stands still, mesh and answers of a map of boxes: from threads of its own, so that
/// a test may wait.
class TopicRobot {
 public:
  explicit TopicRobot(const ArmVector& arm_rad) : arm_rad_(arm_rad), spinner_(2, &queue_) {
    nh_.setCallbackQueue(&queue_);
    joints_ = nh_.advertise<sensor_msgs::JointState>("/joint_states", 10);
    tf_ = nh_.advertise<tf2_msgs::TFMessage>("/tf", 10);
    updates_ = nh_.advertise<interactive_mapping_msgs::MapUpdate>("/map/update", 10, true);
    attached_ = nh_.advertise<interactive_mapping_msgs::AttachedBrick>("/attached_brick", 1, true);
    query_ = nh_.advertiseService("/map/query", &TopicRobot::onQuery, this);
    get_mesh_ = nh_.advertiseService("/map/get_mesh", &TopicRobot::onGetMesh, this);
    timer_ = nh_.createWallTimer(ros::WallDuration(0.02), [this](const ros::WallTimerEvent&) { publishState(); });
    spinner_.start();
  }
  ~TopicRobot() { spinner_.stop(); }

  void setArm(const ArmVector& arm_rad) {
    const std::lock_guard<std::mutex> lock(mutex_);
    arm_rad_ = arm_rad;
  }
  void setBase(const Eigen::Isometry3d& T_map_base) {
    const std::lock_guard<std::mutex> lock(mutex_);
    T_map_base_ = T_map_base;
  }
  /// Waits until the state as it is now has been published; returns its stamp, which tf has exactly.
  ros::Time awaitState() {
    std::uint64_t before = 0;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      before = num_states_;
    }
    EXPECT_TRUE(waitUntil([&] {
      const std::lock_guard<std::mutex> lock(mutex_);
      return num_states_ > before;
    }));
    const std::lock_guard<std::mutex> lock(mutex_);
    return state_stamp_;
  }
  /// Of the newest image in the map.
  ros::Time mapStamp() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return mesh_.header.stamp;
  }
  /// How many meshes were handed out.
  int numMeshes() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return num_meshes_;
  }
  /// The map is another one from now on; returns its number. `spoil` may change the mesh, not what the map answers.
  std::uint64_t setWorld(const BoxWorld& world,
                         const std::function<void(interactive_mapping_msgs::SurfaceMesh&)>& spoil = nullptr) {
    interactive_mapping_msgs::SurfaceMesh message;
    const motion_planning::Surface surface = world.surface();
    for (std::size_t i = 0; i < surface.vertices_map.size(); ++i) {
      geometry_msgs::Point p;
      p.x = surface.vertices_map[i].x();
      p.y = surface.vertices_map[i].y();
      p.z = surface.vertices_map[i].z();
      message.mesh.vertices.push_back(p);
      for (int axis = 0; axis < 3; ++axis) message.normals.push_back(surface.normals_map[i][axis]);
      message.variance.push_back(4e-6F);
    }
    for (const auto& triangle : surface.triangles) {
      message.mesh.triangles.emplace_back();
      message.mesh.triangles.back().vertex_indices = {{triangle[0], triangle[1], triangle[2]}};
    }
    message.header.frame_id = "map";
    message.header.stamp = ros::Time::now();
    if (spoil) spoil(message);
    interactive_mapping_msgs::MapUpdate update;
    update.header = message.header;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      world_ = world;
      update.update = message.update = mesh_.update + 1;
      mesh_ = message;
    }
    updates_.publish(update);
    return update.update;
  }
  void setAttached(const interactive_mapping_msgs::AttachedBrick& brick) { attached_.publish(brick); }
  /// The map refuses to answer, with this reason; empty: it answers.
  void refuseQueries(const std::string& why) {
    const std::lock_guard<std::mutex> lock(mutex_);
    refusal_ = why;
  }

 private:
  void publishState() {
    const std::lock_guard<std::mutex> lock(mutex_);
    const ros::Time now = ros::Time::now();
    if (now.isZero()) return;
    sensor_msgs::JointState joints;
    joints.header.stamp = now;
    // In another order than the arm's, as the driver does.
    for (int i = 5; i >= 0; --i) {
      joints.name.emplace_back(mp700_ur5e_description::kArmJoints[static_cast<std::size_t>(i)]);
      joints.position.push_back(arm_rad_[i]);
    }
    joints_.publish(joints);
    geometry_msgs::TransformStamped transform = tf2::eigenToTransform(T_map_base_);
    transform.header.stamp = now;
    transform.header.frame_id = "map";
    transform.child_frame_id = "base_link";
    tf2_msgs::TFMessage message;
    message.transforms.push_back(transform);
    tf_.publish(message);
    state_stamp_ = now;
    ++num_states_;
  }

  bool onQuery(interactive_mapping_msgs::QueryMap::Request& request,
               interactive_mapping_msgs::QueryMap::Response& response) {
    using Response = interactive_mapping_msgs::QueryMap::Response;
    BoxWorld world;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      response.message = refusal_;
      if (!refusal_.empty()) return true;
      world = world_;
    }
    gpis_mapping::Points3d points(3, static_cast<Eigen::Index>(request.points.size()));
    for (std::size_t i = 0; i < request.points.size(); ++i) {
      points.col(static_cast<Eigen::Index>(i)) << request.points[i].x, request.points[i].y, request.points[i].z;
    }
    const motion_planning::MapAnswers answers = world.query(points);
    for (std::size_t i = 0; i < request.points.size(); ++i) {
      const auto column = static_cast<Eigen::Index>(i);
      response.distance.push_back(answers.distance_m[column]);
      response.surface_std.push_back(answers.surface_std_m[column]);
      const gpis_mapping::SpaceState state = answers.state[i];
      response.state.push_back(state == gpis_mapping::SpaceState::kFree       ? Response::FREE
                               : state == gpis_mapping::SpaceState::kOccupied ? Response::OCCUPIED
                                                                              : Response::UNKNOWN);
    }
    response.success = true;
    return true;
  }

  bool onGetMesh(interactive_mapping_msgs::GetMesh::Request& request,
                 interactive_mapping_msgs::GetMesh::Response& response) {
    const std::lock_guard<std::mutex> lock(mutex_);
    response.revision = mesh_.update;
    response.mesh.header = mesh_.header;
    if (request.revision == response.revision) return true;
    response.mesh = mesh_;
    ++num_meshes_;
    return true;
  }

  std::mutex mutex_;  // guards what follows, up to the blank line
  ArmVector arm_rad_;
  Eigen::Isometry3d T_map_base_{Eigen::Isometry3d::Identity()};
  BoxWorld world_;
  interactive_mapping_msgs::SurfaceMesh mesh_;
  int num_meshes_{0};
  std::uint64_t num_states_{0};
  ros::Time state_stamp_;
  std::string refusal_;

  ros::CallbackQueue queue_;
  ros::NodeHandle nh_;
  ros::Publisher joints_, tf_, updates_, attached_;
  ros::ServiceServer query_, get_mesh_;
  ros::WallTimer timer_;
  ros::AsyncSpinner spinner_;
};

/// Sends goals to one planner and waits for what becomes of them.
class PlanningClient {
 public:
  explicit PlanningClient(const std::string& node = "/motion_planning")
      : pick(node + "/plan_pick", false), arm(node + "/plan_arm", false) {}

  bool connect() {
    return waitUntil([this] { return pick.isServerConnected() && arm.isServerConnected(); });
  }

  PlanPickResult plan(const PlanPickGoal& goal) { return send(pick, goal, PlanPickResult()); }
  PlanArmResult plan(const PlanArmGoal& goal) { return send(arm, goal, PlanArmResult()); }

  actionlib::SimpleActionClient<PlanPickAction> pick;
  actionlib::SimpleActionClient<PlanArmAction> arm;

 private:
  /// Planning takes up to some seconds on a machine that is busy with other work.
  template <typename Client, typename Goal, typename Result>
  static Result send(Client& client, const Goal& goal, Result none) {
    client.sendGoal(goal);
    if (!waitUntil([&client] { return client.getState().isDone(); }, 60.0)) {
      ADD_FAILURE() << "no result of planning";
      none.outcome.status = PlanOutcome::NUM_STATUS;
      return none;
    }
    return client.getResult() ? *client.getResult() : none;
  }
};

}  // namespace integration_tests
