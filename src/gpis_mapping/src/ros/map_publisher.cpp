// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/map_publisher.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <nav_msgs/OccupancyGrid.h>
#include <sensor_msgs/PointCloud2.h>
#include <visualization_msgs/InteractiveMarker.h>
#include <visualization_msgs/Marker.h>
#include <visualization_msgs/MarkerArray.h>

#include "gpis_mapping/ground_projection.h"
#include "gpis_mapping/voxel_states.h"
#include "gpis_mapping_ros/map_messages.h"
#include "gpis_mapping_ros/octomap_messages.h"

namespace gpis_mapping_ros {
namespace {

constexpr std::size_t kMaxSliceCells = 20000;      // about 0.1 s of queries
constexpr std::size_t kMaxRemovedPoints = 200000;  // shown at once
constexpr std::size_t kMaxVoxels = 4'000'000;      // some 10 s and 200 MB
constexpr char kSliceHandle[] = "slice";

// Topics that more than their maker knows by name.
constexpr char kMeshMarker[] = "mesh_marker";
constexpr char kRemovedPoints[] = "removed_points";
constexpr char kFrameMap[] = "frame_map";
constexpr char kSlice[] = "slice";
constexpr char kEsdfSlice[] = "esdf_slice";
constexpr char kSliceMarker[] = "slice_marker";

gpis_mapping::VoxelStates makeVoxels(const MapState& state, double resolution_m) {
  return gpis_mapping::classifyVoxels(*state.snapshot, resolution_m, kMaxVoxels);
}

std::chrono::steady_clock::duration toSteady(double duration_s) {
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(duration_s));
}

}  // namespace

struct MapPublisher::Shown {
  MapState state;
  std_msgs::Header header;
  GpisMappingParams::Output output;
  GpisMappingParams::Slice slice;
  std::vector<Eigen::Vector3d> removed;
  std::optional<SliceCells> slice_cells;
  std::optional<gpis_mapping::VoxelStates> voxels;
  std::unique_ptr<octomap::OcTree> octree;

  const SliceCells& sliceCells() {
    if (!slice_cells) slice_cells = makeSlice(*state.snapshot, slice, kMaxSliceCells);
    return *slice_cells;
  }
  const gpis_mapping::VoxelStates& voxelsOf(double resolution_m) {
    if (!voxels) voxels = makeVoxels(state, resolution_m);
    return *voxels;
  }
  const octomap::OcTree& octreeOf(double resolution_m) {
    if (!octree) octree = toOctree(voxelsOf(resolution_m));
    return *octree;
  }
};

template <typename Message, typename Make>
void MapPublisher::addOutput(ros::NodeHandle* nh, const std::string& topic, bool is_of_mesh, Make make) {
  Output* output = nullptr;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    outputs_.emplace_back();
    output = &outputs_.back();
    output->topic = topic;
    output->is_of_mesh = is_of_mesh;
    output->publish = [make](const ros::Publisher& publisher, Shown* shown) {
      publisher.publish(boost::make_shared<const Message>(make(shown)));
    };
  }
  const ros::SubscriberStatusCallback connected = [this, output](const ros::SingleSubscriberPublisher&) {
    const std::lock_guard<std::mutex> lock(mutex_);
    output->is_stale = true;
    has_news_ = true;
    changed_.notify_all();
  };
  ros::Publisher publisher = nh->advertise<Message>(topic, 1, connected);
  const std::lock_guard<std::mutex> lock(mutex_);
  output->publisher = publisher;
}

