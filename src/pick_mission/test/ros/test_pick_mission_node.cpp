// SPDX-License-Identifier: BSD-3-Clause
// The mission's node as a process in a world of this one's: whole missions, crashes, servers that go, answers that make no
// sense.
#include <fcntl.h>
#include <unistd.h>
#include <sys/stat.h>

#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <interactive_mapping_msgs/MissionState.h>
#include <nlohmann/json.hpp>
#include <ros/master.h>
#include <ros/network.h>
#include <std_msgs/Header.h>
#include <xmlrpcpp/XmlRpcClient.h>

#include <interactive_mapping_common/testing/process.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include "ros/mission_world.h"

namespace mission_world {
namespace {

using msgs::MissionState;
using node_tests::Process;
using node_tests::waitUntil;
using test_support::readText;
using test_support::splitLines;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

std::string describe(const MissionState& state) {
  return "state " + std::to_string(state.state) + ", decision '" + state.decision + "', end " +
         std::to_string(state.end_reason) + " '" + state.end_message + "'";
}

class PickMissionNode : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    clock_ = new FakeClock;
    ASSERT_TRUE(waitUntil([] { return !ros::Time::now().isZero(); }));
    world_ = new MissionWorld(SECTORS);
  }
  static void TearDownTestSuite() {
    delete world_;
    delete clock_;
  }

  void SetUp() override {
    world_->reset();
    set("sectors_file", SECTORS);
    set("bricks_file", BRICKS);
    set("run_folder", folder_.file("run"));
    set("survey/x_m", std::vector<double>{0.5});
    set("survey/y_m", std::vector<double>{0.0});
    set("survey/yaw_rad", std::vector<double>{0.0});
    set("views/choose_after_each_pick", false);
    set("workspace/x_m", std::vector<double>{});
    set("workspace/y_m", std::vector<double>{});
    // All bricks find a place: it drives to the depot at the end.
    set("stow", std::vector<std::string>(5, "container_place_1"));
    set("nodes/unload", std::string("/unload"));
    unload_ = nh_.advertiseService<std_srvs::Trigger::Request, std_srvs::Trigger::Response>(
        "/unload", [this](std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
          ++unloads_;
          response.success = 1;
          return true;
        });
    set("look/images", 2);
    set("look/timeout_s", 20.0);
    // Of this machine, in wall time: the clock here is fast, and the machine may be busy.
    set("input/max_bridge_age_s", 20.0);
    set("input/max_tf_age_s", 20.0);
    set("time/retry_wait_s", 0.1);
    set("servers/timeout_s", 1.0);
    set("servers/service_timeout_s", 1.0);
    subscriber_ = nh_.subscribe<MissionState>("/pick_mission/state", 100,
                                              [this](const MissionState::ConstPtr& state) { state_ = *state; });
  }
  void TearDown() override {
    world_->release();
    node_.reset();
    ros::param::del("/pick_mission");
    for (const std::string& name : MissionWorld::names()) world_->start(name);
    if (HasFailure()) {
      for (const std::string& call : world_->callsSoFar()) std::cout << call << ", ";
      std::cout << "\n" << output_ << "\n" << describe(state_) << std::endl;
    }
  }

  template <typename Value>
  static void set(const std::string& key, const Value& value) {
    ros::param::set("/pick_mission/" + key, value);
  }

  void startNode() {
    state_ = MissionState();
    state_.state = MissionState::NUM_STATES;
    node_ = std::make_unique<Process>(
        std::vector<std::string>{PICK_MISSION_NODE, "__name:=pick_mission", "attached_brick:=/attached_brick"},
        folder_.file("node.log"));
    ASSERT_TRUE(until([this] { return state_.state != MissionState::NUM_STATES; })) << node_->output();
  }
  void endNode(int signal) {
    node_->signal(signal);
    ASSERT_TRUE(waitUntil([this] { return node_->hasEnded(); }));
    output_ = node_->output();
  }
  bool until(const std::function<bool()>& condition) {
    const bool is_so = waitUntil(condition);
    if (node_) output_ = node_->output();
    return is_so;
  }
  bool untilState(int state) {
    return until([this, state] { return state_.state == state; });
  }
  bool untilCalled(const std::string& call, int count = 1) {
    return until([&] { return world_->numOf(call) >= count; });
  }
  std_srvs::Trigger::Response tell(const std::string& what) {
    std_srvs::Trigger trigger;
    EXPECT_TRUE(node_tests::call("/pick_mission/" + what, trigger)) << what;
    return trigger.response;
  }
  /// Waits for what the node has to hear of first.
  void startMission() {
    std::string why;
    ASSERT_TRUE(until([&] {
      const auto response = tell("start");
      why = response.message;
      return response.success != 0;
    })) << why;
  }
  void startAll() {
    startNode();
    startMission();
  }
  nlohmann::json summary() const { return nlohmann::json::parse(readText(folder_.file("run/summary.json"))); }
  std::vector<nlohmann::json> log() const {
    std::vector<nlohmann::json> lines;
    for (const std::string& line : splitLines(readText(folder_.file("run/mission.jsonl")))) {
      lines.push_back(nlohmann::json::parse(line));
    }
    return lines;
  }
  void expectEnd(int reason, const std::string& part) {
    ASSERT_TRUE(untilState(MissionState::ENDED)) << describe(state_);
    EXPECT_EQ(static_cast<int>(state_.end_reason), reason) << describe(state_);
    EXPECT_THAT(state_.end_message, HasSubstr(part));
  }
  void spoil(const std::string& server, std::function<void(void*, bool*)> spoiler) {
    world_->with([&] { world_->spoilers[server] = std::move(spoiler); });
  }
  void setMode(const std::string& server, Mode mode) {
    world_->with([&] { world_->modes[server] = mode; });
  }

