// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <actionlib/client/action_client.h>
#include <control_msgs/FollowJointTrajectoryAction.h>
#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>

#include "ur_driver_bridge/arm_call.h"
#include "ur_driver_bridge_ros/gripper.h"

namespace ur_driver_bridge_ros {

/// Runs calls one after another on a thread of its own: a service that hangs holds up nobody but those behind it.
class CallThread {
 public:
  CallThread() : thread_(&CallThread::work, this) {}
  ~CallThread();
  CallThread(const CallThread&) = delete;
  CallThread& operator=(const CallThread&) = delete;

  void post(std::function<void()> call);

 private:
  void work();

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> calls_;
  bool is_stopping_{false};
  std::thread thread_;  // last: everything it uses exists before it
};

/// The arm's driver as the executor's calls need it: trajectories through scaled_pos_joint_traj_controller, services of
/// ur_hardware_interface. Answers come on threads of their own. Names below are relative to `nh`. What the controller follows
/// when it is first met was sent by another process, a bridge that has crashed, and is cancelled.
class UrDriver {
 public:
  using OnReply = std::function<void(const ur_driver_bridge::CallReply&)>;
  using OnEvent = std::function<void(const ur_driver_bridge::TrajectoryEvent&)>;

  /// `gripper` has been started, and outlives the driver.
  UrDriver(const ros::NodeHandle& nh, Gripper& gripper, OnReply on_reply, OnEvent on_event);
  ~UrDriver();

  bool isControllerThere() const { return is_controller_there_; }

  void send(std::uint64_t id, const ur_driver_bridge::JointTrajectory& trajectory);
  /// Cancels any trajectory of the controller, also those of other clients.
  void cancel();
  void setMagnet(std::uint64_t id, bool is_on);
  void zeroForce(std::uint64_t id);
  void setPayload(std::uint64_t id, const ur_driver_bridge::Payload& payload);
  void dashboard(std::uint64_t id, const std::string& command);

 private:
  using Client = actionlib::ActionClient<control_msgs::FollowJointTrajectoryAction>;

  void onTransition(std::uint64_t id, Client::GoalHandle handle);
  void trigger(std::uint64_t id, const std::string& service);
  void post(std::uint64_t id, std::function<ur_driver_bridge::CallReply()> call);

  ros::NodeHandle nh_;
  Gripper& gripper_;
  OnReply on_reply_;
  OnEvent on_event_;

  ros::CallbackQueue queue_;  // of the action client
  std::unique_ptr<Client> client_;
  bool is_old_cancelled_{false};  // of queue_'s thread
  std::mutex goals_mutex_;
  std::deque<Client::GoalHandle> goals_;  // the newest last; handles that go out of scope tell nothing any more
  std::atomic<bool> is_controller_there_{false};
  ros::WallTimer presence_timer_;
  std::unique_ptr<ros::AsyncSpinner> spinner_;
  CallThread services_;
};

}  // namespace ur_driver_bridge_ros
