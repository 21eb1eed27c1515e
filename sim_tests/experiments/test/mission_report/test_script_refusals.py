#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""What the scripts about missions and long checks refuse, and that they say so before they do anything."""

import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

import rosunit

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[3]
SCRIPTS = ROOT / "scripts"
sys.path.insert(0, str(HERE))

import run_folder  # noqa: E402

def map_result():
    """What bench_map_vs_octomap leaves, with made-up numbers."""
    def series(value):
        return {"median": value, "p95": value, "max": value, "first": value, "per_frame": [value, value]}

    def entry(title, ms):
        errors = {"rmse_mm": 1.0, "mean_mm": 0.1, "median_mm": 0.5, "p95_mm": 2.0, "area_share": 0.3}
        quality = {"rmse_mm": 1.0, "share_off_by_2cm": 0.0, "complete_1cm": 1.0, "complete_2cm": 1.0}
        return {"title": title, "total_ms": series(ms), "processor_ms": series(ms), "map_mb": 10.0, "rss_growth_mb": 10.0,
                "before_removal": {**quality, "places": {place: errors for place in ("face", "convex", "concave")}}, "after_removal": {**quality, "ghost_share": 0.0}}

    stages = ("classify", "regress", "fuse", "observe", "insert", "train", "publish")
    ours = {**entry("ours", 10.0), "threads": 2, "points": 100, "cells": 10, "training_points_per_cell": 30.0, "largest_cell": 40.0, "cells_retrained": series(5.0),
            "stages_ms": {stage: series(1.0) for stage in stages}, "mesh_incremental_ms": series(20.0), "mesh_incremental_cells": series(5.0)}
    rates = {f"{kind}_per_s_{threads}_threads": 2e6 for kind in ("distance", "variance", "variance_gradient") for threads in (1, 2)}
    band = {**rates, "mean_abs_error_mm": 1.0, "answered_share": 1.0}
    times = ("update_ms", "processor_ms", "octomap_processor_ms")
    growth = {"maps": [{"area_m2": area, "points": 100, "map_mb": 1.0, **dict.fromkeys(times, 1.0)} for area in (10.0, 1000.0)], "ratio": dict.fromkeys(times, 1.5)}
    return {"machine": {"processor": "P", "cores": 2, "compiler": "c", "build_type": "Release", "load_at_start": 0.0}, "repeat": 1,
            "scene": {"frames": 2, "width_px": 640, "height_px": 480, "boxes": 5, "removal_frame": 1, "removed_boxes": 1},
            "maps": {"gpis": ours, "octomap_2cm": entry("OctoMap 2 cm", 200.0)}, "mesh": {"full_ms": 100.0, "triangles": 10},
            "queries": {"first_query_ms": 1.0, "bands": {"0 to 5 cm": band, "5 to 30 cm": band}}, "octomap_lookups_per_s": 1e6, "growth": growth}