  static inline FakeClock* clock_ = nullptr;
  static inline MissionWorld* world_ = nullptr;
  const test_support::TemporaryFolder folder_;
  ros::NodeHandle nh_;
  MissionState state_;
  ros::Subscriber subscriber_;
  ros::ServiceServer unload_;
  int unloads_{0};
  std::unique_ptr<Process> node_;
  std::string output_;
};

TEST_F(PickMissionNode, ClearsThePileAndTellsOfIt) {
  set("scene", "four");
  set("seed", 3);
  set("strategy", "gpis");
  set("removed_factor", "travel");
  world_->with([] { world_->magnet_lag = 2; });  // nothing is stowed again for it
  startAll();
  expectEnd(MissionState::NO_BRICK_LEFT, "no pile");
  std::vector<std::string> expected = {"plan_arm clear", "move",   "detect", "drive",
                                       "detect",         "select", "drive",  "detect"};
  for (const char* id : {"0", "1", "2", "3"}) {
    for (const std::string& call : {std::string("plan_pick ") + id, std::string("pick ") + id, std::string("detect")}) {
      expected.push_back(call);
    }
  }
  // Nothing is to be picked here any more: that is told, and the next view asked for. Then to the depot.
  for (const char* call : {"select", "plan_arm clear", "move", "detect", "drive"}) expected.push_back(call);
  EXPECT_EQ(world_->callsSoFar(), expected);
  EXPECT_EQ(unloads_, 1);

  EXPECT_EQ(state_.bricks_picked, 4u);
  EXPECT_EQ(state_.views, 1u);
  EXPECT_EQ(state_.run_folder, folder_.file("run"));
  EXPECT_EQ(state_.header.frame_id, "map");
  ASSERT_EQ(state_.bricks.size(), 4u);
  for (const msgs::MissionBrick& brick : state_.bricks) EXPECT_EQ(brick.status, msgs::MissionBrick::PICKED);
  EXPECT_THAT(state_.view, testing::IsEmpty()) << "it stands at the depot";

  const nlohmann::json json = summary();
  for (const char* key :
       {"scene", "seed", "strategy", "removed_factor", "bricks_total", "bricks_picked", "map_coverage", "map_precision",
        "falls", "collisions", "sim_seconds", "wall_seconds", "views", "end_reason", "failures"}) {
    EXPECT_TRUE(json.contains(key)) << key;
  }
  EXPECT_EQ(json["scene"], "four");
  EXPECT_EQ(json["seed"], 3);
  EXPECT_EQ(json["strategy"], "gpis");
  EXPECT_EQ(json["removed_factor"], "travel");
  EXPECT_EQ(json["bricks_picked"], 4);
  EXPECT_EQ(json["end_reason"], "no_brick_left");
  EXPECT_TRUE(json["falls"].is_null()) << "the judge's to tell";
  EXPECT_GT(json["sim_seconds"], 0.0);
  EXPECT_GT(json["wall_seconds"], 0.0);
  EXPECT_EQ(json["failures"], (nlohmann::json{{"select: no pile", 1}}));

  const std::vector<nlohmann::json> lines = log();
  std::string state = "idle";
  for (const nlohmann::json& line : lines) {
    EXPECT_EQ(line["state"], state) << "the log has a hole before " << line;
    state = line["decision"];
  }
  EXPECT_EQ(state, "ended");
  EXPECT_EQ(lines.back()["bricks_picked"], 4);
  const auto selections = splitLines(readText(folder_.file("run/selections.jsonl")));
  ASSERT_EQ(selections.size(), 2u);
  EXPECT_EQ(nlohmann::json::parse(selections[0])["segments"][0]["utility"], 0.5);
  EXPECT_EQ(nlohmann::json::parse(selections[1])["outcome"], static_cast<int>(msgs::SelectionOutcome::NO_PILE));
  const auto path = splitLines(readText(folder_.file("run/path.jsonl")));
  ASSERT_FALSE(path.empty());
  EXPECT_EQ(nlohmann::json::parse(path.front())["base"].size(), 3u);
  EXPECT_GE(nlohmann::json::parse(path.front())["time_s"], lines.front()["time_s"]);
  const auto saved = nlohmann::json::parse(readText(folder_.file("run/mission_state.json")));
  EXPECT_TRUE(saved["mission"]["has_ended"].get<bool>());

  // Another one goes into a folder of its own.
  world_->with([] { world_->pile = {2}; });
  EXPECT_TRUE(tell("start").success);
  ASSERT_TRUE(until([this] { return state_.state == MissionState::ENDED && state_.bricks_picked == 1; }));
  EXPECT_EQ(state_.run_folder, folder_.file("run/mission_2"));
  EXPECT_EQ(summary(), json) << "the first one's files were touched";
  endNode(SIGTERM);
  EXPECT_EQ(node_->exitCode(), 0);
  startNode();
  EXPECT_EQ(state_.run_folder, folder_.file("run/mission_2")) << "the last one";
}

