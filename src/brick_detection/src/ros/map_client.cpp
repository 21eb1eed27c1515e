// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/map_client.h"

#include <chrono>
#include <exception>
#include <utility>

#include <ros/console.h>

namespace brick_detection_ros {
namespace {

using brick_detection::SpaceState;
using interactive_mapping_msgs::MapUpdate;
using interactive_mapping_msgs::QueryMap;

constexpr double kRepeat_s = 30.0;
constexpr double kRetry_s = 1.0;  // wall time after which a service that was not there is looked for again
/// At the end an answer on its way is waited for so long; then its connection is closed, which ends the call.
constexpr std::chrono::seconds kLastAnswer(1);

SpaceState toSpaceState(std::uint8_t state) {
  if (state == QueryMap::Response::FREE) return SpaceState::kFree;
  return state == QueryMap::Response::OCCUPIED ? SpaceState::kOccupied : SpaceState::kUnknown;
}

}  // namespace

MapClient::MapClient(const ros::NodeHandle& nh, const std::string& map_frame, Callbacks callbacks)
    : nh_(nh), map_frame_(map_frame), callbacks_(std::move(callbacks)), service_(nh_.resolveName("map/query")) {
  update_subscriber_ = nh_.subscribe<MapUpdate>("map_update", 5, [this](const MapUpdate::ConstPtr& update) {
    if (update->status != MapUpdate::ACCEPTED) return;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      ++counters_.updates;
      next_try_ = ros::WallTime();  // there it is
    }
    wake();
  });
  worker_ = std::thread(&MapClient::work, this);
}

MapClient::~MapClient() {
  update_subscriber_.shutdown();
  {
    std::unique_lock<std::mutex> lock(mutex_);
    is_stopping_ = true;
    changed_.notify_all();
    while (!changed_.wait_for(lock, kLastAnswer, [this] { return has_ended_; })) client_.shutdown();
  }
  worker_.join();
}

void MapClient::wake() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    has_news_ = true;
  }
  changed_.notify_all();
}

MapClient::Counters MapClient::counters() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return counters_;
}

void MapClient::work() {
  while (true) {
    {
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait(lock, [this] { return is_stopping_ || has_news_; });
      if (is_stopping_) {
        has_ended_ = true;
        changed_.notify_all();
        return;
      }
      has_news_ = false;
    }
    try {
      ask();
    } catch (const std::exception& error) {
      fail(error.what());
    }
  }
}

void MapClient::fail(const std::string& why) {
  bool is_lost = false;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (is_stopping_) return;
    is_lost = counters_.answers > 0 && counters_.last_failure.empty();
  }
  if (is_lost) callbacks_.lost();
  const std::lock_guard<std::mutex> lock(mutex_);
  counters_.last_failure = why;
  // Somebody may well work without a map.
  if (counters_.updates == 0 && counters_.answers == 0) return;
  if (counters_.asked_since.isZero()) counters_.asked_since = ros::WallTime::now();
  ROS_WARN_THROTTLE_NAMED(kRepeat_s, "brick_detection", "the map was not asked about the bricks: %s", why.c_str());
}

void MapClient::ask() {
  const MapQuestion question = callbacks_.ask();
  const Eigen::Index num_points = question.points_map.cols();
  if (num_points == 0) return;
  ros::ServiceClient client;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (is_stopping_) return;
    // A connection that stays; lost, it is made anew.
    if (!client_.isValid()) {
      if (ros::WallTime::now() < next_try_) return;
      client_ = nh_.serviceClient<QueryMap>("map/query", true);
    }
    client = client_;
    if (client.isValid()) {
      ++counters_.questions;
      if (counters_.asked_since.isZero()) counters_.asked_since = ros::WallTime::now();
    } else {
      next_try_ = ros::WallTime::now() + ros::WallDuration(kRetry_s);
    }
  }
  if (!client.isValid()) {
    fail("no service " + service_);
    return;
  }
  QueryMap query;
  query.request.frame_id = map_frame_;
  query.request.points.resize(static_cast<std::size_t>(num_points));
  for (Eigen::Index i = 0; i < num_points; ++i) {
    geometry_msgs::Point& point = query.request.points[static_cast<std::size_t>(i)];
    point.x = question.points_map(0, i);
    point.y = question.points_map(1, i);
    point.z = question.points_map(2, i);
  }
  if (!client.call(query)) {
    {
      // What is left of the connection is in no known state.
      const std::lock_guard<std::mutex> lock(mutex_);
      client_ = ros::ServiceClient();
    }
    fail("call of " + service_ + " failed");
    return;
  }
  if (!query.response.success || query.response.state.size() != static_cast<std::size_t>(num_points)) {
    fail(service_ + " gave " + std::to_string(query.response.state.size()) + " answers to " +
         std::to_string(num_points) + " points: " + query.response.message);
    return;
  }
  std::vector<SpaceState> states;
  states.reserve(query.response.state.size());
  for (const std::uint8_t state : query.response.state) states.push_back(toSpaceState(state));
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (is_stopping_) return;
    ++counters_.answers;
    counters_.asked_since = ros::WallTime();
    counters_.last_failure.clear();
  }
  callbacks_.answer(question, states, query.response.header.stamp);
}

}  // namespace brick_detection_ros
