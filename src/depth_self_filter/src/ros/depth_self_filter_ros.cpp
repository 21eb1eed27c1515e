// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter_ros/depth_self_filter_ros.h"

#include <exception>
#include <stdexcept>
#include <utility>

#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common_ros/poses.h>
#include <ros/console.h>

namespace depth_self_filter_ros {
namespace {

using depth_camera_ros::CameraPoseSource;
using depth_camera_ros::Refusal;
using depth_self_filter::JointHistory;
using diagnostic_msgs::DiagnosticStatus;
using interactive_mapping::formatted;
using mp700_ur5e_description::RobotModel;

constexpr char kLog[] = "depth_self_filter";
constexpr char kDescription[] = "robot_description";
constexpr double kSilence_s = 2.0;     // without an image: a warning
constexpr double kWarnPeriod_s = 5.0;  // a message in a callback is repeated no more often

std::shared_ptr<const RobotModel> loadRobot(const ros::NodeHandle& nh) {
  // In the node's namespace, or in one around it. A search from a nodelet's handle in the root finds nothing.
  std::string key = nh.resolveName(kDescription);
  std::string urdf;
  if (!nh.getParam(key, urdf) && !(nh.searchParam(kDescription, key) && nh.getParam(key, urdf))) {
    throw std::invalid_argument("no parameter " + nh.resolveName(kDescription) +
                                ", must hold the URDF as text (mp700_ur5e_description/launch/description.launch)");
  }
  return RobotModel::parse(urdf, key);
}

depth_camera_ros::CameraPoseParams poseParams(const DepthSelfFilterParams& params, const RobotModel& robot) {
  depth_camera_ros::CameraPoseParams result;
  result.map_frame = robot.rootFrame();
  result.camera_frame = params.input.camera_frame;
  result.tf_timeout_s = params.input.wait_s;
  result.time_offset_s = params.input.time_offset_s;
  result.max_future_s = params.input.max_future_s;
  return result;
}

double millisecondsBetween(std::chrono::steady_clock::time_point from, std::chrono::steady_clock::time_point to) {
  return std::chrono::duration<double, std::milli>(to - from).count();
}

}  // namespace

DepthSelfFilterRos::DepthSelfFilterRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    // In braces, which keep the order: first the parameters are refused.
    : DepthSelfFilterRos{nh, private_nh, loadDepthSelfFilterParams(private_nh), loadRobot(nh)} {}

DepthSelfFilterRos::DepthSelfFilterRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                       const DepthSelfFilterParams& params, std::shared_ptr<const RobotModel> robot)
    // The source is of cameras that the URDF does not have; it checks the stamps of all.
    : ImageWorker(nh, poseParams(params, *robot)),
      params_(params),
      robot_(std::move(robot)),
      mask_(robot_, params_.mask),
      joints_(robot_, params_.joints),
      input_transport_(nh),
      output_transport_(private_nh),
      diagnostics_(nh, private_nh, private_nh.getNamespace()) {
  ROS_INFO_STREAM_NAMED(kLog, "configuration:\n" << interactive_mapping::toYaml(params_));
  ros::NodeHandle public_nh(nh);
  ros::NodeHandle pnh(private_nh);
  info_publisher_ = pnh.advertise<sensor_msgs::CameraInfo>("camera_info", 5);
  image_publisher_ = output_transport_.advertise("image_rect", 5);

  const ros::TransportHints no_delay = ros::TransportHints().tcpNoDelay();
  attached_subscriber_ = public_nh.subscribe("attached_brick", 5, &DepthSelfFilterRos::onAttached, this);
  // Half a second of an arm that tells 500 times a second.
  joint_subscriber_ = public_nh.subscribe("joint_states", 250, &DepthSelfFilterRos::onJointStates, this, no_delay);
  subscribeInfo(nh, "depth/camera_info");
  image_subscriber_ =
      input_transport_.subscribe("depth/image_rect", 1, &DepthSelfFilterRos::onImage, this,
                                 image_transport::TransportHints(params_.input.image_transport, no_delay, private_nh));
  // Remappings decide what the topic is called.
  is_rectified_ = depth_camera_ros::isRectifiedTopic(nh.resolveName("depth/image_rect"));
  // A simulation that waits for an update after each image may begin when it sees this: the images are subscribed to.
  update_publisher_ = pnh.advertise<Update>("update", 50);
  start();

  diagnostics_.setHardwareID("none");
  diagnostics_.add("input", this, &DepthSelfFilterRos::diagnoseInput);
  diagnostics_.add("joint states", this, &DepthSelfFilterRos::diagnoseJoints);
  // By the wall clock, which the updater's own timing is not: a stopped simulation must be diagnosed as well.
  diagnostics_timer_ = pnh.createWallTimer(ros::WallDuration(diagnostics_.getPeriod()),
                                           [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); });
  ROS_INFO_NAMED(kLog, "taking the robot out of %s, into %s", image_subscriber_.getTopic().c_str(),
                 image_publisher_.getTopic().c_str());
}