TEST_F(PickMissionNode, LooksForTheNextBrickWhileTheArmCarriesOneAway) {
  setMode("pick", Mode::kHang);
  startAll();
  ASSERT_TRUE(untilCalled("pick 0"));
  const auto carry = [this](int id, const std::string& stage) {
    world_->with([&] {
      world_->hand = id;
      world_->arm_stage = stage;
    });
  };
  carry(0, "lift");
  const int looks = world_->numOf("detect");
  carry(0, "stow");
  ASSERT_TRUE(untilCalled("plan_pick 1"));
  EXPECT_EQ(world_->numOf("detect"), looks + 1);
  ASSERT_TRUE(untilState(MissionState::PICK)) << "it waits for the brick to be stowed";
  EXPECT_EQ(world_->numOf("pick 1"), 0);
  EXPECT_EQ(state_.bricks_picked, 0u);
  world_->with([] {
    EXPECT_EQ(world_->pick_plan.after_let_go, 1);
    EXPECT_EQ(world_->pick_plan.start, std::vector<double>(6, 0.1)) << "the end of the first";
  });
  world_->finish("pick");
  ASSERT_TRUE(untilCalled("pick 1"));
  EXPECT_EQ(world_->numOf("detect"), looks + 1) << "the plan is there";
  EXPECT_TRUE(until([this] { return state_.bricks_picked == 1; }));

  // What goes on beside and what it was begun beside are both ended by a hold.
  setMode("plan_pick", Mode::kHang);
  carry(1, "stow");
  ASSERT_TRUE(untilCalled("plan_pick 2"));
  EXPECT_TRUE(tell("hold").success);
  ASSERT_TRUE(untilState(MissionState::HELD));
  world_->with([] {
    EXPECT_EQ(world_->times_cancelled["pick"], 1);
    EXPECT_EQ(world_->times_cancelled["plan_pick"], 1);
  });

  setMode("plan_pick", Mode::kAnswer);
  setMode("pick", Mode::kAnswer);
  EXPECT_TRUE(tell("resume").success);
  expectEnd(MissionState::NO_BRICK_LEFT, "no pile");
  EXPECT_EQ(state_.bricks_picked, 4u);
}

TEST_F(PickMissionNode, DoesNotStartUntilAllIsThereAndSaysWhatIsNot) {
  for (const char* name : {"plan_arm", "drive", "detect"}) world_->stop(name);
  world_->with([] { world_->has_bridge = false; });
  startNode();
  std_srvs::Trigger::Response response;
  // The rest is heard of before long.
  ASSERT_TRUE(until([&] {
    response = tell("start");
    return response.message ==
           "missing: the state of the arm's bridge, the server /motion_planning/plan_arm, the server /move_base, "
           "the server /brick_detection/detect";
  })) << response.message;
  EXPECT_FALSE(response.success);
  EXPECT_EQ(state_.state, MissionState::IDLE);
  EXPECT_THAT(world_->callsSoFar(), testing::IsEmpty());
  endNode(SIGTERM);

  set("autostart", true);
  startNode();
  ASSERT_TRUE(until([this] {
    return node_tests::has(state_.decision, "waits for the state of the arm's bridge, the");
  })) << describe(state_);
  for (const char* name : {"plan_arm", "drive", "detect"}) world_->start(name);
  EXPECT_THAT(world_->callsSoFar(), testing::IsEmpty());
  world_->with([] { world_->has_bridge = true; });
  expectEnd(MissionState::NO_BRICK_LEFT, "");
}

TEST_F(PickMissionNode, PausesHoldsAndStops) {
  setMode("pick", Mode::kHang);
  startNode();
  EXPECT_FALSE(tell("resume").success) << "nothing goes on";
  EXPECT_FALSE(tell("stop").success);
  EXPECT_FALSE(tell("pause").success);
  startMission();
  EXPECT_FALSE(tell("start").success) << "it has begun";
  ASSERT_TRUE(untilCalled("pick 0"));
  ASSERT_TRUE(untilState(MissionState::PICK));
  EXPECT_FALSE(state_.is_pause_wanted) << "of the one that was refused";
  EXPECT_TRUE(tell("pause").success);
  ASSERT_TRUE(until([this] { return state_.is_pause_wanted && state_.state == MissionState::PICK; }));
  setMode("pick", Mode::kAnswer);
  world_->finish("pick");
  ASSERT_TRUE(untilState(MissionState::PAUSED));
  EXPECT_EQ(world_->callsSoFar().back(), "pick 0");
  setMode("pick", Mode::kHang);
  EXPECT_TRUE(tell("resume").success);
  ASSERT_TRUE(untilCalled("pick 1"));
  EXPECT_TRUE(tell("pause").success);
  const auto response = tell("hold");
  EXPECT_TRUE(response.success) << response.message;
  ASSERT_TRUE(untilState(MissionState::HELD));
  EXPECT_FALSE(state_.is_pause_wanted) << "the hold is more than that";
  ASSERT_TRUE(untilCalled("hold"));  // in a thread of its own: what goes on may have been cancelled before
  EXPECT_EQ(world_->numOf("hold"), 1);
  EXPECT_TRUE(world_->with([] { return world_->is_held; }));
  EXPECT_EQ(world_->with([] { return world_->times_cancelled["pick"]; }), 1);
  EXPECT_TRUE(tell("resume").success);
  ASSERT_TRUE(untilCalled("pick 1", 2));
  EXPECT_EQ(world_->numOf("release"), 1);
  EXPECT_FALSE(world_->with([] { return world_->is_held; }));
  EXPECT_TRUE(tell("stop").success);
  expectEnd(MissionState::STOPPED, "by the operator");
  EXPECT_EQ(world_->with([] { return world_->times_cancelled["pick"]; }), 2);
}

