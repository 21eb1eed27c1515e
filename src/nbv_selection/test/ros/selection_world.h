// SPDX-License-Identifier: BSD-3-Clause
// What the tests of node nbv_selection share: maps, a robot and ground that are topics and services only, and a client.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include <actionlib/client/simple_action_client.h>
#include <base_navigation_ros/conversions.h>
#include <geometry_msgs/TransformStamped.h>
#include <gpis_mapping/mesh_extractor.h>
#include <gpis_mapping_ros/map_messages.h>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <interactive_mapping_msgs/SelectNextBestViewAction.h>
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <nav_msgs/OccupancyGrid.h>
#include <octomap/OcTree.h>
#include <octomap_baseline_ros/octomap_messages.h>
#include <octomap_msgs/GetOctomap.h>
#include <ros/callback_queue.h>
#include <ros/spinner.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include <interactive_mapping_common_ros/testing/waiting.h>
#include "support/sampled_map.h"

namespace nbv_selection_ros {

using interactive_mapping_msgs::GetMesh;
using interactive_mapping_msgs::MapUpdate;
using interactive_mapping_msgs::NbvSelection;
using interactive_mapping_msgs::QueryMap;
using interactive_mapping_msgs::SelectionOutcome;
using interactive_mapping_msgs::SelectNextBestViewAction;
using interactive_mapping_msgs::SelectNextBestViewGoal;
using interactive_mapping_msgs::SelectNextBestViewResult;
using interactive_mapping_msgs::SurfaceMesh;
using Snapshot = std::shared_ptr<const gpis_mapping::MapSnapshot>;
using Tree = std::shared_ptr<const octomap::OcTree>;

/// Looked at from -x only: a brick on another, their far sides and the ground behind them are unseen.
inline Snapshot halfSeenPile() {
  using Eigen::Vector3d;
  nbv_selection_test::MapSamples samples;
  samples.addRectangle({-1.0, -1.0, 0.0}, {0.7, 0.0, 0.0}, {0.0, 2.0, 0.0});
  samples.addRectangle({-0.3, -1.0, 0.0}, {0.4, 0.0, 0.0}, {0.0, 0.8, 0.0});
  samples.addRectangle({-0.3, 0.2, 0.0}, {0.4, 0.0, 0.0}, {0.0, 0.8, 0.0});
  const auto addSeenSides = [&samples](const Vector3d& low, const Vector3d& size) {
    const Vector3d y(0.0, size.y(), 0.0), z(0.0, 0.0, size.z()), x(size.x(), 0.0, 0.0), half = 0.7 * x;
    samples.addRectangle(low + z, x, y);
    samples.addRectangle(low, z, y);  // -x
    samples.addRectangle(low, half, z);
    samples.addRectangle(low + y, z, half);
  };
  addSeenSides({-0.3, -0.2, 0.0}, {0.6, 0.4, 0.2});
  addSeenSides({-0.2, -0.1, 0.2}, {0.3, 0.2, 0.2});
  return samples.snapshot();
}

/// One brick seen from all sides, elsewhere.
inline Snapshot otherPile() {
  nbv_selection_test::MapSamples samples;
  samples.addRectangle({-0.7, -0.5, 0.0}, {0.4, 0.0, 0.0}, {0.0, 1.4, 0.0});
  samples.addRectangle({0.0, -0.5, 0.0}, {0.4, 0.0, 0.0}, {0.0, 1.4, 0.0});
  samples.addRectangle({-0.3, -0.5, 0.0}, {0.3, 0.0, 0.0}, {0.0, 0.6, 0.0});
  samples.addRectangle({-0.3, 0.4, 0.0}, {0.3, 0.0, 0.0}, {0.0, 0.5, 0.0});
  samples.addBox({Eigen::Vector3d(-0.3, 0.1, 0.0), Eigen::Vector3d(0.0, 0.4, 0.25)});
  return samples.snapshot();
}

inline Snapshot groundOnly() {
  nbv_selection_test::MapSamples samples;
  samples.addRectangle({-0.5, -0.5, 0.0}, {1.0, 0.0, 0.0}, {0.0, 1.0, 0.0});
  return samples.snapshot();
}

/// About the half-seen pile as an octree: the seen faces occupied, what is before and above them free.
inline Tree halfSeenTree() {
  constexpr double kSize_m = 0.03;
  auto tree = std::make_shared<octomap::OcTree>(kSize_m);
  const std::vector<Eigen::AlignedBox3d> bricks{
      {Eigen::Vector3d(-0.3, -0.21, 0.0), Eigen::Vector3d(0.3, 0.21, 0.21)},
      {Eigen::Vector3d(-0.21, -0.12, 0.21), Eigen::Vector3d(0.12, 0.12, 0.42)}};
  const auto isFull = [&bricks](const Eigen::Vector3d& p) {
    return p.z() < 0.0 ||
           std::any_of(bricks.begin(), bricks.end(), [&p](const auto& brick) { return brick.contains(p); });
  };
  const auto topAt = [&bricks](const Eigen::Vector3d& p) {
    double top_m = 0.0;
    for (const auto& brick : bricks) {
      if (brick.contains(Eigen::Vector3d(p.x(), p.y(), brick.center().z()))) top_m = brick.max().z();
    }
    return top_m;
  };
  for (int x = -34; x < 10; ++x) {
    for (int y = -34; y < 34; ++y) {
      for (int z = -1; z < 24; ++z) {
        const Eigen::Vector3d p = kSize_m * Eigen::Vector3d(x + 0.5, y + 0.5, z + 0.5);
        if (p.x() > 0.1 && p.z() < topAt(p) - kSize_m) continue;  // hidden
        if (p.x() > 0.1 && topAt(p) == 0.0) continue;
        bool is_inside = isFull(p);
        const bool is_full = is_inside;
        for (int axis = 0; axis < 3; ++axis) {
          for (const double step_m : {-kSize_m, kSize_m}) {
            is_inside = is_inside && isFull(p + step_m * Eigen::Vector3d::Unit(axis));
          }
        }
        if (is_inside && z >= 0) continue;  // nobody sees it
        tree->setNodeValue(
            octomap::point3d(static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())),
            octomap::logodds(is_full ? 0.97 : 0.12), true);
      }
    }
  }
  tree->updateInnerOccupancy();
  tree->prune();
  return tree;
}

