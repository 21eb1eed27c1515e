#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""A mission in the simulated world is recorded for some seconds; its bag is mapped again and replayed."""

import glob
import json
import os
import re
import signal
import subprocess
import tempfile
import threading
import time
import unittest

import rosbag
import roslaunch.config
import rospkg
import rospy
import rostest
import yaml
from geometry_msgs.msg import Twist
from interactive_mapping_msgs.msg import MapUpdate, MissionState
from rosgraph_msgs.msg import Clock
from roslaunch.xmlloader import XmlLoader
from std_srvs.srv import SetBool
from visualization_msgs.msg import Marker

IMAGES = 4  # of 1 Hz: the map's marker, one in 4 s, comes at least once
DEADLINE_S = 240.0  # wall time, of what takes 20 s on two idle cores
# What a few seconds always hold. Plans and views come later in a mission.
ALWAYS = {"/depth_self_filter/image_rect", "/depth_self_filter/camera_info", "/lidar_1/scan", "/odom", "/cmd_vel",
          "/joint_states", "/tf", "/tf_static", "/diagnostics", "/recorded_parameters", "/attached_brick",
          "/pick_mission/state", "/pick_mission/heartbeat", "/pick_mission/markers", "/gpis_mapping/update",
          "/gpis_mapping/ground", "/record_mission/mesh_marker", "/brick_detection/bricks", "/brick_detection/markers",
          "/base_navigation/grid", "/base_navigation/markers", "/ur_driver_bridge/state", "/ur_driver_bridge/markers"}


def recorded_topics(*args):
    """What record.launch asks rosbag for."""
    package = rospkg.RosPack().get_path("pick_mission")
    config = roslaunch.config.ROSLaunchConfig()
    XmlLoader().load(f"{package}/launch/record.launch", config, argv=list(args), verbose=False)
    node = next(node for node in config.nodes if node.name == "record_mission")
    return {word for word in node.args.split() if word.startswith("/")}


class Seen:
    """The messages of a topic so far."""

    def __init__(self, topic, kind, is_wanted=lambda message: True):
        self.topic, self.is_wanted, self.count, self.last = topic, is_wanted, 0, None
        self.changed = threading.Condition()
        self.subscriber = rospy.Subscriber(topic, kind, self.on_message, queue_size=50)

    def on_message(self, message):
        with self.changed:
            if self.is_wanted(message):
                self.count, self.last = self.count + 1, message
                self.changed.notify_all()

    def wait(self, count, processes):
        self.wait_until(lambda: self.count >= count, f"{count} messages", 1.0, processes)

    def wait_connected(self, processes):
        self.wait_until(lambda: self.subscriber.get_num_connections() > 0, "a connection", 0.05, processes)

    def wait_until(self, is_reached, aim, poll_s, processes):
        """Raises AssertionError at the deadline, or when a process has ended before."""
        end = time.monotonic() + DEADLINE_S
        with self.changed:
            while not self.changed.wait_for(is_reached, timeout=poll_s):
                dead = [process.args for process in processes if process.poll() is not None]
                assert not dead, f"{self.topic}: ended before {aim}: {dead}"
                assert time.monotonic() < end, f"{self.topic}: {aim} missing after {self.count} messages"


def start(*args):
    return subprocess.Popen(["roslaunch", "mp700_ur5e_bringup", *args], start_new_session=True,
                            stdin=subprocess.DEVNULL)


def stop(process):
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(60.0)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise


class Replay(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        rospy.init_node("test_replay", disable_rostime=True)  # clocks come and go
        run = f"{cls.folder.name}/run"
        images = Seen("/gpis_mapping/update", MapUpdate, lambda update: update.status == MapUpdate.ACCEPTED)
        marker = Seen("/record_mission/mesh_marker", Marker, lambda mesh: len(mesh.points) > 0)
        state = Seen("/pick_mission/state", MissionState)
        command = Seen("/cmd_vel", Twist)
        mission = start("simulation.launch", "scene:=single_brick", "clock:=lockstep", "ideal:=true", "autostart:=true",
                        f"run_folder:={run}", "record:=true", "required:=true")
        try:
            for seen, count in ((images, IMAGES), (marker, 1), (state, 1), (command, 1)):
                seen.wait(count, [mission])
        finally:
            stop(mission)
        cls.robot = rospy.get_param("/robot_description")
        for name in ("/robot_description", "/gpis_mapping"):  # left on the test's master
            rospy.delete_param(name)
        bags = glob.glob(f"{run}/mission_*.bag")
        assert len(bags) == 1, os.listdir(run)
        cls.bag = bags[0]
        with rosbag.Bag(cls.bag) as bag:
            cls.counts = {topic: info.message_count for topic, info in bag.get_type_and_topic_info().topics.items()}

    def test_all_that_replay_needs_is_recorded(self):
        self.assertEqual(ALWAYS - set(self.counts), set())
        self.assertLess(set(self.counts), recorded_topics(), "only what was asked for")
        package = rospkg.RosPack().get_path("mp700_ur5e_bringup")
        with open(f"{package}/rviz/bringup.rviz", encoding="utf-8") as file:
            displays = yaml.safe_load(file)["Visualization Manager"]["Displays"]
        shown = {value for display in displays if display["Enabled"] for key, value in display.items()
                 if re.search("Topic$", key)}
        shown.remove("/gpis_mapping/mesh_marker")
        shown.add("/record_mission/mesh_marker")  # thinned out
        self.assertGreater(len(shown), 8)
        self.assertEqual(shown - recorded_topics("record_images:=true"), set())

    def test_parameters(self):
        read = ["rosrun", "pick_mission", "recorded_parameters", self.bag]
        done = subprocess.run([*read, "robot_description"], stdout=subprocess.PIPE, check=True, text=True)
        self.assertEqual(done.stdout, self.robot)
        done = subprocess.run([*read, "gpis_mapping/map"], stdout=subprocess.PIPE, check=True, text=True)
        self.assertEqual(yaml.safe_load(done.stdout)["sensor"]["noise_preset"], "realsense_d435")
        for wrong, told in (([read[0], read[1], read[2], "/no.bag", "x"], "/no.bag: no such file"),
                            ([read[0], read[1], read[2], __file__, "x"], "is no bag that can be read"),
                            ([*read, "robot/missing"], "without a parameter robot/missing"),
                            (read, "the name of a parameter is missing")):
            done = subprocess.run(wrong, stderr=subprocess.PIPE, text=True)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn(told, done.stderr)

    def test_the_bag_is_mapped_without_options(self):
        out = f"{self.folder.name}/map"
        done = subprocess.run(["rosrun", "gpis_mapping", "map_sequence", self.bag, "--out", out],
                              stdout=subprocess.PIPE, check=True, text=True)
        summary = json.loads(done.stdout.splitlines()[-1])
        self.assertEqual(summary["frames"], self.counts["/depth_self_filter/image_rect"])
        self.assertGreaterEqual(summary["frames"], IMAGES)
        self.assertEqual(summary["skipped"], 0)
        self.assertGreater(summary["mesh_triangles"], 1000)  # 4 images of ground and a brick gave 10^5

    def test_replay_shows_it(self):
        clock = Seen("/clock", Clock)
        played = {topic: Seen(topic.replace("/record_mission/", "/gpis_mapping/"), rospy.AnyMsg)
                  for topic in self.counts}
        replay = start("replay.launch", f"bag:={self.bag}", "rviz:=false", "rate:=2", "bag_args:=--pause")
        try:
            clock.wait(1, [replay])
            self.assertEqual(rospy.get_param("/robot_description"), self.robot)
            self.assertTrue(rospy.get_param("/use_sim_time"))
            # A few seconds played at once would be over before all topics are connected.
            for topic in ALWAYS:
                played[topic].wait_connected([replay])
            rospy.ServiceProxy("/play_mission/pause_playback", SetBool)(False)
            for topic in sorted(ALWAYS):
                played[topic].wait(1, [replay])
        finally:
            stop(replay)

    def test_replay_refuses_what_is_no_recording(self):
        done = subprocess.run(["roslaunch", "mp700_ur5e_bringup", "replay.launch", "bag:=/no.bag", "rviz:=false"],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("/no.bag: no such file", done.stdout)


if __name__ == "__main__":
    rostest.rosrun("mp700_ur5e_bringup", "test_replay", Replay)