DepthSelfFilterRos::~DepthSelfFilterRos() {
  diagnostics_timer_.stop();
  stop();
  // Each of these waits for its callback in progress.
  image_subscriber_.shutdown();
  joint_subscriber_.shutdown();
  attached_subscriber_.shutdown();
}

void DepthSelfFilterRos::onImage(const sensor_msgs::ImageConstPtr& image) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    counters_.last_image = ros::WallTime::now();
  }
  put({image, std::chrono::steady_clock::now()}, &counters_);
}

void DepthSelfFilterRos::onJointStates(const sensor_msgs::JointStateConstPtr& states) {
  std::string problem;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    problem = joints_.add(states->header.stamp.toSec(), states->name, states->position);
    if (!problem.empty()) {
      ++counters_.bad_joint_states;
      counters_.last_bad_joint_states = problem;
    }
  }
  if (problem.empty()) {
    changed_.notify_all();
  } else {
    ROS_WARN_STREAM_THROTTLE_NAMED(kWarnPeriod_s, kLog, "joint states left out: " << problem);
  }
}

void DepthSelfFilterRos::onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message) {
  std::string problem;
  const depth_self_filter::HandHistory::Change change = toChange(*message, *robot_, &problem);
  if (!problem.empty()) ROS_ERROR_STREAM_NAMED(kLog, "images are dropped until it is known what is held: " << problem);
  const std::lock_guard<std::mutex> lock(mutex_);
  hand_.add(change);
  hand_problem_ = problem;
}

void DepthSelfFilterRos::process(const WaitingImage& job) {
  Update update;
  update.header = job.image->header;
  Drop drop;
  try {
    std::optional<Frame> frame = prepare(*job.image, job.arrival, &drop);
    if (isStopping()) return;
    if (frame) {
      const SteadyTime begin = std::chrono::steady_clock::now();
      const depth_self_filter::MaskStatistics statistics =
          mask_.apply(frame->camera, frame->T_root_camera, frame->positions_rad, frame->brick, &frame->image);
      const sensor_msgs::ImagePtr filtered = toMessage(frame->image);
      filtered->header = job.image->header;
      const SteadyTime end = std::chrono::steady_clock::now();
      // First the info: who gets the image finds it there.
      sensor_msgs::CameraInfo info = toOutputInfo(frame->info, frame->camera);
      info.header = job.image->header;
      info_publisher_.publish(info);
      image_publisher_.publish(sensor_msgs::ImageConstPtr(filtered));
      update.has_brick = frame->brick ? 1 : 0;
      update.masked = static_cast<std::uint32_t>(statistics.masked_px);
      update.shadow = static_cast<std::uint32_t>(statistics.shadow_px);
      update.in_front = static_cast<std::uint32_t>(statistics.in_front_px);
      update.filter_ms = static_cast<float>(millisecondsBetween(begin, end));
      update.wait_ms = static_cast<float>(millisecondsBetween(job.arrival, begin));
    }
  } catch (const std::exception& error) {  // out of memory, say: this image is lost, the next may do
    drop = {SelfFilterStatus::kFailed, error.what()};
  }
  update.status = static_cast<std::uint8_t>(drop.status);
  update.message = drop.message;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++counters_.by_status.at(static_cast<std::size_t>(drop.status));
    if (drop.status == SelfFilterStatus::kAccepted) {
      counters_.last_filter_ms = update.filter_ms;
      counters_.last_accepted = ros::WallTime::now();
    } else {
      counters_.last_drop = std::string(toString(drop.status)) + ": " + drop.message;
    }
  }
  if (drop.status != SelfFilterStatus::kAccepted) {
    ROS_WARN_STREAM_THROTTLE_NAMED(kWarnPeriod_s, kLog,
                                   "image dropped, " << toString(drop.status) << ": " << drop.message);
  }
  update_publisher_.publish(update);
}

