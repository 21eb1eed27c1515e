// SPDX-License-Identifier: BSD-3-Clause
// All that the mission's node talks to, in the test's process, with a clock of its own. Everything goes well unless a test
// says otherwise.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <actionlib/server/action_server.h>
#include <geometry_msgs/TransformStamped.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_msgs/ArmBridgeState.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/BrickArray.h>
#include <interactive_mapping_msgs/DetectBricks.h>
#include <interactive_mapping_msgs/LetGoBrickAction.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/MoveArmAction.h>
#include <interactive_mapping_msgs/NavigationOutcome.h>
#include <interactive_mapping_msgs/PickBrickAction.h>
#include <interactive_mapping_msgs/PlanArmAction.h>
#include <interactive_mapping_msgs/PlanPickAction.h>
#include <interactive_mapping_msgs/RecoverArmAction.h>
#include <interactive_mapping_msgs/ReportFailure.h>
#include <interactive_mapping_msgs/SelectNextBestViewAction.h>
#include <motion_planning/manipulability_sector.h>
#include <motion_planning_ros/robot_description.h>
#include <move_base_msgs/MoveBaseAction.h>
#include <mp700_ur5e_description/robot_names.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <ros/spinner.h>
#include <rosgraph_msgs/Clock.h>
#include <std_srvs/Trigger.h>
#include <tf2_msgs/TFMessage.h>

namespace mission_world {

namespace msgs = interactive_mapping_msgs;

/// /clock, some ten times as fast as the wall clock.
class FakeClock {
 public:
  FakeClock()
      : publisher_(ros::NodeHandle().advertise<rosgraph_msgs::Clock>("/clock", 10)), thread_([this] { run(); }) {}
  ~FakeClock() {
    is_over_ = true;
    thread_.join();
  }
  void jump(double by_s) { now_ns_ += static_cast<std::int64_t>(by_s * 1e9); }

 private:
  void run() {
    while (!is_over_) {
      rosgraph_msgs::Clock clock;
      now_ns_ += 20000000;
      clock.clock.fromNSec(static_cast<std::uint64_t>(now_ns_.load()));
      publisher_.publish(clock);
      std::this_thread::sleep_for(std::chrono::milliseconds(2));  // the clock's pace; nothing waits by it
    }
  }

  ros::Publisher publisher_;
  std::atomic<std::int64_t> now_ns_{1000000000000};
  std::atomic<bool> is_over_{false};
  std::thread thread_;
};

enum class Mode {
  kAnswer,
  kHang,  // until it is cancelled
  kDeaf,  // not even then
};

/// An action server that can be taken away. In the thread of its queue.
class AnyServer {
 public:
  virtual ~AnyServer() = default;
  virtual void start() = 0;
  virtual void stop() = 0;
  /// What hangs ends, as if it had never been cancelled.
  virtual void finish() = 0;
};

template <typename Action>
class FakeServer : public AnyServer {
 public:
  using Server = actionlib::ActionServer<Action>;
  using GoalHandle = typename Server::GoalHandle;
  using Goal = typename Action::_action_goal_type::_goal_type;
  using Result = typename Action::_action_result_type::_result_type;
  struct End {
    Result result;
    bool is_success{true};
  };
  using Begin = std::function<Mode(const Goal&)>;  // when the goal has come
  using Finish = std::function<End(const Goal&, bool is_cancelled)>;

  FakeServer(const ros::NodeHandle& nh, std::string name, Begin begin, Finish finish)
      : nh_(nh), name_(std::move(name)), begin_(std::move(begin)), finish_(std::move(finish)) {}

  void start() override {
    if (server_) return;
    server_ = std::make_unique<Server>(
        nh_, name_, [this](GoalHandle goal) { onGoal(goal); }, [this](GoalHandle goal) { onCancel(goal); }, false);
    server_->start();
  }
  void stop() override {
    current_.reset();
    server_.reset();
  }
  void finish() override {
    if (current_) end(false);
  }

 private:
  void onGoal(GoalHandle goal) {
    goal.setAccepted();
    current_ = goal;
    mode_ = begin_(*goal.getGoal());
    if (mode_ == Mode::kAnswer) end(false);
  }
  void onCancel(GoalHandle goal) {
    if (current_ && *current_ == goal && mode_ == Mode::kHang) end(true);
  }
  void end(bool is_cancelled) {
    GoalHandle goal = *current_;
    current_.reset();
    const End end = finish_(*goal.getGoal(), is_cancelled);
    if (is_cancelled) {
      goal.setCanceled(end.result);
    } else if (end.is_success) {
      goal.setSucceeded(end.result);
    } else {
      goal.setAborted(end.result, "as the test wants it");
    }
  }

