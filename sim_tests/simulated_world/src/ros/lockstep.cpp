// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world_ros/lockstep.h"

#include <cstdint>
#include <set>

#include <actionlib_msgs/GoalID.h>
#include <actionlib_msgs/GoalStatus.h>
#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <std_msgs/Header.h>

namespace simulated_world_ros {
namespace {

// Reads the first fields of a message whose type is not known here.
template <typename... Fields>
bool readFirst(const std::vector<std::uint8_t>& serialised, Fields*... fields) {
  // IStream takes a pointer to non-const, and reads only.
  ros::serialization::IStream stream(const_cast<std::uint8_t*>(serialised.data()),
                                     static_cast<std::uint32_t>(serialised.size()));
  try {
    (stream.next(*fields), ...);
  } catch (const ros::serialization::StreamOverrunException&) {
    return false;
  }
  return true;
}

std::vector<std::uint8_t> bytesOf(const topic_tools::ShapeShifter& message) {
  std::vector<std::uint8_t> bytes(message.size());
  ros::serialization::OStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  message.write(stream);
  return bytes;
}

std::int64_t nanoseconds(const ros::Time& time) {
  return static_cast<std::int64_t>(time.toNSec());
}

}  // namespace

bool headerStamp(const std::vector<std::uint8_t>& serialised, std::int64_t* stamp_ns) {
  std_msgs::Header header;
  if (!readFirst(serialised, &header)) {
    return false;
  }
  *stamp_ns = nanoseconds(header.stamp);
  return true;
}

bool goalId(const std::vector<std::uint8_t>& serialised, std::string* id, std::int64_t* stamp_ns) {
  std_msgs::Header header;
  actionlib_msgs::GoalID goal;
  if (!readFirst(serialised, &header, &goal)) {
    return false;
  }
  *id = goal.id;
  *stamp_ns = nanoseconds(goal.stamp);
  return true;
}

bool resultGoalId(const std::vector<std::uint8_t>& serialised, std::string* id) {
  std_msgs::Header header;
  actionlib_msgs::GoalStatus status;
  if (!readFirst(serialised, &header, &status)) {
    return false;
  }
  *id = status.goal_id.id;
  return true;
}

Lockstep::Lockstep(ros::NodeHandle nh, const std::vector<simulated_world::WaitRule>& wait_for,
                   const std::vector<simulated_world::ComputingRule>& computing)
    : nh_(std::move(nh)), gate_(wait_for, computing) {
  constexpr std::uint32_t kQueueSize = 1000;  // an answer that is lost would stop the clock
  // The clock waits for each of these: held back by Nagle's algorithm, each would cost 40 ms.
  const ros::TransportHints no_delay = ros::TransportHints().tcpNoDelay();
  std::set<std::string> actions;
  for (std::size_t i = 0; i < wait_for.size(); ++i) {
    const std::string topic = wait_for[i].topic;
    answers_.push_back(nh_.subscribe<topic_tools::ShapeShifter>(
        topic, kQueueSize,
        [this, i, topic](const topic_tools::ShapeShifter::ConstPtr& message) {
          std::int64_t stamp_ns = 0;
          if (headerStamp(bytesOf(*message), &stamp_ns)) {
            gate_.answered(i, stamp_ns);
          } else {
            complaints_.push_back(topic + " carries " + message->getDataType() +
                                  ", which does not begin with a Header");
          }
        },
        ros::VoidConstPtr(), no_delay));
    if (!wait_for[i].while_action.empty()) {
      actions.insert(wait_for[i].while_action);
    }
  }
  for (const simulated_world::ComputingRule& rule : computing) {
    actions.insert(rule.action);
  }
  for (const std::string& action : actions) {
    watchAction(action);
  }
}

void Lockstep::watchAction(const std::string& action) {
  constexpr std::uint32_t kQueueSize = 1000;
  const ros::TransportHints no_delay = ros::TransportHints().tcpNoDelay();
  actions_.push_back(nh_.subscribe<topic_tools::ShapeShifter>(
      action + "/goal", kQueueSize,
      [this, action](const topic_tools::ShapeShifter::ConstPtr& message) {
        std::string id;
        std::int64_t stamp_ns = 0;
        if (goalId(bytesOf(*message), &id, &stamp_ns)) {
          gate_.goalOpened(action, id, stamp_ns);
        } else {
          complaints_.push_back(action + "/goal carries " + message->getDataType() + ", which is no action goal");
        }
      },
      ros::VoidConstPtr(), no_delay));
  actions_.push_back(nh_.subscribe<topic_tools::ShapeShifter>(
      action + "/result", kQueueSize,
      [this, action](const topic_tools::ShapeShifter::ConstPtr& message) {
        std::string id;
        if (resultGoalId(bytesOf(*message), &id)) {
          gate_.goalClosed(action, id);
        } else {
          complaints_.push_back(action + "/result carries " + message->getDataType() + ", which is no action result");
        }
      },
      ros::VoidConstPtr(), no_delay));
}

std::vector<std::string> Lockstep::missing() const {
  std::vector<std::string> topics;
  for (const ros::Subscriber& subscriber : answers_) {
    if (subscriber.getNumPublishers() == 0) {
      topics.push_back(subscriber.getTopic());
    }
  }
  return topics;
}

std::vector<std::string> Lockstep::takeComplaints() {
  std::vector<std::string> taken;
  taken.swap(complaints_);
  return taken;
}

}  // namespace simulated_world_ros
