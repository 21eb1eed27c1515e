// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>
#include <string>
#include <vector>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gmock/gmock.h>
#include <nav_msgs/Odometry.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/Image.h>
#include <tf2_msgs/TFMessage.h>

namespace {

using diagnostic_msgs::DiagnosticStatus;
using testing::HasSubstr;

constexpr double kDeadline_s = 20.0;  // wall time; a loaded machine answers in one
constexpr double kStart_s = 100.0;

geometry_msgs::TransformStamped transform(const std::string& parent, const std::string& child, double stamp_s,
                                          double x_m = 0.0) {
  geometry_msgs::TransformStamped result;
  result.header.frame_id = parent;
  result.header.stamp.fromSec(stamp_s);
  result.child_frame_id = child;
  result.transform.translation.x = x_m;
  result.transform.rotation.w = 1.0;
  return result;
}

/// Heading of a base that swings about: 0.8 rad to each side every 7.3 s (no multiple of the images' 0.1 s), at up to 0.69 rad/s.
double yawAt(double time_s) {
  return 0.8 * std::sin(2.0 * M_PI * time_s / 7.3);
}

/// A wall of random grey spots, moved to the right by shift_px, between the columns by a straight line.
sensor_msgs::Image image(double stamp_s, double shift_px) {
  constexpr int kWidth = 160, kHeight = 120, kWall = 480, kBegin = 160;
  static const std::vector<double> wall = [] {
    std::mt19937 engine(5);
    std::uniform_int_distribution<int> grey(0, 255);
    std::vector<double> spots(kWall * kHeight), smooth(kWall * kHeight, 128.0);
    for (double& spot : spots) spot = grey(engine);
    for (int row = 1; row + 1 < kHeight; ++row) {
      for (int column = 1; column + 1 < kWall; ++column) {
        double sum = 0.0;
        for (int i = -1; i <= 1; ++i) {
          for (int j = -1; j <= 1; ++j) sum += spots[static_cast<std::size_t>((row + i) * kWall + column + j)];
        }
        smooth[static_cast<std::size_t>(row * kWall + column)] = sum / 9.0;
      }
    }
    return smooth;
  }();
  sensor_msgs::Image result;
  result.header.stamp.fromSec(stamp_s);
  result.encoding = "mono8";
  result.width = kWidth;
  result.height = kHeight;
  result.step = kWidth;
  result.data.resize(kWidth * kHeight);
  for (int row = 0; row < kHeight; ++row) {
    for (int column = 0; column < kWidth; ++column) {
      const double x = kBegin + column - shift_px;
      const auto left = static_cast<std::size_t>(row * kWall + static_cast<int>(x));
      const double share = x - std::floor(x);
      result.data[static_cast<std::size_t>(row * kWidth + column)] =
          static_cast<unsigned char>(std::lround((1.0 - share) * wall[left] + share * wall[left + 1]));
    }
  }
  return result;
}

class SystemDiagnosticsNode : public testing::Test {
 protected:
  void SetUp() override {
    clock_ = nh_.advertise<rosgraph_msgs::Clock>("/clock", 10, true);
    tf_ = nh_.advertise<tf2_msgs::TFMessage>("/tf", 2000);
    tf_static_ = nh_.advertise<tf2_msgs::TFMessage>("/tf_static", 10, true);
    images_ = nh_.advertise<sensor_msgs::Image>("/camera/image", 100);
    odometry_ = nh_.advertise<nav_msgs::Odometry>("/odom", 2000);
    subscriber_ = nh_.subscribe("/diagnostics", 100, &SystemDiagnosticsNode::onDiagnostics, this);
    ASSERT_TRUE(waitFor([this] {
      return tf_.getNumSubscribers() > 0 && tf_static_.getNumSubscribers() > 0 && images_.getNumSubscribers() > 0 &&
             odometry_.getNumSubscribers() > 0 && subscriber_.getNumPublishers() > 0;
    }));
    // The clock goes back to before what the last test had: everything is forgotten.
    setClock(kStart_s);
    ASSERT_TRUE(waitFor([this] { return message("tf map -> odom") == "tf has no map -> odom"; }));
  }

  void onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& array) {
    for (const DiagnosticStatus& status : array->status) {
      statuses_[status.name.substr(status.name.find(": ") + 2)] = {array->header.stamp.toSec(), status};
    }
  }

