// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/gpis_mapping_ros.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <interactive_mapping_common/files/atomic_file.h>
#include <interactive_mapping_common/formatted.h>

#include <ros/console.h>
#include <tf2/exceptions.h>

#include "depth_camera_ros/pose_diagnostics.h"
#include "gpis_mapping/map_io.h"
#include "gpis_mapping_ros/map_messages.h"
#include "gpis_mapping_ros/query_service.h"

namespace gpis_mapping_ros {
namespace {

using depth_camera_ros::toIsometry;
using diagnostic_msgs::DiagnosticStatus;
using gpis_mapping::GpisConfig;
using gpis_mapping::GpisMap;
using gpis_mapping::MapContents;
using interactive_mapping::formatted;

constexpr char kLog[] = "gpis_mapping";
constexpr double kWindow_s = 5.0;      // over which diagnostics count
constexpr double kSilence_s = 2.0;     // without an image: a warning
constexpr double kWarnPeriod_s = 5.0;  // a message in a callback is repeated no more often

/// The map's settings that belong to a file's points, beside those that belong to this node's camera and use.
GpisConfig mergedConfig(const GpisConfig& of_node, const GpisConfig& of_file) {
  GpisConfig config = of_node;
  config.surface = of_file.surface;
  config.cells = of_file.cells;
  config.observed = of_file.observed;
  return config;
}

/// A name beside `path` that no file has.
std::string nameAside(const std::string& path) {
  for (int i = 0; i < 1000; ++i) {
    const std::string name = path + ".unreadable" + (i == 0 ? "" : "." + std::to_string(i));
    if (!std::filesystem::exists(name)) return name;
  }
  return path + ".unreadable";
}

}  // namespace

GpisMappingRos::GpisMappingRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : params_(loadGpisMappingParams(private_nh)),
      map_(std::make_unique<GpisMap>(params_.map)),
      tuned_(params_.map),
      publisher_(private_nh, params_),
      diagnostics_(nh, private_nh, private_nh.getNamespace()) {
  ROS_INFO_STREAM_NAMED(kLog, "map configuration:\n" << gpis_mapping::toYaml(params_.map));
  ROS_INFO_STREAM_NAMED(kLog, "node configuration:\n" << interactive_mapping::toYaml(params_));
  {
    const std::lock_guard<std::mutex> lock(map_mutex_);
    takeState(ros::Time(), true, {});
    const std::lock_guard<std::mutex> report_lock(report_mutex_);
    saved_revision_ = state_.revision;  // an empty map is not worth a file
  }
  if (!params_.storage.autosave_file.empty() && params_.storage.restore_on_start) restore();

  ros::NodeHandle pnh(private_nh);
  update_publisher_ = pnh.advertise<MapUpdate>("update", 50);
  const auto addInput = [&](const DepthInputParams& input, const DepthTopics& topics) {
    const std::size_t camera = inputs_.size();
    inputs_.push_back(std::make_unique<DepthInput>(
        nh, private_nh, input, [this, camera](const DepthInputFrame& frame) { return consume(camera, frame); },
        [this, camera](const ros::Time& stamp, const Refusal& refusal) { refuse(camera, stamp, refusal); }, topics));
  };
  addInput(params_.input, {});
  for (const std::string& topic : params_.more_depth_topics) {
    DepthInputParams input = params_.input;
    input.camera_frame.clear();
    addInput(input, topicsBeside(topic));
  }
  live_ = std::make_unique<interactive_mapping_ros::LiveParams<GpisMappingParamsWithMap>>(
      private_nh, GpisMappingParamsWithMap{params_},
      [this](const GpisMappingParamsWithMap& params) { onTune(params); });
  publisher_.onSliceDragged([this](double height_m) {
    live_->edit([height_m](GpisMappingParamsWithMap& params) { params.slice.height_m = height_m; });
  });

  if (params_.attached.clear) {
    attached_subscriber_ = ros::NodeHandle(nh).subscribe("attached_brick", 5, &GpisMappingRos::onAttached, this);
  }
  query_server_ = pnh.advertiseService("query", &GpisMappingRos::onQuery, this);
  mesh_server_ = pnh.advertiseService("get_mesh", &GpisMappingRos::onGetMesh, this);
  using GetOctomap = octomap_msgs::GetOctomap;
  full_server_ = pnh.advertiseService<GetOctomap::Request, GetOctomap::Response>(
      "octomap_full", [this](auto&, auto& response) { return onGetOctomap(false, &response); });
  binary_server_ = pnh.advertiseService<GetOctomap::Request, GetOctomap::Response>(
      "octomap_binary", [this](auto&, auto& response) { return onGetOctomap(true, &response); });
  save_server_ = pnh.advertiseService("save_map", &GpisMappingRos::onSave, this);
  load_server_ = pnh.advertiseService("load_map", &GpisMappingRos::onLoad, this);
  clear_server_ = pnh.advertiseService("clear_map", &GpisMappingRos::onClear, this);
  clear_box_server_ = pnh.advertiseService("clear_box", &GpisMappingRos::onClearBox, this);

  diagnostics_.setHardwareID("none");
  for (std::size_t camera = 0; camera < inputs_.size(); ++camera) {
    const std::string number = camera == 0 ? "" : " " + std::to_string(camera + 1);
    diagnostics_.add("input" + number, [this, camera](auto& status) { diagnoseInput(camera, status); });
    diagnostics_.add("transforms" + number, [this, camera](auto& status) { diagnoseTransforms(camera, status); });
  }
  diagnostics_.add("map", this, &GpisMappingRos::diagnoseMap);
  diagnostics_.add("storage", this, &GpisMappingRos::diagnoseStorage);
  // By the wall clock, which the updater's own timing is not: a stopped simulation must be diagnosed as well.
  diagnostics_timer_ = pnh.createWallTimer(ros::WallDuration(diagnostics_.getPeriod()),
                                           [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); });
  if (!params_.storage.autosave_file.empty()) {
    autosave_timer_ = pnh.createWallTimer(ros::WallDuration(params_.storage.autosave_period_s),
                                          [this](const ros::WallTimerEvent&) { onAutosave(); });
  }
  for (const auto& input : inputs_) {
    ROS_INFO_NAMED(kLog, "mapping %s with %s in frame '%s'", input->imageTopic().c_str(), input->infoTopic().c_str(),
                   params_.input.map_frame.c_str());
  }
}