  ros::NodeHandle nh_;
  const std::string name_;
  const Begin begin_;
  const Finish finish_;
  Mode mode_{Mode::kAnswer};
  std::optional<GoalHandle> current_;
  std::unique_ptr<Server> server_;
};

class MissionWorld {
 public:
  explicit MissionWorld(const std::string& sectors_file) : spinner_(1, &queue_), service_spinner_(4, &service_queue_) {
    nh_.setCallbackQueue(&queue_);
    service_nh_.setCallbackQueue(&service_queue_);
    findPlace(sectors_file);
    reset();
    tf_ = nh_.advertise<tf2_msgs::TFMessage>("/tf", 10);
    bridge_ = nh_.advertise<msgs::ArmBridgeState>("/ur_driver_bridge/state", 10);
    attached_ = nh_.advertise<msgs::AttachedBrick>("/attached_brick", 5, true);
    map_ = nh_.advertise<msgs::MapUpdate>("/gpis_mapping/update", 10);
    bricks_ = nh_.advertise<msgs::BrickArray>("/brick_detection/bricks", 2, true);
    outcome_ = nh_.advertise<msgs::NavigationOutcome>("/base_navigation/outcome", 10, true);
    makeServers();
    timer_ = nh_.createWallTimer(ros::WallDuration(0.005), [this](const ros::WallTimerEvent&) { publish(); });
    spinner_.start();
    service_spinner_.start();
    for (const std::string& name : names()) start(name);
  }
  ~MissionWorld() {
    release();
    for (const std::string& name : names()) stop(name);
    service_spinner_.stop();
    spinner_.stop();
  }

  static std::vector<std::string> names() {
    return {"plan_arm", "plan_pick", "move",   "pick",   "let_go", "recover",
            "select",   "drive",     "detect", "report", "hold",   "release"};
  }

  /// As before the first mission.
  void reset() {
    const std::lock_guard<std::mutex> lock(mutex_);
    pile = {0, 1, 2, 3};
    base_x_m = -3.0;
    hand.reset();
    magnet_lag = 0;
    calls.clear();
    modes.clear();
    spoilers.clear();
    has_images = has_bridge = has_tf = true;
    bricks_frame = "map";
    is_held = false;
    arm_phase = msgs::ArmBridgeState::IDLE;
    arm_stage.clear();
    times_cancelled.clear();
  }

  /// Runs `job` in the thread of the action servers, and waits for it.
  void run(std::function<void()> job) {
    struct Callback : ros::CallbackInterface {
      CallResult call() override {
        job();
        done.set_value();
        return Success;
      }
      std::function<void()> job;
      std::promise<void> done;
    };
    auto callback = boost::make_shared<Callback>();
    callback->job = std::move(job);
    std::future<void> done = callback->done.get_future();
    queue_.addCallback(callback);
    done.wait();
  }

  void start(const std::string& name) { change(name, true); }
  void stop(const std::string& name) { change(name, false); }
  void finish(const std::string& name) {
    run([this, &name] { actions_.at(name)->finish(); });
  }
  /// Services that hang answer.
  void release() {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (auto& [name, mode] : modes) mode = Mode::kAnswer;
    changed_.notify_all();
  }

  template <typename Function>
  auto with(Function function) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return function();
  }
  std::vector<std::string> callsSoFar() {
    return with([this] { return calls; });
  }
  int numOf(const std::string& call) {
    return with([&] { return static_cast<int>(std::count(calls.begin(), calls.end(), call)); });
  }

  // Guarded by the mutex; see with().
  std::vector<int> pile;
  double base_x_m{0.0};
  bool is_tf_late{false};  // once: of half a minute ahead and elsewhere, as of before the clock jumped back
  std::optional<int> hand;
  int magnet_lag{0};                  // states of the bridge after a pick in which the magnet is still on
  std::vector<std::string> calls;     // in order
  std::map<std::string, Mode> modes;  // by name of the server
  std::map<std::string, int> times_cancelled;
  std::map<std::string, std::function<void(void* result, bool* is_success)>> spoilers;  // before an answer goes out
  std::set<std::string> vanish;  // servers that go when the next goal comes
  bool has_images{true}, has_bridge{true}, has_tf{true}, is_held{false};
  std::uint8_t arm_phase{msgs::ArmBridgeState::IDLE};  // as its bridge tells
  std::string arm_stage;                               // a pick's; at its end
  msgs::PlanPickGoal pick_plan;                        // the last that was asked for
  std::string bricks_frame;