  bool waitFor(const std::function<bool()>& condition) {
    const ros::WallTime deadline = ros::WallTime::now() + ros::WallDuration(kDeadline_s);
    while (ros::ok() && ros::WallTime::now() < deadline) {
      ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.01));
      if (condition()) return true;
    }
    return false;
  }

  void setClock(double now_s) {
    rosgraph_msgs::Clock clock;
    clock.clock.fromSec(now_s);
    clock_.publish(clock);
    ASSERT_TRUE(waitFor([this, now_s] {
      const auto found = statuses_.find("tf tree");
      return found != statuses_.end() && std::abs(found->second.stamp_s - now_s) < 1e-6;
    })) << "the node does not follow the clock to "
        << now_s;
  }

  std::string message(const std::string& name) { return statuses_[name].status.message; }
  int level(const std::string& name) { return statuses_[name].status.level; }
  double value(const std::string& name, const std::string& key) {
    for (const auto& entry : statuses_[name].status.values) {
      if (entry.key == key) return std::stod(entry.value);
    }
    return std::numeric_limits<double>::quiet_NaN();
  }

  void send(const std::vector<geometry_msgs::TransformStamped>& transforms) {
    tf2_msgs::TFMessage tf;
    tf.transforms = transforms;
    tf_.publish(tf);
  }

  /// A robot that stands, for 11 s at 25 Hz, mounted parts included.
  void sendSteadyTree(double jump_at_s = 1e9) {
    tf2_msgs::TFMessage mounted;
    mounted.transforms = {transform("base_link", "camera_color_optical_frame", 0.0, 0.3)};
    tf_static_.publish(mounted);
    for (int i = 0; i <= 275; ++i) {
      const double stamp_s = kStart_s + i * 0.04;
      send({transform("map", "odom", stamp_s, stamp_s >= jump_at_s ? 0.4 : 0.0),
            transform("odom", "base_link", stamp_s), transform("base_link", "magnet_tip", stamp_s, 0.7)});
    }
    setClock(kStart_s + 11.0);
  }

  struct Stamped {
    double stamp_s;
    DiagnosticStatus status;
  };
  ros::NodeHandle nh_;
  ros::Publisher clock_, tf_, tf_static_, images_, odometry_;
  ros::Subscriber subscriber_;
  std::map<std::string, Stamped> statuses_;
};

TEST_F(SystemDiagnosticsNode, ASteadyTreeIsAllRightWithItsNumbers) {
  sendSteadyTree();
  ASSERT_TRUE(waitFor([this] { return level("tf base_link -> magnet_tip") == DiagnosticStatus::OK; }))
      << message("tf base_link -> magnet_tip");
  for (const char* name :
       {"tf map -> odom", "tf odom -> base_link", "tf base_link -> camera_color_optical_frame", "tf tree"}) {
    ASSERT_TRUE(waitFor([this, name] { return level(name) == DiagnosticStatus::OK; })) << message(name);
  }
  EXPECT_NEAR(value("tf map -> odom", "rate [Hz]"), 25.0, 0.2);
  EXPECT_NEAR(value("tf map -> odom", "age [s]"), 0.0, 1e-3);
  EXPECT_NEAR(value("tf odom -> base_link", "longest gap [s]"), 0.04, 1e-3);
  EXPECT_EQ(value("tf tree", "frames"), 4.0);
}

TEST_F(SystemDiagnosticsNode, ATreeThatStopsIsStale) {
  sendSteadyTree();
  setClock(kStart_s + 14.0);
  ASSERT_TRUE(waitFor([this] { return message("tf map -> odom").find("3.00 s old") != std::string::npos; }))
      << message("tf map -> odom");
  EXPECT_EQ(level("tf map -> odom"), DiagnosticStatus::ERROR);
  EXPECT_EQ(level("tf base_link -> camera_color_optical_frame"), DiagnosticStatus::OK);  // has no age
}

TEST_F(SystemDiagnosticsNode, ALocalisationThatJumpsIsToldWithTheWidthOfTheJump) {
  sendSteadyTree(kStart_s + 6.0);
  ASSERT_TRUE(waitFor([this] { return value("tf map -> odom", "jumps") == 1.0; })) << message("tf map -> odom");
  EXPECT_EQ(level("tf map -> odom"), DiagnosticStatus::WARN);
  EXPECT_NEAR(value("tf map -> odom", "largest jump [m]"), 0.4, 1e-6);
  EXPECT_EQ(value("tf odom -> base_link", "jumps"), 0.0);
}

