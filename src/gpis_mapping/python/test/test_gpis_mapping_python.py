#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""The Python module gpis_mapping: answers at a sphere of known place, refusals, files, threads, and its type stubs.

Needs no ROS: python3 -m unittest, with the module on PYTHONPATH.
"""

import ast
import json
import pathlib
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import numpy as np

import gpis_mapping

RADIUS = 0.3
CENTER = np.array([0.4, -0.2, 0.5])
SIZE = (120, 160)
INTRINSICS = (140.0, 140.0, 79.5, 59.5)
NUM_IMAGES = 8
EXAMPLES = pathlib.Path(__file__).resolve().parent.parent / "examples"


def look_at(eye, target=CENTER):
    """T_map_camera: z forward, x right, y down."""
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = eye
    return pose


def orbit_pose(i):
    azimuth = 2.0 * np.pi * i / NUM_IMAGES
    return look_at(CENTER + [np.cos(azimuth), np.sin(azimuth), 0.4])


def render(pose):
    """The exact depth of the sphere [m]; +Inf beside it."""
    fx, fy, cx, cy = INTRINSICS
    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    ray = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(SIZE)], axis=-1)
    center = np.linalg.inv(pose)[:3] @ np.append(CENTER, 1.0)
    a, b = (ray**2).sum(-1), ray @ center
    root = b * b - a * (center @ center - RADIUS**2)
    return np.where(root > 0.0, (b - np.sqrt(np.maximum(root, 0.0))) / a, np.inf).astype(np.float32)


def mapped_sphere(config=None):
    world = gpis_mapping.Map(config)
    for i in range(NUM_IMAGES):
        world.integrate(render(orbit_pose(i)), INTRINSICS, orbit_pose(i))
    return world


def ring(offset, count=36):
    """Points about the sphere where it was seen well, that far outside of it, and the outward normals there."""
    azimuth = 2.0 * np.pi * np.arange(count) / count
    normals = np.stack([np.cos(0.3) * np.cos(azimuth), np.cos(0.3) * np.sin(azimuth), np.full(count, np.sin(0.3))], axis=1)
    return CENTER + (RADIUS + offset) * normals, normals


class Sphere(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.world = mapped_sphere()

    def test_distance_gradient_and_variance(self):
        for offset in (0.02, -0.02):
            points, normals = ring(offset)
            answers = self.world.query(points)
            # As standalone/example: depth is exact, points 2 cm apart leave 0.2 mm between chord and sphere.
            np.testing.assert_allclose(answers.distance, offset, atol=0.002)
            self.assertGreater((answers.gradient * normals).sum(1).min(), 0.95)
            self.assertTrue(((answers.variance > 0.0) & (answers.variance < 0.05**2)).all())
            self.assertEqual(answers.gradient.shape, points.shape)

    def test_states(self):
        points = np.array([CENTER + [0.0, 0.6, 0.1], CENTER + [RADIUS - 0.03, 0.0, 0.0], [50.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
        answers = self.world.query(points)
        states = [gpis_mapping.SpaceState(state) for state in answers.state]
        self.assertEqual(states[:2], [gpis_mapping.SpaceState.FREE, gpis_mapping.SpaceState.OCCUPIED])
        self.assertEqual(states[2:], [gpis_mapping.SpaceState.UNKNOWN] * 2)
        self.assertTrue(np.isnan(answers.distance[3]))

    def test_variance_gradient_matches_differences(self):
        points, _ = ring(0.02, 5)
        step = 1e-4
        answers = self.world.query(points, variance_gradient=True)
        for axis in range(3):
            shift = step * np.eye(3)[axis]
            ahead, behind = self.world.query(points + shift).variance, self.world.query(points - shift).variance
            # The variance is 2e-4 m^2 in float accuracy: a difference over twice the step is exact to 1e-6.
            np.testing.assert_allclose(answers.variance_gradient[:, axis], (ahead - behind) / (2.0 * step), atol=1e-5)

    def test_what_was_not_asked_is_no_number(self):
        answers = self.world.query(ring(0.02)[0], variance=False)
        self.assertTrue(np.isnan(answers.variance).all() and np.isnan(answers.occupancy).all())
        self.assertEqual(len(answers.variance_gradient), 0)
        self.assertEqual(len(self.world.query(np.empty((0, 3))).distance), 0)

    def test_points_of_any_layout(self):
        points, _ = ring(0.02)
        expected = self.world.query(points).distance
        for same in (np.asfortranarray(points), np.repeat(points, 2, axis=0)[::2], points.tolist()):
            np.testing.assert_array_equal(self.world.query(same).distance, expected)

    def test_mesh(self):
        mesh = self.world.mesh()
        self.assertGreater(len(mesh.faces), 5000)
        # The rim was seen at a slant.
        np.testing.assert_allclose(np.linalg.norm(mesh.vertices - CENTER, axis=1), RADIUS, atol=0.005)
        corners = mesh.vertices[mesh.faces]
        outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.assertGreater(((corners.mean(1) - CENTER) * outward).sum(1).min(), 0.0)
        self.assertEqual((mesh.normals.shape, mesh.variance.shape), (mesh.vertices.shape, (len(mesh.vertices),)))

    def test_mesh_file(self):
        mesh = self.world.mesh()
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, "mesh.ply")
            mesh.save_ply(path)
            head = path.read_bytes()[:400].decode("ascii", "ignore")
            with self.assertRaisesRegex(OSError, "missing"):
                mesh.save_ply(pathlib.Path(folder, "missing", "mesh.ply"))
        self.assertIn(f"element vertex {len(mesh.vertices)}\n", head)
        self.assertIn(f"element face {len(mesh.faces)}\n", head)

    def test_arrays_outlive_their_result(self):
        mesh = self.world.mesh()
        vertices, copy = mesh.vertices, mesh.vertices.copy()
        del mesh
        self.world.mesh()
        np.testing.assert_array_equal(vertices, copy)

    def test_millimetres_and_camera_matrix(self):
        fx, fy, cx, cy = INTRINSICS
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        for units in (1000.0, 5000.0):
            world = gpis_mapping.Map()
            for i in range(NUM_IMAGES):
                depth = render(orbit_pose(i))
                raw = np.where(np.isfinite(depth), np.round(units * depth), 0).astype(np.uint16)
                world.integrate(raw, matrix, orbit_pose(i), depth_units_per_metre=units)
            # Rounding to a millimetre, more on what is above.
            np.testing.assert_allclose(world.query(ring(0.02)[0]).distance, 0.02, atol=0.003)

    def test_what_is_taken_away_leaves_the_map(self):
        world = gpis_mapping.Map()
        pose = orbit_pose(0)
        first = world.integrate(render(pose), INTRINSICS, pose)
        self.assertGreater(first.inserted, 100)
        self.assertEqual((first.map_points, len(first.removed_points)), (world.num_points, 0))
        second = world.integrate(np.full(SIZE, np.inf, np.float32), INTRINSICS, pose)
        self.assertEqual((second.deleted, world.num_points), (first.inserted, 0))
        np.testing.assert_allclose(np.linalg.norm(second.removed_points - CENTER, axis=1), RADIUS, atol=0.02)
        self.assertEqual(world.num_images, 2)


class Refusals(unittest.TestCase):
    """Each names what, the value and what is allowed; the map stays as it was."""

    def test_integrate(self):
        world = gpis_mapping.Map()
        depth, pose = render(orbit_pose(0)), orbit_pose(0)
        nan_pose, sheared, mirrored, projective = (pose.copy() for _ in range(4))
        nan_pose[0, 3] = np.nan
        sheared[0, 0] += 0.1
        mirrored[:3, 0] *= -1.0
        projective[3, 0] = 1.0
        for arguments, message in (
                ((depth[0], INTRINSICS, pose), r"depth: shape \(160,\), must be \(H, W\)"),
                ((depth[:, :, None], INTRINSICS, pose), r"depth: shape \(120, 160, 1\), must be \(H, W\)"),
                ((depth.astype(np.float64), INTRINSICS, pose), r"depth: dtype float64, must be float32 \(metres\) or uint16"),
                ((depth.astype(">f4"), INTRINSICS, pose), r"depth: dtype >f4, must be float32"),
                ((depth.tolist(), INTRINSICS, pose), r"depth: a list, must be a numpy array"),
                ((depth[:10], INTRINSICS, pose), r"camera height = 10 px, must be in \[16, 8192\] px"),
                ((depth[:0], INTRINSICS, pose), r"camera height = 0 px, must be in"),
                ((depth, (-140.0, 140.0, 79.5, 59.5), pose), r"camera fx = -140 px, must be in \[8, 1e\+06\] px"),
                ((depth, (np.nan, 140.0, 79.5, 59.5), pose), r"camera fx = nan px, must be in"),
                ((depth, (140.0, 140.0, 79.5), pose), r"intrinsics: shape \(3,\), must be \(fx, fy, cx, cy\)"),
                ((depth, np.ones((3, 3)), pose), r"intrinsics: \[\[1.0, 1.0, .*, must be \[\[fx, 0, cx\]"),
                ((depth, "140", pose), r"intrinsics: dtype <U3, must be of real numbers"),
                ((depth, INTRINSICS, pose[:3]), r"pose: shape \(3, 4\), must be \(4, 4\)"),
                ((depth, INTRINSICS, nan_pose), r"camera pose is not finite"),
                ((depth, INTRINSICS, sheared), r"camera pose is no rigid motion: R\^T R deviates .* must be < 0.0001"),
                ((depth, INTRINSICS, mirrored), r"camera pose is no rigid motion"),
                ((depth, INTRINSICS, projective), r"pose: last row 1 0 0 1, must be 0 0 0 1"),
                ((depth, INTRINSICS, pose, np.inf), r"stamp = inf s, must be in"),
                ((np.zeros(SIZE, np.uint16), INTRINSICS, pose, 0.0, -1.0), r"depth units per metre = -1.0+, must be > 0")):
            with self.subTest(message), self.assertRaisesRegex(ValueError, message):
                world.integrate(*arguments)
        self.assertEqual((world.num_images, world.num_points), (0, 0))

    def test_query(self):
        world = gpis_mapping.Map()
        for points, message in ((np.zeros((3, 4)), r"points: shape \(3, 4\), must be \(N, 3\)"),
                                (np.zeros(3), r"points: shape \(3,\), must be \(N, 3\)"),
                                (np.zeros((2, 3), complex), r"points: dtype complex128, must be of real numbers"),
                                (np.zeros((2, 3), object), r"points: dtype object, must be of real numbers")):
            with self.subTest(message), self.assertRaisesRegex(ValueError, message):
                world.query(points)
        with self.assertRaisesRegex(ValueError, "variance_gradient = True, must be False without variance"):
            world.query(np.zeros((1, 3)), variance=False, variance_gradient=True)

    def test_config(self):
        for config, message in (({"surface": {"spacing_mm": 20}}, r"config: refused:\n  surface/spacing_mm"),
                                ({"surface": {"spacing_m": -0.02}}, r"config: refused:\n  surface/spacing_m = -0.02 m, must be in \[0.003, 0.2\] m"),
                                ({"surface": {"spacing_m": float("nan")}}, r"surface/spacing_m"),
                                ({"sensor": {"max_range_m": "far"}}, r"sensor/max_range_m"),
                                ({"sensor": {"max_range_m": object()}}, r"config: a value of type object, must be"),
                                ([1, 2], r"config: a list, must be a dict, the path of a YAML file, or None"),
                                ("no_such_file.yaml", r"no_such_file.yaml")):
            with self.subTest(message), self.assertRaisesRegex(ValueError, message):
                gpis_mapping.Map(config)

    def test_all_bad_settings_are_listed_at_once(self):
        with self.assertRaises(ValueError) as caught:
            gpis_mapping.Map({"surface": {"spacing_m": 9.0, "nonsense": 1}, "threads": -1})
        for key in ("surface/spacing_m", "surface/nonsense", "threads"):
            self.assertIn(key, str(caught.exception))


class Configurations(unittest.TestCase):
    def test_dict_and_file_give_the_same_map(self):
        config = {"surface": {"spacing_m": np.float64(0.03)}, "region": {"min_m": np.array([-1.0, -1.0, 0.0])}, "threads": 1}
        from_dict = gpis_mapping.Map(config)
        self.assertIn("spacing_m: 0.03\n", from_dict.config_yaml)
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, "map.yaml")
            path.write_text(from_dict.config_yaml, encoding="utf-8")
            self.assertEqual(gpis_mapping.Map(path).config_yaml, from_dict.config_yaml)
            self.assertEqual(gpis_mapping.Map(str(path)).config_yaml, from_dict.config_yaml)
        self.assertNotEqual(gpis_mapping.Map().config_yaml, from_dict.config_yaml)


class Files(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def test_a_loaded_map_answers_as_the_saved_one(self):
        world = mapped_sphere({"surface": {"spacing_m": 0.025}})
        world.save(self.folder / "map.gpis")
        again = gpis_mapping.Map.load(self.folder / "map.gpis")
        self.assertEqual((again.num_points, again.num_images), (world.num_points, NUM_IMAGES))
        self.assertEqual(again.config_yaml, world.config_yaml)
        points = np.concatenate([ring(0.02)[0], ring(-0.02)[0], ring(0.3)[0]])
        before, after = world.query(points), again.query(points)
        np.testing.assert_array_equal(after.state, before.state)
        # Loading trains all cells; before, a cell may lag behind its points by half of their standard deviation of 1 mm.
        np.testing.assert_allclose(after.distance, before.distance, atol=0.0005)
        again.save(self.folder / "again.gpis")
        np.testing.assert_array_equal(gpis_mapping.Map.load(self.folder / "again.gpis").query(points).distance, after.distance)
        again.integrate(render(orbit_pose(0)), INTRINSICS, orbit_pose(0))
        self.assertEqual(again.num_images, NUM_IMAGES + 1)

    def test_refused_files(self):
        bad = self.folder / "bad.gpis"
        bad.write_bytes(b"no map at all")
        for path in (bad, self.folder / "missing.gpis"):
            with self.subTest(path.name), self.assertRaisesRegex(gpis_mapping.MapFileError, path.name):
                gpis_mapping.Map.load(path)
        with self.assertRaisesRegex(gpis_mapping.MapFileError, "missing"):
            gpis_mapping.Map().save(self.folder / "missing" / "map.gpis")

    def write_sequence(self, num_images, without_pose=()):
        from PIL import Image
        fx, fy, cx, cy = INTRINSICS
        np.savetxt(self.folder / "camera-intrinsics.txt", [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        for i in range(num_images):
            depth = render(orbit_pose(i))
            raw = np.where(np.isfinite(depth), np.round(1000.0 * depth), 0).astype(np.uint16)
            Image.fromarray(raw).save(self.folder / f"frame-{i:06d}.depth.png")
            np.savetxt(self.folder / f"frame-{i:06d}.pose.txt", np.full((4, 4), np.nan) if i in without_pose else orbit_pose(i))

    def test_sequence(self):
        self.write_sequence(3, without_pose=[1])
        sequence = gpis_mapping.DepthSequence(self.folder)
        self.assertEqual((len(sequence), sequence.intrinsics), (3, INTRINSICS))
        frame = sequence.frame(2)
        exact = render(orbit_pose(2))
        np.testing.assert_allclose(frame.depth, np.where(np.isfinite(exact), exact, 0.0), atol=0.0006)  # half a millimetre
        np.testing.assert_allclose(frame.pose, orbit_pose(2), atol=1e-6)
        self.assertGreater(frame.stamp_s, sequence.frame(0).stamp_s)
        with self.assertRaisesRegex(gpis_mapping.DepthSequenceError, "frame.*1"):
            sequence.frame(1)
        for index in (3, -1):
            with self.assertRaises((IndexError, TypeError)):
                sequence.frame(index)
        with self.assertRaisesRegex(gpis_mapping.DepthSequenceError, "nowhere"):
            gpis_mapping.DepthSequence(self.folder / "nowhere")

    def test_notebook(self):
        """Each cell runs, as it would in Jupyter, and the slice shows the sphere."""
        self.write_sequence(NUM_IMAGES)
        cells = json.loads((EXAMPLES / "map_a_folder.ipynb").read_text(encoding="utf-8"))["cells"]
        source = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
        self.assertIn('"FOLDER"', source)
        script = f"import matplotlib\nmatplotlib.use('Agg')\n{source}\nfigure.savefig({str(self.folder / 'slice.png')!r})\n"
        run = subprocess.run([sys.executable, "-c", script.replace('"FOLDER"', repr(str(self.folder)))], cwd=EXAMPLES, capture_output=True, text=True, check=False)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertRegex(run.stdout, rf"{NUM_IMAGES} images, \d+ ms each")
        self.assertRegex(run.stdout, r"-0\.02\d m, .*OCCUPIED\n.*\n\+0\.0[12]\d m, .*FREE")
        self.assertGreater((self.folder / "slice.png").stat().st_size, 20000)


class Threads(unittest.TestCase):
    def test_others_run_during_integrate(self):
        """Without the lock of the interpreter: this thread gets to note the time in the middle of a call."""
        depth, pose = np.full((480, 640), 1.5, np.float32), np.eye(4)
        world = gpis_mapping.Map()
        for _ in range(20):  # a busy machine may not give this thread its turn every time
            span = []

            def integrate():
                span.append(time.perf_counter())
                world.integrate(depth, (560.0, 560.0, 319.5, 239.5), pose)
                span.append(time.perf_counter())

            worker = threading.Thread(target=integrate)
            moments = []
            worker.start()
            while worker.is_alive():
                moments.append(time.perf_counter())
                world.query(np.zeros((1, 3)), variance=False)
            third = (span[1] - span[0]) / 3.0
            if any(span[0] + third < moment < span[1] - third for moment in moments):
                return
        self.fail("no other thread ran in the middle of 20 calls")

    def test_two_threads_integrate(self):
        world = gpis_mapping.Map({"threads": 1})
        threads = [threading.Thread(target=lambda: [world.integrate(render(orbit_pose(i)), INTRINSICS, orbit_pose(i)) for i in range(4)])
                   for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(world.num_images, 8)
        np.testing.assert_allclose(world.query(ring(0.02, 8)[0][:3]).distance, 0.02, atol=0.002)


class Stubs(unittest.TestCase):
    def test_stubs_have_what_the_module_has(self):
        package = pathlib.Path(gpis_mapping.__file__).parent
        self.assertTrue((package / "py.typed").exists())
        tree = ast.parse((package / "_core.pyi").read_text(encoding="utf-8"))
        stubs = {}
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                stubs[node.name] = {member.name for member in node.body if isinstance(member, ast.FunctionDef)}
        self.assertEqual(set(stubs), set(gpis_mapping.__all__))
        for name, members in stubs.items():
            kind = getattr(gpis_mapping, name)
            if issubclass(kind, (int, Exception)):
                continue
            public = {member for member in vars(kind) if not member.startswith("_")}
            public |= {special for special in ("__len__",) if special in vars(kind)}
            self.assertEqual(members - {"__init__"}, public, name)


if __name__ == "__main__":
    import rosunit  # the workspace's test runner

    rosunit.unitrun("gpis_mapping", "test_gpis_mapping_python", __name__)
