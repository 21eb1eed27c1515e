// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/map_publisher.h"

#include <cmath>
#include <limits>

#include <nav_msgs/OccupancyGrid.h>
#include <sensor_msgs/PointCloud2.h>
#include <visualization_msgs/InteractiveMarker.h>
#include <visualization_msgs/Marker.h>
#include <visualization_msgs/MarkerArray.h>

#include "gpis_mapping/ground_projection.h"
#include "gpis_mapping_ros/map_messages.h"

namespace gpis_mapping_ros {
namespace {

constexpr std::size_t kMaxSliceCells = 20000;      // about 0.1 s of queries
constexpr std::size_t kMaxRemovedPoints = 200000;  // shown at once
constexpr char kSliceHandle[] = "slice";

std::chrono::steady_clock::duration toSteady(double duration_s) {
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(duration_s));
}

}  // namespace

MapPublisher::MapPublisher(const ros::NodeHandle& private_nh, const GpisMappingParams& params)
    : map_frame_(params.input.map_frame),
      ground_options_(params.ground),
      output_(params.output),
      slice_(params.slice),
      slice_handle_(private_nh.resolveName("slice_handle"), "", true) {
  ros::NodeHandle nh(private_nh);
  const auto advertise = [this, &nh](Output* output, auto type, const char* topic) {
    using Message = decltype(type);
    const ros::SubscriberStatusCallback connected = [this, output](const ros::SingleSubscriberPublisher&) {
      const std::lock_guard<std::mutex> lock(mutex_);
      output->is_stale = true;
      has_news_ = true;
      changed_.notify_all();
    };
    ros::Publisher publisher = nh.advertise<Message>(topic, 1, connected);
    const std::lock_guard<std::mutex> lock(mutex_);
    output->publisher = publisher;
  };
  advertise(&mesh_, interactive_mapping_msgs::SurfaceMesh(), "mesh");
  advertise(&marker_, visualization_msgs::Marker(), "mesh_marker");
  advertise(&points_, sensor_msgs::PointCloud2(), "points");
  advertise(&removed_points_, sensor_msgs::PointCloud2(), "removed_points");
  advertise(&frame_map_, visualization_msgs::MarkerArray(), "frame_map");
  advertise(&ground_, nav_msgs::OccupancyGrid(), "ground");
  advertise(&slice_cloud_, sensor_msgs::PointCloud2(), "slice");
  advertise(&slice_marker_, visualization_msgs::Marker(), "slice_marker");
  worker_ = std::thread(&MapPublisher::work, this);
}

MapPublisher::~MapPublisher() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_stopping_ = true;
  }
  changed_.notify_all();
  worker_.join();
  for (Output* output :
       {&mesh_, &marker_, &points_, &removed_points_, &frame_map_, &ground_, &slice_cloud_, &slice_marker_}) {
    output->publisher.shutdown();  // no callback of theirs may find this object gone
  }
}

void MapPublisher::setState(const MapState& state, const std::vector<Eigen::Vector3d>& removed_points_map) {
  const ros::Time now = ros::Time::now();
  std::uint64_t number = 0;
  bool waits = false;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const double mesh_age_s = (state.stamp - mesh_stamp_).toSec();  // negative: time ran back
    const bool is_mesh_due =
        state.generation != state_.generation || mesh_age_s < 0.0 || mesh_age_s >= output_.mesh_period_s;
    if (is_mesh_due) {
      mesh_stamp_ = state.stamp;
      mesh_.is_stale = marker_.is_stale = true;
    }
    if (state.generation != state_.generation) removed_.clear();
    state_ = state;
    if (!removed_points_map.empty()) removed_.emplace_back(now, removed_points_map);
    std::size_t total = 0;
    for (const auto& entry : removed_) total += entry.second.size();
    while (total > kMaxRemovedPoints && removed_.size() > 1) {
      total -= removed_.front().second.size();
      removed_.pop_front();
    }
    for (Output* output : {&points_, &removed_points_, &frame_map_, &ground_, &slice_cloud_, &slice_marker_}) {
      output->is_stale = true;
    }
    has_news_ = true;
    number = ++num_states_;
    waits = output_.every_image;
  }
  changed_.notify_all();
  if (!waits) return;
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this, number] { return is_stopping_ || num_states_published_ >= number; });
}

bool MapPublisher::wantsBlanket() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return frame_map_.publisher.getNumSubscribers() > 0;
}

void MapPublisher::setOutput(const GpisMappingParams::Output& output) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    output_ = output;
    marker_.is_stale = true;
    removed_points_.is_stale = true;
    has_news_ = true;
  }
  changed_.notify_all();
}

