#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""dynamic_reconfigure's own client and its tool dynparam against a node whose live parameters come from the schema."""
import math
import os
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import rosnode
import rospy
import rostest
import yaml
from dynamic_reconfigure import DynamicReconfigureParameterException
from dynamic_reconfigure.client import Client
from dynamic_reconfigure.encoding import encode_config
from dynamic_reconfigure.srv import Reconfigure
from rosgraph_msgs.msg import Log

NODE = "/example/tune"
DEADLINE_S = 30.0  # ample: what passes takes milliseconds


class LiveParams(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("test_live_params")
        cls.changed = threading.Condition()
        cls.updates, cls.errors = [], []
        rospy.Subscriber("/rosout", Log, cls.on_log)
        cls.client = Client(NODE, timeout=DEADLINE_S, config_callback=cls.on_update)
        cls.start = cls.client.get_configuration(timeout=DEADLINE_S)
        cls.wait(lambda: rospy.Subscriber("/rosout", Log, lambda _: None).get_num_connections() > 1)

    @classmethod
    def on_log(cls, message):
        if message.name == "/example" and message.level >= Log.ERROR:
            with cls.changed:
                cls.errors.append(message.msg)
                cls.changed.notify_all()

    @classmethod
    def on_update(cls, config):
        with cls.changed:
            cls.updates.append(config)
            cls.changed.notify_all()

    @classmethod
    def wait(cls, condition):
        end = time.monotonic() + DEADLINE_S
        with cls.changed:
            while not condition():
                if time.monotonic() > end:
                    return False
                cls.changed.wait(0.1)
        return True

    def setUp(self):
        self.client.update_configuration({name: value for name, value in self.start.items() if name != "groups"})

    def in_use(self):
        return yaml.safe_load(rospy.get_param("/example/in_use"))

    def refused(self, change, reason):
        """What a change leaves; nothing is used, and the log says why."""
        before = rospy.get_param("/example/in_use")
        del self.errors[:]
        answer = change()
        self.assertTrue(self.wait(lambda: self.errors), "no error logged")
        self.assertIn("/example/tune: tuning refused, everything stays as it was", self.errors[0])
        self.assertIn(reason, self.errors[0])
        self.assertEqual(rospy.get_param("/example/in_use"), before)
        for name, value in self.start.items():
            if name not in ("groups", "written_by_the_node"):
                self.assertEqual(answer[name], value, name)

    def set(self, **changes):
        return lambda: self.client.update_configuration(changes)

    def test_description_lists_the_live_fields_with_the_ranges_of_the_schema(self):
        seen = {p["name"]: (p["type"], p["min"], p["max"], p["default"])
                for p in self.client.get_parameter_descriptions(timeout=DEADLINE_S)}
        self.assertEqual(seen, {
            "reach_m": ("double", 0.1, 2.0, 0.5),
            "count": ("int", 1, 10, 4),
            "is_awake": ("bool", False, True, True),
            "label": ("str", "", "", 'it\'s "quoted"'),
            "color": ("str", "", "", "green"),
            "written_by_the_node": ("int", 0, 1000000, 0),
            "band_low": ("double", 0.0, 1.0, 0.2),
            "band_high": ("double", 0.0, 1.0, 0.9),
            "left_p": ("double", 0.0, 1e9, 1.0),
            "right_p": ("double", 0.0, 1e9, 1.0)})
        texts = {p["name"]: p["description"] for p in self.client.get_parameter_descriptions()}
        self.assertEqual(texts["reach_m"], "of the arm [m]")
        self.assertEqual(texts["band_low"], "the lower one")

    def test_sections_are_groups_and_tied_fields_are_sent_together(self):
        root = self.client.get_group_descriptions(timeout=DEADLINE_S)
        self.assertEqual({name: group["type"] for name, group in root["groups"].items()},
                         {"band": "apply", "left": "", "right": ""})
        self.assertEqual([p["name"] for p in root["groups"]["band"]["parameters"]], ["band_low", "band_high"])
        self.assertIn("reach_m", [p["name"] for p in root["parameters"]])
        self.assertEqual(self.start["groups"]["groups"]["band"]["band_low"], 0.2)

    def test_choice_offers_its_words(self):
        color = next(p for p in self.client.get_parameter_descriptions() if p["name"] == "color")
        self.assertEqual([item["value"] for item in eval(color["edit_method"])["enum"]], ["red", "green"])

    def test_values_begin_as_the_parameters_say(self):
        self.assertEqual(self.start["count"], 4)
        self.assertEqual(self.start["band_low"], 0.2)

    def test_what_is_set_is_used_and_told(self):
        answer = self.client.update_configuration(
            {"reach_m": 1.25, "count": 6, "is_awake": False, "label": "5", "color": "red", "right_p": 1e-5})
        used = self.in_use()
        self.assertEqual((used["reach_m"], used["count"], used["is_awake"], used["label"], used["color"]),
                         (1.25, 6, False, "5", "red"))
        self.assertEqual((used["left"]["p"], used["right"]["p"]), (1.0, 1e-5))
        self.assertEqual(used["hidden"], 7)
        self.assertEqual((answer["reach_m"], answer["color"], answer["right_p"]), (1.25, "red", 1e-5))
        self.assertTrue(self.wait(lambda: self.updates[-1]["reach_m"] == 1.25))

    def test_both_ends_of_a_range_are_allowed_and_beyond_it_nothing(self):
        self.client.update_configuration({"reach_m": 2.0, "count": 1})
        self.assertEqual(self.in_use()["reach_m"], 2.0)
        self.setUp()
        self.refused(self.set(reach_m=2.5), "reach_m = 2.5 m, must be in [0.1, 2] m")
        self.refused(self.set(count=0), "count = 0, must be in [1, 10]")
        self.refused(self.set(reach_m=math.nan), "reach_m = nan m, must be in [0.1, 2] m")
        self.refused(self.set(reach_m=-math.inf), "reach_m = -inf m, must be in [0.1, 2] m")
        self.refused(self.set(color="blue"), "color = 'blue', must be one of red, green")

    def test_a_broken_rule_refuses_the_change_as_a_whole(self):
        self.refused(self.set(band_low=0.95, reach_m=1.0), "band/low must be below band/high")
        self.client.update_configuration({"band_low": 0.95, "band_high": 0.99})
        self.assertEqual(self.in_use()["band"], {"low": 0.95, "high": 0.99})

    def test_what_the_node_refuses_is_not_used(self):
        self.refused(self.set(count=5, reach_m=1.0), "count = 5 is what this node refuses")

    def test_what_is_not_live_is_refused(self):
        service = rospy.ServiceProxy(NODE + "/set_parameters", Reconfigure)

        def raw(**changes):
            config = service(encode_config(changes)).config
            return {item.name: item.value for item in config.bools + config.ints + config.strs + config.doubles}

        self.refused(lambda: raw(hidden=3, reach_m=1.0), "hidden is no live parameter")
        self.refused(lambda: raw(reach_m="far"), "reach_m = 'far', must be a number")
        self.refused(lambda: raw(count=2.5), "count = 2.5, must be a whole number")
        raw(reach_m=1)  # a whole number is a number
        self.assertEqual(self.in_use()["reach_m"], 1.0)
        with self.assertRaises(DynamicReconfigureParameterException):
            self.client.update_configuration({"hidden": 3})

    def test_what_the_node_changes_itself_is_told(self):
        before = self.client.update_configuration({"reach_m": 1.0})["written_by_the_node"]
        self.assertTrue(self.wait(lambda: self.updates[-1]["written_by_the_node"] > before))

    def test_dynparam_sets_gets_dumps_and_loads(self):
        def dynparam(*arguments):
            return subprocess.run(["rosrun", "dynamic_reconfigure", "dynparam", *arguments], check=True, timeout=60,
                                  stdout=subprocess.PIPE, universal_newlines=True).stdout

        self.assertIn(NODE, dynparam("list"))
        dynparam("set", NODE, "color", "red")
        dynparam("set", NODE, "{band_low: 0.3, band_high: 0.4}")
        self.assertEqual((self.in_use()["color"], self.in_use()["band"]), ("red", {"low": 0.3, "high": 0.4}))
        self.assertIn("'band_low': 0.3", dynparam("get", NODE))
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "tuned.yaml")
            dynparam("dump", NODE, file)
            self.setUp()
            self.assertEqual(self.in_use()["color"], "green")
            dynparam("load", NODE, file)
        self.assertEqual(self.in_use()["color"], "red")

    def test_node_is_stopped_while_ros_is_there_when_asked_to_shut_down(self):
        self.assertIsNotNone(Client("/ending/tune", timeout=DEADLINE_S))
        rosnode.kill_nodes(["/ending"])
        self.assertTrue(self.wait(lambda: "/ending" not in rosnode.get_node_names()))
        self.assertTrue(rospy.get_param("/ending/has_stopped", False))


if __name__ == "__main__":
    rostest.rosrun("interactive_mapping_common", "test_live_params", LiveParams, sys.argv)
