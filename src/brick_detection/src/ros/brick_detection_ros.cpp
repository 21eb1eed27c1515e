// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/brick_detection_ros.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <stdexcept>
#include <utility>

#include <cv_bridge/cv_bridge.h>
#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common_ros/poses.h>
#include <ros/console.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2/exceptions.h>

#include "brick_detection/annotated_image.h"
#include "depth_camera_ros/pose_diagnostics.h"

namespace brick_detection_ros {
namespace {

using brick_detection::TagStatus;
using brick_detection::TrackedBrick;
using diagnostic_msgs::DiagnosticStatus;
using interactive_mapping::formatted;
using Update = interactive_mapping_msgs::BrickDetectionUpdate;

constexpr char kLog[] = "brick_detection";
constexpr double kWindow_s = 5.0;      // over which diagnostics count
constexpr double kSilence_s = 2.0;     // without an image: a warning
constexpr double kWarnPeriod_s = 5.0;  // a message in a callback is repeated no more often

std::string join(const std::vector<int>& ids) {
  std::string text;
  for (const int id : ids) text += (text.empty() ? "" : ", ") + std::to_string(id);
  return text;
}

/// What to say when the depth image denies everything that the colour image shows; empty: it does not.
std::string contradictionOf(const brick_detection::BrickPoseEstimator::Result& found) {
  int denied = 0;
  for (const brick_detection::TagSighting& tag : found.tags) {
    if (tag.status == TagStatus::kUsed) return "";
    denied += tag.status == TagStatus::kContradictsDepth ? 1 : 0;
  }
  if (denied == 0) return "";
  return "no tag is used, and " + std::to_string(denied) +
         " contradict the depth image: is it registered to the colour image, are depth_units_per_metre and the tags' "
         "size "
         "right?";
}

}  // namespace

BrickDetectionRos::BrickDetectionRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : params_(loadBrickDetectionParams(private_nh)),
      detector_(mp700_ur5e_description::loadBrickTypes(params_.bricks_file), params_.detection),
      markers_(detector_.catalogue()),
      transport_(private_nh),
      diagnostics_(nh, private_nh, private_nh.getNamespace()) {
  ROS_INFO_STREAM_NAMED(kLog, "configuration:\n" << interactive_mapping::toYaml(params_));
  ros::NodeHandle public_nh(nh);
  ros::NodeHandle pnh(private_nh);
  bricks_publisher_ = pnh.advertise<BrickArray>("bricks", 1, true);
  marker_publisher_ = pnh.advertise<visualization_msgs::MarkerArray>("markers", 1, true);
  picture_publisher_ = transport_.advertise("image", 1);
  {
    const std::lock_guard<std::mutex> lock(detector_mutex_);
    publishBricks();  // whoever subscribes learns that none are known
  }
  if (params_.map.use) {
    MapClient::Callbacks callbacks;
    callbacks.ask = [this] {
      const std::lock_guard<std::mutex> lock(detector_mutex_);
      return detector_.mapQuestion();
    };
    callbacks.lost = [this] {
      const std::lock_guard<std::mutex> lock(detector_mutex_);
      detector_.forgetMap();
      publishBricks();
    };
    callbacks.answer = [this](const auto& question, const auto& states, const ros::Time& map_stamp) {
      onMapAnswer(question, states, map_stamp);
    };
    map_ = std::make_unique<MapClient>(nh, params_.input.map_frame, callbacks);
  }
  ImageInput::Callbacks callbacks;
  callbacks.wants = [this](const ros::Time& stamp) { return wants(stamp); };
  callbacks.consume = [this](const InputFrame& frame) { consume(frame); };
  callbacks.refuse = [this](const ros::Time& stamp, const Refusal& refusal, bool is_restart) {
    refuse(stamp, refusal, is_restart);
  };
  const auto source = detector_.decodesImages() ? ImageInput::Source::kImages : ImageInput::Source::kAlvarMarkers;
  input_ = std::make_unique<ImageInput>(nh, private_nh, params_.input, source, callbacks);
  detect_ = std::make_unique<DetectServer>(
      private_nh, params_.detect,
      DetectServer::Input{params_.input.map_frame, "image", input_->topic(), params_.input.max_future_s});
  // A simulation that waits for an update after each image may begin when it sees this: the images are subscribed to.
  update_publisher_ = pnh.advertise<Update>("update", 50);
  input_->start();

  attached_subscriber_ = public_nh.subscribe("attached_brick", 5, &BrickDetectionRos::onAttached, this);
  clear_server_ = pnh.advertiseService("clear", &BrickDetectionRos::onClear, this);

  diagnostics_.setHardwareID("none");
  diagnostics_.add("input", this, &BrickDetectionRos::diagnoseInput);
  diagnostics_.add("transforms", this, &BrickDetectionRos::diagnoseTransforms);
  diagnostics_.add("bricks", this, &BrickDetectionRos::diagnoseBricks);
  if (map_) diagnostics_.add("map", this, &BrickDetectionRos::diagnoseMap);
  // By the wall clock, which the updater's own timing is not: a stopped simulation must be diagnosed as well.
  diagnostics_timer_ = pnh.createWallTimer(ros::WallDuration(diagnostics_.getPeriod()),
                                           [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); });
  ROS_INFO_NAMED(kLog, "looking for tags of family %s in %s, bricks in frame '%s'",
                 detector_.catalogue().tags.family.c_str(), input_->topic().c_str(), params_.input.map_frame.c_str());
}