TEST_F(SystemDiagnosticsNode, AFrameWithTwoParentsIsAnError) {
  sendSteadyTree();
  send({transform("world", "base_link", kStart_s + 11.0)});
  ASSERT_TRUE(waitFor([this] { return level("tf tree") == DiagnosticStatus::ERROR; }));
  EXPECT_THAT(message("tf tree"), HasSubstr("frame base_link"));
  EXPECT_THAT(message("tf tree"), HasSubstr("world"));
  EXPECT_THAT(message("tf tree"), HasSubstr(ros::this_node::getName()));
}

TEST_F(SystemDiagnosticsNode, AnImageBeforeItsStampShowsTheClockAhead) {
  setClock(kStart_s + 1.0);
  images_.publish(image(kStart_s + 0.96, 0.0));
  ASSERT_TRUE(waitFor([this] { return value("camera arrival", "images") == 1.0; })) << message("camera arrival");
  EXPECT_EQ(level("camera arrival"), DiagnosticStatus::OK);
  EXPECT_NEAR(value("camera arrival", "median delay [s]"), 0.04, 1e-6);
  images_.publish(image(kStart_s + 1.03, 0.0));
  ASSERT_TRUE(waitFor([this] { return value("camera arrival", "images") == 2.0; }));
  EXPECT_EQ(level("camera arrival"), DiagnosticStatus::WARN);
  EXPECT_NEAR(value("camera arrival", "least delay [s]"), -0.03, 1e-6);
}

TEST_F(SystemDiagnosticsNode, TheOffsetOfTheStampsIsFoundWhileTheBaseTurns) {
  constexpr double kOffset_s = 0.08, kPxPerRad = 100.0, kDuration_s = 24.0;
  setClock(kStart_s + kDuration_s);  // so that the next test sees it go back
  for (int i = 0; i <= kDuration_s * 20.0; ++i) {
    nav_msgs::Odometry odometry;
    const double time_s = kStart_s + i / 20.0;
    odometry.header.stamp.fromSec(time_s);
    odometry.pose.pose.orientation.z = std::sin(0.5 * yawAt(time_s));
    odometry.pose.pose.orientation.w = std::cos(0.5 * yawAt(time_s));
    odometry_.publish(odometry);
  }
  // From 0.5 s on, so that each pair has odometry 0.2 s before and behind; in portions that the node's queue takes.
  int sent = 0;
  for (int i = 5; i < kDuration_s * 10.0 - 5; ++i) {
    const double taken_s = kStart_s + i / 10.0;
    images_.publish(image(taken_s + kOffset_s, kPxPerRad * yawAt(taken_s)));
    if (++sent % 20 == 0) {
      ASSERT_TRUE(waitFor([this, sent] { return value("camera time offset", "pairs of images") == sent - 1.0; }))
          << value("camera time offset", "pairs of images") << " of " << sent - 1;
    }
  }
  ASSERT_TRUE(waitFor([this, sent] { return value("camera time offset", "pairs of images") == sent - 1.0; }));
  // Four of its own standard deviations, and those are known: a tenth of a pixel of OpenCV's centroid in each of 219 pairs,
  // against 3.5 px/s (root mean square) by which a wrong offset would change them: 2 ms.
  const double std_s = value("camera time offset", "standard deviation [s]");
  EXPECT_LT(std_s, 0.005);
  EXPECT_NEAR(value("camera time offset", "offset [s]"), kOffset_s, 4.0 * std_s);
  EXPECT_EQ(level("camera time offset"), DiagnosticStatus::ERROR);  // above 50 ms
  EXPECT_THAT(message("camera time offset"), HasSubstr("late"));
}

TEST_F(SystemDiagnosticsNode, AnImageThatIsNoPictureIsToldAndLeftOut) {
  sensor_msgs::Image bad = image(kStart_s, 0.0);
  bad.encoding = "32FC7";
  images_.publish(bad);
  ASSERT_TRUE(waitFor([this] { return level("camera time offset") == DiagnosticStatus::WARN; }));
  EXPECT_THAT(message("camera time offset"), HasSubstr("left out"));
  images_.publish(image(kStart_s + 0.1, 0.0));
  EXPECT_TRUE(waitFor([this] { return level("camera time offset") == DiagnosticStatus::OK; }));
}

}  // namespace
