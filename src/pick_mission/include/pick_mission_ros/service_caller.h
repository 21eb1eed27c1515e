// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include <ros/node_handle.h>
#include <ros/service.h>
#include <ros/service_client.h>
#include <ros/time.h>

namespace pick_mission_ros {

/// What other threads have for the mission's.
class Inbox {
 public:
  /// Of a thread that will post.
  void open() {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++num_open_;
  }
  void close() {
    const std::lock_guard<std::mutex> lock(mutex_);
    --num_open_;
    closed_.notify_all();
  }
  /// Until every thread has posted; false if that takes longer.
  bool awaitAll(std::chrono::duration<double> timeout) {
    std::unique_lock<std::mutex> lock(mutex_);
    return closed_.wait_for(lock, timeout, [this] { return num_open_ == 0; });
  }

  void post(std::function<void()> job) {
    const std::lock_guard<std::mutex> lock(mutex_);
    jobs_.push_back(std::move(job));
  }
  /// In the mission's thread: runs all that has come.
  void empty() {
    std::deque<std::function<void()>> jobs;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      jobs.swap(jobs_);
    }
    for (const auto& job : jobs) job();
  }

 private:
  std::mutex mutex_;  // guards all that follows
  std::condition_variable closed_;
  std::deque<std::function<void()>> jobs_;
  int num_open_{0};
};

/// Calls a service without waiting for it. roscpp's own call cannot be given up, so it is made in a thread that
/// outlives the caller if it must. A newer call replaces the one before, whose answer is dropped.
template <typename Service>
class ServiceCaller {
 public:
  /// `service` is null when there is no answer, and `why` says so.
  using OnEnd = std::function<void(const Service* service, const std::string& why)>;

  ServiceCaller(const ros::NodeHandle& nh, const std::string& name, std::shared_ptr<Inbox> inbox)
      : name_(nh.resolveName(name)), inbox_(std::move(inbox)) {}

  const std::string& name() const { return name_; }
  bool exists() const { return ros::service::exists(name_, false); }
  bool isActive() const { return static_cast<bool>(on_end_); }

  void call(const typename Service::Request& request, ros::WallDuration timeout, OnEnd on_end) {
    on_end_ = std::move(on_end);
    deadline_ = ros::SteadyTime::now() + timeout;
    timeout_ = timeout;
    const std::uint64_t number = ++*number_;
    inbox_->open();
    // The thread may outlive this object; the inbox and the number it shares.
    std::thread([name = name_, inbox = inbox_, current = number_, number, request, this]() mutable {
      Service service;
      service.request = request;
      // A connection of its own that the server does not close. A server may close it right after its answer. roscpp
      // then at times finds it closed before it has read the answer, and reports a failed call.
      bool is_answered = false;
      {
        ros::ServiceClient client(name, true, {}, ros::service_traits::md5sum<Service>());
        is_answered = client.call(service);
      }
      inbox->post([service, is_answered, current, number, this] {
        if (*current != number) return;  // replaced, given up, or this object is gone
        finish(is_answered ? &service : nullptr,
               is_answered ? "" : "the service " + name_ + " is not there or broke off");
      });
      inbox->close();
    }).detach();
  }

  /// Answers still to come are dropped.
  void forget() {
    ++*number_;
    on_end_ = nullptr;
  }

  void watch() {
    if (!isActive() || ros::SteadyTime::now() < deadline_) return;
    ++*number_;
    finish(nullptr, "the service " + name() + " has not answered within " + std::to_string(timeout_.toSec()) +
                        " s of wall time");
  }

  ~ServiceCaller() { ++*number_; }
  ServiceCaller(const ServiceCaller&) = delete;
  ServiceCaller& operator=(const ServiceCaller&) = delete;

 private:
  void finish(const Service* service, const std::string& why) {
    const OnEnd on_end = std::move(on_end_);
    on_end_ = nullptr;
    if (on_end) on_end(service, why);
  }

  const std::string name_;
  std::shared_ptr<Inbox> inbox_;
  std::shared_ptr<std::uint64_t> number_{std::make_shared<std::uint64_t>(0)};  // of the call; the mission's thread only
  OnEnd on_end_;
  ros::SteadyTime deadline_;
  ros::WallDuration timeout_;
};

}  // namespace pick_mission_ros