JointHistory::Answer DepthSelfFilterRos::waitForJoints(double stamp_s, SteadyTime deadline) {
  std::unique_lock<std::mutex> lock(mutex_);
  JointHistory::Answer answer;
  waitUntil(deadline, &lock, [&] {
    answer = joints_.at(stamp_s);
    return answer.verdict != JointHistory::Verdict::kNotYet && answer.verdict != JointHistory::Verdict::kNeverHeard;
  });
  if (answer.verdict == JointHistory::Verdict::kNotYet) {
    answer.message += "; waited " + formatted("%.3f s", params_.input.wait_s) + " (wait_s)";
  }
  if (answer.verdict != JointHistory::Verdict::kKnown && !counters_.last_bad_joint_states.empty()) {
    answer.message += "; " + std::to_string(counters_.bad_joint_states) +
                      " joint states were left out, at last: " + counters_.last_bad_joint_states;
  }
  return answer;
}

std::optional<Eigen::Isometry3d> DepthSelfFilterRos::cameraPose(const std::string& camera_frame, const ros::Time& stamp,
                                                                const Eigen::VectorXd& positions_rad,
                                                                SteadyTime deadline, Drop* drop) {
  // The same source as the robot's shapes, where it has the frame.
  if (robot_->hasFrame(camera_frame)) return robot_->framePose(camera_frame, positions_rad);
  Refusal refusal;
  const std::optional<Eigen::Isometry3d> pose = pose_source_.poseAt(camera_frame, stamp, deadline, &refusal);
  if (!pose) {
    *drop = toDrop(refusal);
    drop->message = "the URDF has no frame '" + camera_frame + "', and tf: " + drop->message;
  }
  return pose;
}