BrickDetectionRos::~BrickDetectionRos() {
  // Each of these waits for its callback in progress; then nobody but the input's thread uses the map.
  detect_->stop();
  diagnostics_timer_.stop();
  clear_server_.shutdown();
  attached_subscriber_.shutdown();
  input_.reset();
  map_.reset();
}

bool BrickDetectionRos::wants(const ros::Time& stamp) {
  return params_.continuous || detect_->wants(stamp);
}

void BrickDetectionRos::consume(const InputFrame& frame) {
  DetectLook record;
  Update& update = record.update;
  update.header.stamp = frame.stamp;
  update.header.frame_id = params_.input.map_frame;
  update.message = frame.remark;
  update.wait_ms = static_cast<float>(frame.wait_ms);
  record.bricks.header = update.header;
  brick_detection::BrickDetector::Look look;
  {
    const std::lock_guard<std::mutex> lock(detector_mutex_);
    update.look = ++num_looks_;  // one that fails, too
    if (frame.T_map_camera) {
      look = frame.has_image
                 ? detector_.look(frame.image, frame.depth_m, frame.camera, *frame.T_map_camera, frame.stamp.toSec())
                 : detector_.addMarkers(frame.markers, *frame.T_map_camera, frame.stamp.toSec());
    }
    stamp_ = frame.stamp;
    update.has_depth = look.has_depth ? 1 : 0;
    for (const brick_detection::TagSighting& tag : look.found.tags) update.tags.push_back(toMessage(tag));
    std::set<std::size_t> seen;
    for (std::size_t i = 0; i < look.found.bricks.size(); ++i) {
      update.bricks_seen.push_back(look.found.bricks[i].brick_id);
      if (look.seen[i]) seen.insert(*look.seen[i]);
    }
    for (const std::size_t index : seen) record.bricks.bricks.push_back(toBrick(index));
    update.bricks_dropped = std::move(dropped_);
    dropped_.clear();
    update.detect_ms = static_cast<float>(look.detect_ms);
    update.pose_ms = static_cast<float>(look.pose_ms);
    update.track_ms = static_cast<float>(look.track_ms);
    update.total_ms = update.detect_ms + update.pose_ms + update.track_ms;
    depth_contradiction_ = contradictionOf(look.found);
    if (!depth_contradiction_.empty()) update.message += (update.message.empty() ? "" : "; ") + depth_contradiction_;
    publishBricks();
  }
  if (map_ && !look.found.bricks.empty()) map_->wake();
  {
    const ros::WallTime now = ros::WallTime::now();
    const std::lock_guard<std::mutex> lock(report_mutex_);
    recent_.push_back({now, true, update.total_ms, ros::Time::now().toSec() - frame.stamp.toSec()});
    while ((now - recent_.front().done).toSec() > kWindow_s) recent_.pop_front();
  }
  ROS_DEBUG_NAMED(kLog, "look %lu: %zu tags, %zu bricks, %.1f ms", static_cast<unsigned long>(update.look),
                  update.tags.size(), update.bricks_seen.size(), update.total_ms);
  publishPicture(frame, look.found);
  conclude(std::move(record));
}