/// Counts heartbeats, and how far apart they are at most by their own stamps.
class Heart {
 public:
  Heart() {
    subscriber_ = ros::NodeHandle().subscribe<std_msgs::Header>("/pick_mission/heartbeat", 1000,
                                                                [this](const std_msgs::Header::ConstPtr& beat) {
                                                                  if (beats == 0 && on_first) on_first();
                                                                  ++beats;
                                                                  last = beat->stamp;
                                                                });
  }
  /// Whether none comes for so long.
  bool isStill(double wall_s) {
    const int before = beats;
    const ros::WallTime begin = ros::WallTime::now();
    waitUntil([&] { return beats != before || (ros::WallTime::now() - begin).toSec() > wall_s; });
    return beats == before;
  }
  int beats{0};
  ros::Time last;
  std::function<void()> on_first;

 private:
  ros::Subscriber subscriber_;
};

/// Sends a drive that the mission's node does not know of.
class OtherDriver {
 public:
  OtherDriver() : publisher_(ros::NodeHandle().advertise<move_base_msgs::MoveBaseActionGoal>("/move_base/goal", 1)) {}
  void drive() {
    ASSERT_TRUE(waitUntil([this] { return publisher_.getNumSubscribers() > 0; }));
    move_base_msgs::MoveBaseActionGoal goal;
    goal.goal_id.id = "other " + std::to_string(++number_);
    goal.goal.target_pose.pose.orientation.w = 1.0;
    publisher_.publish(goal);
  }

 private:
  ros::Publisher publisher_;
  int number_{0};
};

constexpr double kStill_s = 0.3;  // wall time: some sixty beats of the fast clock

TEST_F(PickMissionNode, HeartBeatsByRosTimeUntilAHoldReachesNobody) {
  Heart heart;
  setMode("pick", Mode::kHang);
  startAll();
  ASSERT_TRUE(until([&] { return heart.beats > 0; }));
  const int first = heart.beats;
  const ros::Time begin = heart.last;
  ASSERT_TRUE(until([&] { return heart.beats >= first + 100; }));
  // 20 Hz; a busy machine loses some, and makes none up.
  EXPECT_GE((heart.last - begin).toSec(), 0.9 * 100 / 20.0);
  EXPECT_LE((heart.last - begin).toSec(), 3.0 * 100 / 20.0);

  ASSERT_TRUE(untilCalled("pick 0"));
  world_->stop("hold");
  EXPECT_TRUE(tell("hold").success);
  ASSERT_TRUE(untilState(MissionState::HELD));
  ASSERT_TRUE(until([&] { return heart.isStill(kStill_s); })) << "beats on though nobody has taken the hold";
  EXPECT_THAT(node_->output(), HasSubstr("heartbeat stops"));
  const int still = heart.beats;
  world_->start("hold");
  EXPECT_TRUE(tell("resume").success);
  ASSERT_TRUE(until([&] { return heart.beats > still; }));
  ASSERT_TRUE(untilCalled("pick 0", 2));
}

TEST_F(PickMissionNode, AHoldThatReachedNobodyKeepsTheNextMissionFromStarting) {
  Heart heart;
  startAll();
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  world_->stop("hold");
  EXPECT_TRUE(tell("hold").success);
  ASSERT_TRUE(until([&] { return heart.isStill(kStill_s); }));
  world_->start("hold");
  world_->with([] { world_->pile = {2}; });
  std_srvs::Trigger::Response response;
  // That the service is there again, the node has to hear of first.
  ASSERT_TRUE(until([&] {
    response = tell("start");
    return !node_tests::has(response.message, "the server");
  })) << response.message;
  EXPECT_FALSE(response.success) << "the next mission would not know of it, and its heart would not beat";
  EXPECT_THAT(response.message, HasSubstr("resume"));
  EXPECT_TRUE(tell("resume").success);
  startMission();
  EXPECT_TRUE(until([this] { return state_.state == MissionState::ENDED && state_.bricks_picked == 1; }));
}

TEST_F(PickMissionNode, AHoldAfterAReleaseThatHangsHoldsInTheEnd) {
  setMode("pick", Mode::kHang);
  setMode("release", Mode::kHang);
  set("servers/service_timeout_s", 30.0);
  startAll();
  ASSERT_TRUE(untilCalled("pick 0"));
  tell("hold");
  ASSERT_TRUE(untilState(MissionState::HELD));
  tell("resume");
  ASSERT_TRUE(untilCalled("release"));
  tell("hold");
  ASSERT_TRUE(untilCalled("hold", 2));
  world_->release();  // it is carried out after the hold that was called after it
  EXPECT_TRUE(untilCalled("hold", 3));
  EXPECT_TRUE(until([] { return world_->with([] { return world_->is_held; }); }));
}

TEST_F(PickMissionNode, HeartStopsWhenTheMissionHangs) {
  set("heartbeat/max_stall_s", 0.5);
  setMode("pick", Mode::kHang);
  Heart heart;
  startAll();
  ASSERT_TRUE(untilCalled("pick 0"));
  ASSERT_TRUE(until([&] { return heart.beats > 0; }));
  // Opened for writing, a pipe waits for its reader: so does the mission's thread.
  const std::string pipe = folder_.file("run/mission_state.json.new");
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  setMode("pick", Mode::kAnswer);
  world_->finish("pick");
  ASSERT_TRUE(until([&] { return heart.isStill(kStill_s); }));
  const int still = heart.beats;
  const int reader = ::open(pipe.c_str(), O_RDONLY | O_NONBLOCK);
  ASSERT_GE(reader, 0);
  EXPECT_TRUE(until([&] { return heart.beats > still; }));
  ::close(reader);
}

