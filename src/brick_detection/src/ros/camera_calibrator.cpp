// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/camera_calibrator.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <exception>
#include <stdexcept>

#include <geometry_msgs/PoseArray.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common_ros/poses.h>
#include <mp700_ur5e_description/brick_types.h>
#include <tf2/exceptions.h>

#include "brick_detection_ros/conversions.h"

namespace brick_detection_ros {
namespace {

using brick_detection::CameraModel;
using interactive_mapping::formatted;
using interactive_mapping_ros::withoutSlash;

constexpr std::size_t kMaxDepths = 10;  // images of a third of a second at 30 Hz
constexpr int kStillLooks = 11;         // at the arm, evenly over the time it has to stand still
constexpr double kTimer_s = 0.1;
constexpr double kToDeg = 180.0 / M_PI;

brick_detection::TargetFinder makeFinder(const CameraCalibratorParams& params) {
  interactive_mapping::requireValid("impossible parameters:", params);
  const CalibrationTargetParams& target = params.target;
  if (target.brick_id >= 0) {
    return {mp700_ur5e_description::loadBrickTypes(params.bricks_file), target.brick_id, params.pose};
  }
  return {brick_detection::loneTag(target.family, target.tag_id, target.edge_m), 0, params.pose};
}

std::string nowAsText() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

/// The depth image that goes with a colour image. Nothing, and the reason, if it does not.
std::optional<cv::Mat> registeredDepth(const sensor_msgs::Image& depth, const sensor_msgs::Image& color,
                                       double units_per_metre, std::string* why_not) {
  Refusal refusal;
  std::optional<cv::Mat> depth_m = toDepthMat(depth, units_per_metre, &refusal);
  if (!depth_m || depth.width != color.width || depth.height != color.height) {
    *why_not = "the depth image cannot be used (use_depth: false does without): " +
               (depth_m ? "it is of " + sizeText(depth.width, depth.height) + ", the colour image of " +
                              sizeText(color.width, color.height)
                        : refusal.message);
    return std::nullopt;
  }
  const std::string depth_frame = withoutSlash(depth.header.frame_id);
  const std::string color_frame = withoutSlash(color.header.frame_id);
  if (depth_frame == color_frame) return depth_m;
  *why_not = "the depth image is of frame '" + depth_frame + "', must be of the colour image's, '" + color_frame +
             "': registered to it (use_depth: false does without)";
  return std::nullopt;
}

}  // namespace

CameraCalibrator::CameraCalibrator(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                   const CameraCalibratorParams& params)
    : params_(params), finder_(makeFinder(params)), session_(params.session), transport_(nh) {
  tf_connection_ = tf_buffer_._addTransformsChangedListener([this] {
    const std::lock_guard<std::mutex> lock(inputs_mutex_);
    tf_changed_.notify_all();
  });
  ros::NodeHandle private_handle(private_nh);
  samples_publisher_ = private_handle.advertise<geometry_msgs::PoseArray>("samples", 1, true);
  camera_publisher_ = private_handle.advertise<geometry_msgs::PoseWithCovarianceStamped>("camera", 1, true);
  take_sample_ = private_handle.advertiseService("take_sample", &CameraCalibrator::onTakeSample, this);
  discard_last_ = private_handle.advertiseService("discard_last", &CameraCalibrator::onDiscardLast, this);
  solve_ = private_handle.advertiseService("solve", &CameraCalibrator::onSolve, this);
  save_ = private_handle.advertiseService("save", &CameraCalibrator::onSave, this);
  publishSamples();

  info_subscriber_ = ros::NodeHandle(nh).subscribe("color/camera_info", 2, &CameraCalibrator::onInfo, this);
  const image_transport::TransportHints hints("raw", ros::TransportHints(), private_handle);
  image_subscriber_ = transport_.subscribe("color/image_raw", 1, &CameraCalibrator::onImage, this, hints);
  if (params_.use_depth) {
    depth_subscriber_ = transport_.subscribe("depth/image_rect", 2, &CameraCalibrator::onDepth, this);
  }
  // After image_transport's plugins: dlopen() and a first warning of tf2 would wait for each other's locks.
  tf_listener_.emplace(tf_buffer_, nh);
  if (params_.is_auto) {
    timer_ = private_handle.createWallTimer(ros::WallDuration(kTimer_s), &CameraCalibrator::onTimer, this);
  }
  ROS_INFO("Calibrating the camera against %s in %s: images from %s%s", params_.tool_frame.c_str(),
           params_.base_frame.c_str(), image_subscriber_.getTopic().c_str(),
           params_.is_auto ? ", samples wherever the arm is stationary" : "");
}

CameraCalibrator::~CameraCalibrator() {
  {
    const std::lock_guard<std::mutex> lock(inputs_mutex_);
    is_stopping_ = true;
    tf_changed_.notify_all();
  }
  timer_.stop();
  image_subscriber_.shutdown();
  depth_subscriber_.shutdown();
  info_subscriber_.shutdown();
  for (ros::ServiceServer* service : {&take_sample_, &discard_last_, &solve_, &save_}) service->shutdown();
  tf_buffer_._removeTransformsChangedListener(tf_connection_);
}

void CameraCalibrator::onImage(const sensor_msgs::ImageConstPtr& image) {
  const std::lock_guard<std::mutex> lock(inputs_mutex_);
  image_ = image;
}

void CameraCalibrator::onInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  const std::lock_guard<std::mutex> lock(inputs_mutex_);
  info_ = info;
}

