// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics_ros/system_diagnostics_ros.h"

#include <cmath>
#include <tuple>

#include <cv_bridge/cv_bridge.h>
#include <geometry_msgs/TransformStamped.h>
#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common_ros/poses.h>

namespace system_diagnostics_ros {
namespace {

using diagnostic_msgs::DiagnosticStatus;
using diagnostic_updater::DiagnosticStatusWrapper;
using interactive_mapping::formatted;
using interactive_mapping_ros::withoutSlash;
using system_diagnostics::Level;
using system_diagnostics::TimeOffsetEstimate;
using system_diagnostics::TimeOffsetStatus;

// None may be lost while a picture is worked on: two seconds of drivers at 500, 15 and 50 Hz, and more.
constexpr int kTfQueue = 1000;
constexpr int kImageQueue = 30;
constexpr int kOdometryQueue = 1000;

void summarise(const system_diagnostics::Verdict& verdict, DiagnosticStatusWrapper* status) {
  status->summary(static_cast<unsigned char>(verdict.level), verdict.message);
}

Eigen::Isometry3d poseOf(const geometry_msgs::Transform& transform) {
  const auto& [t, q] = std::tie(transform.translation, transform.rotation);
  return Eigen::Translation3d(t.x, t.y, t.z) * Eigen::Isometry3d(Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized());
}

/// Rotation about the vertical; of a base that stands level, its heading.
double yawOf(const geometry_msgs::Quaternion& q) {
  return std::atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z));
}

system_diagnostics::Verdict judge(const TimeOffsetEstimate& estimate, const SystemDiagnosticsParams::Motion& params) {
  system_diagnostics::Verdict verdict;
  switch (estimate.status) {
    case TimeOffsetStatus::kEstimated: {
      const double late_s = std::abs(estimate.offset_s);
      verdict.worsen(late_s > params.error_offset_s  ? Level::kError
                     : late_s > params.warn_offset_s ? Level::kWarning
                                                     : Level::kOk,
                     formatted("the camera's stamps are %.0f ms %s (standard deviation %.1f ms)", 1e3 * late_s,
                               estimate.offset_s >= 0.0 ? "late" : "early", 1e3 * estimate.std_s));
      break;
    }
    case TimeOffsetStatus::kTooLittleTurning:
      verdict.worsen(Level::kOk,
                     formatted("no estimate: the base turned %.2f rad in %.0f s, must be at least %.2f rad",
                               estimate.turned_rad, params.estimator.window_s, system_diagnostics::kMinTurn_rad));
      break;
    case TimeOffsetStatus::kTooFewImages:
      verdict.worsen(Level::kOk, formatted("no estimate: %d pairs of images with odometry, must be at least %d",
                                           estimate.images, params.estimator.min_images));
      break;
    case TimeOffsetStatus::kTooUncertain:
      verdict.worsen(Level::kOk, formatted("no estimate: standard deviation %.0f ms, must be at most %.0f ms",
                                           1e3 * estimate.std_s, 1e3 * system_diagnostics::kMaxOffsetStd_s));
      break;
    case TimeOffsetStatus::kNoCorrelation:
      verdict.worsen(
          Level::kWarning,
          formatted("images do not follow the turning base: correlation %.2f, must be at least %.2f. Another camera, "
                    "upside down, or things that move",
                    estimate.correlation, params.estimator.min_correlation));
      break;
    case TimeOffsetStatus::kBeyondRange:
      verdict.worsen(Level::kError, formatted("the camera's stamps are off by more than %.0f ms",
                                              1e3 * system_diagnostics::kMaxOffset_s));
      break;
  }
  return verdict;
}

}  // namespace

SystemDiagnosticsRos::SystemDiagnosticsRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : params_(loadSystemDiagnosticsParams(private_nh)),
      tree_(params_.window_s),
      delays_(params_.arrival),
      shift_meter_(params_.motion.image),
      estimator_(params_.motion.estimator),
      diagnostics_(nh, private_nh, private_nh.getNamespace()) {
  ROS_INFO("Parameters:\n%s", interactive_mapping::toYaml(params_).c_str());
  for (const auto& [name, frames] : params_.tf.transforms) {
    watches_.push_back(
        {frames, system_diagnostics::TransformWatch(frames.target + " -> " + frames.source, frames.limits)});
  }
  diagnostics_.setHardwareID("none");
  for (std::size_t i = 0; i < watches_.size(); ++i) {
    diagnostics_.add("tf " + watches_[i].watch.name(),
                     [this, i](DiagnosticStatusWrapper& status) { diagnoseTransform(i, status); });
  }
  diagnostics_.add("tf tree", this, &SystemDiagnosticsRos::diagnoseTree);
  diagnostics_.add("camera arrival", this, &SystemDiagnosticsRos::diagnoseArrival);
  if (params_.motion.enabled) diagnostics_.add("camera time offset", this, &SystemDiagnosticsRos::diagnoseMotion);

  ros::NodeHandle handle(nh);
  const auto subscribe = [this, &handle](const char* topic, bool is_static) {
    return handle.subscribe<tf2_msgs::TFMessage>(
        topic, kTfQueue, boost::function<void(const TransformEvent&)>([this, is_static](const TransformEvent& event) {
          onTransforms(event, is_static);
        }));
  };
  tf_subscriber_ = subscribe("/tf", false);
  tf_static_subscriber_ = subscribe("/tf_static", true);
  image_subscriber_ = handle.subscribe("image", kImageQueue, &SystemDiagnosticsRos::onImage, this);
  if (params_.motion.enabled) {
    odometry_subscriber_ = handle.subscribe("odom", kOdometryQueue, &SystemDiagnosticsRos::onOdometry, this);
  }
  // By the wall clock, which the updater's own timing is not: a stopped simulation must be diagnosed as well.
  ros::NodeHandle private_handle(private_nh);
  diagnostics_timer_ = private_handle.createWallTimer(
      ros::WallDuration(diagnostics_.getPeriod()), [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); });
}

