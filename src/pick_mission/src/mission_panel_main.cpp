// SPDX-License-Identifier: BSD-3-Clause
// The mission's panel in a window of its own, for a computer without rviz.
#include <memory>
#include <string>

#include <QApplication>
#include <QTimer>
#include <ros/ros.h>

#include "rviz/mission_widget.h"

namespace {

constexpr int kLook_ms = 100;

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "mission_panel", ros::init_options::AnonymousName);
  QApplication application(argc, argv);
  QApplication::setApplicationDisplayName("Mission");
  // Subscribing waits for the master: until then there is a line in the terminal, and no window that does not answer.
  if (!ros::master::check()) ROS_WARN("mission_panel: waiting for the master at %s", ros::master::getURI().c_str());

  std::unique_ptr<pick_mission_rviz::MissionWidget> widget;
  QTimer timer;
  QObject::connect(&timer, &QTimer::timeout, [&] {
    if (!ros::ok()) {
      QApplication::quit();
    } else if (!widget && ros::master::check()) {
      widget = std::make_unique<pick_mission_rviz::MissionWidget>();
      std::string node;
      if (ros::param::get("~node", node)) widget->setNode(QString::fromStdString(node));
      widget->resize(380, 860);
      widget->show();
    }
  });
  timer.start(kLook_ms);
  QApplication::setQuitOnLastWindowClosed(true);
  return QApplication::exec();
}