void BrickDetectionRos::refuse(const ros::Time& stamp, const Refusal& refusal, bool is_restart) {
  DetectLook record;
  Update& update = record.update;
  update.header.stamp = stamp;
  update.header.frame_id = params_.input.map_frame;
  update.status = static_cast<std::uint8_t>(depth_camera_ros::statusOf<DetectionUpdateStatus>(refusal.status));
  update.message = refusal.message;
  {
    const std::lock_guard<std::mutex> lock(detector_mutex_);
    if (is_restart) {
      forget(stamp);
      update.message += ", and so are all bricks";
    }
    update.look = ++num_looks_;
    update.bricks_dropped = std::move(dropped_);
    dropped_.clear();
  }
  ROS_WARN_STREAM_THROTTLE_NAMED(
      kWarnPeriod_s, kLog,
      "image rejected, " << toString(static_cast<DetectionUpdateStatus>(update.status)) << ": " << update.message);
  {
    const ros::WallTime now = ros::WallTime::now();
    const std::lock_guard<std::mutex> lock(report_mutex_);
    recent_.push_back({now, false, 0.0, 0.0});
    while ((now - recent_.front().done).toSec() > kWindow_s) recent_.pop_front();
  }
  conclude(std::move(record));
}

void BrickDetectionRos::conclude(DetectLook record) {
  // Whoever waits for it finds ~bricks and the services up to date.
  update_publisher_.publish(record.update);
  detect_->conclude(std::move(record));
}

interactive_mapping_msgs::Brick BrickDetectionRos::toBrick(std::size_t index) const {
  const TrackedBrick& brick = detector_.bricks()[index];
  return toMessage(brick, detector_.catalogue().typeOf(brick.id), detector_.graspableFaces(index));
}

void BrickDetectionRos::publishBricks() {
  BrickArray array;
  array.header.stamp = stamp_;
  array.header.frame_id = params_.input.map_frame;
  for (std::size_t i = 0; i < detector_.bricks().size(); ++i) array.bricks.push_back(toBrick(i));
  bricks_publisher_.publish(array);
  marker_publisher_.publish(markers_.update(array));
}

void BrickDetectionRos::publishPicture(const InputFrame& frame,
                                       const brick_detection::BrickPoseEstimator::Result& found) {
  if (!frame.has_image || picture_publisher_.getNumSubscribers() == 0) return;
  std_msgs::Header header;
  header.stamp = frame.stamp;
  header.frame_id = frame.camera_frame;
  const cv::Mat picture = brick_detection::drawDetections(frame.image, frame.camera, found, detector_.catalogue());
  picture_publisher_.publish(cv_bridge::CvImage(header, sensor_msgs::image_encodings::BGR8, picture).toImageMsg());
}

void BrickDetectionRos::noteDropped(const std::vector<int>& ids, const std::string& why) {
  if (ids.empty()) return;
  dropped_.insert(dropped_.end(), ids.begin(), ids.end());
  last_drop_ = join(ids) + ": " + why;
  ROS_INFO_NAMED(kLog, "forgotten: brick %s", last_drop_.c_str());
}

void BrickDetectionRos::forget(const ros::Time& stamp) {
  detector_.clear();
  stamp_ = stamp;
  publishBricks();
}

void BrickDetectionRos::onMapAnswer(const MapClient::MapQuestion& question,
                                    const std::vector<brick_detection::SpaceState>& states,
                                    const ros::Time& map_stamp) {
  const std::lock_guard<std::mutex> lock(detector_mutex_);
  noteDropped(detector_.takeMapAnswer(question, states, map_stamp.toSec()), "its volume is free");
  publishBricks();
}

std::optional<Eigen::Vector3d> BrickDetectionRos::placeOf(
    const interactive_mapping_msgs::AttachedBrick& message) const {
  const std::string frame = interactive_mapping_ros::withoutSlash(message.header.frame_id);
  const Eigen::Vector3d p_tool(message.pose.position.x, message.pose.position.y, message.pose.position.z);
  // The newest, when tf has not come to the stamp yet: the tool has not moved far since.
  for (const ros::Time& stamp : {message.header.stamp, ros::Time(0)}) {
    try {
      const auto T_map_tool = interactive_mapping_ros::toIsometry(
          input_->tfBuffer().lookupTransform(params_.input.map_frame, frame, stamp).transform);
      if (T_map_tool && p_tool.allFinite()) return *T_map_tool * p_tool;
    } catch (const tf2::TransformException&) {
    }
  }
  return std::nullopt;
}