void CameraCalibrator::onDepth(const sensor_msgs::ImageConstPtr& depth) {
  const std::lock_guard<std::mutex> lock(inputs_mutex_);
  depths_.push_back(depth);
  if (depths_.size() > kMaxDepths) depths_.pop_front();
}

CameraCalibrator::Inputs CameraCalibrator::inputs() {
  const std::lock_guard<std::mutex> lock(inputs_mutex_);
  Inputs result{image_, info_, nullptr};
  if (!image_) return result;
  double nearest_s = params_.max_depth_offset_s;
  for (const sensor_msgs::ImageConstPtr& depth : depths_) {
    const double offset_s = std::abs((depth->header.stamp - image_->header.stamp).toSec());
    if (offset_s > nearest_s) continue;
    nearest_s = offset_s;
    result.depth = depth;
  }
  return result;
}

void CameraCalibrator::onTimer(const ros::WallTimerEvent& /*event*/) {
  const Inputs newest = inputs();
  const std::lock_guard<std::mutex> lock(work_mutex_);
  if (!newest.image || newest.image->header.stamp == tried_stamp_) return;
  tried_stamp_ = newest.image->header.stamp;
  std::string message;
  if (takeSample(newest, &message)) {
    ROS_INFO("%s", message.c_str());
  } else {
    ROS_INFO_THROTTLE(5.0, "No sample: %s", message.c_str());
  }
}

bool CameraCalibrator::onTakeSample(Request& /*request*/, Response& response) {
  const std::lock_guard<std::mutex> lock(work_mutex_);
  response.success = takeSample(inputs(), &response.message);
  return true;
}

bool CameraCalibrator::onDiscardLast(Request& /*request*/, Response& response) {
  const std::lock_guard<std::mutex> lock(work_mutex_);
  response.success = session_.discardLast();
  response.message =
      response.success ? std::to_string(session_.samples().size()) + " samples are left" : "there is no sample";
  if (response.success) result_.reset();
  publishSamples();
  return true;
}

bool CameraCalibrator::onSolve(Request& /*request*/, Response& response) {
  const std::lock_guard<std::mutex> lock(work_mutex_);
  response.success = solve(&response.message);
  return true;
}

bool CameraCalibrator::onSave(Request& /*request*/, Response& response) {
  const std::lock_guard<std::mutex> lock(work_mutex_);
  response.success = save(&response.message);
  return true;
}

std::optional<Eigen::Isometry3d> CameraCalibrator::lookUp(const std::string& target, const std::string& source,
                                                          const ros::Time& stamp, std::string* why_not) const {
  try {
    Refusal refusal;
    const auto T = depth_camera_ros::toIsometry(tf_buffer_.lookupTransform(target, source, stamp).transform, &refusal);
    if (!T) *why_not = "tf from " + target + " to " + source + ": " + refusal.message;
    return T;
  } catch (const tf2::TransformException& error) {
    *why_not = "no tf from " + target + " to " + source + ": " + error.what();
    return std::nullopt;
  }
}