/// Free but for the lower brick, 6 m a side.
inline base_navigation::NavigationGrid groundAroundThePile() {
  base_navigation::NavigationGrid grid;
  grid.origin_m = {-3.0, -3.0};
  grid.width = grid.height = 120;
  grid.state.assign(120 * 120, base_navigation::SpaceState::kFree);
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      const Eigen::Vector2d p = grid.centerOf(column, row).cwiseAbs();
      if (p.x() < 0.33 && p.y() < 0.23) grid.state[grid.index(column, row)] = base_navigation::SpaceState::kOccupied;
    }
  }
  return grid;
}

inline geometry_msgs::TransformStamped toTransform(const Eigen::Isometry3d& T, const std::string& parent,
                                                   const std::string& child, const ros::Time& stamp) {
  geometry_msgs::TransformStamped transform = tf2::eigenToTransform(T);
  transform.header.stamp = stamp;
  transform.header.frame_id = parent;
  transform.child_frame_id = child;
  return transform;
}

inline Eigen::Isometry3d poseOnGround(double x_m, double y_m, double yaw_rad) {
  Eigen::Isometry3d T(Eigen::Translation3d(x_m, y_m, 0.0));
  T.rotate(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  return T;
}

/// The map's node, the OctoMap's, the base's and tf, from threads of its own, so that a test may wait.
class SelectionWorld {
 public:
  using Hook = std::function<void(const QueryMap::Request&, QueryMap::Response*)>;

  SelectionWorld() : spinner_(3, &queue_) {
    nh_.setCallbackQueue(&queue_);
    tf_ = nh_.advertise<tf2_msgs::TFMessage>("/tf", 10);
    grid_ = nh_.advertise<nav_msgs::OccupancyGrid>("/grid", 1, true);
    updates_ = nh_.advertise<MapUpdate>("/map/update", 10, true);
    get_mesh_ = nh_.advertiseService("/map/get_mesh", &SelectionWorld::onGetMesh, this);
    query_ = nh_.advertiseService("/map/query", &SelectionWorld::onQuery, this);
    octomap_ = nh_.advertiseService("/octomap_full", &SelectionWorld::onOctomap, this);
    timer_ = nh_.createWallTimer(ros::WallDuration(0.02), [this](const ros::WallTimerEvent&) { publishState(); });
    spinner_.start();
  }
  ~SelectionWorld() { spinner_.stop(); }

  /// Extracts it at the first call: not to be called from two threads at once.
  static SurfaceMesh meshOf(const Snapshot& snapshot, const ros::Time& stamp) {
    static std::map<Snapshot, SurfaceMesh> meshes;
    SurfaceMesh& mesh = meshes[snapshot];
    if (mesh.header.frame_id.empty()) {
      gpis_mapping::MeshExtractor extractor(snapshot->config());
      extractor.update(*snapshot);
      std_msgs::Header header;
      header.frame_id = "map";
      mesh = gpis_mapping_ros::toSurfaceMesh(extractor.mesh(), header, snapshot->numUpdates());
    }
    mesh.header.stamp = stamp;
    return mesh;
  }

  /// As gpis_mapping's node answers.
  static void answerFrom(const gpis_mapping::MapSnapshot& snapshot, const QueryMap::Request& request,
                         QueryMap::Response* response) {
    gpis_mapping::QueryOptions options;
    options.variance = request.with_variance != 0;
    options.variance_gradient = request.with_variance_gradient != 0;
    gpis_mapping_ros::fillAnswer(snapshot.query(gpis_mapping_ros::toPoints(request.points), options),
                                 Eigen::Matrix3d::Identity(), options.variance, response);
    response->prior_variance = std::pow(snapshot.config().signalStd(), 2.0);
    response->success = 1;
  }

  /// The map is another one from now on; returns its stamp, which goals can ask for.
  ros::Time setMap(const Snapshot& snapshot, const std::function<void(SurfaceMesh*)>& spoil = nullptr) {
    SurfaceMesh mesh = meshOf(snapshot, ros::Time::now());
    if (spoil) spoil(&mesh);
    answerFrom(snapshot);
    MapUpdate update;
    update.header = mesh.header;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      mesh_ = std::move(mesh);
    }
    updates_.publish(update);
    return update.header.stamp;
  }
  /// Queries alone are answered from it.
  void answerFrom(const Snapshot& snapshot) {
    const std::lock_guard<std::mutex> lock(mutex_);
    snapshot_ = snapshot;
  }
  ros::Time setTree(const Tree& tree) {
    std_msgs::Header header;
    header.frame_id = "map";
    header.stamp = ros::Time::now();
    setOctomap(octomap_baseline_ros::toFullMessage(*tree, header));
    return header.stamp;
  }
  void setOctomap(const octomap_msgs::Octomap& message) {
    const std::lock_guard<std::mutex> lock(mutex_);
    octomap_message_ = message;
  }
  /// Is called with each answer before it goes out, on the service's thread; none: nothing is.
  void setHook(const Hook& hook) {
    const std::lock_guard<std::mutex> lock(mutex_);
    hook_ = hook;
  }

  // In the middle of a cell of the ground: rounding on the way through tf must not make it the next one.
  const Eigen::Isometry3d T_map_base = poseOnGround(-1.575, 0.425, -0.3);
  const Eigen::Isometry3d T_map_odom = poseOnGround(0.7, -0.4, 0.9);

 private:
  void publishState() {
    const ros::Time now = ros::Time::now();
    if (now.isZero()) return;
    tf2_msgs::TFMessage message;
    message.transforms = {toTransform(T_map_odom, "map", "odom", now),
                          toTransform(T_map_odom.inverse() * T_map_base, "odom", "base_link", now)};
    tf_.publish(message);
    std_msgs::Header header;
    header.frame_id = "map";
    header.stamp = now;
    grid_.publish(base_navigation_ros::toMessage(groundAroundThePile(), header));
  }

  bool onQuery(QueryMap::Request& request, QueryMap::Response& response) {
    Snapshot snapshot;
    Hook hook;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      snapshot = snapshot_;
      hook = hook_;
    }
    if (!snapshot) return false;
    answerFrom(*snapshot, request, &response);
    if (hook) hook(request, &response);
    return true;
  }

  bool onGetMesh(GetMesh::Request&, GetMesh::Response& response) {
    const std::lock_guard<std::mutex> lock(mutex_);
    response.mesh = mesh_;
    return true;
  }

  bool onOctomap(octomap_msgs::GetOctomap::Request&, octomap_msgs::GetOctomap::Response& response) {
    const std::lock_guard<std::mutex> lock(mutex_);
    response.map = octomap_message_;
    return true;
  }

  std::mutex mutex_;  // guards what follows, up to the blank line
  Snapshot snapshot_;
  SurfaceMesh mesh_;
  octomap_msgs::Octomap octomap_message_;
  Hook hook_;

  ros::CallbackQueue queue_;
  ros::NodeHandle nh_;
  ros::Publisher tf_, grid_, updates_;
  ros::ServiceServer query_, get_mesh_, octomap_;
  ros::WallTimer timer_;
  ros::AsyncSpinner spinner_;
};

/// Sends goals to one node and waits for what becomes of them.
class SelectionClient {
 public:
  explicit SelectionClient(const std::string& node) : action(node + "/select", false) {}

  bool connect() {
    return node_tests::waitUntil([this] { return action.isServerConnected(); });
  }
  SelectNextBestViewResult select(const SelectNextBestViewGoal& goal) {
    action.sendGoal(goal);
    return await();
  }
  SelectNextBestViewResult await() {
    SelectNextBestViewResult none;
    none.outcome.status = SelectionOutcome::NUM_STATUS;
    if (!node_tests::waitUntil([this] { return action.getState().isDone(); })) {
      ADD_FAILURE() << "no result of the selection";
      return none;
    }
    return action.getResult() ? *action.getResult() : none;
  }

  actionlib::SimpleActionClient<SelectNextBestViewAction> action;
};

inline SelectNextBestViewGoal goalOf(const std::string& strategy) {
  SelectNextBestViewGoal goal;
  goal.strategy = strategy;
  return goal;
}

}  // namespace nbv_selection_ros
