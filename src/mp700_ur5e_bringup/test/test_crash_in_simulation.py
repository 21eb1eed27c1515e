#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Each of our nodes killed once in the running simulation: it comes back, and the whole is usable again.

Usable is one thing, whichever node it was: drive a little, new images in the map, bricks detected, a way for the arm
planned in that map and gone, a view chosen. The clock waits wait_timeout_wall_s for a dead node's answers, then goes
on.
"""

import os
import signal
import threading
import time
import unittest
from xmlrpc.client import ServerProxy

import rosgraph
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from interactive_mapping_msgs.msg import (ArmBridgeState, ArmGoal, BrickArray, LetGoBrickActionGoal,
                                          LetGoBrickActionResult, LetGoBrickGoal, MapUpdate, MoveArmActionGoal,
                                          MoveArmActionResult, MoveArmGoal, PickBrickActionGoal, PickBrickActionResult,
                                          PickBrickGoal, PlanArmActionGoal, PlanArmActionResult, PlanArmGoal,
                                          PlanOutcome, PlanPickActionGoal, PlanPickActionResult, PlanPickGoal,
                                          SelectNextBestViewActionGoal, SelectNextBestViewActionResult,
                                          SelectNextBestViewGoal, SelectionOutcome)
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult, MoveBaseGoal
from rosgraph_msgs.msg import Clock
from simulated_world.msg import JudgeState
from std_msgs.msg import Header, Int32

NODES = ("/depth_self_filter", "/gpis_mapping", "/brick_detection", "/motion_planning", "/ur_driver_bridge",
         "/base_navigation", "/nbv_selection", "/system_diagnostics")
HEARTBEAT_S = 0.05
# Wall time, with all nodes on a busy machine: how long until everything is there, one answer, and a node is back.
START_S, ANSWER_S, BACK_S = 180.0, 300.0, 60.0
FRONT_M, PILE_M = 0.296, -0.22  # base_profile.yaml; front of two_rows' lower row


class Action:
    """A client without actionlib: goal by topic, result by its id."""

    def __init__(self, name, goal_type, result_type):
        self.name, self.goal_type = name, goal_type
        self.results = {}
        self.publisher = rospy.Publisher(f"{name}/goal", goal_type, queue_size=2)
        self.subscriber = rospy.Subscriber(f"{name}/result", result_type, self.on_result, queue_size=10)

    def on_result(self, message):
        self.results[message.status.goal_id.id] = message

    def is_connected(self):
        return self.publisher.get_num_connections() > 0 and self.subscriber.get_num_connections() > 0

    def send(self, goal, number=[0]):
        number[0] += 1
        message = self.goal_type(goal=goal)
        message.header.stamp = message.goal_id.stamp = rospy.Time.now()
        message.goal_id.id = f"{self.name}-{number[0]}"
        self.publisher.publish(message)
        return message.goal_id.id


class CrashInSimulation(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("test_crash_in_simulation")
        cls.latest = {}
        cls.next_beat = rospy.Time()
        cls.heartbeat = rospy.Publisher("/pick_mission/heartbeat", Header, queue_size=10, tcp_nodelay=True)
        cls.keep = [rospy.Subscriber(topic, kind, lambda message, topic=topic: cls.latest.__setitem__(topic, message),
                                     queue_size=5)
                    for topic, kind in (("/gpis_mapping/update", MapUpdate), ("/brick_detection/bricks", BrickArray),
                                        ("/ur_driver_bridge/state", ArmBridgeState),
                                        ("/simulated_world/judge", JudgeState))]
        cls.keep.append(rospy.Subscriber("/clock", Clock, cls.on_clock, queue_size=100, tcp_nodelay=True))
        cls.drive = Action("/move_base", MoveBaseActionGoal, MoveBaseActionResult)
        cls.plan = Action("/motion_planning/plan_arm", PlanArmActionGoal, PlanArmActionResult)
        cls.move = Action("/ur_driver_bridge/move", MoveArmActionGoal, MoveArmActionResult)
        cls.select = Action("/nbv_selection/select", SelectNextBestViewActionGoal, SelectNextBestViewActionResult)
        cls.plan_pick = Action("/motion_planning/plan_pick", PlanPickActionGoal, PlanPickActionResult)
        cls.pick = Action("/ur_driver_bridge/pick", PickBrickActionGoal, PickBrickActionResult)
        cls.let_go = Action("/ur_driver_bridge/let_go", LetGoBrickActionGoal, LetGoBrickActionResult)
        cls.target = rospy.Publisher("/simulated_world/target", Int32, queue_size=1, latch=True)
        cls.posture = "stowed"
        cls.distance_m = 0.6

    @classmethod
    def on_clock(cls, message):
        """A heartbeat by the clock's own messages: in lock step the clock may run ahead of a timer's thread."""
        if message.clock >= cls.next_beat:
            cls.heartbeat.publish(Header(stamp=message.clock))
            cls.next_beat = message.clock + rospy.Duration(HEARTBEAT_S)

    def until(self, condition, wall_s, what):
        end = time.monotonic() + wall_s
        woken = threading.Event()
        while not condition():
            self.assertLess(time.monotonic(), end, f"{what}: not in {wall_s} s; the bridge says "
                            f"'{getattr(self.latest.get('/ur_driver_bridge/state'), 'reason', None)}'")
            woken.wait(0.02)

    def answer(self, action, goal):
        self.until(action.is_connected, BACK_S, f"connection to {action.name}")
        goal_id = action.send(goal)
        self.until(lambda: goal_id in action.results, ANSWER_S, f"result of {action.name}")
        return action.results[goal_id]

    def drive_to(self, distance_m):
        goal = MoveBaseGoal()
        goal.target_pose.header.frame_id = "map"
        goal.target_pose.pose.position.x = PILE_M - FRONT_M - distance_m
        goal.target_pose.pose.orientation.w = 1.0
        result = self.answer(self.drive, goal)
        self.assertEqual(result.status.status, GoalStatus.SUCCEEDED, result.status.text)

    def images_in_map(self, stamp):
        """One accepted image later than the stamp, and bricks of one."""
        def is_there():
            update, bricks = self.latest.get("/gpis_mapping/update"), self.latest.get("/brick_detection/bricks")
            return (update is not None and update.status == MapUpdate.ACCEPTED and update.header.stamp > stamp
                    and bricks is not None and bricks.header.stamp > stamp and bool(bricks.bricks))
        self.until(is_there, ANSWER_S, "an image in the map and bricks seen")

    def approach(self):
        """Once: the tests go on where the one before has ended."""
        if "start" in self.latest:
            return
        self.until(lambda: "/brick_detection/bricks" in self.latest
                   and getattr(self.latest.get("/ur_driver_bridge/state"), "may_move", False), START_S, "the start")
        self.latest["start"] = rospy.Time.now()
        for distance_m in (1.0, 0.6):
            self.drive_to(distance_m)
            self.images_in_map(rospy.Time.now())

    def use_everything(self):
        stamp = rospy.Time.now()
        type(self).distance_m = 0.5 if self.distance_m > 0.55 else 0.6
        self.drive_to(self.distance_m)
        stood = rospy.Time.now()
        self.images_in_map(stood)
        type(self).posture = "inspect" if self.posture == "stowed" else "stowed"
        goal = PlanArmGoal(min_map_stamp=self.latest["/gpis_mapping/update"].header.stamp)
        if self.posture == "inspect":
            goal.inspect = 1
        else:
            goal.goals = [ArmGoal(kind=ArmGoal.POSTURE, posture="stowed")]
        plan = self.answer(self.plan, goal).result
        self.assertEqual(plan.outcome.status, PlanOutcome.SUCCESS, plan.outcome.message)
        moved = self.answer(self.move, MoveArmGoal(trajectory=plan.trajectory))
        self.assertEqual(moved.status.status, GoalStatus.SUCCEEDED, moved.status.text)
        selection = self.answer(self.select, SelectNextBestViewGoal()).result.selection
        self.assertIn(selection.outcome.status, (SelectionOutcome.SUCCESS, SelectionOutcome.LOW_UTILITY),
                      selection.outcome.message)
        rospy.loginfo("usable: %.1f s of ROS time, %d points, %d segments, best %d",
                      (rospy.Time.now() - stamp).to_sec(), self.latest["/gpis_mapping/update"].map_points,
                      len(selection.segments), selection.best)

    @staticmethod
    def pid_of(node):
        try:
            with ServerProxy(rosgraph.Master(rospy.get_name()).lookupNode(node)) as proxy:
                return proxy.getPid(rospy.get_name())[2]
        except (OSError, rosgraph.MasterException):
            return None

    def kill(self, node):
        """Returns when it is back: known to the master under another process."""
        pid, wall = self.pid_of(node), time.monotonic()
        self.assertIsNotNone(pid)
        rospy.logwarn("killing %s, process %d", node, pid)
        os.kill(pid, signal.SIGKILL)
        self.until(lambda: self.pid_of(node) not in (pid, None), BACK_S, f"{node} back")
        rospy.logwarn("%s is back after %.1f s", node, time.monotonic() - wall)

    def take_brick(self):
        """The first that can be planned, highest first; it hangs in the air then."""
        self.drive_to(0.12)
        self.images_in_map(rospy.Time.now())
        bricks = self.latest["/brick_detection/bricks"]
        why_not = []
        for brick in sorted(bricks.bricks, key=lambda brick: -brick.pose.pose.position.z):
            goal = PlanPickGoal(brick_id=brick.id, type=brick.type, faces=[face.face for face in brick.graspable_faces])
            goal.brick.header.frame_id = bricks.header.frame_id
            goal.brick.pose = brick.pose.pose
            plan = self.answer(self.plan_pick, goal).result
            if plan.outcome.status == PlanOutcome.SUCCESS:
                break
            why_not.append(plan.outcome.message)
        else:
            self.fail("\n".join(why_not))
        self.target.publish(brick.id)
        goal = PickBrickGoal(brick_id=brick.id, type=brick.type, brick=goal.brick, contact=plan.contact, held=plan.held,
                             approach=plan.approach, touch=plan.touch, lift=plan.lift)
        picked = self.answer(self.pick, goal)
        self.assertEqual(picked.status.status, GoalStatus.SUCCEEDED, picked.status.text)

    def test_each_node_comes_back_and_the_whole_is_usable(self):
        self.approach()
        self.use_everything()
        points = self.latest["/gpis_mapping/update"].map_points
        for node in NODES:
            with self.subTest(node):
                killed, wall = rospy.Time.now(), time.monotonic()
                self.kill(node)
                self.use_everything()
                rospy.logwarn("%s: usable %.1f s of wall time, %.1f s of ROS time after the kill", node,
                              time.monotonic() - wall, (rospy.Time.now() - killed).to_sec())
        self.assertGreater(self.latest["/gpis_mapping/update"].map_points, 0.8 * points)

    def test_what_is_in_the_hand_outlives_a_crash(self):
        """Planner and self filter hear of it again, though the bridge itself was started anew: otherwise the brick
        would be planned through, and get into the map."""
        self.approach()
        self.take_brick()
        for node in ("/motion_planning", "/depth_self_filter", "/ur_driver_bridge"):
            self.kill(node)
        killed = rospy.Time.now()
        self.until(lambda: self.latest["/ur_driver_bridge/state"].header.stamp > killed
                   and self.latest["/ur_driver_bridge/state"].may_move, ANSWER_S, "the arm may move")
        state = self.latest["/ur_driver_bridge/state"]
        self.assertTrue(state.is_magnet_on)
        self.images_in_map(rospy.Time.now())
        plan = self.answer(self.plan, PlanArmGoal(goals=[ArmGoal(kind=ArmGoal.PLACE, place_frame="container_place_1")])).result
        self.assertEqual(plan.outcome.status, PlanOutcome.SUCCESS, plan.outcome.message)
        moved = self.answer(self.move, MoveArmGoal(trajectory=plan.trajectory))
        self.assertEqual(moved.status.status, GoalStatus.SUCCEEDED, moved.status.text)
        let_go = self.answer(self.let_go, LetGoBrickGoal())
        self.assertEqual(let_go.status.status, GoalStatus.SUCCEEDED, let_go.status.text)
        self.until(lambda: self.latest["/simulated_world/judge"].stowed == 1, ANSWER_S, "the brick in the container")
        self.use_everything()

        judge = self.latest["/simulated_world/judge"]
        self.assertEqual((judge.collisions, judge.falls, judge.drops), (0, 0, 0))


if __name__ == "__main__":
    rostest.rosrun("mp700_ur5e_bringup", "test_crash_in_simulation", CrashInSimulation)
