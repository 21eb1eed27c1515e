// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world_ros/simulated_world_ros.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <cv_bridge/cv_bridge.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <geometry_msgs/TransformStamped.h>
#include <geometry_msgs/TwistStamped.h>
#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_msgs/PickBrickActionGoal.h>
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <nav_msgs/Odometry.h>
#include <neo_msgs/EmergencyStopState.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/JointState.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <std_msgs/String.h>
#include <visualization_msgs/MarkerArray.h>

#include <mp700_ur5e_description/robot_names.h>

#include "simulated_world/JudgeState.h"
#include "synthetic_depth/sensor.h"
#include "synthetic_depth_ros/camera_info.h"

namespace simulated_world_ros {
namespace {

using simulated_world::ClockEvent;
using simulated_world::Pose2d;
using simulated_world::Simulation;

constexpr double kTruthPeriod_s = 0.1;  // of the bricks' true poses, for rviz
constexpr double kObstacleMarker_s = 0.5;
constexpr double kJudgePeriod_s = 0.5;
constexpr double kWheelsPeriod_s = 0.2;  // each state makes a tf message, and only pictures show how a wheel has turned
constexpr double kDiagnosticsPeriod_s = 1.0;  // wall time: the clock may stand still
constexpr double kPollPeriod_s = 0.002;       // how long a clock that is held waits for callbacks at a time
// The driver's "effort" is a current. Not published for the UR5e; of the right order for its geared motors.
constexpr double kTorquePerCurrent_Nm_A = 10.0;
constexpr double kLongestAdvance_s = 600.0;

geometry_msgs::Quaternion yawQuaternion(double yaw_rad) {
  geometry_msgs::Quaternion q;
  q.z = std::sin(0.5 * yaw_rad);
  q.w = std::cos(0.5 * yaw_rad);
  return q;
}

geometry_msgs::TransformStamped transform(const ros::Time& stamp, const std::string& parent, const std::string& child,
                                          const Pose2d& pose) {
  geometry_msgs::TransformStamped tf;
  tf.header.stamp = stamp;
  tf.header.frame_id = parent;
  tf.child_frame_id = child;
  tf.transform.translation.x = pose.x_m;
  tf.transform.translation.y = pose.y_m;
  tf.transform.rotation = yawQuaternion(pose.yaw_rad);
  return tf;
}

// A quaternion that is no rotation becomes NaN, which the fault's own check refuses.
Eigen::Isometry3d poseFromMessage(const geometry_msgs::Pose& pose) {
  const Eigen::Quaterniond q(pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << pose.position.x, pose.position.y, pose.position.z;
  T.linear() = q.toRotationMatrix();
  if (std::abs(q.norm() - 1.0) > 1e-3) {
    T.linear().setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  return T;
}

simulated_world::StrategySurface surfaceFrom(const interactive_mapping_msgs::SurfaceMesh& message) {
  simulated_world::StrategySurface surface;
  surface.stamp_s = message.header.stamp.toSec();
  for (const geometry_msgs::Point& vertex : message.mesh.vertices) {
    surface.points_map.emplace_back(vertex.x, vertex.y, vertex.z);
  }
  for (const shape_msgs::MeshTriangle& triangle : message.mesh.triangles) {
    surface.triangles.push_back({triangle.vertex_indices[0], triangle.vertex_indices[1], triangle.vertex_indices[2]});
  }
  return surface;
}

simulated_world::StrategySurface surfaceFrom(const sensor_msgs::PointCloud2& message) {
  simulated_world::StrategySurface surface;
  surface.stamp_s = message.header.stamp.toSec();
  sensor_msgs::PointCloud2ConstIterator<float> point(message, "x");
  for (; point != point.end(); ++point) {
    const Eigen::Vector3d p(point[0], point[1], point[2]);
    if (p.allFinite()) {
      surface.points_map.push_back(p);
    }
  }
  return surface;
}

}  // namespace

SimulatedWorldRos::SimulatedWorldRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                     const SimulationParams& params)
    : nh_(nh),
      private_nh_(private_nh),
      experiment_nh_(private_nh),
      params_(params),
      simulation_(params.simulation),
      transport_(nh_) {
  experiment_nh_.setCallbackQueue(&experiment_queue_);
  if (!params.run_folder.empty()) {
    writer_ = std::make_unique<simulated_world::JudgeWriter>(params.run_folder);
  }
  if (params.has_pictures) {
    pictures_ = std::make_unique<simulated_world::RunPictures>(params.run_folder);
  }
  if (writer_ && params.clock == ClockMode::kLockstep) {
    clock_trace_ = std::make_unique<simulated_world::ClockTrace>(params.run_folder);
  }
  arm_ = std::make_unique<UrDriverRos>(nh_, simulation_.armDriver(), arm_mutex_, "ur5e_");
  if (!params_.surface_topic.empty()) {
    // Before the rules: callbacks of a topic are queued in the order of subscription, and a surface that the clock waited
    // for has to be judged before it goes on.
    constexpr std::uint32_t kSurfaces = 50;
    subscribers_.push_back(nh_.subscribe(params_.surface_topic, kSurfaces, &SimulatedWorldRos::onSurface, this));
  }
  lockstep_ = std::make_unique<Lockstep>(nh_, params.wait_for, params.computing);
  advertiseDrivers();
  advertiseExperiment();
  diagnostics_wall_ = ros::WallTime::now();
  diagnostics_s_ = simulation_.now();
  ROS_INFO("%s, seed %lu: %zu bricks, robot at (%.2f, %.2f)", simulation_.scene().name.c_str(),
           static_cast<unsigned long>(params.simulation.seed), simulation_.scene().bricks.size(),
           simulation_.scene().robot_start.xy_m.x(), simulation_.scene().robot_start.xy_m.y());
}

SimulatedWorldRos::~SimulatedWorldRos() {
  if (!writer_) {
    return;
  }
  try {
    simulation_.judge().finish();
    writer_->finish(simulation_.judge(), simulation_.digest());
  } catch (const std::exception& error) {
    ROS_ERROR("the judge's report is not complete: %s", error.what());
  }
  takePictures(true);  // last: who ends the node has little patience
}

void SimulatedWorldRos::takePictures(bool is_last) {
  if (!pictures_) {
    return;
  }
  try {
    is_last ? pictures_->finish(simulation_) : pictures_->watch(simulation_);
  } catch (const std::exception& error) {
    ROS_ERROR("no more pictures of the world: %s", error.what());
    pictures_.reset();  // a run is worth more than they are
  }
}

void SimulatedWorldRos::advertiseDrivers() {
  constexpr std::uint32_t kQueueSize = 50;
  // Latched: whoever comes while the clock stands still would wait for a time for ever.
  constexpr bool kLatched = true;
  clock_publisher_ = nh_.advertise<rosgraph_msgs::Clock>("/clock", kQueueSize, kLatched);
  const auto counted = [this](ClockEvent event) {
    return std::pair<ros::SubscriberStatusCallback, ros::SubscriberStatusCallback>(
        [this, event](const ros::SingleSubscriberPublisher& subscriber) {
          subscribers_of_[event].insert(subscriber.getSubscriberName());
        },
        [this, event](const ros::SingleSubscriberPublisher& subscriber) {
          auto& nodes = subscribers_of_[event];
          const auto one = nodes.find(subscriber.getSubscriberName());
          if (one != nodes.end()) nodes.erase(one);
        });
  };
  const auto [odometry_heard, odometry_left] = counted(ClockEvent::kOdometry);
  odometry_publisher_ = nh_.advertise<nav_msgs::Odometry>("odom", kQueueSize, odometry_heard, odometry_left);
  wheels_publisher_ = nh_.advertise<sensor_msgs::JointState>("drives/joint_states", kQueueSize);
  relay_publisher_ = nh_.advertise<neo_msgs::EmergencyStopState>("relayboard_v2/emergency_stop_state", kQueueSize);
  const auto [scan_heard, scan_left] = counted(ClockEvent::kScan);
  scan_publisher_ = nh_.advertise<sensor_msgs::LaserScan>("lidar_1/scan", kQueueSize, scan_heard, scan_left);
  const auto connected = [this](const image_transport::SingleSubscriberPublisher& subscriber) {
    subscribers_of_[ClockEvent::kImage].insert(subscriber.getSubscriberName());
  };
  const auto left = [this](const image_transport::SingleSubscriberPublisher& subscriber) {
    auto& nodes = subscribers_of_[ClockEvent::kImage];
    const auto one = nodes.find(subscriber.getSubscriberName());
    if (one != nodes.end()) nodes.erase(one);
  };
  color_publisher_ = transport_.advertiseCamera("camera/color/image_raw", kQueueSize, connected, left);
  depth_publisher_ = transport_.advertiseCamera("camera/aligned_depth_to_color/image_raw", kQueueSize, connected, left);
  subscribers_.push_back(
      nh_.subscribe("cmd_vel", kQueueSize, &SimulatedWorldRos::onCommand, this, ros::TransportHints().tcpNoDelay()));
  services_.push_back(nh_.advertiseService("camera/capture", &SimulatedWorldRos::onCapture, this));
  diagnostics_publisher_ = nh_.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", kQueueSize);
}

void SimulatedWorldRos::advertiseExperiment() {
  constexpr std::uint32_t kQueueSize = 50;
  constexpr bool kLatched = true;
  truth_publisher_ = private_nh_.advertise<visualization_msgs::MarkerArray>("truth", 1, kLatched);
  judge_publisher_ = private_nh_.advertise<simulated_world::JudgeState>("judge", kQueueSize, kLatched);
  incident_publisher_ = private_nh_.advertise<std_msgs::String>("incidents", kQueueSize);
  command_publisher_ = private_nh_.advertise<geometry_msgs::TwistStamped>("command_taken", kQueueSize);
  services_.push_back(private_nh_.advertiseService("inject_fault", &SimulatedWorldRos::onFault, this));
  services_.push_back(private_nh_.advertiseService<std_srvs::Trigger::Request, std_srvs::Trigger::Response>(
      "clear_faults", [this](std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
        simulation_.clearFaults();
        response.success = true;
        response.message = "faults that have not started are removed";
        return true;
      }));
  services_.push_back(private_nh_.advertiseService<std_srvs::Trigger::Request, std_srvs::Trigger::Response>(
      "unload", [this](std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
        const std::optional<int> taken = simulation_.unload();
        response.success = taken.has_value();
        response.message = taken ? std::to_string(*taken) + " bricks taken out of the container" : "being unloaded";
        return true;
      }));
  subscribers_.push_back(
      private_nh_.subscribe<std_msgs::Int32>("target", kQueueSize, [this](const std_msgs::Int32::ConstPtr& message) {
        simulation_.setTarget(message->data < 0 ? std::nullopt : std::optional<int>(message->data));
      }));
  if (!params_.pick_action.empty()) {
    // Until the next one: after a pick that failed the magnet may still be at its brick.
    subscribers_.push_back(nh_.subscribe<interactive_mapping_msgs::PickBrickActionGoal>(
        params_.pick_action + "/goal", kQueueSize,
        [this](const interactive_mapping_msgs::PickBrickActionGoal::ConstPtr& message) {
          const geometry_msgs::Point& p = message->goal.brick.pose.position;
          simulation_.setTarget(message->goal.brick_id, {p.x, p.y, p.z});
        },
        ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay()));
  }
  // The last of all: whoever finds it finds the others, too.
  services_.push_back(experiment_nh_.advertiseService("advance", &SimulatedWorldRos::onAdvance, this));
}

ros::Time SimulatedWorldRos::stamp() const {
  ros::Time time;
  time.fromNSec(static_cast<std::uint64_t>(simulation_.nowNs()));
  return time;
}

std::string SimulatedWorldRos::digestText() const {
  return interactive_mapping::formatted("%016lx", static_cast<unsigned long>(simulation_.digest()));
}

void SimulatedWorldRos::run() {
  publishClock();
  publishTruth();
  publishJudge();
  takePictures(false);
  while (ros::ok()) {
    ros::getGlobalCallbackQueue()->callAvailable();
    experiment_queue_.callAvailable();
    for (const std::string& complaint : lockstep_->takeComplaints()) {
      ROS_ERROR_THROTTLE(1.0, "clock: %s", complaint.c_str());
    }
    if (mayTick()) {
      tick();
    }
    if ((ros::WallTime::now() - diagnostics_wall_).toSec() >= kDiagnosticsPeriod_s) {
      publishDiagnostics();
    }
  }
}

bool SimulatedWorldRos::isHeld() {
  const std::int64_t next_ns = simulation_.nowNs() + std::llround(params_.simulation.tick_s * 1e9);
  if (next_ns <= lockstep_->gate().limit()) {
    held_since_wall_ = ros::WallTime();
    return false;
  }
  const ros::WallTime now = ros::WallTime::now();
  if (held_since_wall_.isZero()) {
    held_since_wall_ = now;
  }
  if (clock_trace_) clock_trace_->enter(now.toSec(), lockstep_->gate().awaited());
  if ((now - held_since_wall_).toSec() > params_.wait_timeout_wall_s) {
    for (const std::string& due : lockstep_->gate().giveUp()) {
      ++given_up_;
      ROS_ERROR("clock: waited %.0f s for %s, now continues without it; this run cannot be repeated exactly",
                params_.wait_timeout_wall_s, due.c_str());
    }
    held_since_wall_ = ros::WallTime();
  }
  return true;
}

std::size_t SimulatedWorldRos::numCameraTopicsOf(const std::string& node) const {
  XmlRpc::XmlRpcValue request(ros::this_node::getName());
  XmlRpc::XmlRpcValue response;
  XmlRpc::XmlRpcValue state;  // publishers, subscribers, services: lists of [topic, nodes]
  if (!ros::master::execute("getSystemState", request, response, state, false)) return 0;
  std::size_t count = 0;
  XmlRpc::XmlRpcValue& subscriptions = state[1];
  for (int i = 0; i < subscriptions.size(); ++i) {
    const std::string topic = subscriptions[i][0];
    if (topic != color_publisher_.getTopic() && topic != depth_publisher_.getTopic()) continue;
    for (int k = 0; k < subscriptions[i][1].size(); ++k) {
      count += std::string(subscriptions[i][1][k]) == node ? 1 : 0;
    }
  }
  return count;
}

std::string SimulatedWorldRos::missingSubscriber() const {
  for (const simulated_world::WaitRule& rule : params_.wait_for) {
    const auto known = subscribers_of_.find(rule.after);
    const std::multiset<std::string> none;
    const std::multiset<std::string>& subscribers = rule.after == ClockEvent::kJointStates
                                                        ? arm_->jointStateSubscribers()
                                                    : known != subscribers_of_.end() ? known->second
                                                                                     : none;
    if (rule.subscriber.empty()) {
      if (rule.after == ClockEvent::kImage && subscribers.empty()) return "anybody to subscribe to the camera";
      continue;
    }
    const std::string node = ros::names::resolve(rule.subscriber);
    const std::size_t connected = subscribers.count(node);
    const std::size_t wanted = rule.after == ClockEvent::kImage ? numCameraTopicsOf(node) : 1;
    if (connected == 0 || connected < wanted) {
      return rule.subscriber + " to subscribe to " + simulated_world::toString(rule.after);
    }
  }
  return "";
}

bool SimulatedWorldRos::mayTick() {
  const auto wait = [](double seconds) {
    ros::getGlobalCallbackQueue()->callOne(ros::WallDuration(std::min(seconds, kPollPeriod_s)));
    return false;
  };
  if (params_.clock == ClockMode::kStepped) {
    return wait(kPollPeriod_s);
  }
  if (!has_begun_) {
    const std::vector<std::string> missing = lockstep_->missing();
    if (!missing.empty()) {
      ROS_INFO_THROTTLE(10.0, "clock: not started, %s has no publisher yet", missing.front().c_str());
      return wait(kPollPeriod_s);
    }
    const std::string absent = missingSubscriber();
    if (!absent.empty()) {
      // Who answers messages and does not hear them yet would miss the first, some runs more of them than others.
      ROS_INFO_THROTTLE(10.0, "clock: not started, waiting for %s", absent.c_str());
      return wait(kPollPeriod_s);
    }
    has_begun_ = true;
    begun_wall_ = ros::WallTime::now();
    begun_s_ = simulation_.now();
  }
  if (isHeld()) {
    return wait(kPollPeriod_s);
  }
  if (params_.clock == ClockMode::kRealtime) {
    const double due_wall_s = (simulation_.now() + params_.simulation.tick_s - begun_s_) / params_.realtime_factor;
    const double early_s = due_wall_s - (ros::WallTime::now() - begun_wall_).toSec();
    if (early_s > 0.0) {
      return wait(early_s);
    }
    if (early_s < -1.0) {  // too slow a machine: do not try to make up for it for ever
      begun_wall_ = ros::WallTime::now();
      begun_s_ = simulation_.now();
    }
  }
  return true;
}

void SimulatedWorldRos::traceClock() {
  if (!clock_trace_) {
    return;
  }
  try {
    clock_trace_->reach(simulation_.now(), ros::WallTime::now().toSec());
  } catch (const std::exception& error) {
    ROS_ERROR("no more of the clock's waiting is kept: %s", error.what());
    clock_trace_.reset();  // a run is worth more than it is
  }
}

void SimulatedWorldRos::tick() {
  if (clock_trace_) clock_trace_->enter(ros::WallTime::now().toSec(), "world");
  // Without anybody to look, nothing is drawn.
  simulation_.setCameraUsed(color_publisher_.getNumSubscribers() + depth_publisher_.getNumSubscribers() > 0);
  const Simulation::Tick result = simulation_.tick();
  publishClock();
  publishState(result);
  for (const std::string& incident : result.incidents) {
    ROS_INFO("%s", incident.c_str());
    std_msgs::String message;
    message.data = incident;
    incident_publisher_.publish(message);
  }
  if (writer_) {
    writer_->write(simulation_.judge(), simulation_.digest());
  }
  takePictures(false);
  if (simulation_.now() - last_truth_s_ >= kTruthPeriod_s - 1e-9) {
    publishTruth();
  }
  if (simulation_.now() - last_judge_s_ >= kJudgePeriod_s - 1e-9) {
    publishJudge();
  }
  traceClock();
}

void SimulatedWorldRos::publishClock() {
  rosgraph_msgs::Clock clock;
  clock.clock = stamp();
  clock_publisher_.publish(clock);
}

void SimulatedWorldRos::publishState(const Simulation::Tick& tick) {
  const std::int64_t now_ns = tick.stamp_ns;
  std::vector<geometry_msgs::TransformStamped> transforms;  // in one message: each wakes all that listen to tf
  if (tick.has_localisation) {
    transforms.push_back(transform(stamp(), params_.map_frame, params_.odom_frame, simulation_.mapToOdom()));
  }
  if (tick.has_odometry) {
    transforms.push_back(
        transform(stamp(), params_.odom_frame, mp700_ur5e_description::kBaseFrame, simulation_.drive().odometry()));
    if (simulation_.armDriver().driverConnected()) {
      const simulated_world::World& world = simulation_.world();
      transforms.push_back(
          arm_->toolTransform(stamp(), world.linkPose(mp700_ur5e_description::kArmControllerFrame).inverse() *
                                           world.linkPose(mp700_ur5e_description::kToolFrame)));
    }
  }
  if (!transforms.empty()) {
    tf_.sendTransform(transforms);
  }
  if (tick.has_odometry) {
    publishBase();
    lockstep_->gate().published(ClockEvent::kOdometry, now_ns);
  }
  if (tick.has_joint_states) {
    publishArm();
    // What a driver without its robot does not send, nobody answers.
    if (simulation_.armDriver().driverConnected()) {
      lockstep_->gate().published(ClockEvent::kJointStates, now_ns);
    }
  }
  if (tick.scan) {
    publishScan(*tick.scan);
    lockstep_->gate().published(ClockEvent::kScan, now_ns);
  }
  for (const Simulation::Tick::Image& image : tick.images) {
    publishImage(image);
    lockstep_->gate().published(ClockEvent::kImage, image.stamp_ns);
  }
}

void SimulatedWorldRos::publishArm() {
  namespace names = mp700_ur5e_description;
  const simulated_world::World& world = simulation_.world();
  const simulated_world::ToolWrench wrench = simulation_.wrench();
  ArmMeasurement measured;
  measured.position_rad = world.armPosition();
  measured.velocity_rad_s = world.armVelocity();
  measured.current_A = world.armTorque() / kTorquePerCurrent_Nm_A;
  measured.force_tool_N = wrench.force_N;
  measured.torque_tool_Nm = wrench.torque_Nm;
  if (arm_->publish(stamp(), measured) > 0) {
    lockstep_->gate().published(ClockEvent::kActionResult, simulation_.nowNs());
  }
}

void SimulatedWorldRos::publishBase() {
  namespace names = mp700_ur5e_description;
  const simulated_world::DifferentialDrive& drive = simulation_.drive();
  const ros::Time now = stamp();
  const simulated_world::RelayBoard board = simulation_.relayBoard();
  neo_msgs::EmergencyStopState relay;
  relay.header.stamp = now;
  relay.emergency_button_stop = board.is_button_pressed;
  relay.scanner_stop = board.is_scanner_blocked;
  relay.emergency_state = static_cast<std::int16_t>(board.state);
  relay_publisher_.publish(relay);

  nav_msgs::Odometry odometry;
  odometry.header.stamp = now;
  odometry.header.frame_id = params_.odom_frame;
  odometry.child_frame_id = names::kBaseFrame;
  odometry.pose.pose.position.x = drive.odometry().x_m;
  odometry.pose.pose.position.y = drive.odometry().y_m;
  odometry.pose.pose.orientation = yawQuaternion(drive.odometry().yaw_rad);
  odometry.twist.twist.linear.x = drive.wheelTwist().linear_m_s;
  odometry.twist.twist.angular.z = drive.wheelTwist().angular_rad_s;
  odometry_publisher_.publish(odometry);

  if (simulation_.now() - last_wheels_s_ < kWheelsPeriod_s - 1e-9) {
    return;
  }
  last_wheels_s_ = simulation_.now();
  sensor_msgs::JointState wheels;
  wheels.header.stamp = now;
  wheels.name = {names::kLeftWheelJoint, names::kRightWheelJoint};
  wheels.position = {drive.leftWheelAngle(), drive.rightWheelAngle()};
  wheels.velocity = {drive.leftWheelSpeed(), drive.rightWheelSpeed()};
  wheels_publisher_.publish(wheels);
}

void SimulatedWorldRos::publishScan(const std::vector<float>& ranges) {
  const simulated_world::LaserScannerConfig& config = simulation_.scannerConfig();
  sensor_msgs::LaserScan scan;
  scan.header.stamp = stamp();
  scan.header.frame_id = simulation_.scannerFrame();
  scan.angle_min = static_cast<float>(config.angle_min_rad);
  scan.angle_increment = static_cast<float>(config.angle_increment_rad);
  scan.angle_max = static_cast<float>(config.angle_min_rad +
                                      config.angle_increment_rad * (static_cast<double>(ranges.size()) - 1.0));
  scan.range_min = static_cast<float>(config.range_min_m);
  scan.range_max = static_cast<float>(config.range_max_m);
  scan.ranges = ranges;
  scan_publisher_.publish(scan);
}

void SimulatedWorldRos::publishImage(const Simulation::Tick::Image& image) {
  std_msgs::Header header;
  header.stamp.fromNSec(static_cast<std::uint64_t>(image.stamp_ns));
  header.frame_id = mp700_ur5e_description::kColorFrame;  // depth is registered to colour
  auto info = boost::make_shared<sensor_msgs::CameraInfo>(
      synthetic_depth_ros::cameraInfo(params_.simulation.camera.camera, header.frame_id));
  info->header = header;
  color_publisher_.publish(cv_bridge::CvImage(header, sensor_msgs::image_encodings::RGB8, image.frame.rgb).toImageMsg(),
                           info);
  const bool is_metric = params_.depth_encoding == sensor_msgs::image_encodings::TYPE_32FC1;
  const cv::Mat depth = is_metric ? image.frame.depth_m : synthetic_depth::encodeDepth16(image.frame.depth_m, 1000.0);
  depth_publisher_.publish(cv_bridge::CvImage(header, params_.depth_encoding, depth).toImageMsg(), info);
}

void SimulatedWorldRos::publishTruth() {
  last_truth_s_ = simulation_.now();
  if (truth_publisher_.getNumSubscribers() == 0 && last_truth_s_ > params_.simulation.start_time_s) {
    return;
  }
  visualization_msgs::MarkerArray markers;
  for (const simulated_world::BrickPlacement& placement : simulation_.scene().bricks) {
    visualization_msgs::Marker marker;
    marker.header.frame_id = params_.map_frame;
    marker.header.stamp = stamp();
    marker.ns = "bricks";
    marker.id = placement.id;
    const std::optional<simulated_world::BrickMotion> brick = simulation_.world().brick(placement.id);
    if (brick) {
      marker.type = placement.decoy == simulated_world::Decoy::kSphere     ? visualization_msgs::Marker::SPHERE
                    : placement.decoy == simulated_world::Decoy::kCylinder ? visualization_msgs::Marker::CYLINDER
                                                                           : visualization_msgs::Marker::CUBE;
      marker.pose = interactive_mapping_ros::toPose(brick->T_map_brick);
      marker.scale.x = placement.type.size_m.x();
      marker.scale.y = placement.type.size_m.y();
      marker.scale.z = placement.type.size_m.z();
      const bool is_held = simulation_.world().heldBrick() == placement.id;
      marker.color.r = is_held ? 0.95F : 0.72F;
      marker.color.g = is_held ? 0.75F : 0.32F;
      marker.color.b = 0.22F;
      marker.color.a = 1.0F;
    } else {
      marker.action = visualization_msgs::Marker::DELETE;
    }
    markers.markers.push_back(marker);
  }
  for (const simulated_world::Obstacle& obstacle : simulation_.world().obstacles()) {
    visualization_msgs::Marker marker;
    marker.header.frame_id = params_.map_frame;
    marker.header.stamp = stamp();
    marker.ns = "obstacles";
    marker.id = obstacle.index;
    marker.type = visualization_msgs::Marker::CYLINDER;
    marker.pose.position.x = obstacle.xy_map.x();
    marker.pose.position.y = obstacle.xy_map.y();
    marker.pose.position.z = 0.5 * simulated_world::kObstacleHeight_m;
    marker.pose.orientation.w = 1.0;
    marker.scale.x = marker.scale.y = 2.0 * simulated_world::kObstacleRadius_m;
    marker.scale.z = simulated_world::kObstacleHeight_m;
    marker.color.r = 0.25F;
    marker.color.g = 0.35F;
    marker.color.b = 0.6F;
    marker.color.a = 1.0F;
    marker.lifetime = ros::Duration(kObstacleMarker_s);  // one that has gone is not sent any more
    markers.markers.push_back(marker);
  }
  truth_publisher_.publish(markers);
}

void SimulatedWorldRos::publishJudge() {
  last_judge_s_ = simulation_.now();
  const simulated_world::JudgeRow totals = simulation_.judge().totals();
  simulated_world::JudgeState state;
  state.header.stamp = stamp();
  state.header.frame_id = params_.map_frame;
  state.bricks_total = static_cast<std::int32_t>(simulation_.scene().bricks.size());
  state.stowed = totals.stowed;
  state.falls = totals.falls;
  state.drops = totals.drops;
  state.collisions = totals.collisions;
  state.load_contacts = totals.load_contacts;
  state.coverage = totals.coverage.value_or(std::numeric_limits<double>::quiet_NaN());
  state.precision = totals.precision.value_or(std::numeric_limits<double>::quiet_NaN());
  state.distance_m = totals.distance_m;
  state.digest = digestText();
  judge_publisher_.publish(state);
}

void SimulatedWorldRos::publishDiagnostics() {
  const ros::WallTime now = ros::WallTime::now();
  const double factor = (simulation_.now() - diagnostics_s_) / (now - diagnostics_wall_).toSec();
  diagnostics_wall_ = now;
  diagnostics_s_ = simulation_.now();
  diagnostic_msgs::DiagnosticStatus status;
  status.name = ros::this_node::getName().substr(1) + ": clock";
  status.hardware_id = "simulation";
  const std::vector<std::string> waiting = lockstep_->gate().waitingFor();
  status.level = given_up_ > 0 ? diagnostic_msgs::DiagnosticStatus::WARN : diagnostic_msgs::DiagnosticStatus::OK;
  status.message = given_up_ > 0      ? "continued without an answer: the run cannot be repeated exactly"
                   : !waiting.empty() ? "waiting for " + waiting.front()
                                      : "running";
  const auto add = [&status](const char* key, double value) {
    diagnostic_msgs::KeyValue entry;
    entry.key = key;
    entry.value = interactive_mapping::formatted("%.3f", value);
    status.values.push_back(entry);
  };
  add("simulated time [s]", simulation_.now());
  add("real-time factor", factor);
  add("answers given up", given_up_);
  add("bricks awake", simulation_.world().numAwake());
  add("points of contact", simulation_.world().numContacts());
  diagnostic_msgs::DiagnosticArray array;
  array.header.stamp = stamp();
  array.status.push_back(status);
  diagnostics_publisher_.publish(array);
}

void SimulatedWorldRos::onCommand(const geometry_msgs::Twist& twist) {
  if (!simulation_.commandBase({twist.linear.x, twist.angular.z})) {
    ROS_WARN_THROTTLE(1.0, "cmd_vel (%g m/s, %g rad/s) refused: must be finite, and no emergency stop", twist.linear.x,
                      twist.angular.z);
    return;
  }
  if (twist.linear.y != 0.0) {
    ROS_WARN_THROTTLE(1.0, "cmd_vel linear.y = %g m/s: this base cannot move sideways, must be 0", twist.linear.y);
  }
  geometry_msgs::TwistStamped taken;
  taken.header.stamp = stamp();
  taken.header.frame_id = mp700_ur5e_description::kBaseFrame;
  taken.twist = twist;
  command_publisher_.publish(taken);
}

void SimulatedWorldRos::onSurface(const topic_tools::ShapeShifter::ConstPtr& message) {
  try {
    simulated_world::StrategySurface surface;
    std::string frame;
    const std::string type = message->getDataType();
    if (type == ros::message_traits::datatype<interactive_mapping_msgs::SurfaceMesh>()) {
      const auto mesh = message->instantiate<interactive_mapping_msgs::SurfaceMesh>();
      frame = mesh->header.frame_id;
      surface = surfaceFrom(*mesh);
    } else if (type == ros::message_traits::datatype<sensor_msgs::PointCloud2>()) {
      const auto cloud = message->instantiate<sensor_msgs::PointCloud2>();
      frame = cloud->header.frame_id;
      surface = surfaceFrom(*cloud);
    } else {
      throw std::invalid_argument("type " + type +
                                  ", must be interactive_mapping_msgs/SurfaceMesh or sensor_msgs/PointCloud2");
    }
    if (interactive_mapping_ros::withoutSlash(frame) != params_.map_frame) {
      throw std::invalid_argument("frame '" + frame + "', must be '" + params_.map_frame + "'");
    }
    simulation_.judgeSurface(surface);
  } catch (const std::exception& error) {
    ROS_ERROR_THROTTLE(5.0, "surface on %s is not judged: %s", params_.surface_topic.c_str(), error.what());
  }
}

bool SimulatedWorldRos::onAdvance(simulated_world::Advance::Request& request,
                                  simulated_world::Advance::Response& response) {
  if (params_.clock != ClockMode::kStepped) {
    response.message = "the clock runs by itself; ~advance is for clock/mode: stepped";
  } else if (!(request.duration_s > 0.0 && request.duration_s <= kLongestAdvance_s)) {
    response.message = "duration_s = " + std::to_string(request.duration_s) + ", must be in (0, 600] s";
  } else {
    const auto ticks = static_cast<std::int64_t>(std::ceil(request.duration_s / params_.simulation.tick_s - 1e-6));
    for (std::int64_t i = 0; i < ticks && ros::ok(); ++i) {
      while (ros::ok() && isHeld()) {
        ros::getGlobalCallbackQueue()->callOne(ros::WallDuration(kPollPeriod_s));
      }
      tick();
      ros::getGlobalCallbackQueue()->callAvailable();
    }
    response.success = true;
  }
  response.now = stamp();
  response.digest = digestText();
  return true;
}

bool SimulatedWorldRos::onFault(simulated_world::InjectFault::Request& request,
                                simulated_world::InjectFault::Response& response) {
  try {
    const std::optional<simulated_world::FaultKind> kind = simulated_world::faultKind(request.kind);
    if (!kind) {
      throw std::invalid_argument("kind = '" + request.kind + "', must be one of " + simulated_world::allFaultNames());
    }
    simulated_world::Fault fault;
    fault.kind = *kind;
    fault.at_s = request.at_s;
    fault.duration_s = request.duration_s;
    fault.value = request.value;
    fault.value2 = request.value2;
    fault.brick_id = request.brick_id;
    if (*kind == simulated_world::FaultKind::kMoveBrick || *kind == simulated_world::FaultKind::kObstacle) {
      fault.T_map_object = poseFromMessage(request.pose);
    }
    simulation_.addFault(fault);
    response.success = true;
  } catch (const std::invalid_argument& error) {
    response.message = error.what();
    ROS_WARN("%s", error.what());
  }
  return true;
}

bool SimulatedWorldRos::onCapture(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  response.success = simulation_.requestImage();
  response.message = response.success ? "an image will be taken at the next tick" : "the camera is gone";
  return true;
}

}  // namespace simulated_world_ros