void BrickDetectionRos::onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message) {
  if (message->is_attached == 0) {
    const std::lock_guard<std::mutex> lock(detector_mutex_);
    // Looks from before then may still come, and show it in the hand.
    detector_.detach(message->header.stamp.isZero() ? -std::numeric_limits<double>::infinity()
                                                    : message->header.stamp.toSec());
    attached_id_.reset();
    return;
  }
  std::optional<Eigen::Vector3d> p_map = placeOf(*message);
  const std::lock_guard<std::mutex> lock(detector_mutex_);
  if (!p_map) {
    int known = 0;
    for (const TrackedBrick& brick : detector_.bricks()) {
      if (brick.id != message->id) continue;
      if (known++ == 0) p_map = brick.T_map_brick.translation();
    }
    if (known > 1) {
      ROS_WARN_NAMED(kLog, "tf has no pose of '%s': which of the %d bricks of id %d is in the hand is a guess",
                     message->header.frame_id.c_str(), known, message->id);
    }
  }
  try {
    const bool was_known = detector_.attach(message->id, p_map.value_or(Eigen::Vector3d::Zero()));
    attached_id_ = message->id;
    if (!was_known) return;
    noteDropped({message->id}, "it is in the hand");
    publishBricks();
  } catch (const std::invalid_argument& error) {
    ROS_ERROR_NAMED(kLog, "attached brick ignored: %s", error.what());
  }
}

bool BrickDetectionRos::onClear(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  {
    const std::lock_guard<std::mutex> lock(detector_mutex_);
    response.message = "forgot " + std::to_string(detector_.bricks().size()) + " bricks";
    forget(stamp_);
  }
  input_->resetPoseGuard();
  response.success = 1;
  return true;
}

void BrickDetectionRos::diagnoseInput(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const ImageInputCounters counters = input_->counters();
  const ros::WallTime now = ros::WallTime::now();
  std::size_t accepted = 0;
  std::size_t refused = 0;
  double silence_s = kWindow_s;
  double sum_ms = 0.0;
  double max_ms = 0.0;
  double latency_s = 0.0;
  {
    const std::lock_guard<std::mutex> lock(report_mutex_);
    for (const LookTimes& look : recent_) {
      if ((now - look.done).toSec() > kWindow_s) continue;
      ++(look.is_accepted ? accepted : refused);
      silence_s = std::min(silence_s, (now - look.done).toSec());
      sum_ms += look.total_ms;
      max_ms = std::max(max_ms, look.total_ms);
      latency_s += look.is_accepted ? look.latency_s : 0.0;
    }
  }
  const std::uint64_t all_accepted = counters.by_status[Update::ACCEPTED];
  if (counters.received == 0) {
    status.summary(DiagnosticStatus::WARN, "nothing received on " + input_->topic());
  } else if (params_.continuous && silence_s > kSilence_s) {
    status.summary(DiagnosticStatus::WARN, "no image in the last " + formatted("%.0f s", kSilence_s));
  } else if (refused > 0 && accepted == 0) {
    status.summary(DiagnosticStatus::ERROR, "every image is rejected; " + counters.last_refusal);
  } else if (refused * 10 > accepted + refused) {
    status.summary(DiagnosticStatus::WARN, std::to_string(refused) + " of " + std::to_string(accepted + refused) +
                                               " images rejected recently; " + counters.last_refusal);
  } else if (!counters.warning.empty()) {
    status.summary(DiagnosticStatus::WARN, counters.warning);
  } else if (counters.without_depth * 2 > all_accepted) {
    status.summary(DiagnosticStatus::WARN, counters.last_remark);
  } else {
    status.summary(DiagnosticStatus::OK, params_.continuous ? "images are processed" : "images are processed on call");
  }
  status.add("image topic", input_->topic());
  if (detector_.decodesImages()) {
    status.add("camera info topic", input_->infoTopic());
    status.add("depth topic", params_.input.use_depth ? input_->depthTopic() : "none");
  }
  status.add("rate [Hz]", formatted("%.2f", static_cast<double>(accepted) / kWindow_s));
  if (accepted > 0) {
    status.add("time per image, mean [ms]", formatted("%.1f", sum_ms / static_cast<double>(accepted)));
    status.add("time per image, longest [ms]", formatted("%.1f", max_ms));
    status.add("latency, mean [s]", formatted("%.3f", latency_s / static_cast<double>(accepted)));
  }
  status.add("received", counters.received);
  status.add("replaced by a newer one", counters.replaced);
  if (!params_.continuous) status.add("not asked for", counters.unwanted);
  for (std::size_t i = 0; i < counters.by_status.size(); ++i) {
    const std::string name = toString(static_cast<DetectionUpdateStatus>(i));
    status.add(i == 0 ? name : "left out: " + name, counters.by_status[i]);
  }
  status.add("without depth", counters.without_depth);
  status.add("calls of ~detect that wait", detect_->numWaiting());
  if (!counters.last_remark.empty()) status.add("last without depth", counters.last_remark);
  if (!counters.last_refusal.empty()) status.add("last left out", counters.last_refusal);
}