void MapPublisher::setSliceHeight(double height_m) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (slice_.height_m == height_m) return;
    slice_.height_m = height_m;
    slice_cloud_.is_stale = slice_marker_.is_stale = true;
    has_news_ = true;
  }
  changed_.notify_all();
}

void MapPublisher::onSliceDragged(std::function<void(double height_m)> callback) {
  const std::lock_guard<std::mutex> lock(mutex_);
  on_slice_dragged_ = std::move(callback);
}

std_msgs::Header MapPublisher::headerOf(const MapState& state) const {
  std_msgs::Header header;
  header.frame_id = map_frame_;
  header.stamp = state.stamp;
  return header;
}

const gpis_mapping::TriangleMesh& MapPublisher::surfaceOf(const MapState& state) {
  if (surface_revision_ == state.revision) return surface_;
  if (!extractor_ || extractor_generation_ != state.generation) {
    extractor_ = std::make_unique<gpis_mapping::MeshExtractor>(state.snapshot->config());
    extractor_generation_ = state.generation;
  }
  surface_revision_ = 0;
  extractor_->update(*state.snapshot);
  surface_ = extractor_->mesh();
  surface_revision_ = state.revision;
  return surface_;
}

void MapPublisher::getMesh(const interactive_mapping_msgs::GetMesh::Request& request,
                           interactive_mapping_msgs::GetMesh::Response* response) {
  MapState state;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    state = state_;
  }
  response->revision = first_revision_ + state.revision;
  if (request.revision == response->revision) {
    response->mesh.header = headerOf(state);
    response->mesh.update = state.snapshot->numUpdates();
    return;
  }
  const std::lock_guard<std::mutex> lock(mesh_mutex_);
  response->mesh = toSurfaceMesh(surfaceOf(state), headerOf(state), state.snapshot->numUpdates());
}

std::string MapPublisher::lastError() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return last_error_;
}

void MapPublisher::work() {
  SteadyTime next = std::chrono::steady_clock::now();
  while (true) {
    std::uint64_t taken = 0;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      // Removed points fade although nothing else happens.
      const auto isDue = [this] { return is_stopping_ || has_news_; };
      if (removed_.empty()) {
        changed_.wait(lock, isDue);
      } else {
        changed_.wait_for(lock, toSteady(1.0 / output_.rate_hz), isDue);
      }
      if (is_stopping_) return;
      if (!output_.every_image) changed_.wait_until(lock, next, [this] { return is_stopping_; });
      if (is_stopping_) return;
      has_news_ = false;
      taken = num_states_;
      next = std::chrono::steady_clock::now() + toSteady(1.0 / output_.rate_hz);
    }
    std::string error;
    try {
      publish();
    } catch (const std::exception& e) {  // out of memory, say: the map itself is not touched
      error = e.what();
    }
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      last_error_ = error;
      num_states_published_ = taken;
    }
    changed_.notify_all();
  }
}

bool MapPublisher::takeWanted(Output* output) {
  if (!output->is_stale || output->publisher.getNumSubscribers() == 0) return false;
  output->is_stale = false;
  return true;
}

bool MapPublisher::removedHaveExpired(const ros::Time& now) {
  bool has_changed = false;
  while (!removed_.empty()) {
    const double age = (now - removed_.front().first).toSec();
    if (age >= 0.0 && age <= output_.removed_display_s) break;  // negative: time ran back
    removed_.pop_front();
    has_changed = true;
  }
  return has_changed;
}