GpisMappingRos::~GpisMappingRos() {
  // Each of these waits for its callback in progress; then nobody uses the input any more.
  autosave_timer_.stop();
  diagnostics_timer_.stop();
  for (ros::ServiceServer* server : {&query_server_, &mesh_server_, &full_server_, &binary_server_, &save_server_,
                                     &load_server_, &clear_server_, &clear_box_server_}) {
    server->shutdown();
  }
  attached_subscriber_.shutdown();
  publisher_.onSliceDragged(nullptr);
  live_.reset();
  inputs_.clear();
  if (!params_.storage.autosave_file.empty()) onAutosave();
}

Refusal GpisMappingRos::consume(std::size_t camera, const DepthInputFrame& frame) {
  MapUpdate message;
  {
    const std::lock_guard<std::mutex> lock(map_mutex_);
    clearAttached();
    gpis_mapping::UpdateStatistics statistics;
    std::shared_ptr<gpis_mapping::FrameBlanket> blanket;
    if (publisher_.wantsBlanket()) blanket = std::make_shared<gpis_mapping::FrameBlanket>();
    try {
      statistics =
          map_->update(frame.image, frame.camera, frame.T_map_camera, frame.stamp.toSec(), blanket.get(), camera);
    } catch (const std::exception& error) {
      // What the update had done before it failed is part of the map; readers see a consistent snapshot either way.
      return {FrameStatus::kRefusedByMap, error.what()};
    }
    // Images of several cameras come a little out of order; a clock that ran back is another matter.
    const ros::Time newest = state().stamp;
    const bool is_overtaken = inputs_.size() > 1 && newest > frame.stamp && newest < frame.stamp + ros::Duration(1.0);
    takeState(is_overtaken ? newest : frame.stamp, false, statistics.removed_points_map, std::move(blanket));
    std_msgs::Header header;
    header.stamp = frame.stamp;
    header.frame_id = params_.input.map_frame;
    message = toMapUpdate(statistics, header, map_->snapshot()->numUpdates(), frame.wait_ms);
  }
  noteFrame(camera, true, message.total_ms, ros::Time::now().toSec() - frame.stamp.toSec());
  ROS_DEBUG_NAMED(kLog, "update %lu: %.1f ms, %u points, +%u -%u", static_cast<unsigned long>(message.update),
                  message.total_ms, message.map_points, message.inserted, message.deleted);
  // Last: whoever waits for it finds the map's answers up to date.
  update_publisher_.publish(message);
  return {};
}