void BrickDetectionRos::diagnoseTransforms(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const ImageInputCounters counters = input_->counters();
  depth_camera_ros::diagnosePoses(params_.input, counters.pose, counters.by_status[Update::POSE_JUMP],
                                  counters.by_status[Update::TIME_RAN_BACK],
                                  "bricks seen before may be off; ~clear forgets them", &status);
}

void BrickDetectionRos::diagnoseBricks(diagnostic_updater::DiagnosticStatusWrapper& status) {
  std::size_t known = 0;
  std::vector<int> duplicates;
  std::string last_drop;
  std::optional<int> attached_id;
  std::uint64_t looks = 0;
  std::string contradiction;
  {
    const std::lock_guard<std::mutex> lock(detector_mutex_);
    known = detector_.bricks().size();
    for (const TrackedBrick& brick : detector_.bricks()) {
      if (brick.has_duplicate && (duplicates.empty() || duplicates.back() != brick.id)) duplicates.push_back(brick.id);
    }
    last_drop = last_drop_;
    attached_id = attached_id_;
    looks = num_looks_;
    contradiction = depth_contradiction_;
  }
  if (!contradiction.empty()) {
    status.summary(DiagnosticStatus::WARN, contradiction);
  } else if (duplicates.empty()) {
    status.summary(DiagnosticStatus::OK, "");
  } else {
    status.summary(DiagnosticStatus::WARN,
                   "several bricks carry the id " + join(duplicates) + ": it does not distinguish them");
  }
  status.add("bricks known", known);
  status.add("ids carried by several", duplicates.empty() ? "none" : join(duplicates));
  status.add("in the hand", attached_id ? std::to_string(*attached_id) : "none");
  status.add("last forgotten", last_drop.empty() ? "none" : last_drop);
  status.add("images processed", looks);
}

void BrickDetectionRos::diagnoseMap(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const MapClient::Counters counters = map_->counters();
  const double unanswered_s =
      counters.asked_since.isZero() ? 0.0 : (ros::WallTime::now() - counters.asked_since).toSec();
  if (unanswered_s > params_.map.answer_age_s) {
    status.summary(DiagnosticStatus::WARN,
                   "no answer for " + formatted("%.0f s", unanswered_s) +
                       (counters.last_failure.empty() ? ": it hangs" : "; " + counters.last_failure) +
                       ": faces are ranked by neighbours alone, and removed bricks are not noticed");
  } else {
    status.summary(DiagnosticStatus::OK, counters.answers > 0            ? "the map answers"
                                         : counters.last_failure.empty() ? "nothing to ask yet"
                                                                         : "no map: faces are ranked by neighbours");
  }
  status.add("service", map_->service());
  status.add("updates of the map", counters.updates);
  status.add("questions", counters.questions);
  status.add("answers", counters.answers);
  if (!counters.last_failure.empty()) status.add("last failure", counters.last_failure);
}

}  // namespace brick_detection_ros