TEST_F(PickMissionNode, KilledInAPickGoesOnAndStowsWhatHangsThere) {
  setMode("pick", Mode::kHang);
  startAll();
  ASSERT_TRUE(untilCalled("pick 0"));
  endNode(SIGKILL);
  world_->with([] {
    world_->calls.clear();
    world_->modes.clear();
    world_->hand = 0;
    world_->pile = {1, 2, 3};
  });
  set("autostart", true);
  startNode();
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  const auto calls = world_->callsSoFar();
  ASSERT_GE(calls.size(), 4u);
  EXPECT_THAT(std::vector<std::string>(calls.begin(), calls.begin() + 4),
              ElementsAre("plan_arm container_place_1", "move", "let_go", "detect"));
  EXPECT_EQ(std::count(calls.begin(), calls.end(), "drive"), 1)
      << "to the depot: it stands where it stood, all can be picked";
  const nlohmann::json json = summary();
  EXPECT_EQ(json["bricks_picked"], 4);
  EXPECT_EQ(json["picks_begun"], 4);
  EXPECT_EQ(json["failures"]["pick: interrupted by a restart"], 1);
  EXPECT_EQ(state_.views, 1u) << "of before";
}

TEST_F(PickMissionNode, KilledWhilePausedItWaitsForResumeThoughItStartsByItself) {
  setMode("pick", Mode::kHang);
  startAll();
  ASSERT_TRUE(untilCalled("pick 0"));
  EXPECT_TRUE(tell("pause").success);
  world_->finish("pick");
  ASSERT_TRUE(untilState(MissionState::PAUSED));
  endNode(SIGKILL);
  world_->with([] {
    world_->calls.clear();
    world_->modes.clear();
  });
  set("autostart", true);
  startNode();
  ASSERT_EQ(state_.state, MissionState::PAUSED) << describe(state_);
  EXPECT_EQ(tell("start").message, "it has begun already: paused");
  // It would have looked whether it can start with each of these.
  int told = 0;
  const ros::Subscriber counter =
      nh_.subscribe<MissionState>("/pick_mission/state", 100, [&told](const MissionState::ConstPtr&) { ++told; });
  ASSERT_TRUE(until([&told] { return told > 3; }));
  EXPECT_EQ(state_.state, MissionState::PAUSED) << describe(state_);
  EXPECT_THAT(world_->callsSoFar(), testing::IsEmpty());
  EXPECT_TRUE(tell("resume").success);
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  EXPECT_EQ(state_.bricks_picked, 4u);
}

// With the heart beating again the navigation would go on with what it was told by a process that is no more.
TEST_F(PickMissionNode, KilledInADriveTheNextNodeEndsItBeforeItsHeartBeats) {
  setMode("drive", Mode::kHang);
  startAll();
  ASSERT_TRUE(untilCalled("drive"));
  endNode(SIGKILL);
  const auto cancelled = [] { return world_->with([] { return world_->times_cancelled["drive"]; }); };
  ASSERT_EQ(cancelled(), 0);
  Heart heart;
  int at_first = -1;
  heart.on_first = [&] { at_first = cancelled(); };
  startNode();
  ASSERT_TRUE(until([&] { return heart.beats > 0; })) << "beats in the end";
  EXPECT_EQ(at_first, 1);
  EXPECT_EQ(state_.state, MissionState::IDLE);
  setMode("drive", Mode::kAnswer);
  startMission();
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  EXPECT_EQ(cancelled(), 1) << "of its own drives none";
}

TEST_F(PickMissionNode, KilledInAMotionOfTheArmTheNextNodeEndsIt) {
  setMode("move", Mode::kHang);
  startAll();
  ASSERT_TRUE(untilCalled("move"));
  endNode(SIGKILL);
  startNode();
  EXPECT_TRUE(until([] { return world_->with([] { return world_->times_cancelled["move"]; }) == 1; }));
}

TEST_F(PickMissionNode, HeartBeatsInTheEndThoughTheNavigationIsNotThere) {
  world_->stop("drive");
  Heart heart;
  startNode();
  ASSERT_TRUE(until([&] { return heart.beats > 0; }));
  // Late as it comes, what it goes on with is nobody's.
  setMode("drive", Mode::kHang);
  world_->start("drive");
  OtherDriver other;
  other.drive();
  ASSERT_TRUE(untilCalled("drive"));
  EXPECT_TRUE(until([] { return world_->with([] { return world_->times_cancelled["drive"]; }) == 1; }));
}

TEST_F(PickMissionNode, HoldAndStopEndADriveThatThisNodeDoesNotKnow) {
  Heart heart;
  OtherDriver other;
  startNode();
  ASSERT_TRUE(until([&] { return heart.beats > 0; })) << "it has cancelled what was before it";
  setMode("drive", Mode::kHang);
  int count = 0;
  for (const char* what : {"hold", "stop"}) {
    SCOPED_TRACE(what);
    other.drive();
    ASSERT_TRUE(untilCalled("drive", ++count));
    tell(what);
    EXPECT_TRUE(until([&] { return world_->with([] { return world_->times_cancelled["drive"]; }) == count; }));
  }
  EXPECT_EQ(state_.state, MissionState::IDLE);
}