void GpisMappingRos::refuse(std::size_t camera, const ros::Time& stamp, const Refusal& refusal) {
  ROS_WARN_STREAM_THROTTLE_NAMED(kWarnPeriod_s, kLog,
                                 "image rejected, " << toString(refusal.status) << ": " << refusal.message);
  noteFrame(camera, false, 0.0, 0.0);
  MapUpdate message;
  message.header.stamp = stamp;
  message.header.frame_id = params_.input.map_frame;
  message.status = static_cast<std::uint8_t>(refusal.status);
  message.message = refusal.message;
  const MapState now = state();
  message.update = now.snapshot->numUpdates();
  message.map_points = static_cast<std::uint32_t>(now.snapshot->numPoints());
  update_publisher_.publish(message);
}

void GpisMappingRos::noteFrame(std::size_t camera, bool is_accepted, double update_ms, double latency_s) {
  const ros::WallTime now = ros::WallTime::now();
  const std::lock_guard<std::mutex> lock(report_mutex_);
  recent_.push_back({camera, now, is_accepted, update_ms, latency_s});
  while (!recent_.empty() && (now - recent_.front().done).toSec() > kWindow_s) recent_.pop_front();
}

MapState GpisMappingRos::state() const {
  const std::lock_guard<std::mutex> lock(state_mutex_);
  return state_;
}

void GpisMappingRos::takeState(const ros::Time& stamp, bool is_new_map, const std::vector<Eigen::Vector3d>& removed,
                               std::shared_ptr<const gpis_mapping::FrameBlanket> blanket) {
  MapState next;
  {
    const std::lock_guard<std::mutex> lock(state_mutex_);
    state_.snapshot = map_->snapshot();
    state_.blanket = std::move(blanket);
    state_.stamp = stamp;
    if (is_new_map) ++state_.generation;
    ++state_.revision;
    next = state_;
  }
  publisher_.setState(next, removed);
}

bool GpisMappingRos::onQuery(interactive_mapping_msgs::QueryMap::Request& request,
                             interactive_mapping_msgs::QueryMap::Response& response) {
  const auto map = [this] {
    const MapState now = state();
    const double prior_std = now.snapshot->config().signalStd();
    return QueriedMap{
        now.stamp, now.snapshot->numUpdates(), now.snapshot->cells().empty(), prior_std * prior_std,
        [snapshot = now.snapshot](const gpis_mapping::Points3d& points, const gpis_mapping::QueryOptions& options) {
          return snapshot->query(points, options);
        }};
  };
  answerQuery(request, params_.input.map_frame, tfBuffer(), map, &response);
  return true;
}

bool GpisMappingRos::onGetMesh(interactive_mapping_msgs::GetMesh::Request& request,
                               interactive_mapping_msgs::GetMesh::Response& response) {
  try {
    publisher_.getMesh(request, &response);
    return true;
  } catch (const std::exception& error) {
    ROS_ERROR_NAMED(kLog, "no mesh could be made: %s", error.what());
    return false;
  }
}