std::vector<Eigen::Isometry3d> CameraCalibrator::toolPoses(const ros::Time& stamp, std::string* why_not) {
  // Wall clock: simulated time may stand while this waits.
  const auto deadline =
      std::chrono::steady_clock::now() + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                                             std::chrono::duration<double>(params_.tf_timeout_s));
  {
    std::unique_lock<std::mutex> lock(inputs_mutex_);
    tf_changed_.wait_until(lock, deadline, [&] {
      return is_stopping_ || tf_buffer_.canTransform(params_.base_frame, params_.tool_frame, stamp);
    });
  }
  std::vector<Eigen::Isometry3d> poses;
  for (int i = kStillLooks - 1; i >= 0; --i) {
    const double before_s = params_.still_s * i / (kStillLooks - 1);
    if (stamp.toSec() <= before_s) {
      *why_not = "time has just begun";
      return {};
    }
    const auto T_base_tool = lookUp(params_.base_frame, params_.tool_frame, stamp - ros::Duration(before_s), why_not);
    if (!T_base_tool) return {};
    poses.push_back(*T_base_tool);
  }
  return poses;
}

bool CameraCalibrator::takeSample(const Inputs& inputs, std::string* message) {
  if (!inputs.image) {
    *message = "no image on " + image_subscriber_.getTopic() + " yet";
    return false;
  }
  if (!inputs.info) {
    *message = "no camera info on " + info_subscriber_.getTopic() + " yet";
    return false;
  }
  const sensor_msgs::Image& image = *inputs.image;
  const ros::Time stamp = image.header.stamp;
  const double age_s = (ros::Time::now() - stamp).toSec();
  if (age_s > params_.max_image_age_s) {
    *message = "the newest image is " + formatted("%.1f", age_s) + " s old, at most " +
               formatted("%.1f", params_.max_image_age_s) + " s are allowed: is the camera running?";
    return false;
  }
  const std::string camera_frame =
      params_.camera_frame.empty() ? withoutSlash(image.header.frame_id) : params_.camera_frame;
  if (!session_.samples().empty() && camera_frame != camera_frame_) {
    *message = "the image is of " + camera_frame + ", earlier samples of " + camera_frame_ + ": discard those first";
    return false;
  }
  const bool is_rectified = depth_camera_ros::isRectifiedTopic(image_subscriber_.getTopic());
  Refusal refusal;
  const std::optional<CameraModel> camera = brick_detection_ros::cameraModelOf(*inputs.info, is_rectified, &refusal);
  if (!camera) {
    *message = refusal.message;
    return false;
  }
  if (camera->width_px != static_cast<int>(image.width) || camera->height_px != static_cast<int>(image.height)) {
    *message = "the image is of " + sizeText(image.width, image.height) + ", its camera info of " +
               sizeText(camera->width_px, camera->height_px);
    return false;
  }
  const std::vector<Eigen::Isometry3d> poses = toolPoses(stamp, message);
  if (poses.empty()) return false;
  *message = session_.whyNotStill(poses);
  if (!message->empty()) return false;
  *message = session_.whyNotNew(poses.back());
  if (!message->empty()) return false;

  const std::optional<cv::Mat> color = toColorImage(image, &refusal);
  if (!color) {
    *message = "the image cannot be used: " + refusal.message;
    return false;
  }
  cv::Mat depth_m;
  if (inputs.depth) {
    const std::optional<cv::Mat> depth = registeredDepth(*inputs.depth, image, params_.depth_units_per_metre, message);
    if (!depth) return false;
    depth_m = *depth;
  }
  std::optional<brick_detection::BrickSighting> target;
  try {
    target = finder_.find(*color, depth_m, *camera, message);
  } catch (const std::exception& error) {  // of OpenCV, for want of memory: no reason to end
    *message = error.what();
    return false;
  }
  if (!target) return false;

  brick_detection::HandEyeSample sample;
  sample.T_base_tool = poses.back();
  sample.T_camera_target = target->T_camera_brick;
  sample.covariance = target->covariance;
  session_.add(sample);
  camera_frame_ = camera_frame;
  result_.reset();
  publishSamples();
  *message = "sample " + std::to_string(session_.samples().size() - 1) + " taken: target at " +
             formatted("%.2f", sample.T_camera_target.translation().norm()) + " m, " +
             std::to_string(target->faces.size()) + (target->faces.size() == 1 ? " tag face, " : " tag faces, ") +
             (target->has_depth ? "with depth" : "without depth") + ", known to " +
             formatted("%.1f", 1e3 * std::sqrt(sample.covariance.topLeftCorner<3, 3>().trace())) + " mm and " +
             formatted("%.2f", kToDeg * std::sqrt(sample.covariance.bottomRightCorner<3, 3>().trace())) + " deg";
  return true;
}

