// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>

#include <geometry_msgs/Twist.h>
#include <image_transport/image_transport.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <std_msgs/Int32.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/transform_broadcaster.h>
#include <topic_tools/shape_shifter.h>

#include "simulated_world/Advance.h"
#include "simulated_world/InjectFault.h"
#include "simulated_world/clock_trace.h"
#include "simulated_world/judge_writer.h"
#include "simulated_world/run_pictures.h"
#include "simulated_world/simulation.h"
#include "simulated_world_ros/lockstep.h"
#include "simulated_world_ros/simulation_params.h"
#include "simulated_world_ros/ur_driver_ros.h"

namespace simulated_world_ros {

/// The simulated world as a ROS node: stands where the drivers of arm, base, scanner and camera stand, and makes the
/// clock. One thread: callbacks run between ticks, so what has arrived by a tick takes effect in it.
/// Long: each topic, service and diagnostic is a few lines, and the work is in the core.
class SimulatedWorldRos {
 public:
  /// Builds the world; throws what Simulation and JudgeWriter throw.
  SimulatedWorldRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const SimulationParams& params);
  ~SimulatedWorldRos();

  /// Until the node is shut down. Throws std::runtime_error if the physics fail.
  void run();

 private:
  void advertiseDrivers();
  void advertiseExperiment();

  bool mayTick();  // as far as the clock's mode is concerned; waits a little if not
  bool isHeld();   // by what is due
  void tick();
  void takePictures(bool is_last);
  void traceClock();
  void publishClock();
  void publishState(const simulated_world::Simulation::Tick& tick);
  void publishArm();
  void publishBase();
  void publishScan(const std::vector<float>& ranges);
  void publishImage(const simulated_world::Simulation::Tick::Image& image);
  void publishTruth();
  void publishJudge();
  void publishDiagnostics();

  void onCommand(const geometry_msgs::Twist& twist);
  void onSurface(const topic_tools::ShapeShifter::ConstPtr& message);
  bool onAdvance(simulated_world::Advance::Request& request, simulated_world::Advance::Response& response);
  bool onFault(simulated_world::InjectFault::Request& request, simulated_world::InjectFault::Response& response);
  bool onCapture(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  std::string digestText() const;
  /// Of colour and depth images, those that the master knows a node to want. 0 if the master is away.
  std::size_t numCameraTopicsOf(const std::string& node) const;
  /// Who must hear what it answers and does not yet; empty: nobody.
  std::string missingSubscriber() const;
  ros::Time stamp() const;

  ros::NodeHandle nh_;
  ros::NodeHandle private_nh_;
  ros::CallbackQueue experiment_queue_;  // ~advance runs ticks, which serve the drivers' callbacks
  ros::NodeHandle experiment_nh_;
  SimulationParams params_;
  simulated_world::Simulation simulation_;
  std::unique_ptr<simulated_world::JudgeWriter> writer_;
  std::unique_ptr<simulated_world::RunPictures> pictures_;
  std::unique_ptr<simulated_world::ClockTrace> clock_trace_;
  std::mutex arm_mutex_;  // asked for by UrDriverRos, which does not know that all is one thread
  std::unique_ptr<UrDriverRos> arm_;
  std::unique_ptr<Lockstep> lockstep_;

  ros::Publisher clock_publisher_;
  ros::Publisher odometry_publisher_;
  ros::Publisher wheels_publisher_;
  ros::Publisher relay_publisher_;
  ros::Publisher scan_publisher_;
  ros::Publisher truth_publisher_;
  ros::Publisher judge_publisher_;
  ros::Publisher incident_publisher_;
  ros::Publisher command_publisher_;
  ros::Publisher diagnostics_publisher_;
  image_transport::ImageTransport transport_;
  image_transport::CameraPublisher color_publisher_;
  image_transport::CameraPublisher depth_publisher_;
  std::map<simulated_world::ClockEvent, std::multiset<std::string>> subscribers_of_;  // nodes, once for each topic
  tf2_ros::TransformBroadcaster tf_;
  std::vector<ros::Subscriber> subscribers_;
  std::vector<ros::ServiceServer> services_;

  bool has_begun_{false};
  ros::WallTime begun_wall_;  // of the real-time schedule
  double begun_s_{0.0};
  ros::WallTime held_since_wall_;
  int given_up_{0};  // answers that never came: the run is no longer lock-step
  ros::WallTime diagnostics_wall_;
  double diagnostics_s_{0.0};
  double last_truth_s_{0.0};
  double last_judge_s_{0.0};
  double last_wheels_s_{0.0};
};

}  // namespace simulated_world_ros