 private:
  /// Where the arm reaches for certain, as the real sectors have it.
  void findPlace(const std::string& sectors_file) {
    const auto arm = motion_planning_ros::kinematicsFromServer(ros::NodeHandle());
    const auto sectors = motion_planning::ManipulabilitySectors::load(sectors_file, arm->robot());
    const Eigen::Isometry3d T_base_armbase = arm->robot().framePose(
        mp700_ur5e_description::kArmBaseFrame, arm->robotPositions(motion_planning::ArmVector::Zero()));
    for (double x_m = 0.3; x_m < 2.0; x_m += 0.05) {
      bool is_fine = true;
      for (int id = 0; id < 4; ++id) {
        is_fine = is_fine && sectors.admits(topOf(id, x_m), Eigen::Vector3d::UnitZ(), T_base_armbase);
      }
      if (!is_fine) continue;
      place_x_m_ = x_m;
      return;
    }
    throw std::runtime_error("the arm reaches nowhere");
  }
  /// When the robot stands at the origin.
  static Eigen::Vector3d topOf(int id, double x_m) { return {x_m, 0.04 * (id - 1.5), 0.3 - 0.01 * id}; }

  template <typename Action>
  void make(const std::string& key, const std::string& name,
            std::function<std::string(const typename FakeServer<Action>::Goal&)> describe,
            std::function<void(const typename FakeServer<Action>::Goal&, bool is_cancelled,
                               typename FakeServer<Action>::Result*, bool* is_success)>
                act) {
    using Fake = FakeServer<Action>;
    actions_[key] = std::make_unique<Fake>(
        nh_, name,
        [this, key, describe](const typename Fake::Goal& goal) {
          const std::lock_guard<std::mutex> lock(mutex_);
          calls.push_back(describe(goal));
          if (vanish.erase(key) > 0) gone_.push_back(key);
          const bool goes = !gone_.empty();
          const auto mode = modes.find(key);
          return goes ? Mode::kDeaf : mode == modes.end() ? Mode::kAnswer : mode->second;
        },
        [this, key, act](const typename Fake::Goal& goal, bool is_cancelled) {
          typename Fake::End end;
          const std::lock_guard<std::mutex> lock(mutex_);
          if (is_cancelled) ++times_cancelled[key];
          act(goal, is_cancelled, &end.result, &end.is_success);
          const auto spoil = spoilers.find(key);
          if (spoil != spoilers.end()) spoil->second(&end.result, &end.is_success);
          return end;
        });
  }

  template <typename Result>
  static void fill(bool is_cancelled, std::uint8_t cancelled, Result* result) {
    if (is_cancelled) result->outcome.status = cancelled;
  }
  template <typename Result>
  void fillArm(bool is_cancelled, Result* result) {
    result->outcome.header.stamp = ros::Time::now();
    if (is_cancelled) result->outcome.status = is_held ? msgs::ArmOutcome::HELD : msgs::ArmOutcome::CANCELLED;
  }

