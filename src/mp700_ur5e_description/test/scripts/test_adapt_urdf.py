#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
import os
import pathlib
import struct
import subprocess
import tempfile
import unittest
from xml.etree import ElementTree

import numpy as np
import rosunit
import yaml

PACKAGE = pathlib.Path(__file__).resolve().parents[2]
SHIPPED = PACKAGE / "urdf" / "mp700_ur5e.urdf"
ARM = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
MESH_ROBOT = """<robot name="one"><link name="base_link">
  <visual><geometry><mesh filename="{file}"/></geometry></visual>
  <collision><origin xyz="0.1 0.2 0.3" rpy="0.3 -0.4 1.1"/><geometry><mesh filename="{file}" scale="{scale}"/></geometry></collision>
</link></robot>"""


def box_triangles(low, high):
    corner = [np.array([(low, high)[k >> axis & 1][axis] for axis in range(3)], float) for k in range(8)]
    faces = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    return [[corner[a], corner[b], corner[c]] for q in faces for a, b, c in (q[:3], (q[0], q[2], q[3]))]


def cylinder_triangles(radius, length, sides=64):
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    low, high = (np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(sides, z)], axis=1)
                 for z in (-0.5 * length, 0.5 * length))
    return [t for k in range(sides) for j in [(k + 1) % sides]
            for t in ([low[k], low[j], high[j]], [low[k], high[j], high[k]])]


def write_obj(path, triangles):
    lines = [f"v {x} {y} {z}" for triangle in triangles for x, y, z in triangle]
    lines += [f"f {3 * k + 1} {3 * k + 2} {3 * k + 3}" for k in range(len(triangles))]
    path.write_text("\n".join(lines))


def write_stl(path, triangles, ascii_text=False):
    if ascii_text:
        loops = ["facet normal 0 0 0\nouter loop\n" + "".join("vertex {} {} {}\n".format(*p) for p in t) + "endloop\nendfacet"
                 for t in triangles]
        path.write_text("solid s\n" + "\n".join(loops) + "\nendsolid s\n")
        return
    records = [struct.pack("<12fH", 0, 0, 0, *np.concatenate(t), 0) for t in triangles]
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(triangles)) + b"".join(records))


def rotation(rpy):
    roll, pitch, yaw = rpy
    about = lambda k, a: np.roll(np.roll(np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]),
                                         k + 1, axis=0), k + 1, axis=1)
    return about(2, yaw) @ about(1, pitch) @ about(0, roll)


def numbers(text):
    return np.array([float(x) for x in text.split()])


def collisions(urdf):
    """Of each shape: kind, sizes, position, rotation."""
    for element in ElementTree.parse(urdf).getroot().iter("collision"):
        shape = element.find("geometry")[0]
        sizes = numbers(shape.get("size")) if shape.tag == "box" else numbers(f"{shape.get('radius')} {shape.get('length')}")
        origin = element.find("origin")
        yield shape.tag, sizes, numbers(origin.get("xyz")), rotation(numbers(origin.get("rpy")))


def is_in(shape, points):
    kind, sizes, position, R = shape
    local = (points - position) @ R
    slack = 1e-5  # the file has six decimals
    if kind == "box":
        return (np.abs(local) <= 0.5 * sizes + slack).all(axis=1)
    return (np.hypot(local[:, 0], local[:, 1]) <= sizes[0] + slack) & (np.abs(local[:, 2]) <= 0.5 * sizes[1] + slack)


def volume(shape):
    kind, sizes = shape[:2]
    return sizes.prod() if kind == "box" else np.pi * sizes[0] ** 2 * sizes[1]


