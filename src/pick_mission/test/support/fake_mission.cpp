// SPDX-License-Identifier: BSD-3-Clause
// A mission that stands still in a pick, with state, markers and services: to look at panel and markers without a robot.
//   rosrun pick_mission fake_mission BRICKS_YAML
#include <array>
#include <cmath>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include <interactive_mapping_msgs/MissionBrick.h>
#include <interactive_mapping_msgs/MissionFailure.h>
#include <interactive_mapping_msgs/MissionState.h>
#include <interactive_mapping_msgs/NbvSegment.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include "pick_mission_ros/mission_markers.h"

namespace {

using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionFailure;
using interactive_mapping_msgs::MissionState;
using interactive_mapping_msgs::NbvSegment;

constexpr double kNow_s = 1385.0;  // of the mission's clock: it stands, so that two pictures are alike
constexpr double kGap_m = 0.03;    // between bricks
constexpr double kYaw_rad = -0.25;
constexpr std::array<std::uint8_t, 12> kStatus = {MissionBrick::OPEN,    MissionBrick::OPEN,   MissionBrick::EXHAUSTED,
                                                  MissionBrick::OPEN,    MissionBrick::OPEN,   MissionBrick::OPEN,
                                                  MissionBrick::CURRENT, MissionBrick::OPEN,   MissionBrick::PICKED,
                                                  MissionBrick::AWAY,    MissionBrick::PICKED, MissionBrick::PICKED};

/// Two rows of three, and the same on top of them.
MissionBrick makeBrick(int id, const mp700_ur5e_description::BrickType& type) {
  MissionBrick brick;
  brick.id = id;
  brick.type = type.name;
  brick.status = kStatus[static_cast<std::size_t>(id)];
  const int column = id % 3;
  const int row = id / 3 % 2;
  const int layer = id / 6;
  brick.pose.position.x = (row - 0.5) * (type.size_m.x() + kGap_m);
  brick.pose.position.y = (column - 1.0) * (type.size_m.y() + kGap_m);
  brick.pose.position.z = (layer + 0.5) * type.size_m.z();
  brick.pose.orientation.w = 1.0;
  if (brick.status == MissionBrick::EXHAUSTED) {
    brick.picks_begun = brick.picks_failed = 3;
    brick.last_failure = "NO_CONTACT";
  }
  return brick;
}

MissionFailure makeFailure(double ago_s, std::uint8_t state, const std::string& event, const std::string& reason) {
  MissionFailure failure;
  failure.stamp = ros::Time(kNow_s - ago_s);
  failure.state = state;
  failure.event = event;
  failure.reason = reason;
  return failure;
}

MissionState makeState(const mp700_ur5e_description::BrickType& type) {
  MissionState state;
  state.header.frame_id = "map";
  state.header.stamp = ros::Time(kNow_s);
  state.state = MissionState::PICK;
  state.since = ros::Time(kNow_s - 12.0);
  state.brick = 6;
  state.decision = "brick 6: the highest that is there, graspable and in the arm's sector";
  state.hand = MissionState::EMPTY;
  state.scene = "brick_pile";
  state.strategy = "gpis";
  state.used_s = 385.0;
  state.limit_s = 3600.0;
  state.bricks_total = kStatus.size();
  for (std::size_t id = 0; id < kStatus.size(); ++id) {
    state.bricks.push_back(makeBrick(static_cast<int>(id), type));
    state.bricks_picked += kStatus[id] == MissionBrick::PICKED;
    state.bricks_open += kStatus[id] == MissionBrick::OPEN || kStatus[id] == MissionBrick::CURRENT;
    state.bricks_exhausted += kStatus[id] == MissionBrick::EXHAUSTED;
  }
  state.picks_begun = 7;
  state.views = 4;
  state.failures = 5;
  state.last_failures = {
      makeFailure(45.0, MissionState::PLAN_PICK, "goal in unknown space",
                  "unseen space at the brick: another view may show it"),
      makeFailure(95.0, MissionState::PICK, "NO_CONTACT", "the brick is not at its expected pose: look again"),
      makeFailure(182.0, MissionState::DRIVE, "obstacle", "an obstacle on the path stays")};

  NbvSegment view;
  view.kind = NbvSegment::FRONTIER;
  view.manipulability_factor = 0.82;
  view.pick_order_factor = 0.64;
  view.travel_factor = 0.91;
  view.uncertainty_factor = 0.37;
  view.frontier_factor = 0.12;
  view.failure_penalty = 0.2;
  view.utility = 0.49;
  view.standing.position.x = -1.15;
  view.standing.position.y = 0.3;
  view.standing.orientation.z = std::sin(0.5 * kYaw_rad);
  view.standing.orientation.w = std::cos(0.5 * kYaw_rad);
  state.view = {view};
  return state;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "pick_mission");
  if (argc != 2) {
    std::fprintf(stderr, "usage: fake_mission BRICKS_YAML\n");
    return 2;
  }
  try {
    const auto catalogue = mp700_ur5e_description::loadBrickTypes(argv[1]);
    const MissionState state = makeState(catalogue.types.front());
    ros::NodeHandle nh("~");
    std::vector<ros::ServiceServer> services;
    for (const std::string name : {"start", "pause", "resume", "hold", "stop"}) {
      services.push_back(nh.advertiseService<std_srvs::Trigger::Request, std_srvs::Trigger::Response>(
          name, [name](auto& /*request*/, auto& response) {
            response.success = true;
            response.message = "nothing is done, this is a fake";
            return true;
          }));
    }
    ros::Publisher markers = nh.advertise<visualization_msgs::MarkerArray>("markers", 1, true);
    markers.publish(pick_mission_ros::toMarkers(state, catalogue));
    ros::Publisher states = nh.advertise<MissionState>("state", 1, true);
    const ros::WallTimer timer =
        nh.createWallTimer(ros::WallDuration(1.0), [&](const ros::WallTimerEvent&) { states.publish(state); });
    states.publish(state);
    ros::spin();
  } catch (const std::exception& error) {
    ROS_FATAL("fake_mission: %s", error.what());
    return 1;
  }
  return 0;
}
