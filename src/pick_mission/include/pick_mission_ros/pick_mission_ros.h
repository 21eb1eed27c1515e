// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include <diagnostic_updater/diagnostic_updater.h>
#include <interactive_mapping_common_ros/clock_timer.h>
#include <interactive_mapping_msgs/MissionFailure.h>
#include <interactive_mapping_msgs/MissionState.h>
#include <mp700_ur5e_description/brick_types.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include "pick_mission/clock_steps.h"
#include "pick_mission/mission_machine.h"
#include "pick_mission_ros/mission_actions.h"
#include "pick_mission_ros/pick_mission_params.h"
#include "pick_mission_ros/run_recorder.h"

namespace pick_mission_ros {

/// The node: the machine decides, MissionActions carries out, RunRecorder keeps. All in the thread that calls spinOnce(),
/// but for the heartbeat, which stops when that thread hangs.
/// Long: each topic, service and diagnostic is a few lines, and the work is in the core.
class PickMissionRos {
 public:
  /// Throws std::invalid_argument for impossible parameters, files that cannot be used, or a saved state that is none.
  PickMissionRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~PickMissionRos();

  /// What has come, or nothing for a moment.
  void spinOnce();

  /// Ends the running action and waits for that, at most `timeout`. The mission can resume in the next node.
  void stop(ros::WallDuration timeout);

 private:
  using Service = bool (PickMissionRos::*)(std_srvs::Trigger::Request&, std_srvs::Trigger::Response&);

  std::string folderOf(int mission) const;
  void makeMachine();
  void makeAnother();
  void autostart();
  std::string start();
  void step(const pick_mission::Event& event);
  void drain();
  void keep();
  void publishState();
  void tick();
  void unload();
  void tellPlannerOfEmptyContainer();
  void letHeartBeat();
  double followClock();
  void beat();
  double wallSeconds() const;
  std::optional<int> currentBrick() const;
  void take(const pick_mission::Event& event, std_srvs::Trigger::Response* response);
  void onSelection(const interactive_mapping_msgs::NbvSelection& selection);
  bool onStart(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onPause(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onResume(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onHold(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onStop(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onUnloaded(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);

  const PickMissionParams params_;
  const mp700_ur5e_description::BrickCatalogue catalogue_;
  ros::CallbackQueue queue_;
  std::shared_ptr<Inbox> inbox_;
  std::unique_ptr<RunRecorder> recorder_;
  std::unique_ptr<pick_mission::MissionMachine> machine_;
  std::unique_ptr<MissionActions> actions_;
  std::unique_ptr<ServiceCaller<std_srvs::Trigger>> unload_;  // null: a person unloads
  std::unique_ptr<ServiceCaller<std_srvs::Trigger>> container_emptied_;
  int num_missions_{1};  // of this run, the present one included

  std::deque<pick_mission::Event> events_;  // to be stepped through
  bool is_draining_{false};
  bool is_stopping_{false};
  std::string decision_;               // the last one
  std::optional<std::string> answer_;  // to what a service asks for: the reason in the log
  ros::Time state_since_;
  std::optional<int> brick_;                                       // of the last command about one
  std::deque<interactive_mapping_msgs::MissionFailure> failures_;  // newest first
  int num_failures_{0};
  std::optional<interactive_mapping_msgs::NbvSegment> selected_;  // by the last selection
  std::optional<interactive_mapping_msgs::NbvSegment> view_;      // driven to, or stood at
  double wall_before_s_{0.0};                                     // of earlier nodes of this run
  std::optional<ros::SteadyTime> started_;
  std::optional<double> ended_wall_s_;
  std::string told_problem_;
  std::string waits_for_;  // before it can start

  pick_mission::ClockSteps clock_steps_;
  ros::Time ticked_;
  ros::SteadyTime watched_, published_, asked_;
  std::atomic<double> alive_s_{0.0};  // steady time of the last spinOnce()
  std::atomic<bool> is_hold_lost_{false};
  std::atomic<bool> may_heart_beat_{false};
  const ros::SteadyTime begun_{ros::SteadyTime::now()};

  ros::Publisher state_publisher_, marker_publisher_, heartbeat_publisher_;
  std::vector<ros::ServiceServer> servers_;
  diagnostic_updater::Updater diagnostics_;
  ros::WallTimer diagnostics_timer_;
  ros::CallbackQueue heart_queue_;
  std::unique_ptr<interactive_mapping_ros::ClockTimer> heart_timer_;
  std::unique_ptr<ros::AsyncSpinner> heart_;  // last: it uses the rest
};

}  // namespace pick_mission_ros