bool GpisMappingRos::onGetOctomap(bool binary, octomap_msgs::GetOctomap::Response* response) {
  try {
    response->map = publisher_.getOctomap(binary);
    return true;
  } catch (const std::exception& error) {
    ROS_ERROR_NAMED(kLog, "no octomap could be made: %s", error.what());
    return false;
  }
}

std::size_t GpisMappingRos::save(const std::string& path) {
  MapContents contents;
  std::uint64_t revision = 0;
  {
    const std::lock_guard<std::mutex> lock(map_mutex_);
    contents = map_->contents();
    revision = state().revision;
  }
  gpis_mapping::saveMap(contents, path);
  if (path == params_.storage.autosave_file) {
    const std::lock_guard<std::mutex> lock(report_mutex_);
    saved_revision_ = revision;
    saved_at_ = ros::WallTime::now();
    save_error_.clear();
  }
  return contents.points.size();
}

std::string GpisMappingRos::load(const std::string& path, std::size_t* num_points) {
  MapContents contents = gpis_mapping::loadMap(path);
  const GpisConfig of_file = contents.config;
  GpisConfig of_node;
  {
    const std::lock_guard<std::mutex> lock(map_mutex_);
    of_node = tuned_;
  }
  contents.config = mergedConfig(of_node, of_file);
  *num_points = contents.points.size();
  float newest_s = 0.0f;
  for (const gpis_mapping::SurfacePoint& point : contents.points) newest_s = std::max(newest_s, point.last_seen_s);
  const double stamp_s = contents.epoch_s + static_cast<double>(newest_s);
  const ros::Time stamp =
      stamp_s > 0.0 && stamp_s < std::numeric_limits<std::uint32_t>::max() ? ros::Time(stamp_s) : ros::Time();
  const bool differs = gpis_mapping::toYaml(contents.config) != gpis_mapping::toYaml(of_node);
  auto map = std::make_unique<GpisMap>(std::move(contents));  // trains; readers and updates go on meanwhile
  {
    const std::lock_guard<std::mutex> lock(map_mutex_);
    map->retune(tuned_.sensor, tuned_.dynamic);  // which may have changed meanwhile
    map_ = std::move(map);
    tuned_ = map_->config();
    takeState(stamp, true, {});
  }
  resetPoseGuards();
  return differs ? "the sections surface, cells and observed of the file differ from the node's parameters and are used"
                 : "";
}

void GpisMappingRos::resetPoseGuards() {
  for (const auto& input : inputs_) input->resetPoseGuard();
}

void GpisMappingRos::restore() {
  const std::string& path = params_.storage.autosave_file;
  if (!std::filesystem::exists(path)) {
    ROS_INFO_NAMED(kLog, "no map to restore: %s does not exist yet", path.c_str());
    return;
  }
  try {
    std::size_t num_points = 0;
    const std::string note = load(path, &num_points);
    const MapState now = state();
    const std::lock_guard<std::mutex> lock(report_mutex_);
    saved_revision_ = now.revision;
    ROS_INFO_NAMED(kLog, "restored %zu points from %s. %s", num_points, path.c_str(), note.c_str());
  } catch (const std::exception& error) {
    // The next autosave would overwrite what somebody may still want to rescue.
    const std::string aside = nameAside(path);
    std::error_code failure;
    std::filesystem::rename(path, aside, failure);
    ROS_ERROR_NAMED(kLog, "map not restored, starting empty: %s. The file %s %s", error.what(),
                    failure ? "could not be moved to" : "is now", aside.c_str());
  }
}

bool GpisMappingRos::onSave(interactive_mapping_msgs::SaveMap::Request& request,
                            interactive_mapping_msgs::SaveMap::Response& response) {
  response.path = request.path.empty() ? params_.storage.autosave_file : request.path;
  try {
    if (response.path.empty()) throw std::invalid_argument("path is empty and storage/autosave_file is not set");
    interactive_mapping::requireUsablePath(response.path);
    const std::lock_guard<std::mutex> lock(file_mutex_);
    response.num_points = save(response.path);
    response.success = true;
    ROS_INFO_NAMED(kLog, "saved %lu points to %s", static_cast<unsigned long>(response.num_points),
                   response.path.c_str());
  } catch (const std::exception& error) {
    response.message = error.what();
    ROS_ERROR_NAMED(kLog, "map not saved: %s", error.what());
  }
  return true;
}

