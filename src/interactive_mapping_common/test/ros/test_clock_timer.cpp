// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/clock_timer.h"

#include <sys/resource.h>

#include <atomic>
#include <future>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <vector>

#include <gmock/gmock.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <ros/callback_queue.h>
#include <ros/spinner.h>

namespace interactive_mapping_ros {
namespace {

using node_tests::waitUntil;
using ::testing::ElementsAre;

class ClockTimerTest : public testing::Test {
 protected:
  ClockTimerTest() {
    handle.setCallbackQueue(&queue);
    spinner.start();
  }
  ~ClockTimerTest() override { spinner.stop(); }

  std::unique_ptr<ClockTimer> every(double period_s) {
    return std::make_unique<ClockTimer>(handle, ros::Duration(period_s), [this] {
      const std::lock_guard<std::mutex> lock(mutex);
      fired_s.push_back(ros::Time::now().toSec());
    });
  }
  /// Publishes a time and waits until the timer's queue has served it: a marker follows it there.
  void set(double time_s) {
    // The last to be subscribed is the last to be handed a message: the timer has it by then.
    seen = ros::NodeHandle().subscribe<rosgraph_msgs::Clock>(
        "/clock", 100, [this](const auto& clock) { seen_s = clock->clock.toSec(); });
    rosgraph_msgs::Clock clock;
    clock.clock.fromSec(time_s);
    ASSERT_TRUE(waitUntil([&] { return publisher.getNumSubscribers() > 0; }));
    publisher.publish(clock);
    ASSERT_TRUE(waitUntil([&] { return seen_s == time_s && ros::Time::now() == clock.clock; }));
    serve();
  }
  void serve() {
    struct Marker : ros::CallbackInterface {
      std::promise<void> served;
      CallResult call() override {
        served.set_value();
        return Success;
      }
    };
    const boost::shared_ptr<Marker> marker(new Marker);
    queue.addCallback(marker);
    marker->served.get_future().wait();
  }
  std::vector<double> fired() {
    const std::lock_guard<std::mutex> lock(mutex);
    return fired_s;
  }

  ros::NodeHandle handle;
  ros::CallbackQueue queue;
  ros::AsyncSpinner spinner{1, &queue};  // a second thread would overtake the marker
  ros::Publisher publisher{handle.advertise<rosgraph_msgs::Clock>("/clock", 100)};
  ros::Subscriber seen;
  double seen_s{0.0};
  std::mutex mutex;  // guards fired_s
  std::vector<double> fired_s;
};

TEST_F(ClockTimerTest, FiresOncePerPeriodOfSimulatedTime) {
  set(10.0);
  const auto timer = every(0.5);
  for (const double time_s : {10.2, 10.4, 10.5, 10.6, 10.9, 11.1, 13.7, 13.9, 14.0}) set(time_s);
  EXPECT_THAT(fired(), ElementsAre(10.5, 11.1, 13.7, 14.0));
}

TEST_F(ClockTimerTest, GoesOnAfterAJumpBackwards) {
  set(100.0);
  const auto timer = every(0.5);
  for (const double time_s : {100.5, 20.1, 20.2, 20.6}) set(time_s);
  EXPECT_THAT(fired(), ElementsAre(100.5, 20.1, 20.6));
}

TEST_F(ClockTimerTest, DestructorWaitsForTheRunningCallback) {
  set(10.0);
  std::promise<void> is_in, may_leave;
  std::atomic<int> left{0};
  auto timer = std::make_unique<ClockTimer>(handle, ros::Duration(0.5), [&] {
    is_in.set_value();  // a second call throws
    may_leave.get_future().wait();
    ++left;
  });
  rosgraph_msgs::Clock clock;
  clock.clock.fromSec(10.5);
  publisher.publish(clock);
  is_in.get_future().wait();
  std::future<int> left_after = std::async(std::launch::async, [&] {
    timer.reset();
    return left.load();
  });
  may_leave.set_value();
  EXPECT_EQ(left_after.get(), 1);
  set(11.0);
  EXPECT_EQ(left, 1);
}

TEST_F(ClockTimerTest, MayBeDestroyedByItsCallback) {
  set(10.0);
  std::atomic<int> calls{0};
  std::unique_ptr<ClockTimer> timer;
  timer = std::make_unique<ClockTimer>(handle, ros::Duration(0.5), [&] {
    ++calls;
    timer.reset();
  });
  set(10.5);
  set(11.0);
  EXPECT_EQ(calls, 1);
}

TEST_F(ClockTimerTest, DoesNotPollAClockAtRest) {
  const auto switches = [] {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_nvcsw;
  };
  const auto switchesOfASecond = [&] {
    const long before = switches();
    ros::WallDuration(1.0).sleep();
    return switches() - before;
  };
  set(10.0);
  const long without = switchesOfASecond();  // roscpp's own threads
  const auto timer = every(0.5);
  // ros::Timer adds 1000, one per millisecond.
  EXPECT_LT(switchesOfASecond(), without + 100);
}

TEST_F(ClockTimerTest, FiresByTheWallWithoutASimulatedClock) {
  ros::Time::init();
  const auto timer = every(0.01);
  EXPECT_TRUE(waitUntil([&] { return fired().size() >= 3; }));
}

TEST_F(ClockTimerTest, RejectsAPeriodOfZero) {
  EXPECT_THROW(every(0.0), std::invalid_argument);
}

}  // namespace
}  // namespace interactive_mapping_ros
