// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include <actionlib_msgs/GoalStatusArray.h>
#include <interactive_mapping_msgs/ArmBridgeState.h>
#include <interactive_mapping_msgs/ArmOutcome.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/BrickArray.h>
#include <interactive_mapping_msgs/DetectBricks.h>
#include <interactive_mapping_msgs/LetGoBrickAction.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/MoveArmAction.h>
#include <interactive_mapping_msgs/NavigationOutcome.h>
#include <interactive_mapping_msgs/PickBrickAction.h>
#include <interactive_mapping_msgs/PlanArmAction.h>
#include <interactive_mapping_msgs/PlanPickAction.h>
#include <interactive_mapping_msgs/RecoverArmAction.h>
#include <interactive_mapping_msgs/ReportFailure.h>
#include <interactive_mapping_msgs/SelectNextBestViewAction.h>
#include <motion_planning/arm_kinematics.h>
#include <motion_planning/manipulability_sector.h>
#include <move_base_msgs/MoveBaseAction.h>
#include <ros/callback_queue.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "pick_mission_ros/action_caller.h"
#include "pick_mission_ros/conversions.h"
#include "pick_mission_ros/pick_mission_params.h"
#include "pick_mission_ros/service_caller.h"

namespace pick_mission_ros {

constexpr char kLog[] = "pick_mission";  // the logger's name

/// Carries the mission's commands out: each is answered by one Reply, through `post`. All in the thread of `queue`, but for
/// tf.
/// Long: a few lines for each command, which share callers, tf and the newest of each topic.
class MissionActions {
 public:
  using Post = std::function<void(const pick_mission::Event& event)>;
  using OnSelection = std::function<void(const interactive_mapping_msgs::NbvSelection& selection)>;

  /// Throws std::invalid_argument for a robot_description or a file of sectors that cannot be used.
  MissionActions(const ros::NodeHandle& nh, const PickMissionParams& params, ros::CallbackQueue* queue,
                 std::shared_ptr<Inbox> inbox, Post post, OnSelection on_selection);

  void carryOut(const pick_mission::Command& command);

  /// Limits of time, lost servers, a bridge that no longer reports. To be called some ten times per
  /// second of wall time.
  void watch();

  /// The clock was set forward by so much: limits of time go with it.
  void shiftTimes(ros::Duration by);

  /// What a mission cannot begin without and is not there, a phrase each.
  std::vector<std::string> missing();

  /// Where it begins. Throws std::runtime_error if tf has no pose.
  pick_mission::event::Start start() const;

  /// The robot's pose in the map; nothing if tf has none.
  std::optional<pick_mission::Pose2d> place() const;

  /// Ends the running action, which is then answered as it ended.
  void cancel();
  bool isIdle() const { return !running_ && !carrying_; }

  /// Ends every drive, also one that this process has not asked for.
  void cancelDrives() { drive_.cancelAll(); }

  /// Whether drives and motions of the arm that an earlier process has asked for have been cancelled. It is begun with the
  /// construction, as soon as each server is there; false for as long as one is not.
  bool areOldGoalsCancelled() const;

  /// A hold that no server has received: then the mission sends no heartbeat.
  bool isHoldLost() const { return is_hold_lost_; }

  /// As the bridge reports; unknown if its report is stale.
  pick_mission::Hand hand() const;

 private:
  using ArmOutcome = interactive_mapping_msgs::ArmOutcome;

  struct PendingArm {  // until the bridge has reported the magnet's state after it
    std::uint64_t id;  // of the command
    pick_mission::ArmStatus status;
    std::string message;
    ros::Time stamp;
    ros::SteadyTime since;
    bool lets_go;
    bool is_lost_over_robot;
  };
  struct PendingDetection {  // until the list of all bricks has come
    interactive_mapping_msgs::DetectBricks::Response response;
    ros::SteadyTime since;
  };
  struct PendingDrive {  // until the navigation has reported its outcome
    bool is_succeeded;
    bool is_cancelled;
    std::string why;
    ros::SteadyTime since;
  };
  struct LookWork {
    int images;
    int seen{0};
    ros::Time since;
    ros::Time deadline;
    double map_stamp_s{0.0};
    std::string refused;
  };
  struct WaitWork {
    pick_mission::WaitUntil until;
    ros::Time since;
    ros::Time deadline;
    ros::Duration at_least;
  };

  void begin(const pick_mission::command::PlanArm& plan);
  void begin(const pick_mission::command::MoveArm& move);
  void begin(const pick_mission::command::Look& look);
  void begin(const pick_mission::command::Detect& detect);
  void begin(const pick_mission::command::PlanPick& plan);
  void begin(const pick_mission::command::Pick& pick);
  void begin(const pick_mission::command::LetGo& let_go);
  void begin(const pick_mission::command::ReportFailure& report);
  void begin(const pick_mission::command::SelectView& select);
  void begin(const pick_mission::command::Drive& drive);
  void begin(const pick_mission::command::Recover& recover);
  void begin(const pick_mission::command::Wait& wait);
  void begin(const pick_mission::command::Cancel& cancel);
  void begin(const pick_mission::command::Hold& hold);
  void begin(const pick_mission::command::Release& release);

