// SPDX-License-Identifier: BSD-3-Clause
// What the mission's node calls actions and services with, against servers in processes of their own, which can be killed.
// The server's process is this program, too: see serveActionAndService().
#include <unistd.h>

#include <csignal>

#include <actionlib/server/action_server.h>
#include <gmock/gmock.h>
#include <interactive_mapping_msgs/PlanArmAction.h>
#include <interactive_mapping_msgs/ReportFailure.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>

#include <interactive_mapping_common/testing/process.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include "pick_mission_ros/action_caller.h"
#include "pick_mission_ros/service_caller.h"

namespace pick_mission_ros {
namespace {

using interactive_mapping_msgs::PlanArmAction;
using interactive_mapping_msgs::PlanArmGoal;
using interactive_mapping_msgs::PlanArmResult;
using interactive_mapping_msgs::ReportFailure;
using node_tests::Process;
using testing::HasSubstr;
using Caller = ActionCaller<PlanArmAction>;

constexpr double kDeadline_s = 20.0;  // ample on a busy machine
constexpr double kLong_s = 60.0;      // a timeout that must not be what ends a goal
constexpr double kShort_s = 0.6;

/// Does with each goal what its posture says, and answers with that and the number of goals it has got.
int serveActionAndService(const std::string& name) {
  using Server = actionlib::ActionServer<PlanArmAction>;
  ros::NodeHandle nh;
  std::uint64_t num_goals = 0;
  std::vector<Server::GoalHandle> waiting;
  Server server(
      nh, name + "/action",
      [&](Server::GoalHandle goal) {
        const std::string what = goal.getGoal()->goals.at(0).posture;
        PlanArmResult result;
        result.outcome.message = what;
        result.map_update = ++num_goals;
        if (what == "die") ::_exit(0);
        if (what == "reject") return goal.setRejected(result, "no");
        goal.setAccepted();
        if (what == "wait") {
          waiting.push_back(goal);
        } else if (what == "abort") {
          goal.setAborted(result, "it failed");
        } else if (what == "drop") {
          goal.setCanceled(PlanArmResult(), "for another");
        } else {
          goal.setSucceeded(result);
        }
      },
      [&](Server::GoalHandle goal) {
        PlanArmResult result;
        result.outcome.message = "cancelled";
        goal.setCanceled(result);
      },
      false);
  const auto answer = boost::function<bool(ReportFailure::Request&, ReportFailure::Response&)>(
      [](ReportFailure::Request& request, ReportFailure::Response& response) {
        if (request.reason == "hang") {
          while (true) ::pause();
        }
        if (request.reason == "die") ::_exit(0);
        response.success = 1;
        response.message = request.reason;
        return request.reason != "refuse";
      });
  const ros::ServiceServer service = nh.advertiseService(name + "/service", answer);
  server.start();
  ros::spin();
  return 0;
}

PlanArmGoal goalTo(const std::string& what) {
  PlanArmGoal goal;
  goal.goals.resize(1);
  goal.goals[0].posture = what;
  return goal;
}

class MissionCallers : public testing::Test {
 protected:
  MissionCallers()
      : name_(std::string("/") + testing::UnitTest::GetInstance()->current_test_info()->name()),
        inbox_(std::make_shared<Inbox>()),
        action_(std::make_unique<Caller>(nh_, name_ + "/action", &queue_)),
        service_(std::make_unique<ServiceCaller<ReportFailure>>(nh_, name_ + "/service", inbox_)) {}
  ~MissionCallers() override {
    service_.reset();
    server_.reset();  // what hangs in it breaks off
    EXPECT_TRUE(inbox_->awaitAll(std::chrono::duration<double>(kDeadline_s)));
    inbox_->empty();
  }

  void startServer() {
    server_ = std::make_unique<Process>(std::vector<std::string>{"/proc/self/exe", "serve", name_},
                                        folder_.file("server.log"));
  }
  void startServerAndConnect() {
    startServer();
    ASSERT_TRUE(until([this] { return action_->isConnected() && service_->exists(); })) << server_->output();
  }
  void kill() {
    server_->signal(SIGKILL);
    ASSERT_TRUE(until([this] { return server_->hasEnded(); }));
  }

  bool until(const std::function<bool()>& condition) {
    const ros::WallTime deadline = ros::WallTime::now() + ros::WallDuration(kDeadline_s);
    while (ros::WallTime::now() < deadline) {
      if (condition()) return true;
      queue_.callAvailable(ros::WallDuration(0.005));
      inbox_->empty();
      action_->watch(ros::WallDuration(timeout_s_));
      service_->watch();
    }
    return condition();
  }

