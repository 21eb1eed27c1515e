// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/spinner.h"

#include <ctime>
#include <functional>
#include <future>
#include <mutex>
#include <stdexcept>

#include <gtest/gtest.h>

namespace interactive_mapping_ros {
namespace {

/// May run in one thread at a time, as those of subscriptions.
struct Exclusive : ros::CallbackInterface {
  explicit Exclusive(std::function<void()> its_run) : run(std::move(its_run)) {}
  CallResult call() override {
    const std::unique_lock<std::mutex> lock(mutex, std::try_to_lock);
    if (!lock) return TryAgain;
    run();
    return Success;
  }
  std::function<void()> run;
  std::mutex mutex;
};

TEST(Spinner, AThreadThatWaitsForAnothersCallbackRests) {
  ros::CallbackQueue queue;
  std::promise<void> is_in, may_end, has_run_again, other_has_run;
  int runs = 0;
  const boost::shared_ptr<Exclusive> slow(new Exclusive([&] {
    if (++runs == 2) return has_run_again.set_value();
    is_in.set_value();
    may_end.get_future().wait();
  }));
  Spinner spinner(3, &queue);
  queue.addCallback(slow, 1);
  is_in.get_future().wait();
  queue.addCallback(slow, 1);
  const std::clock_t before = std::clock();
  ros::WallDuration(1.0).sleep();
  EXPECT_LT(std::clock() - before, CLOCKS_PER_SEC / 10);  // AsyncSpinner's threads take what they can get
  queue.addCallback(boost::shared_ptr<Exclusive>(new Exclusive([&] { other_has_run.set_value(); })), 2);
  other_has_run.get_future().wait();
  EXPECT_EQ(runs, 1);
  may_end.set_value();
  has_run_again.get_future().wait();
}

TEST(Spinner, StopWaitsForWhatRuns) {
  ros::CallbackQueue queue;
  std::promise<void> is_in, may_end;
  bool has_ended = false;
  Spinner spinner(2, &queue);
  queue.addCallback(boost::shared_ptr<Exclusive>(new Exclusive([&] {
    is_in.set_value();
    may_end.get_future().wait();
    has_ended = true;
  })));
  is_in.get_future().wait();
  std::future<bool> ended_after = std::async(std::launch::async, [&] {
    spinner.stop();
    return has_ended;
  });
  may_end.set_value();
  EXPECT_TRUE(ended_after.get());
  spinner.stop();
  queue.addCallback(boost::shared_ptr<Exclusive>(new Exclusive([] { FAIL() << "served after stop()"; })));
}

TEST(Spinner, RefusesToHaveNoThread) {
  ros::CallbackQueue queue;
  EXPECT_THROW(Spinner(0, &queue), std::invalid_argument);
}

}  // namespace
}  // namespace interactive_mapping_ros
