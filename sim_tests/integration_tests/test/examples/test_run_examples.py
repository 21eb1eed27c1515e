#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""scripts/run_examples: what it refuses and what it finds failed, on made pages; then the pages of the repository.

The detector of the tutorial, which no page can start without a robot: as a node, on made images.
The script of the tutorial for MoveIt, which Debian does not have: with the messages that it uses, on made meshes.
"""

import io
import pathlib
import re
import subprocess
import sys
import tempfile
import types
import unittest
import unittest.mock

import genpy.dynamic
import rospy
import rosunit
from geometry_msgs.msg import Point, PoseStamped
from interactive_mapping_msgs.msg import BrickArray, BrickFace, SurfaceMesh
from interactive_mapping_msgs.srv import DetectBricks, DetectBricksRequest, QueryMapResponse
from sensor_msgs.msg import Image
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import Header

ROOT = pathlib.Path(__file__).resolve().parents[4]
RUN_EXAMPLES = ROOT / "scripts/run_examples"
# As moveit_msgs for ROS Noetic has them, without the fields that the tutorial does not set.
MOVEIT_MSGS = {"PlanningScene": "RobotState robot_state\nPlanningSceneWorld world\nbool is_diff\n",
               "RobotState": "bool is_diff\n",
               "PlanningSceneWorld": "CollisionObject[] collision_objects\n",
               "CollisionObject": "Header header\ngeometry_msgs/Pose pose\nstring id\nshape_msgs/Mesh[] meshes\n"
                                  "geometry_msgs/Pose[] mesh_poses\nbyte ADD=0\nbyte REMOVE=1\nbyte APPEND=2\n"
                                  "byte MOVE=3\nbyte operation\n"}


def moveit_msgs():
    """The module moveit_msgs.msg."""
    line = "\n" + "=" * 80 + "\n"
    parts = {text.partition("\n")[0]: text for message in (PoseStamped, SurfaceMesh)
             for text in message._full_text.split(line)[1:]}
    parts.update({name: f"MSG: moveit_msgs/{name}\n{text}" for name, text in MOVEIT_MSGS.items()})
    first = parts.pop("PlanningScene").partition("\n")[2]
    made = genpy.dynamic.generate_dynamic("moveit_msgs/PlanningScene", line.join([first, *parts.values()]))
    module = types.ModuleType("moveit_msgs.msg")
    vars(module).update({name: made[f"moveit_msgs/{name}"] for name in MOVEIT_MSGS})
    return module


def run_it(*arguments):
    done = subprocess.run([str(RUN_EXAMPLES), *map(str, arguments)], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, check=False)
    return done.returncode, done.stdout


class RunExamples(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def page(self, text):
        path = pathlib.Path(self.folder.name) / "page.md"
        path.write_text(text, encoding="utf-8")
        return path

    def test_marks(self):
        wrong = [("bash", "no mark"), ("python", "no mark"), ("console", "no mark"), ("bash walk", "no mark"),
                 ("bash run now", "run takes no words"), ("bash stays", "stays takes the topics"),
                 ("bash stays chatter", "stays takes the topics"), ("bash skip", "skip takes one of"),
                 ("bash skip tired", "skip takes one of"), ("", "must be bash")]
        right = ["bash run", "python run", "bash skip robot", "bash stays /chatter", "cpp", "text"]
        blocks = [f"```{fence}\nrosrun a b\n```\n" for fence in [fence for fence, _ in wrong] + right]
        code, output = run_it("--check", self.page("".join(blocks) + "```\na picture ─► of arrows\n```\n"))
        self.assertEqual(code, 1)
        lines = output.splitlines()
        self.assertEqual(len(lines), len(wrong) + 1, output)
        for i, (fence, told) in enumerate(wrong):
            self.assertRegex(lines[i], f"^FAILED .*page.md:{3 * i + 1}: .*{told}", fence)
        self.assertEqual(run_it("--check", self.page("".join(blocks[len(wrong):])))[0], 0)

    def test_what_fails_is_named_and_what_builds_on_it_is_not_run(self):
        code, output = run_it(self.page("# A\n```bash run\necho so; false\n```\n```bash run\ntouch later\n```\n"
                                        "# B\n```bash run\n[ ! -e later ]\n[ -d src ]\n```\n"
                                        "```bash skip root\nfalse\n```\n"))
        self.assertEqual(code, 1)
        self.assertRegex(output, r"FAILED .*page.md:2: exit code 1\n +so\n")
        self.assertRegex(output, r"ok +.*page.md:9 run")
        self.assertRegex(output, r"skip +.*page.md:13: needs root")
        self.assertIn("3 blocks to run, 1 failed, 1 skipped", output)

    def test_each_line_counts(self):
        code, output = run_it(self.page("```bash run\nfalse\ntrue\n```\n```python run\nraise SystemExit(3)\n```\n"))
        self.assertEqual(code, 1, output)

    def test_a_terminal_that_ends(self):
        code, output = run_it(self.page("```bash stays /chatter\necho no such thing; exit 3\n```\n"))
        self.assertEqual(code, 1)
        self.assertRegex(output, r"page.md:1: nothing on /chatter: a terminal has ended with 3\n +no such thing\n")

    def test_a_terminal_is_listened_to_and_closed_at_the_heading(self):
        code, output = run_it(self.page(
            "# A\n```bash stays /camera/depth/camera_info /tf\nsource devel/setup.bash\n"
            "roslaunch synthetic_depth synthetic_depth.launch\n```\n"
            "```bash run\nsource devel/setup.bash\nrostopic echo -n 1 /camera/depth/camera_info\n```\n"
            "# B\n```bash run\nsource devel/setup.bash\n! rostopic list\n```\n"))
        self.assertEqual(code, 0, output)
        self.assertIn("3 blocks to run, 0 failed, 0 skipped", output)

    def test_the_detector_of_the_tutorial(self):
        page = (ROOT / "docs/tutorials/detector.md").read_text(encoding="utf-8")
        node = pathlib.Path(self.folder.name) / "my_detection.py"
        node.write_text(re.search(r"```python.*?\n(.*?)```", page, re.DOTALL).group(1), encoding="utf-8")
        rospy.init_node("test_run_examples")
        process = subprocess.Popen(["/usr/bin/python3", str(node), "image:=/made_image"], stdin=subprocess.DEVNULL)
        self.addCleanup(process.wait)
        self.addCleanup(process.terminate)
        rospy.wait_for_service("/my_detection/detect", timeout=30.0)
        detect = rospy.ServiceProxy("/my_detection/detect", DetectBricks)
        # No image: it says so and reports nothing.
        none = detect(DetectBricksRequest(timeout=rospy.Duration(0.5)))
        self.assertEqual((none.success, none.status, none.bricks.bricks), (False, none.NO_IMAGE, []))
        # Images of before the call, then those of after it: only these count.
        publisher = rospy.Publisher("/made_image", Image, queue_size=1)
        begin = rospy.Time.now()
        late_s = 1.0

        def publish(_):
            image = Image(encoding="rgb8", width=4, height=3, step=12, data=bytes(36))
            image.header.stamp = rospy.Time.now() - rospy.Duration(late_s)
            publisher.publish(image)

        timer = rospy.Timer(rospy.Duration(0.05), publish)
        self.addCleanup(timer.shutdown)
        found = detect(DetectBricksRequest(timeout=rospy.Duration(20.0)))
        self.assertEqual((found.success, found.status, list(found.update.bricks_seen)), (True, found.OK, [7]))
        self.assertGreaterEqual(found.update.header.stamp, begin)
        self.assertGreaterEqual(rospy.Time.now() - begin, rospy.Duration(late_s))
        # What the mission reads: the latched topic, a face whose z leads out of the box, at its surface.
        bricks = rospy.wait_for_message("/my_detection/bricks", BrickArray, timeout=10.0)
        self.assertEqual((bricks.header.frame_id, bricks.header.stamp), ("map", found.update.header.stamp))
        brick, = bricks.bricks
        face, = brick.graspable_faces
        self.assertEqual((brick.id, face.face), (7, BrickFace.PLUS_Z))
        self.assertAlmostEqual(face.pose.position.z - brick.pose.pose.position.z, 0.5 * brick.size.z)

    def test_the_collision_object_of_the_tutorial(self):
        page = (ROOT / "docs/tutorials/moveit.md").read_text(encoding="utf-8")
        script = re.search(r"```python.*?\n(.*?)```", page, re.DOTALL).group(1)
        moveit = moveit_msgs()
        # As it is, up to rospy.spin(), without a master.
        modules = {"moveit_msgs": types.ModuleType("moveit_msgs"), "moveit_msgs.msg": moveit}
        replaced = dict.fromkeys(("init_node", "Publisher", "Subscriber", "spin"), unittest.mock.DEFAULT)
        with unittest.mock.patch.dict(sys.modules, modules), unittest.mock.patch.multiple(rospy, **replaced) as ros:
            exec(compile(script, "moveit.md", "exec"), {})
        ros["spin"].assert_called_once_with()
        self.assertEqual(ros["Publisher"].call_args[0], ("planning_scene", moveit.PlanningScene))
        topic, kind, on_mesh = ros["Subscriber"].call_args[0]
        self.assertEqual((topic, kind), ("/gpis_mapping/mesh", SurfaceMesh))
        triangle = Mesh([MeshTriangle([0, 1, 2])], [Point(0, 0, 0), Point(1, 0, 0), Point(0, 1, 0)])
        for mesh, operation in ((triangle, moveit.CollisionObject.ADD), (Mesh(), moveit.CollisionObject.REMOVE)):
            on_mesh(SurfaceMesh(header=Header(frame_id="map"), mesh=mesh))
            wire = io.BytesIO()
            ros["Publisher"].return_value.publish.call_args[0][0].serialize(wire)
            scene = moveit.PlanningScene().deserialize(wire.getvalue())
            self.assertTrue(scene.is_diff and scene.robot_state.is_diff)
            thing, = scene.world.collision_objects
            self.assertEqual((thing.header.frame_id, thing.id, thing.operation), ("map", "mapped_surface", operation))
            self.assertEqual([len(one.vertices) for one in thing.meshes], [3] if mesh.triangles else [])
            self.assertEqual([pose.orientation.w for pose in thing.mesh_poses], [1.0] * len(thing.meshes))
            self.assertEqual(thing.pose.orientation.w, 1.0)
        # What the page says of the map's service.
        self.assertEqual((QueryMapResponse.UNKNOWN, QueryMapResponse.OCCUPIED), (0, 2))
        self.assertLessEqual({"state", "surface_std"}, set(QueryMapResponse.__slots__))

    def test_the_repository(self):
        code, output = run_it()
        print(output)
        self.assertEqual(code, 0, output)
        self.assertRegex(output, r"\d\d blocks to run, 0 failed, \d+ skipped")


if __name__ == "__main__":
    rosunit.unitrun("integration_tests", "test_run_examples", RunExamples)