void MapPublisher::publish() {
  MapState state;
  GpisMappingParams::Output output;
  GpisMappingParams::Slice slice;
  std::vector<Eigen::Vector3d> removed;
  // Together with the state that they are to be shown: a state that comes meanwhile makes its outputs stale again.
  bool wants_mesh = false;
  bool wants_marker = false;
  bool wants_points = false;
  bool wants_removed_points = false;
  bool wants_frame_map = false;
  bool wants_ground = false;
  bool wants_slice_cloud = false;
  bool wants_slice_marker = false;
  {
    const ros::Time now = ros::Time::now();
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!state_.snapshot) return;
    if (removedHaveExpired(now)) removed_points_.is_stale = true;
    state = state_;
    output = output_;
    slice = slice_;
    for (const auto& entry : removed_) removed.insert(removed.end(), entry.second.begin(), entry.second.end());
    wants_mesh = takeWanted(&mesh_);
    wants_marker = takeWanted(&marker_);
    wants_points = takeWanted(&points_);
    wants_removed_points = takeWanted(&removed_points_);
    wants_frame_map = state.blanket && takeWanted(&frame_map_);
    wants_ground = takeWanted(&ground_);
    wants_slice_cloud = takeWanted(&slice_cloud_);
    wants_slice_marker = takeWanted(&slice_marker_);
  }
  const std_msgs::Header header = headerOf(state);
  if (wants_mesh || wants_marker) {
    const std::lock_guard<std::mutex> lock(mesh_mutex_);
    const gpis_mapping::TriangleMesh& mesh = surfaceOf(state);
    if (wants_mesh) {
      mesh_.publisher.publish(boost::make_shared<const interactive_mapping_msgs::SurfaceMesh>(
          toSurfaceMesh(mesh, header, state.snapshot->numUpdates())));
    }
    if (wants_marker) {
      marker_.publisher.publish(boost::make_shared<const visualization_msgs::Marker>(
          toMarker(mesh, header, output.mesh_color, output.color_max_std_m)));
    }
  }
  if (wants_points) {
    points_.publisher.publish(
        boost::make_shared<const sensor_msgs::PointCloud2>(toPointCloud(*state.snapshot, header)));
  }
  if (wants_removed_points) {
    removed_points_.publisher.publish(
        boost::make_shared<const sensor_msgs::PointCloud2>(toPointCloud(removed, header)));
  }
  if (wants_frame_map) {
    frame_map_.publisher.publish(
        boost::make_shared<const visualization_msgs::MarkerArray>(toMarkers(*state.blanket, header)));
  }
  if (wants_ground) {
    const auto grid = gpis_mapping::projectToGround(*state.snapshot, ground_options_);
    gpis_mapping::GroundGrid none;  // one unknown cell: rviz takes a grid without cells for an error
    none.cell_size_m = ground_options_.cell_size_m;
    none.width = none.height = 1;
    none.state = {gpis_mapping::SpaceState::kUnknown};
    const nav_msgs::OccupancyGrid message = toOccupancyGrid(grid ? *grid : none, header);
    ground_.publisher.publish(boost::make_shared<const nav_msgs::OccupancyGrid>(message));
  }
  if (wants_slice_cloud || wants_slice_marker) {
    const SliceCells cells = makeSlice(*state.snapshot, slice, kMaxSliceCells);
    if (wants_slice_cloud) {
      slice_cloud_.publisher.publish(boost::make_shared<const sensor_msgs::PointCloud2>(toPointCloud(cells, header)));
    }
    if (wants_slice_marker) {
      slice_marker_.publisher.publish(boost::make_shared<const visualization_msgs::Marker>(toMarker(cells, header)));
    }
  }
  placeSliceHandle(state, slice.height_m);
}

void MapPublisher::placeSliceHandle(const MapState& state, double height_m) {
  if (state.snapshot->cells().empty()) return;
  if (has_handle_ && handle_height_m_ == height_m) return;
  if (has_handle_) {  // not inserted anew: that would tear it out of the hand that drags it
    geometry_msgs::Pose pose = handle_pose_;
    pose.position.z = height_m;
    slice_handle_.setPose(kSliceHandle, pose);
    slice_handle_.applyChanges();
    handle_height_m_ = height_m;
    return;
  }
  // In the middle of what the first image showed: where one looks.
  const gpis_mapping::GpisConfig::Cells& cells = state.snapshot->config().cells;
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d high = -low;
  for (const auto& entry : state.snapshot->cells()) {
    const Eigen::AlignedBox3d box = cells.box(entry.first);
    low = low.cwiseMin(box.min().head<2>());
    high = high.cwiseMax(box.max().head<2>());
  }
  const Eigen::Vector2d middle = 0.5 * (low + high);
  visualization_msgs::InteractiveMarker handle;
  handle.header.frame_id = map_frame_;  // stamp 0: always drawn at its newest
  handle.name = kSliceHandle;
  handle.description = "slice";
  handle.scale = 0.3f;
  handle.pose.position.x = middle.x();
  handle.pose.position.y = middle.y();
  handle.pose.position.z = height_m;
  handle.pose.orientation.w = 1.0;
  visualization_msgs::InteractiveMarkerControl up;
  up.name = "height";
  up.interaction_mode = visualization_msgs::InteractiveMarkerControl::MOVE_AXIS;
  // Its x axis turned to z.
  up.orientation.w = up.orientation.y = std::sqrt(0.5);
  handle.controls.push_back(up);
  slice_handle_.insert(handle, [this](const visualization_msgs::InteractiveMarkerFeedbackConstPtr& feedback) {
    if (feedback->event_type != visualization_msgs::InteractiveMarkerFeedback::POSE_UPDATE) return;
    const double dragged_m = feedback->pose.position.z;
    if (!std::isfinite(dragged_m)) return;
    std::function<void(double)> callback;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      callback = on_slice_dragged_;
    }
    setSliceHeight(dragged_m);
    if (callback) callback(dragged_m);
  });
  slice_handle_.applyChanges();
  handle_pose_ = handle.pose;
  has_handle_ = true;
  handle_height_m_ = height_m;
}

}  // namespace gpis_mapping_ros
