#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
import unittest

import actionlib
import rospy
import rostest
from geometry_msgs.msg import TransformStamped
from interactive_mapping_msgs.msg import MapUpdate, NbvSegment, SelectNextBestViewAction, SelectNextBestViewGoal
from nav_msgs.msg import OccupancyGrid
from tf2_msgs.msg import TFMessage

HALF_M = 5.0
CELL_M = 0.1


def free_ground():
    """As a map server publishes it: once, latched."""
    grid = OccupancyGrid()
    grid.header.stamp = rospy.Time.now()
    grid.header.frame_id = "map"
    grid.info.resolution = CELL_M
    grid.info.width = grid.info.height = round(2 * HALF_M / CELL_M)
    grid.info.origin.position.x = grid.info.origin.position.y = -HALF_M
    grid.info.origin.orientation.w = 1.0
    grid.data = [0] * (grid.info.width * grid.info.height)
    return grid


def robot_pose():
    """East of the pile, facing it."""
    transform = TransformStamped()
    transform.header.frame_id, transform.child_frame_id = "map", "base_link"
    transform.transform.translation.x, transform.transform.translation.y = 2.2, 0.4
    transform.transform.rotation.z = 1.0
    return TFMessage([transform])


def rank(segment):
    return (segment.manipulability <= 0.0, segment.distance)


class NearestTest(unittest.TestCase):
    def select(self, strategy):
        self.client.send_goal_and_wait(SelectNextBestViewGoal(strategy=strategy))
        result = self.client.get_result()
        self.assertGreaterEqual(result.selection.best, 0, result.outcome)
        return result.selection

    def test_chooses_the_nearest_pose_with_something_to_pick(self):
        ground = rospy.Publisher("/grid", OccupancyGrid, queue_size=1, latch=True)
        ground.publish(free_ground())
        tf = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        tf.publish(robot_pose())
        self.client = actionlib.SimpleActionClient("/nbv_selection/select", SelectNextBestViewAction)
        self.assertTrue(self.client.wait_for_server(rospy.Duration(60)))
        for _ in range(8):  # images: most of the pile's outline
            rospy.wait_for_message("/gpis_mapping/update", MapUpdate, 60)
        selection = self.select("nearest")
        self.assertEqual(selection.strategy, "nearest")
        candidates = [i for i, s in enumerate(selection.segments) if s.verdict == NbvSegment.CANDIDATE]
        self.assertGreater(len(candidates), 3)
        self.assertEqual(rank(selection.segments[selection.best]), min(rank(selection.segments[i]) for i in candidates))
        # The shipped strategy weighs more than the distance: were the choice its own, both would be the same.
        shipped = self.select("gpis")
        self.assertGreater(rank(shipped.segments[shipped.best]), rank(selection.segments[selection.best]))


if __name__ == "__main__":
    rospy.init_node("test_nearest")
    rostest.rosrun("nearest_strategy", "test_nearest", NearestTest)
