// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking_ros/surface_picking_ros.h"

#include <algorithm>
#include <exception>
#include <utility>

#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_enums/map_update.h>
#include <ros/console.h>
#include <visualization_msgs/MarkerArray.h>

#include "surface_picking/picking.h"
#include "surface_picking_ros/conversions.h"

namespace surface_picking_ros {
namespace {

using diagnostic_msgs::DiagnosticStatus;
using interactive_mapping::formatted;
using interactive_mapping_msgs::MapUpdate;
using surface_picking::Body;

constexpr char kLog[] = "surface_picking";
constexpr double kSilence_s = 5.0;     // without an update of the map: a warning
constexpr double kWarnPeriod_s = 5.0;  // a message in a callback is repeated no more often

Eigen::AlignedBox3d viewOf(const MapUpdate& update) {
  const Eigen::AlignedBox3d box(Eigen::Vector3d(update.view_min.x, update.view_min.y, update.view_min.z),
                                Eigen::Vector3d(update.view_max.x, update.view_max.y, update.view_max.z));
  return box.min() == box.max() ? gpis_mapping::kEverywhere : box;
}

}  // namespace

SurfacePickingRos::SurfacePickingRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : params_(loadSurfacePickingParams(private_nh)),
      catalogue_(mp700_ur5e_description::loadBrickTypes(params_.bricks_file)),
      map_(nh, params_.map_frame),
      private_nh_(private_nh),
      tracker_(params_.bodies, private_nh_.param(kNextIdParam, 0)),
      markers_(catalogue_),
      detect_(private_nh, params_.detect, {params_.map_frame, "update of the map", nh.resolveName("map_update")}),
      diagnostics_(nh, private_nh, private_nh.getNamespace()) {
  ROS_INFO_STREAM_NAMED(kLog, "configuration:\n" << interactive_mapping::toYaml(params_));
  ros::NodeHandle public_nh(nh);
  ros::NodeHandle pnh(private_nh);
  bricks_.header.frame_id = params_.map_frame;
  bricks_publisher_ = pnh.advertise<BrickArray>("bricks", 1, true);
  marker_publisher_ = pnh.advertise<visualization_msgs::MarkerArray>("markers", 1, true);
  patch_publisher_ = pnh.advertise<visualization_msgs::MarkerArray>("patches", 1, true);
  {
    const std::lock_guard<std::mutex> lock(bodies_mutex_);
    publishBricks();  // whoever subscribes learns that none are known
  }
  map_subscriber_ = public_nh.subscribe("map_update", 5, &SurfacePickingRos::onMapUpdate, this);
  // A simulation that waits for an update after each image may begin when it sees this: the map's are subscribed to.
  update_publisher_ = pnh.advertise<Update>("update", 50);
  attached_subscriber_ = public_nh.subscribe("attached_brick", 5, &SurfacePickingRos::onAttached, this);
  clear_server_ = pnh.advertiseService("clear", &SurfacePickingRos::onClear, this);
  worker_ = std::thread(&SurfacePickingRos::work, this);

  diagnostics_.setHardwareID("none");
  diagnostics_.add("map", this, &SurfacePickingRos::diagnoseMap);
  diagnostics_.add("bodies", this, &SurfacePickingRos::diagnoseBodies);
  // By the wall clock, which the updater's own timing is not: a stopped simulation must be diagnosed as well.
  diagnostics_timer_ = pnh.createWallTimer(ros::WallDuration(diagnostics_.getPeriod()),
                                           [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); });
  ROS_INFO_NAMED(kLog, "looking for bodies of %zu types on the surface of %s, in frame '%s'", catalogue_.types.size(),
                 nh.resolveName("map/get_mesh").c_str(), params_.map_frame.c_str());
}

SurfacePickingRos::~SurfacePickingRos() {
  {
    const std::lock_guard<std::mutex> lock(look_mutex_);
    is_stopping_ = true;
  }
  work_come_.notify_all();
  detect_.stop();
  map_.stop();  // first: a call that hangs holds up the worker, and with it callbacks
  // Each of these waits for its callback in progress.
  diagnostics_timer_.stop();
  clear_server_.shutdown();
  attached_subscriber_.shutdown();
  map_subscriber_.shutdown();
  worker_.join();
}