  void send(const std::string& what) {
    action_->send(goalTo(what), [this](const Caller::End& end) { ends_.push_back(end); });
  }
  const Caller::End& awaitEnd(std::size_t number = 1) {
    static const Caller::End kNone;
    EXPECT_TRUE(until([&] { return ends_.size() >= number; })) << "no end";
    EXPECT_EQ(ends_.size(), number);
    EXPECT_FALSE(action_->isActive());
    return ends_.size() < number ? kNone : ends_[number - 1];
  }
  void call(const std::string& what, double timeout_s) {
    ReportFailure::Request request;
    request.reason = what;
    service_->call(request, ros::WallDuration(timeout_s), [this](const ReportFailure* answer, const std::string& why) {
      answers_.push_back(answer != nullptr ? answer->response.message : "none: " + why);
    });
  }
  /// All that there are, by a part of each.
  void expectAnswers(const std::vector<std::string>& parts) {
    EXPECT_TRUE(until([&] { return answers_.size() >= parts.size(); })) << "no answer";
    ASSERT_EQ(answers_.size(), parts.size());
    for (std::size_t i = 0; i < parts.size(); ++i) EXPECT_THAT(answers_[i], HasSubstr(parts[i]));
    EXPECT_FALSE(service_->isActive());
  }

  const std::string name_;
  const test_support::TemporaryFolder folder_;
  ros::NodeHandle nh_;
  ros::CallbackQueue queue_;
  std::shared_ptr<Inbox> inbox_;
  std::unique_ptr<Caller> action_;
  std::unique_ptr<ServiceCaller<ReportFailure>> service_;
  std::unique_ptr<Process> server_;
  double timeout_s_{kLong_s};
  std::vector<Caller::End> ends_;
  std::vector<std::string> answers_;
};

TEST_F(MissionCallers, NextGoalIsSentFromWithinTheEndOfTheLastOne) {
  startServerAndConnect();
  constexpr std::uint64_t kGoals = 30;
  std::uint64_t num_ended = 0;
  std::function<void(const Caller::End&)> next = [&](const Caller::End& end) {
    ASSERT_TRUE(end.result) << end.why;
    EXPECT_TRUE(end.is_succeeded);
    EXPECT_EQ(end.result->map_update, ++num_ended) << "the result of another goal";
    if (num_ended < kGoals) action_->send(goalTo("succeed"), next);
  };
  action_->send(goalTo("succeed"), next);
  EXPECT_TRUE(until([&] { return num_ended == kGoals; })) << num_ended;
  EXPECT_FALSE(action_->isActive());
}

TEST_F(MissionCallers, CancelAllEndsGoalsOfOthersAsSoonAsTheServerIsThere) {
  Caller other(nh_, name_ + "/action", &queue_);
  startServer();
  ASSERT_TRUE(until([&] { return other.isConnected(); }));
  bool is_cancelled = false;
  other.send(goalTo("wait"), [&](const Caller::End& end) { is_cancelled = end.is_cancelled; });
  Caller next(nh_, name_ + "/action", &queue_);
  next.cancelAll();
  EXPECT_TRUE(next.isCancelAllWanted()) << "not connected yet";
  EXPECT_TRUE(until([&] {
    next.watch(ros::WallDuration(kLong_s));
    return is_cancelled;
  }));
  EXPECT_FALSE(next.isCancelAllWanted());
}

// They go by different connections.
TEST_F(MissionCallers, CancelAllDoesNotOvertakeTheGoalAfterIt) {
  startServerAndConnect();
  for (std::size_t number = 1; number <= 5; ++number) {
    action_->cancelAll();
    send("wait");
    const ros::WallTime begin = ros::WallTime::now();
    EXPECT_FALSE(until([&] { return !ends_.empty() || (ros::WallTime::now() - begin).toSec() > kShort_s; }) &&
                 !ends_.empty())
        << "cancelled with what was before it";
    action_->abandon();
  }
}

TEST_F(MissionCallers, GoalWithoutAServerIsGivenUp) {
  timeout_s_ = kShort_s;
  const ros::WallTime begin = ros::WallTime::now();
  send("succeed");
  const Caller::End& end = awaitEnd();
  EXPECT_GE((ros::WallTime::now() - begin).toSec(), kShort_s);
  EXPECT_FALSE(end.result);
  EXPECT_THAT(end.why, HasSubstr(name_ + "/action is not there"));
}

TEST_F(MissionCallers, GoalWaitsForAServerThatComesInTime) {
  send("succeed");
  startServer();
  EXPECT_TRUE(awaitEnd().is_succeeded);
}

TEST_F(MissionCallers, ServerKilledInTheMiddleIsNoticed) {
  startServerAndConnect();
  timeout_s_ = kShort_s;
  send("wait");
  kill();
  EXPECT_THAT(awaitEnd().why, HasSubstr("is not there"));
  EXPECT_FALSE(ends_[0].result);
  startServerAndConnect();
  timeout_s_ = kLong_s;
  send("succeed");
  EXPECT_TRUE(awaitEnd(2).is_succeeded);
}

TEST_F(MissionCallers, ServerStartedAnewHasLostTheGoal) {
  startServerAndConnect();
  bool is_running = false;
  const ros::Subscriber status = nh_.subscribe<actionlib_msgs::GoalStatusArray>(
      name_ + "/action/status", 10, [&](const actionlib_msgs::GoalStatusArrayConstPtr& array) {
        is_running = !array->status_list.empty() && array->status_list[0].status == actionlib_msgs::GoalStatus::ACTIVE;
      });
  send("wait");
  ASSERT_TRUE(until([&] {
    ros::getGlobalCallbackQueue()->callAvailable();
    return is_running;
  }));
  kill();
  startServer();
  EXPECT_THAT(awaitEnd().why, HasSubstr("has lost the goal"));
  EXPECT_FALSE(ends_[0].result);
}

TEST_F(MissionCallers, ServerStartedAnewThatNeverHeardOfTheGoalIsNotWaitedForForEver) {
  startServerAndConnect();
  timeout_s_ = 3.0;  // longer than the new one takes to start: it is there when the goal is given up
  send("die");
  ASSERT_TRUE(until([this] { return server_->hasEnded(); }));
  startServer();
  EXPECT_THAT(awaitEnd().why, HasSubstr("does not report the goal's result"));
}

TEST_F(MissionCallers, FailuresComeWithTheirResults) {
  startServerAndConnect();
  send("reject");
  Caller::End end = awaitEnd(1);
  ASSERT_TRUE(end.result);
  EXPECT_EQ(end.result->outcome.message, "reject");
  EXPECT_FALSE(end.is_succeeded);
  EXPECT_FALSE(end.is_cancelled);
  EXPECT_EQ(end.why, "no");
  send("abort");
  end = awaitEnd(2);
  ASSERT_TRUE(end.result);
  EXPECT_FALSE(end.is_succeeded);
  EXPECT_FALSE(end.is_cancelled);
  EXPECT_EQ(end.why, "it failed");
  send("drop");
  end = awaitEnd(3);
  ASSERT_TRUE(end.result);
  EXPECT_FALSE(end.is_succeeded);
  EXPECT_TRUE(end.is_cancelled);
}

TEST_F(MissionCallers, CancelledGoalEndsAsSuch) {
  startServerAndConnect();
  send("wait");
  action_->cancel();
  const Caller::End& end = awaitEnd();
  ASSERT_TRUE(end.result);
  EXPECT_TRUE(end.is_cancelled);
  EXPECT_FALSE(end.is_succeeded);
}

TEST_F(MissionCallers, GoalCancelledBeforeItIsSentNeverIs) {
  send("succeed");
  action_->cancel();
  const Caller::End& end = awaitEnd();
  EXPECT_TRUE(end.is_cancelled);
  EXPECT_FALSE(end.result);
  startServerAndConnect();
  send("succeed");
  const Caller::End& next = awaitEnd(2);
  ASSERT_TRUE(next.result);
  EXPECT_EQ(next.result->map_update, 1u) << "goals that the server has got";
}

TEST_F(MissionCallers, AbandonedGoalIsCancelledAndItsEndIsNotTold) {
  startServerAndConnect();
  std::vector<std::uint8_t> states;
  const ros::Subscriber results = nh_.subscribe<interactive_mapping_msgs::PlanArmActionResult>(
      name_ + "/action/result", 10, [&](const interactive_mapping_msgs::PlanArmActionResultConstPtr& result) {
        states.push_back(result->status.status);
      });
  ASSERT_TRUE(until([&] { return results.getNumPublishers() > 0; }));
  send("wait");
  send("wait");  // instead
  ASSERT_TRUE(until([&] {
    ros::getGlobalCallbackQueue()->callAvailable();
    return !states.empty();
  }));
  EXPECT_EQ(states, std::vector<std::uint8_t>{actionlib_msgs::GoalStatus::PREEMPTED});
  EXPECT_TRUE(ends_.empty());
  EXPECT_TRUE(action_->isActive());
  action_->abandon();
  ASSERT_TRUE(until([&] {
    ros::getGlobalCallbackQueue()->callAvailable();
    return states.size() == 2;
  }));
  EXPECT_TRUE(ends_.empty());
}

TEST_F(MissionCallers, ServerThatStandsStillDoesNotGoOnLaterWithWhatWasGivenUp) {
  startServerAndConnect();
  timeout_s_ = kShort_s;
  server_->signal(SIGSTOP);
  send("wait");
  EXPECT_THAT(awaitEnd().why, HasSubstr("does not report the goal's result"));
  // Its socket is there all the time; what it was sent waits in it.
  std::vector<std::uint8_t> states;
  const ros::Subscriber results = nh_.subscribe<interactive_mapping_msgs::PlanArmActionResult>(
      name_ + "/action/result", 10, [&](const interactive_mapping_msgs::PlanArmActionResultConstPtr& result) {
        states.push_back(result->status.status);
      });
  server_->signal(SIGCONT);
  ASSERT_TRUE(until([&] { return results.getNumPublishers() > 0; }));
  timeout_s_ = kLong_s;
  send("succeed");
  const Caller::End& next = awaitEnd(2);
  ASSERT_TRUE(next.result);
  EXPECT_EQ(next.result->outcome.message, "succeed") << "the first one's";
  EXPECT_EQ(next.result->map_update, 2u);
}

TEST_F(MissionCallers, CallersMayGoInTheMiddle) {
  startServerAndConnect();
  send("wait");
  call("hang", kLong_s);
  service_.reset();
  action_.reset();
  server_.reset();
  EXPECT_TRUE(inbox_->awaitAll(std::chrono::duration<double>(kDeadline_s)));
  inbox_->empty();  // what came for those that are gone
  queue_.callAvailable();
  EXPECT_TRUE(ends_.empty());
  EXPECT_TRUE(answers_.empty());
}

TEST_F(MissionCallers, ServiceAnswers) {
  startServerAndConnect();
  // Often: an answer on a connection that is closed behind it gets lost at times.
  for (int i = 0; i < 50; ++i) {
    answers_.clear();
    call("answer " + std::to_string(i), kLong_s);
    expectAnswers({"answer " + std::to_string(i)});
  }
}

TEST_F(MissionCallers, ServiceThatIsNotThereOrRefusesIsToldAtOnce) {
  EXPECT_FALSE(service_->exists());
  call("answer", kLong_s);
  expectAnswers({"none: the service " + name_ + "/service is not there"});
  startServerAndConnect();
  call("refuse", kLong_s);
  expectAnswers({"none", "none: the service"});
  call("die", kLong_s);
  expectAnswers({"none", "none", "none: the service " + name_ + "/service is not there or broke off"});
}

TEST_F(MissionCallers, ServiceThatHangsIsGivenUp) {
  startServerAndConnect();
  const ros::WallTime begin = ros::WallTime::now();
  call("hang", kShort_s);
  expectAnswers({"none: the service " + name_ + "/service has not answered within"});
  EXPECT_GE((ros::WallTime::now() - begin).toSec(), kShort_s);
  // Its late end is nobody's.
  kill();
  EXPECT_TRUE(inbox_->awaitAll(std::chrono::duration<double>(kDeadline_s)));
  inbox_->empty();
  EXPECT_EQ(answers_.size(), 1u);
}

TEST_F(MissionCallers, NewerCallReplacesTheOneBefore) {
  startServerAndConnect();
  call("hang", kLong_s);
  server_.reset();
  // The end of the first one waits in the inbox while the second one is called.
  EXPECT_TRUE(inbox_->awaitAll(std::chrono::duration<double>(kDeadline_s)));
  startServer();
  ASSERT_TRUE(ros::service::waitForService(name_ + "/service", ros::Duration(kDeadline_s)));
  call("answer", kLong_s);
  expectAnswers({"answer"});
  call("answer", kLong_s);
  service_->forget();
  EXPECT_TRUE(inbox_->awaitAll(std::chrono::duration<double>(kDeadline_s)));
  inbox_->empty();
  EXPECT_EQ(answers_.size(), 1u) << "of one that was forgotten";
}

}  // namespace

int serve(const std::string& name) {
  return serveActionAndService(name);
}

}  // namespace pick_mission_ros

int main(int argc, char** argv) {
  if (argc == 3 && std::string(argv[1]) == "serve") {
    ros::init(argc, argv, "server", ros::init_options::AnonymousName);
    return pick_mission_ros::serve(argv[2]);
  }
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_mission_callers");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