TEST_F(PickMissionNode, ResumeGoesOnFromWhereTheRobotStandsNow) {
  setMode("pick", Mode::kHang);
  startAll();
  ASSERT_TRUE(untilCalled("pick 0"));
  EXPECT_TRUE(tell("pause").success);
  world_->finish("pick");
  ASSERT_TRUE(untilState(MissionState::PAUSED));
  const double pushed_to_m = 0.01;
  world_->with([&] { world_->base_x_m = pushed_to_m; });
  const ros::Time begin = ros::Time::now();
  const double tf_has_come_s = 5.0;
  ASSERT_TRUE(until([&] { return (ros::Time::now() - begin).toSec() > tf_has_come_s; }));
  EXPECT_TRUE(tell("resume").success);
  ASSERT_TRUE(untilCalled("pick 1"));
  const auto saved = nlohmann::json::parse(readText(folder_.file("run/mission_state.json")));
  EXPECT_EQ(saved["mission"]["base"][0].get<double>(), pushed_to_m);
}

TEST_F(PickMissionNode, StopEndsAMissionThatWasInterrupted) {
  setMode("pick", Mode::kHang);
  startAll();
  ASSERT_TRUE(untilCalled("pick 0"));
  endNode(SIGKILL);
  startNode();
  ASSERT_EQ(state_.state, MissionState::IDLE);
  EXPECT_GT(state_.used_s, 0.0) << "by which the panel knows it";
  EXPECT_TRUE(tell("stop").success);
  expectEnd(MissionState::STOPPED, "by the operator");
}

// A mission that was started anew, while the arm still does what the one before it had asked for.
TEST_F(PickMissionNode, ArmThatIsBusyIsWaitedFor) {
  world_->with([] { world_->arm_phase = msgs::ArmBridgeState::RECOVERING; });
  spoil("move", [](void* result, bool* is_success) {
    if (world_->arm_phase == msgs::ArmBridgeState::IDLE) return;
    static_cast<msgs::MoveArmResult*>(result)->outcome.status = msgs::ArmOutcome::BUSY;
    *is_success = false;
  });
  set("time/ready_timeout_s", 250.0);
  startAll();
  ASSERT_TRUE(untilState(MissionState::WAIT));
  const ros::Time begin = ros::Time::now();
  const double many_retry_waits_s = 5.0;
  ASSERT_TRUE(until([&] { return (ros::Time::now() - begin).toSec() > many_retry_waits_s; }));
  EXPECT_EQ(world_->numOf("move"), 1) << "asked again while the arm is busy";
  EXPECT_EQ(state_.state, MissionState::WAIT);
  world_->with([] { world_->arm_phase = msgs::ArmBridgeState::IDLE; });
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  EXPECT_EQ(summary()["failures"]["clear: BUSY"], 1);
}

// As with arm and camera at this computer and the base's driver at another whose cable is out.
TEST_F(PickMissionNode, WhileNobodyTellsWhereTheRobotIsNothingIsAskedAgain) {
  spoil("plan_arm", [](void* result, bool* is_success) {
    if (world_->has_tf) return;
    static_cast<msgs::PlanArmResult*>(result)->outcome.status = msgs::PlanOutcome::NO_ROBOT_STATE;
    *is_success = false;
  });
  setMode("plan_arm", Mode::kHang);
  set("time/ready_timeout_s", 250.0);
  startAll();
  ASSERT_TRUE(untilCalled("plan_arm clear"));
  const auto passes = [this](double time_s) {
    const ros::Time begin = ros::Time::now();
    return until([&] { return (ros::Time::now() - begin).toSec() > time_s; });
  };
  world_->with([] { world_->has_tf = false; });
  const double longer_than_tf_may_be_old_s = 25.0, many_retry_waits_s = 20.0;
  ASSERT_TRUE(passes(longer_than_tf_may_be_old_s));
  world_->release();
  world_->finish("plan_arm");
  ASSERT_TRUE(untilState(MissionState::WAIT));
  ASSERT_TRUE(passes(many_retry_waits_s));
  EXPECT_EQ(state_.state, MissionState::WAIT);
  EXPECT_EQ(world_->numOf("plan_arm clear"), 1) << "asked again though it is not known where the robot is";
  world_->with([] { world_->has_tf = true; });
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  EXPECT_EQ(summary()["failures"]["plan_clear: no robot state"], 1);
}

TEST_F(PickMissionNode, RefusesToStartWithWhatCannotBe) {
  ASSERT_TRUE(std::filesystem::create_directory(folder_.file("run")));
  test_support::writeText(folder_.file("run/mission_state.json"), "{\"mission\": {");
  const auto refusal = [this] {
    node_ = std::make_unique<Process>(std::vector<std::string>{PICK_MISSION_NODE, "__name:=pick_mission"},
                                      folder_.file("node.log"));
    EXPECT_TRUE(waitUntil([this] { return node_->hasEnded(); }));
    EXPECT_EQ(node_->exitCode(), 1);
    return node_->output();
  };
  EXPECT_THAT(refusal(), HasSubstr("run/mission_state.json is no mission's state"));
  test_support::writeText(folder_.file("run/mission_state.json"), "{\"mission\": {}, \"wall_s\": 1.0}");
  EXPECT_THAT(refusal(), HasSubstr("move it away, or set another run_folder, to start a new mission"));
  set("run_folder", "/proc/self");
  EXPECT_THAT(refusal(), HasSubstr("run_folder = '/proc/self', must be a folder that can be written to"));
  set("look/images", -1);
  EXPECT_THAT(refusal(), HasSubstr("/pick_mission/look/images = -1, must be in"));
}