  void makeServers() {
    make<msgs::PlanArmAction>(
        "plan_arm", "/motion_planning/plan_arm",
        [](const auto& goal) { return goal.inspect ? "plan_arm clear" : "plan_arm " + goal.goals.at(0).place_frame; },
        [](const auto&, bool is_cancelled, auto* result, bool*) {
          fill(is_cancelled, msgs::PlanOutcome::CANCELLED, result);
          result->trajectory.joint_names = {"planned"};
        });
    make<msgs::PlanPickAction>(
        "plan_pick", "/motion_planning/plan_pick",
        [](const auto& goal) { return "plan_pick " + std::to_string(goal.brick_id); },
        [this](const auto& goal, bool is_cancelled, auto* result, bool*) {
          fill(is_cancelled, msgs::PlanOutcome::CANCELLED, result);
          pick_plan = goal;
          result->stow.points.resize(1);
          result->stow.points[0].positions.assign(6, 0.1 * (goal.brick_id + 1));
        });
    make<msgs::MoveArmAction>(
        "move", "/ur_driver_bridge/move",
        [](const auto& goal) { return goal.trajectory.joint_names.empty() ? "move nowhere" : "move"; },
        [this](const auto&, bool is_cancelled, auto* result, bool*) { fillArm(is_cancelled, result); });
    make<msgs::PickBrickAction>(
        "pick", "/ur_driver_bridge/pick", [](const auto& goal) { return "pick " + std::to_string(goal.brick_id); },
        [this](const auto& goal, bool is_cancelled, auto* result, bool*) {
          fillArm(is_cancelled, result);
          if (!is_cancelled) pile.erase(std::remove(pile.begin(), pile.end(), goal.brick_id), pile.end());
          magnet_lag_left_ = magnet_lag;
          arm_stage.clear();
          if (!is_cancelled) hand.reset();
        });
    make<msgs::LetGoBrickAction>(
        "let_go", "/ur_driver_bridge/let_go", [](const auto&) { return "let_go"; },
        [this](const auto&, bool is_cancelled, auto* result, bool*) {
          fillArm(is_cancelled, result);
          hand.reset();
        });
    make<msgs::RecoverArmAction>(
        "recover", "/ur_driver_bridge/recover", [](const auto&) { return "recover"; },
        [this](const auto&, bool is_cancelled, auto* result, bool*) { fillArm(is_cancelled, result); });
    make<msgs::SelectNextBestViewAction>(
        "select", "/nbv_selection/select", [](const auto&) { return "select"; },
        [this](const auto&, bool is_cancelled, auto* result, bool*) {
          fill(is_cancelled, msgs::SelectionOutcome::CANCELLED, result);
          result->selection.best = -1;
          if (pile.empty()) result->outcome.status = msgs::SelectionOutcome::NO_PILE;
          if (result->outcome.status == msgs::SelectionOutcome::SUCCESS) {
            msgs::NbvSegment segment;
            segment.standing.orientation.w = 1.0;
            segment.utility = 0.5;
            result->standing.header.frame_id = "/map";  // as others name it
            result->standing.pose = segment.standing;
            result->selection.best = 0;
            result->selection.segments = {segment};
          }
          result->selection.strategy = "gpis";
          result->selection.outcome = result->outcome;
        });
    make<move_base_msgs::MoveBaseAction>(
        "drive", "/move_base", [](const auto&) { return "drive"; },
        [this](const auto& goal, bool is_cancelled, auto*, bool* is_success) {
          if (!is_cancelled) base_x_m = goal.target_pose.pose.position.x;
          msgs::NavigationOutcome outcome;
          outcome.header.frame_id = "map";
          outcome.header.stamp = ros::Time::now();
          outcome.status = is_cancelled ? msgs::NavigationOutcome::CANCELLED : msgs::NavigationOutcome::SUCCESS;
          outcome.goal = goal.target_pose.pose;
          outcome.base = outcome.goal;
          const auto spoil = spoilers.find("outcome");
          if (spoil != spoilers.end()) spoil->second(&outcome, is_success);
          outcome_.publish(outcome);
        });
  }

  void change(const std::string& name, bool is_there) {
    run([&] {
      const auto action = actions_.find(name);
      if (action != actions_.end()) return is_there ? action->second->start() : action->second->stop();
      ros::ServiceServer& server = services_[name];
      if (!is_there) {
        server.shutdown();
      } else if (!server) {
        server = advertise(name);
      }
    });
  }

  ros::ServiceServer advertise(const std::string& name) {
    if (name == "detect") return service_nh_.advertiseService("/brick_detection/detect", &MissionWorld::onDetect, this);
    if (name == "hold") return service_nh_.advertiseService("/ur_driver_bridge/hold", &MissionWorld::onHold, this);
    if (name == "release") {
      return service_nh_.advertiseService("/ur_driver_bridge/release", &MissionWorld::onRelease, this);
    }
    return service_nh_.advertiseService("/nbv_selection/report_failure", &MissionWorld::onReport, this);
  }

  /// With the lock held.
  void waitWhileItHangs(const std::string& key, std::unique_lock<std::mutex>* lock) {
    changed_.wait(*lock, [&] {
      const auto mode = modes.find(key);
      return mode == modes.end() || mode->second == Mode::kAnswer;
    });
  }