MapPublisher::MapPublisher(const ros::NodeHandle& private_nh, const GpisMappingParams& params)
    : map_frame_(params.input.map_frame),
      ground_options_(params.ground),
      octomap_resolution_m_(params.octomap.resolution_m),
      output_(params.output),
      slice_(params.slice),
      slice_handle_(private_nh.resolveName("slice_handle"), "", true) {
  using sensor_msgs::PointCloud2;
  using visualization_msgs::Marker;
  ros::NodeHandle nh(private_nh);
  const auto withMesh = [this](Shown* shown, const auto& convert) {
    const std::lock_guard<std::mutex> lock(mesh_mutex_);
    return convert(surfaceOf(shown->state));
  };
  addOutput<interactive_mapping_msgs::SurfaceMesh>(&nh, "mesh", true, [withMesh](Shown* shown) {
    return withMesh(shown, [shown](const gpis_mapping::TriangleMesh& mesh) {
      return toSurfaceMesh(mesh, shown->header, shown->state.snapshot->numUpdates());
    });
  });
  addOutput<Marker>(&nh, kMeshMarker, true, [withMesh](Shown* shown) {
    return withMesh(shown, [shown](const gpis_mapping::TriangleMesh& mesh) {
      return toMarker(mesh, shown->header, shown->output.mesh_color, shown->output.color_max_std_m);
    });
  });
  addOutput<PointCloud2>(&nh, "surface_cloud", true, [withMesh](Shown* shown) {
    return withMesh(shown,
                    [shown](const gpis_mapping::TriangleMesh& mesh) { return toPointCloud(mesh, shown->header); });
  });
  addOutput<PointCloud2>(&nh, "points", false,
                         [](Shown* shown) { return toPointCloud(*shown->state.snapshot, shown->header); });
  addOutput<PointCloud2>(&nh, kRemovedPoints, false,
                         [](Shown* shown) { return toPointCloud(shown->removed, shown->header); });
  addOutput<visualization_msgs::MarkerArray>(
      &nh, kFrameMap, false, [](Shown* shown) { return toMarkers(*shown->state.blanket, shown->header); });
  addOutput<nav_msgs::OccupancyGrid>(&nh, "ground", false, [this](Shown* shown) {
    const auto grid = gpis_mapping::projectToGround(*shown->state.snapshot, ground_options_);
    gpis_mapping::GroundGrid none;  // one unknown cell: rviz takes a grid without cells for an error
    none.cell_size_m = ground_options_.cell_size_m;
    none.width = none.height = 1;
    none.state = {gpis_mapping::SpaceState::kUnknown};
    return toOccupancyGrid(grid ? *grid : none, shown->header);
  });
  addOutput<PointCloud2>(&nh, kSlice, false,
                         [](Shown* shown) { return toPointCloud(shown->sliceCells(), shown->header); });
  addOutput<PointCloud2>(&nh, kEsdfSlice, false,
                         [](Shown* shown) { return toIntensityCloud(shown->sliceCells(), shown->header); });
  addOutput<Marker>(&nh, kSliceMarker, false,
                    [](Shown* shown) { return toMarker(shown->sliceCells(), shown->header); });
  addOutput<octomap_msgs::Octomap>(&nh, "octomap_full", false, [this](Shown* shown) {
    return toFullMessage(shown->octreeOf(octomap_resolution_m_), shown->header);
  });
  addOutput<octomap_msgs::Octomap>(&nh, "octomap_binary", false, [this](Shown* shown) {
    return toBinaryMessage(shown->octreeOf(octomap_resolution_m_), shown->header);
  });
  addOutput<octomap_msgs::OctomapWithPose>(&nh, "octomap_with_pose", false, [this](Shown* shown) {
    octomap_msgs::OctomapWithPose placed;
    placed.header = shown->header;
    placed.origin.orientation.w = 1.0;
    placed.octomap = toBinaryMessage(shown->octreeOf(octomap_resolution_m_), shown->header);
    return placed;
  });
  addOutput<PointCloud2>(&nh, "esdf_pointcloud", false, [this](Shown* shown) {
    return toIntensityCloud(*shown->state.snapshot, shown->voxelsOf(octomap_resolution_m_), shown->header);
  });
  worker_ = std::thread(&MapPublisher::work, this);
}

MapPublisher::~MapPublisher() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_stopping_ = true;
  }
  changed_.notify_all();
  worker_.join();
  for (Output& output : outputs_) output.publisher.shutdown();  // no callback of theirs may find this object gone
}

void MapPublisher::setState(const MapState& state, const std::vector<Eigen::Vector3d>& removed_points_map) {
  const ros::Time now = ros::Time::now();
  std::uint64_t number = 0;
  bool waits = false;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const double mesh_age_s = (state.stamp - mesh_stamp_).toSec();  // negative: time ran back
    const bool is_taken_out = state.stamp == state_.stamp;  // by a service, or with a brick: no image may follow
    const bool is_mesh_due = state.generation != state_.generation || is_taken_out || mesh_age_s < 0.0 ||
                             mesh_age_s >= output_.mesh_period_s;
    if (is_mesh_due) mesh_stamp_ = state.stamp;
    if (state.generation != state_.generation) removed_.clear();
    state_ = state;
    if (!removed_points_map.empty()) removed_.emplace_back(now, removed_points_map);
    std::size_t total = 0;
    for (const auto& entry : removed_) total += entry.second.size();
    while (total > kMaxRemovedPoints && removed_.size() > 1) {
      total -= removed_.front().second.size();
      removed_.pop_front();
    }
    for (Output& output : outputs_) output.is_stale = output.is_stale || !output.is_of_mesh || is_mesh_due;
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
  return std::any_of(outputs_.begin(), outputs_.end(), [](const Output& output) {
    return output.topic == kFrameMap && output.publisher.getNumSubscribers() > 0;
  });
}

