#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
import pathlib
import subprocess
import tempfile
import threading
import unittest

import rospy
import rostest
from interactive_mapping_msgs.msg import MissionState
from simulated_world.msg import JudgeState

PACKAGE = pathlib.Path(__file__).resolve().parents[1]
NUM_BRICKS = 4  # of four_bricks.yaml
WALL_LIMIT_S = 1400.0


class HuskyMissionTest(unittest.TestCase):
    def test_shipped_urdf_is_what_adapt_urdf_makes(self):
        with tempfile.TemporaryDirectory() as folder:
            made = pathlib.Path(folder) / "adapted.urdf"
            subprocess.run(["rosrun", "mp700_ur5e_description", "adapt_urdf", PACKAGE / "urdf" / "husky_ur5e.urdf", made,
                            "--names", PACKAGE / "config" / "names.yaml"], check=True)
            self.assertEqual(made.read_text(), (PACKAGE / "config" / "adapted.urdf").read_text())

    def test_stows_four_bricks(self):
        changed = threading.Condition()
        newest = {}

        def keep(message):
            with changed:
                newest[type(message)] = message
                changed.notify_all()
        subscribers = [rospy.Subscriber("/pick_mission/state", MissionState, keep),
                       rospy.Subscriber("/simulated_world/judge", JudgeState, keep)]

        def is_over():
            return MissionState in newest and newest[MissionState].state == MissionState.ENDED and JudgeState in newest
        with changed:
            self.assertTrue(changed.wait_for(is_over, WALL_LIMIT_S), newest)
            mission = newest[MissionState]
            # The judge reports every half simulated second.
            changed.wait_for(lambda: newest[JudgeState].stowed >= mission.bricks_picked, 60.0)
            judge = newest[JudgeState]
        for subscriber in subscribers:
            subscriber.unregister()
        self.assertEqual(mission.end_reason, MissionState.NO_BRICK_LEFT, mission.end_message)
        self.assertEqual(judge.stowed, NUM_BRICKS)
        self.assertEqual(judge.collisions, 0)


if __name__ == "__main__":
    rospy.init_node("test_husky_mission")
    rostest.rosrun("husky_ur5e", "test_husky_mission", HuskyMissionTest)
