// SPDX-License-Identifier: BSD-3-Clause
// The widget against a fake node, without a screen. Everything is waited for by its condition; the GUI's thread is that of
// the test.
#include "rviz/mission_widget.h"

#include <algorithm>
#include <array>
#include <condition_variable>
#include <mutex>
#include <string>
#include <vector>

#include <QApplication>
#include <QElapsedTimer>
#include <QLabel>
#include <QLineEdit>
#include <QPushButton>
#include <gmock/gmock.h>
#include <interactive_mapping_msgs/MissionBrick.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

namespace pick_mission_rviz {
namespace {

using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionState;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr int kDeadline_ms = 10000;  // of anything: a loaded machine is slow
constexpr int kPoll_ms = 10;

MissionState stateOf(std::uint8_t value) {
  MissionState state;
  state.header.stamp = ros::Time(1000.0);
  state.since = ros::Time(988.0);
  state.state = value;
  state.brick = -1;
  state.bricks_total = -1;
  state.limit_s = 3600.0;
  return state;
}

/// Topic and services as of pick_mission, in threads of its own.
class FakeNode {
 public:
  explicit FakeNode(const std::string& name) : nh_(name), spinner_(8, &queue_) {
    nh_.setCallbackQueue(&queue_);
    publisher_ = nh_.advertise<MissionState>("state", 1, true);
    spinner_.start();
  }
  ~FakeNode() {
    letAnswer();
    spinner_.stop();
  }

  void publish(const MissionState& state) { publisher_.publish(state); }
  void offer(const std::string& service, bool success = true, const std::string& message = "") {
    services_.push_back(nh_.advertiseService<std_srvs::Trigger::Request, std_srvs::Trigger::Response>(
        service, [this, service, success, message](auto& /*request*/, auto& response) {
          std::unique_lock<std::mutex> lock(mutex_);
          called_.push_back(service);
          may_answer_changed_.wait(lock, [&] { return service != held_back_; });
          response.success = success;
          response.message = message;
          return true;
        }));
  }
  void offerAll() {
    for (const char* service : {"start", "pause", "resume", "hold", "stop"}) offer(service);
  }
  void holdBack(const std::string& service) {
    const std::lock_guard<std::mutex> lock(mutex_);
    held_back_ = service;
  }
  void letAnswer() {
    holdBack("");
    may_answer_changed_.notify_all();
  }
  std::vector<std::string> called() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return called_;
  }

 private:
  ros::NodeHandle nh_;
  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_;
  ros::Publisher publisher_;
  mutable std::mutex mutex_;  // guards the next three
  std::condition_variable may_answer_changed_;
  std::vector<std::string> called_;
  std::string held_back_;
  std::vector<ros::ServiceServer> services_;
};

class MissionWidgetTest : public testing::Test {
 protected:
  MissionWidgetTest() : name_(std::string("/") + testing::UnitTest::GetInstance()->current_test_info()->name()) {
    widget_ = std::make_unique<MissionWidget>();
    widget_->setNode(QString::fromStdString(name_));
    widget_->resize(360, 800);
    widget_->show();
  }

  /// Lets the GUI work until it is so.
  template <typename Condition>
  bool waitUntil(Condition condition) {
    QElapsedTimer timer;
    timer.start();
    while (!condition()) {
      if (timer.elapsed() > kDeadline_ms) return false;
      QApplication::processEvents(QEventLoop::AllEvents, kPoll_ms);
      ros::WallDuration(1e-3 * kPoll_ms).sleep();
    }
    return true;
  }

  std::string text(const char* label) const { return widget_->findChild<QLabel*>(label)->text().toStdString(); }
  QPushButton* button(const char* name) const { return widget_->findChild<QPushButton*>(name); }
  bool waitForTitle(const std::string& title) {
    return waitUntil([&] { return text("title") == title; });
  }
  bool waitForAnswer(const std::string& part) {
    return waitUntil([&] { return text("answer").find(part) != std::string::npos; });
  }
  std::string enabled() const {
    std::string names;
    for (const char* name : {"start", "pause", "stop", "hold"}) {
      if (button(name)->isEnabled()) names += std::string(name) + " ";
    }
    return names;
  }