class ScriptRefusals(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="script_refusals_"))
        self.addCleanup(shutil.rmtree, self.folder)

    def run_it(self, script, *arguments):
        environment = {**os.environ, "MPLCONFIGDIR": str(self.folder / "matplotlib"), "SKIP_INSTALL": "1"}
        done = subprocess.run([str(script), *map(str, arguments)], env=environment, capture_output=True, text=True, timeout=120, check=False,
                              stdin=subprocess.DEVNULL)
        self.assertNotIn("Traceback", done.stderr)
        return done

    @staticmethod
    def copy_strategies(tree):
        """For a tree of its own: what is asked for the strategies that there are."""
        shutil.copytree(ROOT / "tools", tree / "tools")
        (tree / "scripts").mkdir()
        shutil.copy(SCRIPTS / "run_mission", tree / "scripts", follow_symlinks=False)
        for name in ("package.xml", "strategy_plugins.xml", "config"):
            source, copy = ROOT / "src/nbv_selection" / name, tree / "src/nbv_selection" / name
            copy.parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if source.is_dir() else shutil.copy)(source, copy)

    def refused(self, code, words, script, *arguments):
        """With one line, and nothing else."""
        done = self.run_it(SCRIPTS / script, *arguments)
        self.assertEqual(done.returncode, code, (arguments, done.stdout, done.stderr))
        self.assertEqual(done.stdout, "", arguments)
        self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
        self.assertIn(words, done.stderr)

    def test_run_mission_names_option_value_and_range_and_deletes_nothing(self):
        run = self.folder / "run"
        run.mkdir()
        (run / "kept").write_text("")

        def mission(*options):
            # What is wrong with the usage comes first: this folder is never deleted, and nothing begins.
            return ("run_mission", "--run", run, "--overwrite", *options)

        for option, value, allowed in (("--time-limit", "0.5", "[1, 86400] s"), ("--time-limit", "90000", "[1, 86400] s"), ("--time-limit", "0", "[1, 86400] s"),
                                       ("--time-limit", "1e3", "[1, 86400] s"), ("--seed", "99999999999", "[0, 2147483647]"), ("--seed", "2147483648", "[0, 2147483647]"),
                                       ("--seed", "-1", "[0, 2147483647]"), ("--seed", "08", "[0, 2147483647]")):
            number = "whole number" if option == "--seed" else "number"
            self.refused(2, f"{option} {value}, must be a {number} in {allowed}", *mission(option, value))
        for fine in (("--time-limit", "1"), ("--time-limit", "86400.0"), ("--seed", "0"), ("--seed", "2147483647")):
            self.refused(1, "was not made by scripts/run_mission: not deleted", *mission(*fine))
        for argument in ("a.*:=1", "sc:=x y", "x", ":=1", "Scene:=1"):
            self.refused(2, f"{argument} after --, must be ARGUMENT:=VALUE" if argument != "sc:=x y" else "no argument sc", *mission("--", argument))
        for argument, words in (("map_config:=/x", "simulation.launch has no argument map_config any more: write its keys below gpis_mapping/map"),
                                ("strategie:=x", "simulation.launch has no argument strategie, but strategy: "),
                                ("deployment:=robot", "simulation.launch has no argument deployment")):
            self.refused(2, words, *mission("--", argument))
        for name in ("run_folder", "scene", "seed", "strategy", "clock"):
            self.refused(2, f"an option of this script sets {name}", *mission("--", f"{name}:=1"))
        for argument in ("record:=true", "autostart:=false"):
            self.refused(1, "was not made by scripts/run_mission: not deleted", *mission("--", argument))
        self.assertTrue((run / "kept").exists())

    def test_run_mission_wants_every_node_built(self):
        # Another launch file in a tree of its own, with a node that nobody has built.
        tree, package = self.folder / "tree", self.folder / "tree/src/mp700_ur5e_bringup"
        (package / "launch").mkdir(parents=True)
        (tree / "sim_tests/simulated_world/worlds").mkdir(parents=True)
        (tree / "sim_tests/simulated_world/worlds/toy.yaml").write_text("")
        self.copy_strategies(tree)
        (tree / "scripts/lib.sh").write_text((SCRIPTS / "lib.sh").read_text() + "use_workspace() { :; }\n")
        (package / "package.xml").write_text("<package format='2'><name>mp700_ur5e_bringup</name><version>0.0.0</version><description/>"
                                             "<maintainer email='a@b.c'>a</maintainer><license>BSD</license><depend>rosout</depend></package>")
        # It is of the map that --strategy asks for.
        (package / "launch/simulation.launch").write_text("""<launch><arg name="map" default="gpis"/><arg name="run_folder"/>
            <param name="made" command="mkdir -p '$(arg run_folder)'"/><group if="$(eval map == 'octomap')">
            <node pkg="rosout" type="not_built" name="not_built"/><node pkg="not_there" type="node" name="not_there"/></group></launch>""")
        done = self.run_it(tree / "scripts/run_mission", "--run", self.folder / "run", "--scene", "toy", "--strategy", "octomap_random")
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("what is not there: not_there/node rosout/not_built", done.stderr)
        self.assertFalse((self.folder / "run").exists())

    def test_every_declared_strategy_is_taken(self):
        # A package outside of ours, sourced as a user's workspace would be.
        package = self.folder / "outside/my_views"
        package.mkdir(parents=True)
        (package / "package.xml").write_text("<package format='2'><name>my_views</name><version>0.0.0</version><description>d</description>"
                                             "<maintainer email='a@example.org'>a</maintainer><license>BSD</license><depend>nbv_selection</depend>"
                                             "<export><nbv_selection plugin='${prefix}/plugins.xml'/></export></package>")
        (package / "plugins.xml").write_text("<library path='lib/libmy_views'><class name='my_views/Nearest' type='my_views::Nearest' "
                                             "base_class_type='nbv_selection_ros::Strategy'/></library>")
        config = self.folder / "views.yaml"
        config.write_text("nbv_selection: {nearest: {plugin: my_views/Nearest}, farthest: {plugin: my_views/Farthest}}\n")
        run = self.folder / "run"
        run.mkdir()
        kept = ("run_mission", "--run", run, "--overwrite", "--scene", "two_rows", "--strategy")
        shipped = "gpis, octomap_gradient_frontier, octomap_random"
        refusals = ((), f"strategy nearest: must be one of {shipped}"), ((config,), "strategy nearest: its plugin my_views/Nearest is exported by no package on "
                                                                                  f"ROS_PACKAGE_PATH; must be one of {shipped}")
        for given, words in refusals:
            self.refused(2, words, *kept, "nearest", *(("--", f"params:={config}") if given else ()))
        with unittest.mock.patch.dict(os.environ, ROS_PACKAGE_PATH=f"{package.parent}:{os.environ['ROS_PACKAGE_PATH']}"):
            self.refused(1, "not deleted", *kept, "nearest", "--", f"params:={config}")
            self.refused(2, "my_views/Farthest is exported by no package on ROS_PACKAGE_PATH; must be one of gpis, nearest, ", *kept, "farthest", "--",
                         f"params:={config}")
        # Of the same environment the nodes are started: sourcing this workspace once more would hide the user's.
        environment = {**os.environ, "ROS_PACKAGE_PATH": f"{package.parent}:/x", "CMAKE_PREFIX_PATH": f"{package.parent}/devel:{ROOT}/devel:/usr"}
        told = subprocess.run(["bash", "-c", '. "$0"; use_workspace; echo "$ROS_PACKAGE_PATH"', str(SCRIPTS / "lib.sh")], env=environment,
                              capture_output=True, text=True, check=True).stdout
        self.assertEqual(told.strip(), environment["ROS_PACKAGE_PATH"])
        for name in shipped.split(", "):
            self.refused(1, "not deleted", *kept, name)
        self.refused(1, "not deleted", *kept, "nearest", "--", f"params:={ROOT}/examples/nearest_strategy/mission.yaml")
        self.refused(2, "strategies cannot be read", *kept, "gpis", "--", f"params:={self.folder / 'nope.yaml'}")

    def test_endurance_refuses_seeds_that_no_world_takes(self):
        kept = self.folder / "endurance/kept"
        kept.parent.mkdir()
        kept.write_text("")
        for seed in ("-5", "2147483648"):
            done = self.run_it(SCRIPTS / "soak_endurance.py", "--out", self.folder, f"--seed={seed}", "--sim-hours", "0.05")
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(f"--seed {seed}, must be in [0, 2147483647]", done.stderr)
        done = self.run_it(SCRIPTS / "soak_endurance.py", "--out", self.folder, "--seed", "2147483647", "--sim-hours", "0.05")
        self.assertIn("--sim-hours 0.05, must be", done.stderr)
        self.assertTrue(kept.exists())

    def test_recorder_refuses_times_that_are_none(self):
        for option in ("--wall-limit", "--begin-within", "--gone-after"):
            for value in ("nan", "-1.0"):
                done = self.run_it(SCRIPTS / "mission_recorder.py", self.folder / "nope", f"{option}={value}")
                self.assertEqual(done.returncode, 2, done.stderr)
                self.assertIn(f"{option} {value}, must be a number of seconds >= 0", done.stderr)

    def test_soak_mission_tells_that_there_is_no_table(self):
        for option in ("--judge", "--tables"):
            self.refused(2, f"error: no mission.csv in {self.folder}", "soak_mission.py", "--out", self.folder, option)

    def test_soak_calls_a_missing_value_bad_usage(self):
        for option in ("--frames", "--plans", "--picks", "--hours"):
            self.refused(2, f"{option} needs a number", "soak", option)

    def test_figures_says_what_it_needs(self):
        self.refused(2, "figure 4 needs a mission's run folder", "figures", "4")
        self.refused(2, "invalid choice: '2'", "figures", "2")
        self.refused(1, "nope/missions.csv: No such file", "figures", "7", self.folder / "nope")
        (self.folder / "blanket.csv").write_text("column,row\n1,2\n")
        for text, words in (("x,y,z\n", "removed.csv: holds no row"), ("x,y\n1,2\n", "cannot be drawn: KeyError: 'z'"), ("x,y,z\n1,2,3\n", "gpis_before.ply: No such file")):
            (self.folder / "removed.csv").write_text(text)
            self.refused(1, words, "figures", "3", self.folder)

    def test_plot_bench_renews_what_was_measured_and_says_what_is_missing(self):
        page, path = self.folder / "page.md", self.folder / "bench_map_vs_octomap.json"
        before = "".join(f"<!-- {name}: begin -->\nold {name}\n<!-- {name}: end -->\n" for name in ("bench", "core", "world"))
        page.write_text(before)
        command = ("plot_bench.py", self.folder, "--plot", self.folder / "bench.png", "--document", page)
        self.refused(1, f"{self.folder}: holds none of bench_map_vs_octomap.json", *command)
        for text in ("[]", '{"maps": {}}', json.dumps({key: value for key, value in map_result().items() if key != "growth"})):
            path.write_text(text)
            self.refused(1, f"{path}: has no ", *command)
            self.refused(1, "growth: it comes from another version of bench_map_vs_octomap", *command)
        result = map_result()
        del result["maps"]["octomap_2cm"]["before_removal"]["places"]
        path.write_text(json.dumps(result))
        self.refused(1, f"{path}: has no maps/octomap_2cm/before_removal/places", *command)
        path.write_text(json.dumps({**map_result(), "maps": []}))
        self.refused(1, "plot_bench: ", *command)
        path.write_text(json.dumps(map_result())[:100])
        self.refused(1, str(path), *command)
        self.assertEqual(page.read_text(), before)

        path.write_text(json.dumps(map_result()))
        done = self.run_it(SCRIPTS / command[0], *command[1:])
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertGreater((self.folder / "bench.png").stat().st_size, 10000)
        text = page.read_text()
        self.assertNotIn("old bench", text)
        self.assertEqual(text[text.index("<!-- core"):], before[before.index("<!-- core"):])
        self.assertIn("| update, median, of OctoMap 2 cm | <= 0.08 | 0.050 | 0.62 | yes |", text)
        self.assertIn("| distance and gradient, 2 threads [M/s] | >= 4 | 2.00 | 0.50 | **no** |", text)
        self.assertIn("| update in 1000 m2, of that in 10 m2 (processor time) | <= 1.1 | 1.50 | 1.36 | **no** |", text)

    def test_report_soak_leaves_the_page_where_there_is_nothing(self):
        page = self.folder / "soak.md"
        page.write_text("what was measured")

        def soak(folder):
            return ("report_soak.py", folder, "--plot", self.folder / "soak.png", "--table", page)

        self.refused(1, "neither loop.csv nor fuzz.csv", *soak(self.folder / "nope"))
        self.refused(1, "neither loop.csv nor fuzz.csv", *soak(self.folder))
        (self.folder / "fuzz.csv").write_text("")
        self.refused(1, "fuzz.csv: no results", *soak(self.folder))
        (self.folder / "loop.csv").write_text("frame,points\n1\n")
        self.refused(1, "report_soak: ", *soak(self.folder))
        self.assertEqual(page.read_text(), "what was measured")

    def test_plot_mission_fails_where_there_is_nothing_to_plot(self):
        self.refused(1, f"{self.folder}: no mission left anything to plot there", "plot_mission.py", self.folder)
        run_folder.make_run_folder(self.folder / "run", 2)
        self.assertEqual(self.run_it(SCRIPTS / "plot_mission.py", self.folder / "run").returncode, 0)
        shutil.rmtree(self.folder / "run/report")
        (self.folder / "run/report").write_text("")
        for script in ("plot_mission.py", "report_mission.py"):
            self.refused(1, f"{self.folder / 'run/report'}: File exists", script, self.folder / "run")


if __name__ == "__main__":
    rosunit.unitrun("experiments", "test_script_refusals", ScriptRefusals)
