#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""mission_recorder.py beside a mission that this test acts."""

import io
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
import unittest
import unittest.mock
import xmlrpc.client

import numpy as np
import rospy
import rostest
from geometry_msgs.msg import Point
from interactive_mapping_msgs.msg import MissionFailure, MissionState, SurfaceMesh
from rospy import AnyMsg
from shape_msgs.msg import MeshTriangle

HERE = pathlib.Path(__file__).resolve().parent
SCRIPTS = HERE.parents[3] / "scripts"
sys.path.insert(0, str(HERE.parents[3] / "tools"))

from interactive_mapping_tools import mission_recorder, render_mesh  # noqa: E402

DEADLINE_S = 30.0  # wall time of every wait; a loaded machine is slow


def mesh_of(size, stamp_s=1000.5):
    """A tetrahedron whose size tells which it is."""
    message = SurfaceMesh()
    message.header.frame_id = "map"
    message.header.stamp = rospy.Time.from_sec(stamp_s)
    message.mesh.vertices = [Point(0, 0, 0), Point(size, 0, 0), Point(0, size, 0), Point(0, 0, size)]
    message.mesh.triangles = [MeshTriangle(vertex_indices=indices) for indices in ([0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3])]
    message.normals = [float(number) for number in range(12)]
    message.variance = [1e-6, 2e-6, 3e-6, 4e-6]
    return message


def serialised(message):
    stream = io.BytesIO()
    message.serialize(stream)
    return stream.getvalue()


