// SPDX-License-Identifier: BSD-3-Clause
// Waiting on conditions, for tests that talk to nodes.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>

namespace node_tests {

/// Ample on a machine that is busy with other work; what passes takes milliseconds.
constexpr double kDeadline_s = 30.0;

/// Serves callbacks until the condition holds; false if it does not within the deadline.
inline bool waitUntil(const std::function<bool()>& condition, double deadline_s = kDeadline_s) {
  const ros::WallTime deadline = ros::WallTime::now() + ros::WallDuration(deadline_s);
  while (ros::ok() && ros::WallTime::now() < deadline) {
    if (condition()) return true;
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.02));
  }
  return condition();
}

/// Calls a service by a connection that the server does not close. A server may close it right after its answer. roscpp
/// then at times finds it closed before it has read the answer, and reports a failed call.
template <typename Service>
bool call(const std::string& name, Service& service) {
  return ros::NodeHandle().serviceClient<Service>(name, true).call(service);
}

/// The bytes a message has on the wire: equal only if every field is, NaN included.
template <typename Message>
std::vector<std::uint8_t> bytesOf(const Message& message) {
  std::vector<std::uint8_t> bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, message);
  return bytes;
}

inline bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// The last message of a topic.
template <typename Message>
class Latest {
 public:
  explicit Latest(const std::string& topic) : topic_(topic) {
    subscriber_ = ros::NodeHandle().subscribe<Message>(
        topic, 10, [this](const boost::shared_ptr<const Message>& message) { last_ = message; });
  }
  /// The first message for which the predicate holds, waiting for it. A copy: the next message may come at any wait.
  Message await(const std::function<bool(const Message&)>& predicate) {
    EXPECT_TRUE(waitUntil([&] { return last_ && predicate(*last_); })) << topic_;
    if (!last_) last_.reset(new Message());
    return *last_;
  }
  bool hasCome() const { return last_ != nullptr; }
  Message awaitStamp(const ros::Time& stamp) {
    return await([stamp](const Message& message) { return message.header.stamp == stamp; });
  }

 private:
  std::string topic_;
  ros::Subscriber subscriber_;
  boost::shared_ptr<const Message> last_;
};

}  // namespace node_tests