class AdaptUrdf(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.out = self.folder / "out.urdf"

    def run_tool(self, urdf, names=None, *options):
        command = [str(PACKAGE / "scripts" / "adapt_urdf"), str(urdf), str(self.out), *options]
        if names is not None:
            (self.folder / "names.yaml").write_text(yaml.dump(names))
            command += ["--names", str(self.folder / "names.yaml")]
        return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True,
                              env={**os.environ, "PATH": "/usr/bin:" + os.environ["PATH"]}, check=False)

    def adapt_mesh(self, file, scale="1 1 1", *options):
        urdf = self.folder / "in.urdf"
        urdf.write_text(MESH_ROBOT.format(file=file, scale=scale))
        done = self.run_tool(urdf, None, *options)
        self.assertEqual(done.stderr, "")
        self.assertEqual(list(ElementTree.parse(self.out).getroot().iter("mesh")), [])
        return list(collisions(self.out))

    def test_shapes_contain_a_bent_mesh_and_little_more(self):
        boxes = [((0, 0, 0), (0.5, 0.1, 0.1)), ((0.4, 0, 0), (0.5, 0.1, 0.6))]
        write_obj(self.folder / "bent.obj", [t for low, high in boxes for t in box_triangles(low, high)])
        shapes = self.adapt_mesh("bent.obj", "1 2 1")
        random = np.random.default_rng(1)
        solid = np.concatenate([random.uniform(low, high, (1000, 3)) for low, high in boxes]) * [1, 2, 1]
        in_link = solid @ rotation([0.3, -0.4, 1.1]).T + [0.1, 0.2, 0.3]
        self.assertTrue(np.any([is_in(shape, in_link) for shape in shapes], axis=0).all())
        # The solid has 0.02 m^3, its bounding box 0.06. Slabs of equal height cut the bend off within one slab.
        self.assertLess(sum(volume(shape) for shape in shapes), 0.03)
        self.assertEqual(len(self.adapt_mesh("bent.obj", "1 2 1", "--max-parts", "1")), 1)

    def test_cylinder_stays_a_cylinder_in_both_kinds_of_stl(self):
        for ascii_text in (False, True):
            write_stl(self.folder / "tube.stl", cylinder_triangles(0.05, 0.4), ascii_text)
            (kind, sizes, position, R), = self.adapt_mesh("tube.stl")
            self.assertEqual(kind, "cylinder")
            # The search for the smallest circle ends within a two-hundredth of the radius.
            np.testing.assert_allclose(sizes, [0.05, 0.4], rtol=0.01)
            np.testing.assert_allclose(position, [0.1, 0.2, 0.3], atol=5e-4)
            np.testing.assert_allclose(np.abs(R[:, 2] @ rotation([0.3, -0.4, 1.1])), [0, 0, 1], atol=1e-5)

    def test_names_of_another_robot_become_ours(self):
        text = SHIPPED.read_text()
        links = {"magnet": "cup", "magnet_tip": "cup_tip", "ur5e_base_link": "arm_base"}
        for ours, theirs in links.items():
            text = text.replace(f'"{ours}"', f'"{theirs}"')
        for joint in ARM:
            text = text.replace(f'"{joint}_joint"', f'"left_{joint}_joint"')
        (self.folder / "their.urdf").write_text(text)
        done = self.run_tool(self.folder / "their.urdf",
                             {"arm_joints": [f"left_{joint}_joint" for joint in ARM], "links": links})
        self.assertEqual(done.stderr, "")

        def tree_of(path):
            robot = ElementTree.parse(path).getroot()
            return ([link.get("name") for link in robot.findall("link")],
                    [(j.get("name"), j.find("parent").get("link"), j.find("child").get("link"))
                     for j in robot.findall("joint")])
        self.assertEqual(tree_of(self.out), tree_of(SHIPPED))
        checked = subprocess.run(["check_urdf", str(self.out)], stdout=subprocess.DEVNULL, check=False)
        self.assertEqual(checked.returncode, 0)

    def test_bad_input_is_named(self):
        urdf = self.folder / "in.urdf"

        def refusal(text, names=None):
            urdf.write_text(text)
            done = self.run_tool(urdf, names)
            self.assertEqual(done.returncode, 1)
            self.assertFalse(self.out.exists())
            return done.stderr
        two = '<robot name="r"><link name="a"/><link name="magnet"/></robot>'
        empty = {"arm_joints": ARM}
        self.assertIn("the URDF has no joint elbow, shoulder_lift", refusal(two, empty))
        self.assertIn("arm_joints must be a list of six", refusal(two, {"arm_joints": ["one"]}))
        self.assertIn("must have the keys arm_joints, joints and links only", refusal(two, {"link": {}}))
        joints = "".join(f'<joint name="{name}" type="fixed"><parent link="a"/><child link="magnet"/></joint>' for name in ARM)
        self.assertIn("two links would be called magnet",
                      refusal(two.replace("</robot>", joints + "</robot>"), {**empty, "links": {"magnet": "a"}}))
        self.assertIn("the root is <sdf>, must be <robot>", refusal("<sdf/>"))
        self.assertIn("no element found", refusal("<robot>"))
        for file, reason in (("gone.stl", "No such file"), ("part.dae", "must be one of .stl, .obj"),
                             ("package://no_such_package/a.stl", "no package no_such_package"),
                             ("none.obj", "has no triangles"), ("bad.obj", "no obj file that can be read")):
            (self.folder / "none.obj").write_text("")
            (self.folder / "bad.obj").write_text("v 0 0 zero\n")
            self.assertIn(reason, refusal(MESH_ROBOT.format(file=file, scale="1 1 1")))


if __name__ == "__main__":
    rosunit.unitrun("mp700_ur5e_description", "test_adapt_urdf", AdaptUrdf)