bool GpisMappingRos::onLoad(interactive_mapping_msgs::LoadMap::Request& request,
                            interactive_mapping_msgs::LoadMap::Response& response) {
  response.path = request.path.empty() ? params_.storage.autosave_file : request.path;
  try {
    if (response.path.empty()) throw std::invalid_argument("path is empty and storage/autosave_file is not set");
    interactive_mapping::requireUsablePath(response.path);
    const std::lock_guard<std::mutex> lock(file_mutex_);
    std::size_t num_points = 0;
    response.message = load(response.path, &num_points);
    response.num_points = num_points;
    response.success = true;
    ROS_INFO_NAMED(kLog, "loaded %zu points from %s. %s", num_points, response.path.c_str(), response.message.c_str());
  } catch (const std::exception& error) {
    response.message = std::string(error.what()) + "; the map is as it was";
    ROS_ERROR_NAMED(kLog, "map not loaded: %s", error.what());
  }
  return true;
}

bool GpisMappingRos::onClear(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  try {
    const std::lock_guard<std::mutex> lock(map_mutex_);
    const std::size_t num_points = map_->snapshot()->numPoints();
    GpisConfig config = params_.map;  // a loaded file's cells and spacing go with its map
    config.sensor = tuned_.sensor;
    config.dynamic = tuned_.dynamic;
    map_ = std::make_unique<GpisMap>(config);
    tuned_ = config;
    takeState(state().stamp, true, {});
    response.success = true;
    response.message = "forgot " + std::to_string(num_points) + " points";
  } catch (const std::exception& error) {
    response.message = error.what();
  }
  resetPoseGuards();
  return true;
}

Eigen::Isometry3d GpisMappingRos::boxInMap(const std_msgs::Header& header, const geometry_msgs::Pose& pose) const {
  const std::string frame = interactive_mapping_ros::withoutSlash(header.frame_id);
  if (frame.empty()) throw std::invalid_argument("frame_id is empty, must name a frame");
  Refusal refusal;
  const auto T_frame_box = toIsometry(pose, &refusal);
  if (!T_frame_box) throw std::invalid_argument("of the box, the " + refusal.message);
  if (frame == params_.input.map_frame) return *T_frame_box;
  const auto T_map_frame =
      toIsometry(tfBuffer().lookupTransform(params_.input.map_frame, frame, header.stamp).transform, &refusal);
  if (!T_map_frame) throw std::invalid_argument("frame_id '" + frame + "': " + refusal.message);
  return *T_map_frame * *T_frame_box;
}

bool GpisMappingRos::onClearBox(interactive_mapping_msgs::ClearBox::Request& request,
                                interactive_mapping_msgs::ClearBox::Response& response) {
  try {
    const Eigen::Isometry3d T_map_box = boxInMap(request.pose.header, request.pose.pose);
    const Eigen::Vector3d size(request.size.x, request.size.y, request.size.z);
    const std::lock_guard<std::mutex> lock(map_mutex_);
    const std::vector<Eigen::Vector3d> removed = map_->clearBox(T_map_box, size);
    takeState(state().stamp, false, removed);
    response.num_removed = removed.size();
    response.success = true;
  } catch (const std::exception& error) {  // tf too
    response.message = error.what();
  }
  return true;
}

void GpisMappingRos::onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message) {
  const std::lock_guard<std::mutex> lock(map_mutex_);
  taken_.reset();
  if (message->is_attached == 0) return;
  taken_ = message;
  clearAttached();
}