void SurfacePickingRos::onMapUpdate(const MapUpdate::ConstPtr& update) {
  {
    const std::lock_guard<std::mutex> lock(look_mutex_);
    ++counters_.updates;
    counters_.last_update = ros::WallTime::now();
    if (update->status == MapUpdate::ACCEPTED) view_.extend(viewOf(*update));
    if (!params_.continuous && !detect_.wants(update->header.stamp)) return;
    news_ = *update;
  }
  work_come_.notify_all();
}

void SurfacePickingRos::work() {
  while (true) {
    MapUpdate update;
    Eigen::AlignedBox3d view;
    brick_detection_ros::DetectLook done;
    {
      std::unique_lock<std::mutex> lock(look_mutex_);
      work_come_.wait(lock, [this] { return is_stopping_ || news_; });
      if (is_stopping_) return;
      update = std::move(*news_);
      news_.reset();
      view = std::exchange(view_, {});
      done.update.look = ++counters_.looks;
    }
    done.update.header = update.header;
    done.update.header.frame_id = params_.map_frame;
    const ros::WallTime begun = ros::WallTime::now();
    try {
      if (update.status != MapUpdate::ACCEPTED) {
        throw std::runtime_error("the map left the image out, " +
                                 std::string(toString(static_cast<interactive_mapping::FrameStatus>(update.status))) +
                                 ": " + update.message);
      }
      look(update, view, &done);
    } catch (const std::exception& error) {
      done.update.status = Update::FAILED;
      done.update.message = error.what();
      done.bricks = BrickArray();
      ROS_WARN_STREAM_THROTTLE_NAMED(kWarnPeriod_s, kLog, "no bodies are looked for: " << error.what());
    }
    done.update.total_ms = static_cast<float>((ros::WallTime::now() - begun).toSec() * 1e3);
    // Whoever waits for it finds ~bricks and the services up to date.
    update_publisher_.publish(done.update);
    {
      const std::lock_guard<std::mutex> lock(look_mutex_);
      counters_.last_ms = done.update.total_ms;
      const bool is_good = done.update.status == Update::ACCEPTED;
      counters_.failures += is_good ? 0 : 1;
      counters_.last_failure = is_good ? "" : done.update.message;
      if (!is_good) view_.extend(view);  // not looked at yet
    }
    detect_.conclude(std::move(done));
  }
}