std::optional<DepthSelfFilterRos::Frame> DepthSelfFilterRos::prepare(const sensor_msgs::Image& message,
                                                                     SteadyTime arrival, Drop* drop) {
  Refusal refusal;
  const SteadyTime deadline = pose_source_.deadline(arrival);
  const auto refused = [&]() -> std::optional<Frame> {
    *drop = toDrop(refusal);
    return std::nullopt;
  };
  if (pose_source_.checkStamp(message.header.stamp, &refusal) != CameraPoseSource::StampVerdict::kGood)
    return refused();
  const std::optional<std::string> camera_frame = pose_source_.cameraFrame(message.header.frame_id, &refusal);
  if (!camera_frame) return refused();
  Frame frame;
  std::optional<depth_camera::DepthImage> image =
      depth_camera_ros::toDepthImage(message, params_.input.depth_units_per_metre, &refusal);
  if (!image) return refused();
  frame.image = std::move(*image);
  const sensor_msgs::CameraInfoConstPtr info = waitForInfo(deadline, &refusal);
  if (!info) return refused();
  frame.info = *info;
  if (!depth_camera_ros::toDepthRectifier(*info, is_rectified_, &rectifier_, &refusal)) return refused();
  const depth_camera::CameraModel& raw = rectifier_.rawCamera();
  if (frame.image.width != raw.width || frame.image.height != raw.height) {
    refusal = sizeMismatch(frame.image.width, frame.image.height, raw.width, raw.height);
    return refused();
  }
  frame.camera = rectifier_.camera();
  const double stamp_s = message.header.stamp.toSec() + params_.input.time_offset_s;  // by the robot's clock
  const JointHistory::Answer joints = waitForJoints(stamp_s, deadline);
  *drop = toDrop(joints);
  if (drop->status != SelfFilterStatus::kAccepted) return std::nullopt;
  frame.positions_rad = joints.positions_rad;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const depth_self_filter::HandHistory::Change hand = hand_.at(stamp_s);
    if (!hand.is_clear) {
      *drop = {SelfFilterStatus::kBadAttachedBrick, hand_problem_};
      return std::nullopt;
    }
    frame.brick = hand.brick;
  }
  const std::optional<Eigen::Isometry3d> pose =
      cameraPose(*camera_frame, message.header.stamp, frame.positions_rad, deadline, drop);
  if (!pose) return std::nullopt;
  frame.T_root_camera = *pose;
  frame.image = rectifier_.rectify(std::move(frame.image));
  return frame;
}

void DepthSelfFilterRos::diagnoseInput(diagnostic_updater::DiagnosticStatusWrapper& status) {
  Counters counters;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    counters = counters_;
  }
  const ros::WallTime now = ros::WallTime::now();
  if (!counters.last_image) {
    status.summary(DiagnosticStatus::WARN, "no image on " + image_subscriber_.getTopic() + " yet");
  } else if ((now - *counters.last_image).toSec() > kSilence_s) {
    status.summary(DiagnosticStatus::WARN, "no image on " + image_subscriber_.getTopic() + " for " +
                                               formatted("%.3f s", (now - *counters.last_image).toSec()));
  } else if (!counters.last_accepted || (now - *counters.last_accepted).toSec() > kSilence_s) {
    status.summary(DiagnosticStatus::ERROR, "every image is dropped: " + counters.last_drop);
  } else {
    status.summary(DiagnosticStatus::OK, "images are filtered");
  }
  status.add("received", counters.received);
  status.add("replaced while waiting", counters.replaced);
  for (std::size_t i = 0; i < counters.by_status.size(); ++i) {
    status.add(toString(static_cast<SelfFilterStatus>(i)), counters.by_status[i]);
  }
  status.add("last drop", counters.last_drop);
  status.addf("last filtering [ms]", "%.2f", counters.last_filter_ms);
}

void DepthSelfFilterRos::diagnoseJoints(diagnostic_updater::DiagnosticStatusWrapper& status) {
  JointHistory::Answer answer;
  Counters counters;
  std::string hand_problem;
  const ros::Time now = ros::Time::now();
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    answer = joints_.at(now.toSec());
    counters = counters_;
    hand_problem = hand_problem_;
  }
  if (!hand_problem.empty()) {
    status.summary(DiagnosticStatus::ERROR, hand_problem);
  } else if (answer.verdict == JointHistory::Verdict::kNeverHeard) {
    status.summary(DiagnosticStatus::ERROR, answer.message + " on " + joint_subscriber_.getTopic());
  } else if (counters.bad_joint_states > 0) {
    status.summary(DiagnosticStatus::WARN, "left out: " + counters.last_bad_joint_states);
  } else {
    status.summary(DiagnosticStatus::OK, "joint states come");
  }
  status.add("left out", counters.bad_joint_states);
  status.add("brick in the hand", hand_problem.empty() ? "known" : hand_problem);
}

}  // namespace depth_self_filter_ros