  const std::string name_;
  std::unique_ptr<MissionWidget> widget_;
};

TEST_F(MissionWidgetTest, ShowsWhatThePublishedStateSays) {
  FakeNode node(name_);
  MissionState state = stateOf(MissionState::PICK);
  state.brick = 4;
  state.decision = "brick 4: the highest";
  state.bricks.resize(1);
  state.bricks[0].id = 4;
  state.bricks[0].status = MissionBrick::CURRENT;
  node.publish(state);
  ASSERT_TRUE(waitForTitle("Picking brick 4")) << text("title");
  EXPECT_EQ(text("since"), "for 12 s");
  EXPECT_EQ(text("decision"), "Brick 4: the highest");
  EXPECT_THAT(text("counts"), HasSubstr("in&nbsp;work"));
  EXPECT_TRUE(widget_->findChild<QWidget*>("details")->isEnabled());
  EXPECT_EQ(enabled(), "pause stop hold ");
  state.state = MissionState::IDLE;
  node.publish(state);
  ASSERT_TRUE(waitForTitle("Waiting for start"));
  EXPECT_EQ(enabled(), "start pause hold ");
  EXPECT_EQ(button("pause")->text(), "Resume") << "of a hold that is given before the mission";
}

TEST_F(MissionWidgetTest, EachButtonCallsItsService) {
  FakeNode node(name_);
  node.offerAll();
  const auto press = [&](const char* name, const std::string& service) {
    const std::size_t before = node.called().size();
    ASSERT_TRUE(button(name)->isEnabled()) << name;
    button(name)->click();
    ASSERT_TRUE(waitUntil([&] { return node.called().size() > before; })) << name;
    ASSERT_TRUE(waitForAnswer(": done.")) << text("answer");
    EXPECT_EQ(node.called().back(), service);
  };
  node.publish(stateOf(MissionState::IDLE));
  ASSERT_TRUE(waitForTitle("Waiting for start"));
  press("start", "start");
  node.publish(stateOf(MissionState::DETECT));
  ASSERT_TRUE(waitForTitle("Detecting bricks"));
  EXPECT_EQ(button("pause")->text(), "Pause");
  press("pause", "pause");
  node.publish(stateOf(MissionState::PAUSED));
  ASSERT_TRUE(waitForTitle("Paused"));
  EXPECT_EQ(button("pause")->text(), "Resume");
  press("pause", "resume");
  press("hold", "hold");
  EXPECT_THAT(node.called(), ElementsAre("start", "pause", "resume", "hold"));
}

TEST_F(MissionWidgetTest, StopAsksFirstAndHoldStaysWithinReach) {
  FakeNode node(name_);
  node.offerAll();
  node.publish(stateOf(MissionState::DRIVE));
  ASSERT_TRUE(waitForTitle("Driving to the next view"));
  auto* question = widget_->findChild<QWidget*>("stop_question");
  EXPECT_FALSE(question->isVisible());
  button("stop")->click();
  EXPECT_TRUE(question->isVisible());
  EXPECT_EQ(QApplication::activeModalWidget(), nullptr);
  button("stop_no")->click();
  EXPECT_FALSE(question->isVisible());
  button("stop")->click();
  button("hold")->click();
  ASSERT_TRUE(waitForAnswer("Hold: done."));
  EXPECT_THAT(node.called(), ElementsAre("hold")) << "nobody has said yes";
  button("stop_yes")->click();
  EXPECT_FALSE(question->isVisible());
  ASSERT_TRUE(waitForAnswer("Stop: done."));
  EXPECT_THAT(node.called(), ElementsAre("hold", "stop"));
}

TEST_F(MissionWidgetTest, AMissingServiceGivesASentence) {
  FakeNode node(name_);
  button("hold")->click();
  ASSERT_TRUE(waitForAnswer("there is no service " + name_ + "/hold")) << text("answer");
  EXPECT_THAT(text("answer"), HasSubstr("emergency stop"));
}

TEST_F(MissionWidgetTest, ARefusalIsShown) {
  FakeNode node(name_);
  node.offer("hold", false, "the bridge is gone");
  button("hold")->click();
  ASSERT_TRUE(waitForAnswer("Hold was refused: the bridge is gone.")) << text("answer");
}

// Each pressed one has its own thread: hold does not stand in line behind a start that hangs, and the GUI does not hang.
TEST_F(MissionWidgetTest, HoldOvertakesACallThatHangs) {
  FakeNode node(name_);
  node.offerAll();
  node.holdBack("start");
  node.publish(stateOf(MissionState::IDLE));
  ASSERT_TRUE(waitForTitle("Waiting for start"));
  button("start")->click();
  ASSERT_TRUE(waitUntil([&] { return node.called().size() == 1; }));
  button("hold")->click();
  ASSERT_TRUE(waitForAnswer("Hold: done.")) << text("answer");
  EXPECT_THAT(node.called(), ElementsAre("start", "hold"));
}

TEST_F(MissionWidgetTest, WithoutAnAnswerItSaysSo) {
  FakeNode node(name_);
  node.offerAll();
  node.holdBack("hold");
  button("hold")->click();
  ASSERT_TRUE(waitForAnswer("no answer of " + name_ + "/hold")) << text("answer");
  EXPECT_THAT(text("answer"), HasSubstr("emergency stop"));
  button("hold")->click();
  ASSERT_TRUE(waitUntil([&] { return node.called().size() == 2; })) << "it can be pressed again";
  node.letAnswer();
  ASSERT_TRUE(waitForAnswer("Hold: done.")) << text("answer");
}

// Whoever is afraid presses again and again: that must neither break off what is on its way, nor begin the wait anew, nor
// start a thread each time.
TEST_F(MissionWidgetTest, HoldPressedAgainAndAgainIsOneHold) {
  FakeNode node(name_);
  node.offerAll();
  node.holdBack("hold");
  constexpr int kPress_ms = 50;
  int presses = 0;
  QElapsedTimer timer;
  timer.start();
  ASSERT_TRUE(waitUntil([&] {
    if (timer.elapsed() < presses * kPress_ms) return false;
    ++presses;
    button("hold")->click();
    return text("answer").find("no answer of") != std::string::npos;
  })) << text("answer");
  EXPECT_GT(presses, 10);
  // One more where the last one is old: that one may be lost.
  EXPECT_LE(node.called().size(), 1 + static_cast<std::size_t>(timer.elapsed()) / 2000);
  node.letAnswer();
  ASSERT_TRUE(waitForAnswer("Hold: done.")) << text("answer");
}

TEST_F(MissionWidgetTest, HoldAfterAResumeIsGivenAnew) {
  FakeNode node(name_);
  node.offerAll();
  node.holdBack("hold");
  node.publish(stateOf(MissionState::HELD));
  ASSERT_TRUE(waitForTitle("Held"));
  button("hold")->click();
  ASSERT_TRUE(waitUntil([&] { return node.called().size() == 1; }));
  button("pause")->click();
  ASSERT_TRUE(waitForAnswer("Resume: done."));
  button("hold")->click();
  ASSERT_TRUE(waitUntil([&] { return node.called().size() == 3; })) << "taken for one with that before the resume";
}

TEST_F(MissionWidgetTest, HoldThatWasRefusedIsGivenAnew) {
  FakeNode node(name_);
  node.offer("hold", false, "the bridge is gone");
  for (std::size_t press = 1; press <= 20; ++press) {
    button("hold")->click();
    ASSERT_TRUE(waitUntil([&] { return node.called().size() == press; })) << "taken for one with that which had ended";
    ASSERT_TRUE(waitForAnswer("Hold was refused")) << text("answer");
  }
}

TEST_F(MissionWidgetTest, ClosingDoesNotWaitForACallThatHangs) {
  FakeNode node(name_);
  node.offerAll();
  node.holdBack("hold");
  button("hold")->click();
  ASSERT_TRUE(waitUntil([&] { return node.called().size() == 1; }));
  widget_.reset();  // hangs, if it waits: the node answers only after it
  node.letAnswer();
}

// The clock of this test never runs: only wall time can tell.
TEST_F(MissionWidgetTest, GreysOutWhenTheNodeIsSilent) {
  FakeNode node(name_);
  node.publish(stateOf(MissionState::DRIVE));
  ASSERT_TRUE(waitForTitle("Driving to the next view"));
  QElapsedTimer timer;
  timer.start();
  ASSERT_TRUE(waitUntil([&] { return text("title").rfind("No message for", 0) == 0; })) << text("title");
  EXPECT_GT(timer.elapsed(), 2000) << "it came a moment before the timer started";
  EXPECT_THAT(text("note"), HasSubstr("the clock is stopped"));
  EXPECT_FALSE(widget_->findChild<QWidget*>("details")->isEnabled());
  EXPECT_EQ(enabled(), "hold ");
  node.publish(stateOf(MissionState::LOOK));
  ASSERT_TRUE(waitForTitle("Looking: new images into the map"));
  EXPECT_TRUE(widget_->findChild<QWidget*>("details")->isEnabled());
}

TEST_F(MissionWidgetTest, AnotherNodeCanBeChosen) {
  FakeNode node(name_);
  FakeNode other("/other");
  other.offerAll();
  node.publish(stateOf(MissionState::DRIVE));
  other.publish(stateOf(MissionState::SELECT));
  ASSERT_TRUE(waitForTitle("Driving to the next view"));
  int changes = 0;
  QObject::connect(widget_.get(), &MissionWidget::nodeChanged, [&] { ++changes; });
  auto* line = widget_->findChild<QLineEdit*>("node");
  line->setText(" other ");
  Q_EMIT line->editingFinished();
  EXPECT_EQ(changes, 1);
  EXPECT_EQ(widget_->node().toStdString(), "/other");
  EXPECT_EQ(text("title"), "No mission") << "nothing of the one before";
  ASSERT_TRUE(waitForTitle("Selecting the next view"));
  node.publish(stateOf(MissionState::LOOK));
  button("hold")->click();
  ASSERT_TRUE(waitForAnswer("Hold: done."));
  EXPECT_THAT(other.called(), ElementsAre("hold"));
  EXPECT_EQ(text("title"), "Selecting the next view");
}

TEST_F(MissionWidgetTest, ANameThatIsNoneIsNotTaken) {
  for (const char* bad : {"", "/", "a b", "5x"}) {
    widget_->setNode(bad);
    EXPECT_EQ(widget_->node().toStdString(), name_) << bad;
    EXPECT_EQ(widget_->findChild<QLineEdit*>("node")->text().toStdString(), name_) << bad;
    EXPECT_THAT(text("answer"), HasSubstr("must be a node's name")) << bad;
  }
}

TEST_F(MissionWidgetTest, FitsItsWidthWhateverTheWords) {
  FakeNode node(name_);
  MissionState state = stateOf(MissionState::PLAN_CLEAR);
  state.decision = std::string(300, 'x');
  state.run_folder = "/results/" + std::string(200, 'y');
  state.failures = 1;
  state.last_failures.resize(1);
  state.last_failures[0].event = "<b>" + std::string(100, 'z') + "</b>";
  state.last_failures[0].reason = "not free (<i>of brick 3</i>)";
  for (int id = 0; id < 60; ++id) {
    MissionBrick brick;
    brick.id = id;
    state.bricks.push_back(brick);
  }
  node.publish(state);
  ASSERT_TRUE(waitForTitle("Planning the arm out of the view"));
  QApplication::processEvents();
  EXPECT_EQ(widget_->width(), 360);
  EXPECT_LE(widget_->minimumSizeHint().width(), 360);
  // Of 360 px, less margins, all bricks in rows of at least 20 px.
  const auto* strip = widget_->findChild<QWidget*>("bricks");
  EXPECT_LE(strip->width(), 360);
  EXPECT_GE(strip->height(), 20 * (60 * 20 / 360));
  EXPECT_THAT(text("failures"), HasSubstr("&lt;b&gt;")) << "words are not markup";
  EXPECT_THAT(widget_->findChild<QLabel*>("failures")->toolTip().toStdString(), HasSubstr("&lt;i&gt;of"));
  for (const char* name : {"start", "pause", "stop", "hold"}) {
    EXPECT_GE(button(name)->width(), button(name)->fontMetrics().horizontalAdvance(button(name)->text())) << name;
    EXPECT_TRUE(widget_->rect().contains(button(name)->geometry().translated(button(name)->parentWidget()->pos())));
  }
}

}  // namespace
}  // namespace pick_mission_rviz

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_mission_widget");
  const ros::NodeHandle keeps_ros_running;
  QApplication application(argc, argv);
  return RUN_ALL_TESTS();
}