void SurfacePickingRos::look(const MapUpdate& update, const Eigen::AlignedBox3d& view_map,
                             brick_detection_ros::DetectLook* done) {
  const ros::WallTime begun = ros::WallTime::now();
  const Eigen::AlignedBox3d region(params_.region.min_m, params_.region.max_m);
  // What a body at the border of the view stands beside counts as well.
  double beside_m = 0.0;
  for (const auto& type : catalogue_.types) beside_m = std::max(beside_m, type.size_m.norm());
  const Eigen::Vector3d beside = Eigen::Vector3d::Constant(beside_m);
  const Eigen::AlignedBox3d box =
      Eigen::AlignedBox3d(view_map.min() - beside, view_map.max() + beside).intersection(region);
  interactive_mapping_msgs::SurfaceMesh message;
  if (!box.isEmpty()) message = map_.mesh(box);
  const surface_picking::TriangleMesh mesh = surface_picking::cropMesh(toMesh(message), box.min(), box.max());
  const ros::WallTime received = ros::WallTime::now();
  surface_picking::PatchStatistics patch_statistics;
  const std::vector<surface_picking::Patch> patches =
      surface_picking::findPatches(mesh, params_.patches, &patch_statistics);
  const surface_picking::SpaceQuery space = [this](const Eigen::Matrix3Xd& points) { return map_.states(points); };
  surface_picking::CuboidStatistics cuboid_statistics;
  const std::vector<surface_picking::Cuboid> cuboids =
      surface_picking::findCuboids(mesh, patches, catalogue_.types, space, params_.cuboids, &cuboid_statistics);
  const ros::WallTime found = ros::WallTime::now();

  // The map may have gone on since the update that woke us.
  const ros::Time stamp = std::max(message.header.stamp, update.header.stamp);
  std::vector<Body> bodies;
  surface_picking::BodyTracker::Update seen;
  int next_id = 0;
  {
    const std::lock_guard<std::mutex> lock(bodies_mutex_);
    if (stamp < bricks_.header.stamp) {
      ROS_WARN_NAMED(kLog, "time ran back by %.1f s: all bodies are forgotten", (bricks_.header.stamp - stamp).toSec());
      for (const Body& body : tracker_.bodies()) dropped_.push_back(body.id);
      tracker_.clear();
    }
    seen = tracker_.update(stamp.toSec(), cuboids, space, view_map);
    bodies = tracker_.bodies();
    next_id = tracker_.nextId();
    dropped_.insert(dropped_.end(), seen.dropped.begin(), seen.dropped.end());
  }
  if (next_id != kept_next_id_) private_nh_.setParam(kNextIdParam, kept_next_id_ = next_id);
  std::vector<std::size_t> all(bodies.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
  std::vector<interactive_mapping_msgs::Brick> bricks = toBricks(bodies, all);

  done->update.header.stamp = stamp;
  done->update.has_depth = 1;
  done->update.detect_ms = static_cast<float>((received - begun).toSec() * 1e3);
  done->update.pose_ms = static_cast<float>((found - received).toSec() * 1e3);
  done->update.track_ms = static_cast<float>((ros::WallTime::now() - found).toSec() * 1e3);
  done->bricks.header = done->update.header;
  for (const std::size_t index : seen.seen) {
    done->update.bricks_seen.push_back(bodies[index].id);
    done->bricks.bricks.push_back(bricks[index]);
  }
  {
    const std::lock_guard<std::mutex> lock(bodies_mutex_);
    // What was taken in hand meanwhile.
    const auto isTaken = [this](const interactive_mapping_msgs::Brick& brick) {
      return std::none_of(tracker_.bodies().begin(), tracker_.bodies().end(),
                          [&](const Body& body) { return body.id == brick.id; });
    };
    bricks.erase(std::remove_if(bricks.begin(), bricks.end(), isTaken), bricks.end());
    bricks_.header.stamp = stamp;
    bricks_.bricks = std::move(bricks);
    done->update.bricks_dropped.assign(dropped_.begin(), dropped_.end());
    dropped_.clear();
    publishBricks();
  }
  if (patch_publisher_.getNumSubscribers() > 0) {
    patch_publisher_.publish(patch_markers_.update(done->update.header, patches));
  }
  const std::lock_guard<std::mutex> lock(look_mutex_);
  counters_.patches = patch_statistics;
  counters_.cuboids = cuboid_statistics;
}

std::vector<interactive_mapping_msgs::Brick> SurfacePickingRos::toBricks(const std::vector<Body>& bodies,
                                                                         const std::vector<std::size_t>& indices) {
  std::vector<interactive_mapping_msgs::Brick> bricks;
  const surface_picking::SpaceQuery space = [this](const Eigen::Matrix3Xd& points) { return map_.states(points); };
  for (const std::size_t index : indices) {
    const mp700_ur5e_description::BrickType& type = catalogue_.type(bodies[index].cuboid.type);
    bricks.push_back(
        toMessage(bodies[index], type, surface_picking::pickableFaces(bodies, index, type, space, params_.access)));
  }
  return bricks;
}

void SurfacePickingRos::publishBricks() {
  bricks_publisher_.publish(bricks_);
  marker_publisher_.publish(markers_.update(bricks_));
}

void SurfacePickingRos::onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message) {
  const std::lock_guard<std::mutex> lock(bodies_mutex_);
  if (message->is_attached == 0) {
    tracker_.detach(message->header.stamp.toSec(), attached_ ? placeOf(*attached_) : std::nullopt);
    attached_.reset();
    return;
  }
  attached_ = *message;
  if (!tracker_.attach(message->id)) return;
  dropped_.push_back(message->id);
  bricks_.bricks.erase(
      std::remove_if(bricks_.bricks.begin(), bricks_.bricks.end(),
                     [&](const interactive_mapping_msgs::Brick& brick) { return brick.id == message->id; }),
      bricks_.bricks.end());
  publishBricks();
}