TEST_F(PickMissionNode, ServersThatVanishEndTheMissionWithAReason) {
  set("attempts/max_failures_in_a_row", 1);
  set("servers/timeout_s", 0.5);
  const std::vector<std::pair<std::string, int>> cases = {
      {"plan_arm", MissionState::PLANNING_FAILED},  {"move", MissionState::ARM_FAILED},
      {"plan_pick", MissionState::PLANNING_FAILED}, {"pick", MissionState::PICKS_FAILED},
      {"select", MissionState::SELECTION_FAILED},   {"drive", MissionState::DRIVES_FAILED}};
  int number = 0;
  for (const auto& [name, reason] : cases) {
    SCOPED_TRACE(name);
    world_->reset();
    set("run_folder", folder_.file("run" + std::to_string(++number)));
    const std::string server = name;
    world_->with([&] { world_->vanish = {server}; });
    startAll();
    expectEnd(reason, "is not there");
    node_.reset();
    world_->start(name);
  }
}

TEST_F(PickMissionNode, AServerThatComesBackIsUsedAgain) {
  world_->with([] { world_->vanish = {"plan_pick"}; });
  set("servers/timeout_s", 0.5);
  startAll();
  ASSERT_TRUE(until([this] { return state_.failures > 0; }));
  world_->start("plan_pick");
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  ASSERT_FALSE(state_.last_failures.empty());
  EXPECT_EQ(state_.last_failures.back().state, MissionState::PLAN_PICK);
  EXPECT_THAT(state_.last_failures.back().reason, HasSubstr("/motion_planning/plan_pick is not there"));
}

TEST_F(PickMissionNode, ImagesThatDoNotComeEndTheMissionWithAReason) {
  set("attempts/max_failures_in_a_row", 2);
  set("look/timeout_s", 2.0);
  setMode("detect", Mode::kHang);
  startAll();
  ASSERT_TRUE(untilCalled("detect"));
  world_->with([] { world_->has_images = false; });
  world_->release();
  expectEnd(MissionState::LOOKS_FAILED, "0 of 2 images came into the map within 2");
}

