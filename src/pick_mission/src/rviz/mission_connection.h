// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <QObject>
#include <interactive_mapping_msgs/MissionState.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>

#include "mission_view_model.h"

namespace pick_mission_rviz {

/// A mission's state and services. Its own threads wait; what comes is told in the thread of this object (the GUI's),
/// which never waits for more than the master, and that in connectTo() only. Needs ros::init().
class MissionConnection : public QObject {
  Q_OBJECT
 public:
  using StateCallback = std::function<void(const interactive_mapping_msgs::MissionState::ConstPtr&)>;
  using AnswerCallback = std::function<void(Request, const Answer&)>;

  MissionConnection(StateCallback on_state, AnswerCallback on_answer);
  /// Calls that have no answer yet are broken off, a hold after half a second; one that waits for the master (a cut
  /// network) is waited for.
  ~MissionConnection() override;

  /// Nothing of the node before comes any more; a hold that is on its way there goes on. Throws std::invalid_argument
  /// unless it is the name of a node.
  void connectTo(const std::string& node);
  const std::string& node() const { return node_; }

  /// At once, whatever else waits. The same request again breaks off the one before, which is then not answered. But a hold
  /// is never broken off: the same again within 2 s, with nothing else in between, is one with it; else it goes out beside it.
  void call(Request request);

 private:
  class Call;

  const StateCallback on_state_;
  const AnswerCallback on_answer_;
  std::string node_;
  unsigned epoch_{0};                               // counts the nodes: what comes late, of one before, is known by it
  std::array<unsigned, kNumRequests> last_call_{};  // the same for the calls of each request
  std::optional<Request> last_request_;
  ros::NodeHandle nh_;
  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_;
  ros::Subscriber subscriber_;
  std::vector<std::unique_ptr<Call>> calls_;
};

}  // namespace pick_mission_rviz