void GpisMappingRos::clearAttached() {
  if (!taken_) return;
  // A latched message of long ago says where the tool was then, and the map has seen that place since.
  constexpr double kMaxAge_s = 5.0;
  const double age_s = (state().stamp - taken_->header.stamp).toSec();
  try {
    if (age_s > kMaxAge_s) {
      throw std::invalid_argument("the message is " + std::to_string(age_s) +
                                  " s older than the last image, allowed are " + std::to_string(kMaxAge_s) + " s");
    }
    const Eigen::Isometry3d T_map_brick = boxInMap(taken_->header, taken_->pose);
    const Eigen::Quaterniond q_frame_brick(taken_->pose.orientation.w, taken_->pose.orientation.x,
                                           taken_->pose.orientation.y, taken_->pose.orientation.z);
    const Eigen::Vector3d axis_map =
        T_map_brick.linear() * (q_frame_brick.normalized().inverse() * Eigen::Vector3d::UnitZ());
    const std::vector<Eigen::Vector3d> removed =
        map_->takeOut(T_map_brick, Eigen::Vector3d(taken_->size.x, taken_->size.y, taken_->size.z),
                      params_.attached.padding_m, taken_->header.stamp.toSec(), params_.attached.pushed_m * axis_map);
    takeState(state().stamp, false, removed);
    ROS_INFO_NAMED(kLog, "brick %d was taken: %zu points of it forgotten", taken_->id, removed.size());
  } catch (const tf2::ExtrapolationException&) {
    return;  // the arm's pose of that time is on its way: tried again before the next image
  } catch (const std::exception& error) {
    ROS_WARN_NAMED(kLog, "the volume of attached brick %d was not cleared: %s", taken_->id, error.what());
  }
  taken_.reset();
}

void GpisMappingRos::onTune(const GpisMappingParamsWithMap& params) {
  {
    const std::lock_guard<std::mutex> lock(map_mutex_);
    GpisConfig next = tuned_;
    next.sensor = params.map.sensor;
    next.dynamic = params.map.dynamic;
    if (gpis_mapping::toYaml(next) != gpis_mapping::toYaml(tuned_)) {
      map_->retune(next.sensor, next.dynamic);
      tuned_ = next;
    }
  }
  for (const auto& input : inputs_) input->setPoseLimits(params.input.pose_limits);
  publisher_.setOutput(params.output);
  publisher_.setSliceHeight(params.slice.height_m);
}

void GpisMappingRos::onAutosave() {
  const std::lock_guard<std::mutex> file_lock(file_mutex_);
  const MapState now = state();
  {
    const std::lock_guard<std::mutex> lock(report_mutex_);
    if (now.revision == saved_revision_) return;
  }
  try {
    save(params_.storage.autosave_file);
    ROS_DEBUG_NAMED(kLog, "autosaved to %s", params_.storage.autosave_file.c_str());
  } catch (const std::exception& error) {
    ROS_ERROR_THROTTLE_NAMED(kWarnPeriod_s, kLog, "autosave failed: %s", error.what());
    const std::lock_guard<std::mutex> lock(report_mutex_);
    save_error_ = error.what();
  }
}