ros::Time SystemDiagnosticsRos::checkClock() {
  const ros::Time now = ros::Time::now();
  if (now < last_now_) {
    ROS_WARN("The clock went back from %.3f s to %.3f s: what was seen is forgotten", last_now_.toSec(), now.toSec());
    buffer_.clear();
    for (Watch& watch : watches_) watch.watch.clear();
    tree_.clear();
    delays_.clear();
    shift_meter_.clear();
    estimator_.clear();
    last_image_stamp_ = ros::Time();
  }
  last_now_ = now;
  return now;
}

void SystemDiagnosticsRos::onTransforms(const TransformEvent& event, bool is_static) {
  const ros::Time now = checkClock();
  if (event.getReceiptTime() > now) return;  // it waited here while the clock went back
  const std::string publisher = event.getPublisherName();
  for (const geometry_msgs::TransformStamped& transform : event.getMessage()->transforms) {
    tree_.add(now.toSec(), withoutSlash(transform.header.frame_id), withoutSlash(transform.child_frame_id), publisher,
              is_static);
    buffer_.setTransform(transform, publisher, is_static);  // says itself what it refuses
  }
  for (Watch& watch : watches_) {
    if (!buffer_.canTransform(watch.frames.target, watch.frames.source, ros::Time(0))) continue;
    const geometry_msgs::TransformStamped found =
        buffer_.lookupTransform(watch.frames.target, watch.frames.source, ros::Time(0));
    if (found.header.stamp.isZero()) {
      watch.watch.addStatic(poseOf(found.transform));
    } else {
      watch.watch.add(found.header.stamp.toSec(), poseOf(found.transform));
    }
  }
}

void SystemDiagnosticsRos::onImage(const ros::MessageEvent<sensor_msgs::Image const>& event) {
  if (event.getReceiptTime() > checkClock()) return;
  const sensor_msgs::ImageConstPtr& image = event.getConstMessage();
  delays_.add(event.getReceiptTime().toSec(), image->header.stamp.toSec());
  if (!params_.motion.enabled) return;
  try {
    const auto shift = shift_meter_.add(cv_bridge::toCvShare(image, "mono8")->image);
    if (shift && !last_image_stamp_.isZero()) {
      estimator_.addShift(last_image_stamp_.toSec(), image->header.stamp.toSec(), shift->x_px);
    }
    last_image_stamp_ = image->header.stamp;
    image_problem_.clear();
  } catch (const std::exception& error) {  // of cv_bridge, OpenCV or the meter: an image of no use
    image_problem_ = error.what();
    shift_meter_.clear();
    ROS_WARN_THROTTLE(10.0, "Image on %s (%s) is left out: %s", image_subscriber_.getTopic().c_str(),
                      image->encoding.c_str(), error.what());
  }
}

void SystemDiagnosticsRos::onOdometry(const ros::MessageEvent<nav_msgs::Odometry const>& event) {
  if (event.getReceiptTime() > checkClock()) return;
  const nav_msgs::OdometryConstPtr& odometry = event.getConstMessage();
  estimator_.addYaw(odometry->header.stamp.toSec(), yawOf(odometry->pose.pose.orientation));
}

void SystemDiagnosticsRos::diagnoseTransform(std::size_t index, DiagnosticStatusWrapper& status) {
  const system_diagnostics::TransformReport report = watches_[index].watch.report(checkClock().toSec());
  summarise(report.verdict, &status);
  status.add("fixed", report.is_static);
  status.add("rate [Hz]", report.rate_hz);
  status.add("age [s]", report.age_s);
  status.add("longest gap [s]", report.longest_gap_s);
  status.add("jumps", report.jumps);
  status.add("jumps since the start", report.total_jumps);
  status.add("largest jump [m]", report.largest_jump_m);
  status.add("largest jump [rad]", report.largest_jump_rad);
}

void SystemDiagnosticsRos::diagnoseTree(DiagnosticStatusWrapper& status) {
  summarise(tree_.report(checkClock().toSec()), &status);
  status.add("frames", tree_.edges());
}

void SystemDiagnosticsRos::diagnoseArrival(DiagnosticStatusWrapper& status) {
  const system_diagnostics::DelayReport report = delays_.report(checkClock().toSec());
  summarise(report.verdict, &status);
  status.add("topic", image_subscriber_.getTopic());
  status.add("images", report.count);
  status.add("rate [Hz]", report.rate_hz);
  status.add("least delay [s]", report.min_s);
  status.add("median delay [s]", report.median_s);
  status.add("95 % delay [s]", report.p95_s);
}

void SystemDiagnosticsRos::diagnoseMotion(DiagnosticStatusWrapper& status) {
  if (!image_problem_.empty()) {
    status.summary(DiagnosticStatus::WARN, "images are left out: " + image_problem_);
    return;
  }
  const TimeOffsetEstimate estimate = estimator_.estimate();
  summarise(judge(estimate, params_.motion), &status);
  status.add("offset [s]", estimate.offset_s);
  status.add("standard deviation [s]", estimate.std_s);
  status.add("correlation", estimate.correlation);
  status.add("turned [rad]", estimate.turned_rad);
  status.add("pairs of images", estimate.images);
}

}  // namespace system_diagnostics_ros