TEST_F(PickMissionNode, AnswersThatMakeNoSenseAreNoAnswers) {
  struct Case {
    std::string server;
    std::function<void(void*, bool*)> spoiler;
    int reason;
    std::string part;
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Case> cases = {
      {"plan_arm", [](void* r, bool*) { static_cast<msgs::PlanArmResult*>(r)->outcome.status = 99; },
       MissionState::PLANNING_FAILED, "outcome of plan_arm = 99, must be less than 14"},
      {"move", [](void* r, bool*) { static_cast<msgs::MoveArmResult*>(r)->outcome.status = 28; },
       MissionState::ARM_FAILED, "outcome of the arm = 28, must be less than 28"},
      // A result that nobody has filled in looks like success.
      {"move", [](void*, bool* is_success) { *is_success = false; }, MissionState::ARM_FAILED, "gives no reason"},
      {"select", [](void* r, bool*) { static_cast<msgs::SelectNextBestViewResult*>(r)->outcome.status = 200; },
       MissionState::SELECTION_FAILED, "outcome of the selection = 200"},
      {"select", [](void* r, bool*) { static_cast<msgs::SelectNextBestViewResult*>(r)->selection = {}; },
       MissionState::SELECTION_FAILED, ""},
      {"select",
       [](void* r, bool*) { static_cast<msgs::SelectNextBestViewResult*>(r)->standing.pose.position.x = kNan; },
       MissionState::SELECTION_FAILED, "without a standing pose"},
      {"select",
       [](void* r, bool*) { static_cast<msgs::SelectNextBestViewResult*>(r)->standing.header.frame_id = "odom"; },
       MissionState::SELECTION_FAILED, "in frame 'odom', must be in 'map'"},
      {"outcome", [](void* r, bool*) { static_cast<msgs::NavigationOutcome*>(r)->status = 20; },
       MissionState::DRIVES_FAILED, "outcome of the drive = 20"},
      // It tells success, and its action has failed.
      {"outcome", [](void*, bool* is_success) { *is_success = false; }, MissionState::DRIVES_FAILED, "gives no reason"},
      {"detect", [](void* r, bool*) { static_cast<msgs::DetectBricks::Response*>(r)->status = 4; },
       MissionState::DETECTION_FAILED, "status of the detection = 4"},
      {"bricks", [](void* r, bool*) { static_cast<msgs::BrickArray*>(r)->header.frame_id = "odom"; },
       MissionState::DETECTION_FAILED, "bricks come in frame 'odom'"},
      {"bricks", [](void* r, bool*) { static_cast<msgs::BrickArray*>(r)->header.stamp = ros::Time(1.0); },
       MissionState::DETECTION_FAILED, "its list of bricks does not come"},
  };
  set("attempts/max_failures_in_a_row", 1);
  int number = 0;
  for (const Case& one : cases) {
    SCOPED_TRACE(one.server + ": " + one.part);
    world_->reset();
    set("run_folder", folder_.file("run" + std::to_string(++number)));
    spoil(one.server, one.spoiler);
    startAll();
    expectEnd(one.reason, one.part);
    node_.reset();
  }
}

TEST_F(PickMissionNode, LeavesBricksThatItCannotTellApartOrWhosePoseIsNone) {
  spoil("bricks", [](void* r, bool*) {
    auto& bricks = static_cast<msgs::BrickArray*>(r)->bricks;
    for (msgs::Brick& brick : bricks) {
      if (brick.id == 1) brick.pose.pose.orientation.w = std::numeric_limits<double>::quiet_NaN();
    }
    if (bricks.empty() || bricks[0].id != 0) return;
    bricks.push_back(bricks[0]);
    bricks.back().pose.pose.position.x += 0.5;
  });
  set("views/max_fruitless", 1);
  startAll();
  ASSERT_TRUE(untilState(MissionState::ENDED));
  EXPECT_EQ(world_->numOf("plan_pick 0"), 0);
  EXPECT_EQ(world_->numOf("plan_pick 1"), 0);
  EXPECT_EQ(world_->numOf("pick 2"), 1);
  EXPECT_EQ(world_->numOf("pick 3"), 1);
  EXPECT_THAT(node_->output(), HasSubstr("brick 1 has an invalid pose"));
}

TEST_F(PickMissionNode, AStopOfTheBaseItselfNeedsAPerson) {
  spoil("outcome", [](void* r, bool* is_success) {
    static_cast<msgs::NavigationOutcome*>(r)->status = msgs::NavigationOutcome::BASE_STOPPED;
    *is_success = false;
  });
  startAll();
  expectEnd(MissionState::NEEDS_PERSON, "");
}

TEST_F(PickMissionNode, OutcomesOfOtherDrivesAreNotThisOnes) {
  set("attempts/max_failures_in_a_row", 1);
  // Not a word of the navigation about this drive: the action's end counts.
  spoil("outcome", [](void* r, bool*) {
    auto* outcome = static_cast<msgs::NavigationOutcome*>(r);
    outcome->status = msgs::NavigationOutcome::STUCK;
    static bool is_elsewhere = false;
    is_elsewhere = !is_elsewhere;
    if (is_elsewhere) {
      outcome->goal.position.x += 0.5;
    } else {
      outcome->header.stamp = ros::Time(1.0);  // latched, of an earlier drive to the same place
    }
  });
  startAll();
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  EXPECT_EQ(summary()["failures"], (nlohmann::json{{"select: no pile", 1}}));
}

TEST_F(PickMissionNode, LateResultOfWhatWasGivenUpIsNotTheNextOnes) {
  set("time/action_timeout_s", 20.0);
  set("look/timeout_s", 15.0);
  set("time/ready_timeout_s", 15.0);
  set("views/fade_wait_s", 1.0);
  set("time/cancel_timeout_s", 1.0);
  setMode("move", Mode::kDeaf);
  startAll();
  ASSERT_TRUE(untilCalled("move"));
  // It does not even end when it is cancelled; the mission goes on without.
  ASSERT_TRUE(untilCalled("plan_arm clear", 2));
  setMode("plan_arm", Mode::kHang);
  ASSERT_TRUE(until([this] { return state_.failures > 0; }));
  // Whatever runs now, the old motion ends in the middle of it.
  world_->finish("move");
  world_->with([] { world_->modes.clear(); });
  world_->finish("plan_arm");
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  for (const nlohmann::json& line : log()) {
    EXPECT_THAT(line["reason"].get<std::string>(), Not(HasSubstr("an invalid answer"))) << line;
  }
  EXPECT_THAT(node_->output(), Not(HasSubstr("an invalid answer")));
}

TEST_F(PickMissionNode, ClockThatJumpsBackDoesNotStopIt) {
  startAll();
  for (const char* call : {"drive", "pick 0", "pick 2"}) {
    ASSERT_TRUE(untilCalled(call));
    clock_->jump(-30.0);
  }
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  EXPECT_EQ(state_.bricks_picked, 4u);
}

// On its way when the clock jumped, it comes after tf2 has forgotten what was before.
TEST_F(PickMissionNode, TfOfBeforeAJumpOfTheClockIsForgotten) {
  startAll();
  for (const char* call : {"drive", "pick 0"}) {
    ASSERT_TRUE(untilCalled(call));
    world_->with([] { world_->is_tf_late = true; });
  }
  expectEnd(MissionState::NO_BRICK_LEFT, "");
  EXPECT_EQ(state_.bricks_picked, 4u);
}

/// As `rosnode kill` does.
void askToShutDown(const std::string& node) {
  XmlRpc::XmlRpcValue request, response, uri;
  request[0] = ros::this_node::getName();
  request[1] = node;
  ASSERT_TRUE(ros::master::execute("lookupNode", request, response, uri, false));
  std::string host;
  std::uint32_t port = 0;
  ASSERT_TRUE(ros::network::splitURI(static_cast<std::string>(uri), host, port));
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
  request[1] = "the test wants it";
  EXPECT_TRUE(client.execute("shutdown", request, response));
}

TEST_F(PickMissionNode, EndsTheDriveBeforeItGoes) {
  for (const int signal : {SIGTERM, SIGINT, 0}) {
    SCOPED_TRACE(signal);
    world_->reset();
    setMode("drive", Mode::kHang);
    startAll();
    ASSERT_TRUE(untilCalled("drive"));
    if (signal == 0) askToShutDown("/pick_mission");
    endNode(signal);
    EXPECT_EQ(node_->exitCode(), 0);
    EXPECT_EQ(world_->with([] { return world_->times_cancelled["drive"]; }), 1);
    EXPECT_FALSE(nlohmann::json::parse(readText(folder_.file("run/mission_state.json")))["mission"]["has_ended"]);
  }
  world_->with([] { world_->modes.clear(); });
  startAll();
  expectEnd(MissionState::NO_BRICK_LEFT, "");
}

TEST_F(PickMissionNode, GoesThoughAServiceHangs) {
  setMode("detect", Mode::kHang);
  startAll();
  ASSERT_TRUE(untilCalled("detect"));
  endNode(SIGTERM);
  EXPECT_EQ(node_->exitCode(), 0) << node_->output();
}

}  // namespace
}  // namespace mission_world