void GpisMappingRos::diagnoseInput(std::size_t camera, diagnostic_updater::DiagnosticStatusWrapper& status) {
  const DepthInput& input = *inputs_[camera];
  const DepthInputCounters counters = input.counters();
  const ros::WallTime now = ros::WallTime::now();
  std::size_t accepted = 0;
  std::size_t refused = 0;
  double silence_s = kWindow_s;
  {
    const std::lock_guard<std::mutex> lock(report_mutex_);
    for (const FrameTimes& frame : recent_) {
      if (frame.camera != camera || (now - frame.done).toSec() > kWindow_s) continue;
      ++(frame.is_accepted ? accepted : refused);
      silence_s = std::min(silence_s, (now - frame.done).toSec());
    }
  }
  if (counters.received == 0) {
    status.summary(DiagnosticStatus::WARN, "no image received on " + input.imageTopic());
  } else if (silence_s > kSilence_s) {
    status.summary(DiagnosticStatus::WARN, "no image in the last " + formatted("%.0f s", kSilence_s));
  } else if (accepted == 0) {
    status.summary(DiagnosticStatus::ERROR, "every image is rejected; " + counters.last_refusal);
  } else if (refused * 10 > accepted + refused) {
    status.summary(DiagnosticStatus::WARN, std::to_string(refused) + " of " + std::to_string(accepted + refused) +
                                               " images rejected recently; " + counters.last_refusal);
  } else if (!counters.warning.empty()) {
    status.summary(DiagnosticStatus::WARN, counters.warning);
  } else {
    status.summary(DiagnosticStatus::OK, "images are taken in");
  }
  status.add("image topic", input.imageTopic());
  status.add("camera info topic", input.infoTopic());
  status.add("rate [Hz]", formatted("%.2f", static_cast<double>(accepted) / kWindow_s));
  status.add("received", counters.received);
  status.add("replaced by a newer one", counters.replaced);
  for (std::size_t i = 0; i < counters.by_status.size(); ++i) {
    const std::string name = toString(static_cast<FrameStatus>(i));
    status.add(i == 0 ? name : "left out: " + name, counters.by_status[i]);
  }
  if (!counters.last_refusal.empty()) status.add("last left out", counters.last_refusal);
}

void GpisMappingRos::diagnoseTransforms(std::size_t camera, diagnostic_updater::DiagnosticStatusWrapper& status) {
  const DepthInputCounters counters = inputs_[camera]->counters();
  const auto count = [&](FrameStatus refusal) { return counters.by_status[static_cast<std::size_t>(refusal)]; };
  depth_camera_ros::diagnosePoses(params_.input, counters.pose, count(FrameStatus::kPoseJump),
                                  count(FrameStatus::kTimeRanBack), "surface that was mapped before may be doubled",
                                  &status);
}

void GpisMappingRos::diagnoseMap(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const MapState now = state();
  double update_ms = 0.0;
  double max_ms = 0.0;
  double latency_s = 0.0;
  std::size_t count = 0;
  {
    const std::lock_guard<std::mutex> lock(report_mutex_);
    for (const FrameTimes& frame : recent_) {
      if (!frame.is_accepted) continue;
      ++count;
      update_ms += frame.update_ms;
      latency_s += frame.latency_s;
      max_ms = std::max(max_ms, frame.update_ms);
    }
  }
  const std::string display_error = publisher_.lastError();
  if (display_error.empty()) {
    status.summary(DiagnosticStatus::OK, "");
  } else {
    status.summary(DiagnosticStatus::ERROR, "cannot publish: " + display_error);
  }
  std::string made;
  for (const auto& [topic, number] : publisher_.numMade()) made += "~" + topic + " " + std::to_string(number) + " ";
  status.add("messages made for subscribers", made);
  status.add("images in the map", now.snapshot->numUpdates());
  status.add("points", now.snapshot->numPoints());
  status.add("memory [MB]", formatted("%.1f", static_cast<double>(now.snapshot->memoryBytes()) / 1e6));
  if (count > 0) {
    status.add("update, mean [ms]", formatted("%.1f", update_ms / static_cast<double>(count)));
    status.add("update, longest [ms]", formatted("%.1f", max_ms));
    status.add("latency from the image's stamp [s]", formatted("%.3f", latency_s / static_cast<double>(count)));
  }
}

void GpisMappingRos::diagnoseStorage(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const std::lock_guard<std::mutex> lock(report_mutex_);
  if (!save_error_.empty()) {
    status.summary(DiagnosticStatus::ERROR, "autosave failed: " + save_error_);
  } else {
    status.summary(DiagnosticStatus::OK, params_.storage.autosave_file.empty() ? "no autosave" : "");
  }
  status.add("autosave file", params_.storage.autosave_file);
  if (!saved_at_.isZero())
    status.add("last saved [s ago]", formatted("%.0f", (ros::WallTime::now() - saved_at_).toSec()));
}

}  // namespace gpis_mapping_ros