std::optional<brick_detection::CalibratedEdge> CameraCalibrator::edge(std::string* why_not) const {
  brick_detection::CalibratedEdge result;
  result.parent_frame = params_.parent_frame;
  result.child_frame = params_.child_frame;
  const auto T_base_parent = lookUp(params_.base_frame, params_.parent_frame, ros::Time(0), why_not);
  if (!T_base_parent) return std::nullopt;
  const auto T_child_camera = lookUp(params_.child_frame, camera_frame_, ros::Time(0), why_not);
  if (!T_child_camera) return std::nullopt;
  result.T_base_parent = *T_base_parent;
  result.T_child_camera = *T_child_camera;
  return result;
}

bool CameraCalibrator::solve(std::string* message) {
  try {
    result_ = session_.solve();
  } catch (const std::exception& error) {  // a sample's covariance, say: nothing a user can mend, but no reason to end
    *message = error.what();
    return false;
  }
  *message = brick_detection::residualTable(*result_);
  if (!result_->isGood()) {
    ROS_WARN("%s", message->c_str());
    return false;
  }
  std::string why_not;
  if (const auto now = lookUp(params_.base_frame, camera_frame_, ros::Time(0), &why_not)) {
    const Eigen::Isometry3d change = now->inverse() * result_->T_base_camera;
    *message += "\nfrom where tf has the camera now: " + formatted("%.1f", 1e3 * change.translation().norm()) +
                " mm and " + formatted("%.2f", kToDeg * Eigen::AngleAxisd(change.linear()).angle()) + " deg";
  }
  ROS_INFO("%s", message->c_str());
  publishCamera();
  return true;
}

bool CameraCalibrator::save(std::string* message) {
  if (params_.output_file.empty()) {
    *message = "there is nowhere to save to: set the parameter output_file";
    return false;
  }
  if (!result_ && !solve(message)) return false;
  if (!result_->isGood()) {
    *message = result_->reason;
    return false;
  }
  const auto of = edge(message);
  if (!of) return false;
  try {
    brick_detection::saveCameraCalibration(params_.output_file, toCameraCalibration(*result_, *of, nowAsText()));
  } catch (const std::exception& error) {
    *message = error.what();
    return false;
  }
  *message =
      "saved the edge " + of->parent_frame + " -> " + of->child_frame + " to " + params_.output_file +
      "; to use it: roslaunch mp700_ur5e_description description.launch camera_calibration:=" + params_.output_file;
  ROS_INFO("%s", message->c_str());
  return true;
}

void CameraCalibrator::publishSamples() {
  geometry_msgs::PoseArray message;
  message.header.frame_id = params_.base_frame;
  message.header.stamp = ros::Time::now();
  for (const brick_detection::HandEyeSample& sample : session_.samples()) {
    message.poses.push_back(toPose(sample.T_base_tool));
  }
  samples_publisher_.publish(message);
}

void CameraCalibrator::publishCamera() {
  geometry_msgs::PoseWithCovarianceStamped message;
  message.header.frame_id = params_.base_frame;
  message.header.stamp = ros::Time::now();
  message.pose.pose = toPose(result_->T_base_camera);
  // Both are row-wise (x, y, z, about x, about y, about z) along fixed axes, and symmetric.
  std::copy(result_->covariance.data(), result_->covariance.data() + result_->covariance.size(),
            message.pose.covariance.begin());
  camera_publisher_.publish(message);
}

}  // namespace brick_detection_ros