void MapPublisher::setOutput(const GpisMappingParams::Output& output) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    output_ = output;
    markStale({kMeshMarker, kRemovedPoints});
    has_news_ = true;
  }
  changed_.notify_all();
}

void MapPublisher::setSliceHeight(double height_m) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (slice_.height_m == height_m) return;
    slice_.height_m = height_m;
    markStale({kSlice, kEsdfSlice, kSliceMarker});
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

gpis_mapping::MeshExtractor& MapPublisher::extractorOf(const MapState& state) {
  if (!extractor_ || extractor_generation_ != state.generation) {
    extractor_ = std::make_unique<gpis_mapping::MeshExtractor>(state.snapshot->config());
    extractor_generation_ = state.generation;
  }
  extractor_->update(*state.snapshot);
  return *extractor_;
}

const gpis_mapping::TriangleMesh& MapPublisher::surfaceOf(const MapState& state) {
  if (surface_revision_ == state.revision) return surface_;
  surface_revision_ = 0;
  surface_ = extractorOf(state).mesh();
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
  const Eigen::AlignedBox3d box_map = boxOf(request);
  const std::lock_guard<std::mutex> lock(mesh_mutex_);
  response->mesh = toSurfaceMesh(extractorOf(state).mesh(box_map), headerOf(state), state.snapshot->numUpdates());
}

octomap_msgs::Octomap MapPublisher::getOctomap(bool binary) const {
  MapState state;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    state = state_;
  }
  const auto tree = toOctree(makeVoxels(state, octomap_resolution_m_));
  return binary ? toBinaryMessage(*tree, headerOf(state)) : toFullMessage(*tree, headerOf(state));
}

std::string MapPublisher::lastError() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return last_error_;
}

std::map<std::string, std::uint64_t> MapPublisher::numMade() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::map<std::string, std::uint64_t> made;
  for (const Output& output : outputs_) {
    if (output.num_made > 0) made[output.topic] = output.num_made;
  }
  return made;
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
      error = publish();
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

std::vector<MapPublisher::Output*> MapPublisher::takeWanted() {
  std::vector<Output*> wanted;
  for (Output& output : outputs_) {
    if (!output.is_stale || output.publisher.getNumSubscribers() == 0) continue;
    if (output.topic == kFrameMap && !state_.blanket) continue;  // subscribed after the image: with the next one
    output.is_stale = false;
    ++output.num_made;
    wanted.push_back(&output);
  }
  return wanted;
}

void MapPublisher::markStale(const std::vector<std::string>& topics) {
  for (Output& output : outputs_) {
    if (std::find(topics.begin(), topics.end(), output.topic) != topics.end()) output.is_stale = true;
  }
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

std::string MapPublisher::publish() {
  Shown shown;
  // Together with the state that they are to be shown: a state that comes meanwhile makes its outputs stale again.
  std::vector<Output*> wanted;
  {
    const ros::Time now = ros::Time::now();
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!state_.snapshot) return "";
    if (removedHaveExpired(now)) markStale({kRemovedPoints});
    shown.state = state_;
    shown.output = output_;
    shown.slice = slice_;
    for (const auto& entry : removed_) {
      shown.removed.insert(shown.removed.end(), entry.second.begin(), entry.second.end());
    }
    wanted = takeWanted();
  }
  shown.header = headerOf(shown.state);
  std::string error;
  for (Output* output : wanted) {
    try {
      output->publish(output->publisher, &shown);
    } catch (const std::exception& e) {  // out of memory, say, or too many voxels: the others are published
      error = "~" + output->topic + ": " + e.what();
    }
  }
  placeSliceHandle(shown.state, shown.slice.height_m);
  return error;
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