std::optional<Eigen::Vector3d> SurfacePickingRos::placeOf(
    const interactive_mapping_msgs::AttachedBrick& attached) const {
  try {
    const geometry_msgs::TransformStamped transform = tf_buffer_.lookupTransform(
        params_.map_frame, interactive_mapping_ros::withoutSlash(attached.header.frame_id), ros::Time(0));
    std::string reason;
    const auto T_map_tool = interactive_mapping_ros::toIsometry(transform.transform, &reason);
    const auto T_tool_brick = interactive_mapping_ros::toIsometry(attached.pose, &reason);
    if (!T_map_tool || !T_tool_brick) throw std::invalid_argument(reason);
    return Eigen::Vector3d((*T_map_tool * *T_tool_brick).translation());
  } catch (const std::exception& error) {
    ROS_WARN_NAMED(kLog, "where brick %d was let go is not known: %s", attached.id, error.what());
    return std::nullopt;
  }
}

bool SurfacePickingRos::onClear(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  const std::lock_guard<std::mutex> lock(bodies_mutex_);
  response.message = "forgot " + std::to_string(tracker_.bodies().size()) + " bodies";
  response.success = 1;
  tracker_.clear();
  bricks_.bricks.clear();
  publishBricks();
  return true;
}

void SurfacePickingRos::diagnoseMap(diagnostic_updater::DiagnosticStatusWrapper& status) {
  Counters counters;
  {
    const std::lock_guard<std::mutex> lock(look_mutex_);
    counters = counters_;
  }
  if (counters.updates == 0) {
    status.summary(DiagnosticStatus::WARN, "nothing received on " + map_subscriber_.getTopic());
  } else if ((ros::WallTime::now() - counters.last_update).toSec() > kSilence_s) {
    status.summary(DiagnosticStatus::WARN, "no update of the map in the last " + formatted("%.0f s", kSilence_s));
  } else if (!counters.last_failure.empty()) {
    status.summary(DiagnosticStatus::ERROR, counters.last_failure);
  } else {
    status.summary(DiagnosticStatus::OK,
                   params_.continuous ? "every update is processed" : "updates are processed on call");
  }
  status.add("updates of the map", counters.updates);
  status.add("processed", counters.looks);
  status.add("failed", counters.failures);
  status.add("last detection [ms]", formatted("%.0f", counters.last_ms));
}

void SurfacePickingRos::diagnoseBodies(diagnostic_updater::DiagnosticStatusWrapper& status) {
  std::size_t known = 0;
  std::optional<interactive_mapping_msgs::AttachedBrick> attached;
  {
    const std::lock_guard<std::mutex> lock(bodies_mutex_);
    known = bricks_.bricks.size();
    attached = attached_;
  }
  Counters counters;
  {
    const std::lock_guard<std::mutex> lock(look_mutex_);
    counters = counters_;
  }
  status.summary(DiagnosticStatus::OK, std::to_string(known) + " bodies known");
  status.add("in the hand", attached ? std::to_string(attached->id) : "none");
  status.add("pieces too small", counters.patches.num_small);
  status.add("pieces curved", counters.patches.num_curved);
  status.add("hypotheses", counters.cuboids.num_hypotheses);
  status.add("refused: few edges", counters.cuboids.num_few_edges);
  status.add("refused: in other surface", counters.cuboids.num_penetrating);
  status.add("refused: seen free", counters.cuboids.num_free);
  status.add("refused: unsure", counters.cuboids.num_unsure);
  status.add("refused: ambiguous", counters.cuboids.num_ambiguous);
}

}  // namespace surface_picking_ros