  /// Copies: what is replied may be a part of the work that it ends.
  void reply(std::uint64_t id, pick_mission::Result result, std::string message,
             std::optional<pick_mission::Hand> hand = std::nullopt);
  void reply(const pick_mission::Result& result, const std::string& message,
             std::optional<pick_mission::Hand> hand = std::nullopt) {
    if (running_) reply(*running_, result, message, hand);
  }
  void noAnswer(const std::string& why) { reply(pick_mission::NoAnswer{}, why); }
  /// `lets_go`: it succeeds when what was held is let go.
  template <typename Action>
  void sendArm(ActionCaller<Action>* caller, const typename ActionCaller<Action>::Goal& goal, bool lets_go);
  template <typename Action, typename OnResult>
  void sendPlan(ActionCaller<Action>* caller, const typename ActionCaller<Action>::Goal& goal, OnResult on_result);
  void abandon(bool keeps_pick);
  void forgetWork();
  void tellPileLeft();
  void callHold();
  void callRelease();
  void finishArm();
  void finishDetection();
  void finishDrive(const interactive_mapping_msgs::NavigationOutcome* outcome);
  void tellHand();
  Eigen::Isometry3d baseInMap() const;

  void onBridgeState(const interactive_mapping_msgs::ArmBridgeStateConstPtr& message);
  void onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message);
  void onMapUpdate(const interactive_mapping_msgs::MapUpdateConstPtr& message);
  void onBricks(const interactive_mapping_msgs::BrickArrayConstPtr& message);
  void onNavigationOutcome(const interactive_mapping_msgs::NavigationOutcomeConstPtr& message);
  void onDriveStatus(const actionlib_msgs::GoalStatusArrayConstPtr& message);

  template <typename Call>
  void forActions(const Call& call) {
    std::apply([&call](auto&... action) { (call(action), ...); },
               std::tie(plan_arm_, plan_pick_, move_arm_, pick_, let_go_, recover_, select_, drive_));
  }
  template <typename Call>
  void forServices(const Call& call) {
    std::apply([&call](auto&... service) { (call(service), ...); }, std::tie(detect_, report_, hold_, release_));
  }

  const PickMissionParams params_;
  const std::shared_ptr<const motion_planning::ArmKinematics> arm_;
  const motion_planning::ManipulabilitySectors sectors_;
  const Eigen::Isometry3d T_base_armbase_;
  const Post post_;
  const OnSelection on_selection_;

  std::optional<std::uint64_t> running_;   // id of the command that has not been answered
  std::optional<std::uint64_t> carrying_;  // of a pick beside it
  std::uint64_t pile_left_by_{0};          // the pick of which that was reported
  std::optional<PendingArm> pending_arm_;
  std::optional<PendingDetection> pending_detection_;
  std::optional<PendingDrive> pending_drive_;
  std::optional<LookWork> look_;
  std::optional<WaitWork> wait_;
  std::optional<pick_mission::Pose2d> drive_goal_;
  std::optional<interactive_mapping_msgs::NavigationOutcome> drive_outcome_;  // heard before the action's result
  ros::Time drive_since_;
  bool may_base_drive_{true};  // by its server's last status a goal runs that is not cancelled; or no status has come
  bool is_hold_wanted_{false};
  bool is_hold_lost_{false};

  // Plans that wait to be carried out, with the id of the command that asked for them.
  std::uint64_t arm_plan_id_{0}, pick_plan_id_{0};
  interactive_mapping_msgs::PlanArmResult arm_plan_;
  interactive_mapping_msgs::PlanPickResult pick_plan_;
  std::vector<double> pick_end_rad_;  // joints at the end of the pick that was begun last

  interactive_mapping_msgs::ArmBridgeStateConstPtr bridge_;
  interactive_mapping_msgs::AttachedBrickConstPtr attached_;
  interactive_mapping_msgs::BrickArrayConstPtr bricks_;
  ros::Time map_stamp_;
  pick_mission::Hand told_hand_{pick_mission::Hand::kUnknown};

  mutable tf2_ros::Buffer tf_;  // drops what a jump of the clock has left in it at the next look-up
  tf2_ros::TransformListener tf_listener_;
  ActionCaller<interactive_mapping_msgs::PlanArmAction> plan_arm_;
  ActionCaller<interactive_mapping_msgs::PlanPickAction> plan_pick_;
  ActionCaller<interactive_mapping_msgs::MoveArmAction> move_arm_;
  ActionCaller<interactive_mapping_msgs::PickBrickAction> pick_;
  ActionCaller<interactive_mapping_msgs::LetGoBrickAction> let_go_;
  ActionCaller<interactive_mapping_msgs::RecoverArmAction> recover_;
  ActionCaller<interactive_mapping_msgs::SelectNextBestViewAction> select_;
  ActionCaller<move_base_msgs::MoveBaseAction> drive_;
  ServiceCaller<interactive_mapping_msgs::DetectBricks> detect_;
  ServiceCaller<interactive_mapping_msgs::ReportFailure> report_;
  ServiceCaller<std_srvs::Trigger> hold_, release_;
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace pick_mission_ros