  bool onDetect(msgs::DetectBricks::Request&, msgs::DetectBricks::Response& response) {
    std::unique_lock<std::mutex> lock(mutex_);
    calls.emplace_back("detect");
    waitWhileItHangs("detect", &lock);
    msgs::BrickArray array;
    array.header.frame_id = bricks_frame;
    array.header.stamp = ros::Time::now();
    for (const int id : pile) {
      if (hand == id) continue;
      msgs::Brick brick;
      brick.id = id;
      brick.type = "small";
      Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
      T.translation() = topOf(id, place_x_m_);
      msgs::BrickFace face;
      face.face = msgs::BrickFace::PLUS_Z;
      face.pose = interactive_mapping_ros::toPose(T);
      brick.graspable_faces = {face};
      T.translation().z() -= 0.05;
      brick.pose.pose = interactive_mapping_ros::toPose(T);
      array.bricks.push_back(brick);
      response.update.bricks_seen.push_back(id);
    }
    response.update.header = array.header;
    response.success = 1;
    const auto spoil = spoilers.find("detect");
    if (spoil != spoilers.end()) spoil->second(&response, nullptr);
    const auto spoil_bricks = spoilers.find("bricks");
    if (spoil_bricks != spoilers.end()) spoil_bricks->second(&array, nullptr);
    bricks_.publish(array);
    return true;
  }
  bool onReport(msgs::ReportFailure::Request&, msgs::ReportFailure::Response& response) {
    std::unique_lock<std::mutex> lock(mutex_);
    calls.emplace_back("report");
    response.success = 1;
    return true;
  }
  bool onHold(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
    std::unique_lock<std::mutex> lock(mutex_);
    calls.emplace_back("hold");
    waitWhileItHangs("hold", &lock);
    is_held = true;
    response.success = 1;
    return true;
  }
  bool onRelease(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
    std::unique_lock<std::mutex> lock(mutex_);
    calls.emplace_back("release");
    waitWhileItHangs("release", &lock);
    is_held = false;
    response.success = 1;
    return true;
  }

  void publish() {
    std::vector<std::string> gone;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      gone.swap(gone_);
    }
    for (const std::string& name : gone) actions_.at(name)->stop();
    const ros::Time now = ros::Time::now();
    if (now.isZero()) return;
    const std::lock_guard<std::mutex> lock(mutex_);
    geometry_msgs::TransformStamped transform;
    transform.header.stamp = now;
    transform.header.frame_id = "map";
    transform.child_frame_id = "base_link";
    transform.transform.translation.x = base_x_m;
    transform.transform.rotation.w = 1.0;
    tf2_msgs::TFMessage tf;
    tf.transforms = {transform};
    if (has_tf) tf_.publish(tf);
    if (is_tf_late) {
      tf.transforms.front().header.stamp = now + ros::Duration(30.0);
      tf.transforms.front().transform.translation.x = 99.0;
      tf_.publish(tf);
      is_tf_late = false;
    }
    if (has_bridge) {
      msgs::ArmBridgeState state;
      state.header.stamp = now;
      state.may_move = !is_held;
      state.phase = arm_phase;
      state.stage = arm_stage;
      state.progress = 1.0F;
      state.is_holding = hand.has_value();
      state.is_magnet_on = hand.has_value() || magnet_lag_left_ > 0;
      magnet_lag_left_ = std::max(0, magnet_lag_left_ - 1);
      bridge_.publish(state);
      if (!told_hand_ || *told_hand_ != hand) {
        msgs::AttachedBrick attached;
        attached.header.stamp = now;
        attached.is_attached = hand.has_value();
        attached.id = hand.value_or(0);
        attached_.publish(attached);
        told_hand_ = hand;
      }
    }
    if (has_images && ++ticks_ % 4 == 0) {
      msgs::MapUpdate update;
      update.header.stamp = now;
      update.header.frame_id = "map";
      map_.publish(update);
    }
  }

  std::mutex mutex_;  // guards the public data and what follows, up to the blank line
  std::condition_variable changed_;
  std::vector<std::string> gone_;
  std::optional<std::optional<int>> told_hand_;
  int magnet_lag_left_{0};
  int ticks_{0};

  double place_x_m_{0.0};
  ros::CallbackQueue queue_, service_queue_;
  ros::NodeHandle nh_, service_nh_;
  ros::Publisher tf_, bridge_, attached_, map_, bricks_, outcome_;
  std::map<std::string, std::unique_ptr<AnyServer>> actions_;
  std::map<std::string, ros::ServiceServer> services_;
  ros::WallTimer timer_;
  ros::AsyncSpinner spinner_, service_spinner_;
};

}  // namespace mission_world