class MissionRecorder(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="mission_recorder_"))
        self.addCleanup(shutil.rmtree, self.folder)
        self.states = rospy.Publisher("/pick_mission/state", MissionState, queue_size=10, latch=True)
        self.meshes = rospy.Publisher("/gpis_mapping/mesh", SurfaceMesh, queue_size=10)
        self.recorder = None
        self.time_s = 10.0

    def tearDown(self):
        self.states.unregister()
        self.meshes.unregister()
        if self.recorder is not None:
            self.recorder.kill()
            self.recorder.wait()

    def wait_until(self, holds, what):
        end = time.monotonic() + DEADLINE_S
        while not holds():
            self.assertLess(time.monotonic(), end, what)
            time.sleep(0.01)

    def start(self, *options):
        with open(self.folder / "stdout", "wb") as output, open(self.folder / "stderr", "wb") as errors:
            self.recorder = subprocess.Popen(["/usr/bin/python3", str(SCRIPTS / "mission_recorder.py"), str(self.folder), "--judge", "", *options],
                                             stdout=output, stderr=errors)

    def connect(self):
        self.wait_until(lambda: self.states.get_num_connections() > 0 and self.meshes.get_num_connections() > 0, "the recorder listens")

    def finish(self):
        code = self.recorder.wait(timeout=DEADLINE_S)
        self.assertNotIn("Traceback", (self.folder / "stderr").read_text())
        return code, self.output()

    def output(self):
        return (self.folder / "stdout").read_text()

    def say(self, state, **fields):
        self.states.publish(self.message(state, **fields))

    def message(self, state, picked=0, begun=0, brick=-1, **fields):
        self.time_s += 1.0
        message = MissionState(state=state, bricks_picked=picked, picks_begun=begun, bricks_total=3, brick=brick, **fields)
        message.header.stamp = rospy.Time.from_sec(self.time_s)
        message.since = message.header.stamp
        message.used_s = self.time_s - 10.0
        return message

    def maps(self):
        return sorted(path.name for path in (self.folder / "pictures").glob("*.ply"))

    def test_keeps_maps_when_they_show_something_new_and_tells_what_goes_on(self):
        states = MissionState
        terminal = io.StringIO()
        recorder = mission_recorder.Recorder(self.folder, mission_recorder.Screen(terminal), MissionState, mission_recorder.Processes(self.folder, ""))

        def show(size):
            recorder.on_mesh(AnyMsg().deserialize(serialised(mesh_of(size))))

        def say(*arguments, **fields):
            recorder.on_state(self.message(*arguments, **fields))

        show(0.5)
        say(states.BEGIN)
        self.assertEqual(self.maps(), [], "nothing has been looked at")
        show(1.0)
        say(states.LOOK)
        say(states.DETECT)
        self.assertEqual(len(self.maps()), 1, "after the first look")
        show(2.0)
        say(states.PICK, begun=1, brick=2)
        self.assertEqual(len(self.maps()), 2, "before the first pick")
        show(3.0)
        say(states.PLAN_CLEAR, picked=1, begun=1)
        say(states.LOOK, picked=1, begun=1)
        show(4.0)
        say(states.DETECT, picked=1, begun=1)
        self.assertEqual(len(self.maps()), 3, "after the look that follows the pick")
        show(5.0)
        say(states.LOOK, picked=1, begun=1)
        failure = MissionFailure(state=states.DRIVE, event="obstacle", reason="another view")
        say(states.DETECT, picked=1, begun=1, failures=1, last_failures=[failure])
        self.assertEqual(len(self.maps()), 3, "a look without a pick before it")
        self.assertFalse(recorder.ended.is_set())
        say(states.ENDED, picked=1, begun=1, failures=1, last_failures=[failure], end_reason=states.TIME_UP, end_message="after 60 s")
        self.assertTrue(recorder.ended.is_set())
        sizes = [render_mesh.read_ply(self.folder / "pictures" / name).points.max() for name in self.maps()]
        self.assertEqual(sizes, [1.0, 2.0, 4.0, 5.0])
        self.assertEqual([name[-7:] for name in self.maps()], ["000.ply", "000.ply", "001.ply", "001.ply"])
        output = terminal.getvalue()
        for words in ("picks brick 2", "a brick is stowed", "! drive: obstacle; another view", "has ended: time up, after 60 s", "1 of 3 bricks"):
            self.assertIn(words, output)
        self.assertEqual(output.count("obstacle"), 1, "a failure is told once")
        self.assertNotIn("\r", output, "no terminal, no line that is written anew")

    def test_a_map_is_kept_when_the_look_is_in_it(self):
        recorder = mission_recorder.Recorder(self.folder, mission_recorder.Screen(io.StringIO()), MissionState, mission_recorder.Processes(self.folder, ""))
        for picked, begun in ((0, 1), (1, 2)):
            recorder.on_mesh(AnyMsg().deserialize(serialised(mesh_of(1.0 + picked, self.time_s))))
            recorder.on_state(self.message(MissionState.LOOK, picked=picked, begun=begun))
            looked_s = self.time_s
            recorder.on_state(self.message(MissionState.DETECT, picked=picked, begun=begun))
            self.assertEqual(len(self.maps()), picked, "before the look")
            recorder.on_mesh(AnyMsg().deserialize(serialised(mesh_of(3.0 + picked, looked_s + 0.5))))
            self.assertEqual(self.maps()[-1], f"map_{self.time_s:09.3f}_{picked:03d}.ply")
        self.assertEqual([render_mesh.read_ply(self.folder / "pictures" / name).points.max() for name in self.maps()], [3.0, 4.0])

    def test_keeps_no_more_maps_than_allowed_but_the_last(self):
        recorder = mission_recorder.Recorder(self.folder, mission_recorder.Screen(io.StringIO()), MissionState, mission_recorder.Processes(self.folder, ""))
        for picked in range(mission_recorder.MAX_MAPS + 5):
            recorder.on_mesh(AnyMsg().deserialize(serialised(mesh_of(1.0))))
            recorder.on_state(self.message(MissionState.LOOK, picked=picked, begun=picked))
            recorder.on_state(self.message(MissionState.DETECT, picked=picked, begun=picked))
        self.assertEqual(len(self.maps()), mission_recorder.MAX_MAPS)
        recorder.on_mesh(AnyMsg().deserialize(serialised(mesh_of(2.0))))
        recorder.on_state(self.message(MissionState.ENDED, picked=99))
        self.assertEqual(self.maps()[-1][-7:], "099.ply")

    def test_follows_a_mission_to_its_end(self):
        self.start()
        self.connect()

        def has_map():
            # In which order two topics arrive nobody knows.
            self.meshes.publish(mesh_of(1.0))
            self.say(MissionState.LOOK)
            self.say(MissionState.DETECT)
            return len(self.maps()) > 0

        self.wait_until(has_map, "a map")
        self.say(MissionState.ENDED, end_reason=MissionState.NO_BRICK_LEFT)
        code, output = self.finish()
        self.assertEqual(code, 0, output)
        self.assertIn("has ended: no brick left", output)

    def test_says_so_when_the_mission_is_gone(self):
        self.start("--gone-after", "1.0")
        self.connect()
        self.say(MissionState.DRIVE, decision="drive: the depot")
        # A publisher that goes takes with it what is not yet sent.
        self.wait_until(lambda: "drive: the depot" in self.output(), "the recorder has heard of the mission")
        self.states.unregister()
        code, output = self.finish()
        self.assertEqual(code, 1)
        self.assertIn("has been gone for 1 s", output)

    def test_silent_mission_that_answers_is_not_given_up(self):
        node = rospy.get_name()
        states = rospy.Publisher(node + "/state", MissionState, queue_size=10, latch=True)
        self.addCleanup(states.unregister)
        states.publish(self.message(MissionState.DRIVE))
        self.start("--mission", node, "--gone-after", "0.5", "--wall-limit", "4.0")
        code, output = self.finish()
        self.assertEqual(code, 3, output)

    def test_does_not_wait_for_ever_for_a_mission(self):
        self.states.unregister()
        self.start("--begin-within", "1.0")
        code, output = self.finish()
        self.assertEqual(code, 1)
        self.assertIn("did not come within 1 s", output)

    def test_gives_up_when_the_time_is_up(self):
        self.say(MissionState.DRIVE)  # latched: there when the recorder comes, which may be gone before it can be met
        self.start("--wall-limit", "1.0")
        code, output = self.finish()
        self.assertEqual(code, 3)
        self.assertIn("has not ended within 1 s", output)

    def test_ends_when_told(self):
        self.start()
        self.connect()
        self.recorder.terminate()
        code, output = self.finish()
        self.assertEqual(code, 1)
        self.assertIn("stopped before the mission", output)

    def test_processes_of_the_run_and_of_nobody_else(self):
        folder = self.folder / "proc"

        def process(number, mark, *words):
            of_one = folder / str(number)
            of_one.mkdir(parents=True)
            (of_one / "environ").write_bytes(f"HOME=/root\0RUN_MISSION_MARK={mark}\0".encode())
            (of_one / "cmdline").write_bytes(b"\0".join(word.encode() for word in words) + b"\0")
            (of_one / "status").write_text("Name:\tnode\nVmRSS:\t  2048 kB\n")
            # Name with a bracket and blanks; then the state, 10 numbers, ticks of user and system.
            (of_one / "stat").write_text(f"{number} (a b) c) S " + "1 " * 10 + f"{2 * os.sysconf('SC_CLK_TCK')} {os.sysconf('SC_CLK_TCK')} 0\n")

        process(1, "7-1", "gpis_mapping", "__name:=gpis_mapping", "__log:=log")
        process(2, "7-1", "/usr/bin/python3", "/usr/bin/rosmaster", "--core")
        process(3, "7-12", "gpis_mapping", "__name:=of_another_run")
        (folder / "4").mkdir()  # has just ended
        self.assertEqual(mission_recorder.processes_of("7-1", folder), {"gpis_mapping": folder / "1", "(rosmaster)": folder / "2"})
        processes = mission_recorder.Processes(self.folder, "7-1", folder)
        processes.update(1.0)
        processes.left(2.5, "plan pick")
        self.assertEqual((self.folder / "memory.csv").read_text(), "time_s,node,resident_mb\n1.000,gpis_mapping,2.0\n")
        self.assertEqual((self.folder / "processor.csv").read_text().splitlines(),
                         ["time_s,state,process,processor_s", "2.500,plan pick,(rosmaster),3.00", "2.500,plan pick,gpis_mapping,3.00"])

    def test_no_table_of_processes_without_a_run(self):
        processes = mission_recorder.Processes(self.folder, "")
        processes.update(1.0)
        processes.left(1.0, "look")
        self.assertEqual(list(self.folder.glob("*.csv")), [])

    def test_missing_parameters_do_not_end_the_recording(self):
        terminal = io.StringIO()
        for error in (ConnectionRefusedError("no master"), KeyError("/"), xmlrpc.client.Fault(1, "no answer")):
            mission_recorder.keep_parameters(self.folder, mission_recorder.Screen(terminal), unittest.mock.Mock(side_effect=error))
        self.assertEqual(terminal.getvalue().count("the parameters cannot be kept: "), 3)
        mission_recorder.keep_parameters(self.folder, mission_recorder.Screen(terminal), {"/": {"run_id": {}, "map": {"a": 1}, "rosdistro": "x"}}.get)
        self.assertEqual((self.folder / "parameters.yaml").read_text(), "map:\n  a: 1\n")

    def test_damaged_mesh_is_refused(self):
        data = serialised(mesh_of(1.0))
        points, normals, variance, triangles = mission_recorder.parse_surface_mesh(data)
        self.assertEqual((points.shape, normals.shape, triangles.shape), ((4, 3), (4, 3), (4, 3)))
        self.assertEqual((points[3, 2], normals[1, 0], triangles[3, 0], mission_recorder.stamp_of(data)), (1.0, 3.0, 1, 1000.5))
        np.testing.assert_allclose(variance, [1e-6, 2e-6, 3e-6, 4e-6], rtol=1e-6)
        for length in range(len(data)):
            with self.assertRaises(mission_recorder.MeshError):
                mission_recorder.parse_surface_mesh(data[:length])


if __name__ == "__main__":
    rospy.init_node("test_mission_recorder")
    rostest.rosrun("experiments", "test_mission_recorder", MissionRecorder)
