#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""report_mission.py on a run folder whose figures are known, and on broken ones."""

import html
import html.parser
import json
import math
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import unittest.mock
import warnings

import matplotlib.colors
import matplotlib.image
import numpy as np
import rosunit
from PIL import Image

HERE = pathlib.Path(__file__).resolve().parent
SCRIPTS = HERE.parents[3] / "scripts"
sys.path[:0] = [str(HERE), str(HERE.parents[3] / "tools")]

import run_folder  # noqa: E402
from interactive_mapping_tools import mission_run, plot_mission, report_mission  # noqa: E402

KEYS = {"scene", "seed", "strategy", "removed_factor", "bricks_total", "bricks_pickable", "bricks_picked", "bricks_stowed", "map_coverage", "map_coverable", "map_precision", "falls",
        "collisions", "load_contacts", "sim_seconds", "wall_seconds", "views", "end_reason", "failures"}


class Page(html.parser.HTMLParser):
    """What a browser would ask for, and whether all that is opened is closed."""

    def __init__(self, text):
        super().__init__()
        self.addresses, self.links, self.ids, self.open, self.text = [], [], [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        if "id" in attributes:
            self.ids.append(attributes["id"])
        if tag == "img":
            self.addresses.append(attributes["src"])
        elif tag == "a":
            self.links.append(attributes["href"])
        if tag not in ("img", "meta", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-1:]}"
        self.open.pop()

    def handle_data(self, data):
        self.text += data


class ReportMission(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="report_mission_")) / "run"
        self.addCleanup(shutil.rmtree, self.folder.parent)

    def make(self, bricks=4):
        return run_folder.make_run_folder(self.folder, bricks)

    def make_without_maps(self):
        """To draw a map takes a second or two."""
        made = self.make()
        for path in (self.folder / "pictures").glob("*.ply"):
            path.unlink()
        return made

    def report(self, *options):
        environment = {**os.environ, "MPLCONFIGDIR": str(self.folder.parent / "matplotlib")}
        done = subprocess.run(["/usr/bin/python3", str(SCRIPTS / "report_mission.py"), str(self.folder), *options], env=environment,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=120, check=False)
        self.assertNotIn("Traceback", done.stderr)
        return done

    def summary(self):
        return json.loads((self.folder / "summary.json").read_text(), parse_constant=lambda name: self.fail(f"{name} is no JSON"))

    def new_page(self):
        self.assertEqual(self.report().returncode, 0)
        return self.page()

    def page(self):
        page = Page((self.folder / "index.html").read_text())
        self.assertEqual(page.open, [])
        for address in page.addresses:
            self.assertTrue(address.startswith("data:image/"), address[:60])
        for link in page.links:
            self.assertTrue(link[1:] in page.ids if link[0] == "#" else (self.folder / link).exists(), link)
        return page

    def test_the_commands_of_the_tutorial(self):
        root = self.folder.parent
        self.folder = root / "results/demo"
        self.folder.parent.mkdir()
        self.make(8)
        for path in (self.folder / "pictures").glob("*.ply"):
            path.unlink()
        (root / "scripts").symlink_to(SCRIPTS)
        tutorial = (SCRIPTS.parent / "docs/tutorials/report.md").read_text(encoding="utf-8")
        make_page, ask_for_brick = re.findall(r"```bash.*?\n(.*?)```", tutorial, re.DOTALL)

        def run(commands):
            done = subprocess.run(["bash", "-e", "-o", "pipefail", "-c", commands], cwd=root, env={**os.environ, "MPLCONFIGDIR": str(root / "matplotlib")},
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=120, check=False)
            self.assertEqual(done.returncode, 0, done.stdout)
            return done.stdout.splitlines()

        run(make_page)
        self.page()
        steps = (self.folder / "mission.jsonl").read_text(encoding="utf-8").splitlines()
        of_brick = [line for line in steps if "brick 7," in line]
        self.assertGreater(len(of_brick), 0)
        lines = run(ask_for_brick)
        self.assertEqual(lines[:len(of_brick)], of_brick)
        self.assertEqual(len(lines), len(of_brick) + len(steps))
        self.assertIn("plan_pick success -> pick |", " ".join(lines))

    def test_crumbs_in_an_empty_place_are_not_the_maps_precision(self):
        self.make_without_maps()
        path = self.folder / "judge.csv"
        lines = path.read_text().splitlines()
        last = lines[-1].split(",")
        last[7] = "0.0"
        path.write_text("\n".join([*lines, ",".join(last)]) + "\n")
        judge = json.loads((self.folder / "judge.json").read_text())
        (self.folder / "judge.json").write_text(json.dumps({**judge, "precision": 0.0}))
        self.assertEqual(self.report().returncode, 0)
        self.assertGreater(self.summary()["map_precision"], 0.9)

    def test_summary_has_the_judges_figures_beside_the_missions(self):
        made = self.make()
        done = self.report()
        self.assertEqual(done.returncode, 0, done.stderr)
        summary = self.summary()
        self.assertLessEqual(KEYS, set(summary))
        self.assertEqual((summary["bricks_stowed"], summary["bricks_picked"], summary["bricks_total"]), (4, 4, 4))
        self.assertEqual((summary["falls"], summary["collisions"], summary["drops"]), (made.falls, 0, 0))
        self.assertAlmostEqual(summary["map_coverage"], made.coverage)
        self.assertAlmostEqual(summary["map_coverable"], 0.98)  # of run_folder's areas
        self.assertIn("98.0 % of all that was ever exposed", done.stdout)
        self.assertAlmostEqual(summary["map_precision"], made.precision, places=4)
        self.assertEqual(sum(summary["failures"].values()), made.failures)
        self.assertEqual(summary["end_reason"], "no_brick_left")
        self.assertIn("4 of 4 bricks stowed (100 %)", done.stdout)
        self.assertNotIn("Missing", done.stdout)
        page = self.page()
        self.assertIn("4 of 4", page.text)
        # 4 stages of world and of map, 5 plots, and all 5 pictures of the world once more, and as a GIF.
        self.assertEqual(len(page.addresses), 4 + 4 + 5 + 5 + 1)
        with Image.open(self.folder / "report" / "mission.gif") as moving:
            self.assertEqual((moving.n_frames, moving.width), (5, 480))
        # Each decision of the log is in the table; the bar leads to those that something followed.
        decisions = (self.folder / "mission.jsonl").read_text().splitlines()
        self.assertEqual([name for name in page.ids if name.startswith("d")], [f"d{index}" for index in range(len(decisions))])
        jumps = [link for link in page.links if link.startswith("#")]
        self.assertGreater(len(jumps), 0.5 * len(decisions))
        first = (self.folder / "summary.json").read_text()
        self.report("--summary-only")
        self.assertEqual((self.folder / "summary.json").read_text(), first, "a second report changes nothing")

    def test_memory_is_compared_between_two_quarters(self):
        self.make_without_maps()
        # One hour; grows by 1 MB a minute, after a start that is left out.
        rows = [f"{60.0 * minute:.3f},map,{100.0 + minute if minute >= 15 else 10.0:.1f}" for minute in range(61)]
        (self.folder / "memory.csv").write_text("time_s,node,resident_mb\n" + "\n".join(rows) + "\n3660.0,ma")
        self.assertEqual(self.report("--summary-only").returncode, 0)
        self.assertEqual(self.summary()["memory"], {"map": {"most_mb": 160.0, "early_mb": 122.5, "late_mb": 152.5, "hours": 0.5}})

    def plot_speed(self, processor, clock, *options):
        self.folder.mkdir()
        (self.folder / "processor.csv").write_text("time_s,state,process,processor_s\n" + "".join(processor))
        (self.folder / "clock.csv").write_text("time_s,waited_for,wall_s\n" + "".join(clock))
        environment = {**os.environ, "MPLCONFIGDIR": str(self.folder.parent / "matplotlib")}
        return subprocess.run(["/usr/bin/python3", str(SCRIPTS / "plot_speed.py"), str(self.folder), *options], env=environment, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, timeout=120, check=False)

    def test_speed_by_process_and_state(self):
        # Two cycles of drive (4 s) and pick (6 s); the map computes 1 s in a drive and 3 s in a pick, and is started anew in the last pick.
        ends = ((10, "begin", 5, 1), (14, "drive", 6, 1), (20, "pick", 9, 4), (24, "drive", 10, 4), (30, "pick", 3, 7))
        processor = [f"{time_s:.3f},{state},{process},{used_s}\n" for time_s, state, map_s, arm_s in ends for process, used_s in (("map", map_s), ("arm", arm_s))]
        clock = [f"{10 + 0.2 * step:.3f},{what},{wall_s}\n" for step in range(100) for what, wall_s in (("world", 0.02), ("/map/update", 0.06))]
        done = self.plot_speed(processor, clock, "--picture", str(self.folder / "speed.png"))
        self.assertEqual(done.returncode, 0, done.stderr)
        for row in (f"| processor s per simulated s | all, {self.folder.name} | pick | drive |", "| map | 0.400 | 0.500 | 0.250 |", "| arm | 0.300 | 0.500 | 0.000 |",
                    "| **together** | 0.700 | 1.000 | 0.250 |", "| share of the time |  | 60 % | 40 % |", "| /map/update | 0.300 |", "| world | 0.100 |"):
            self.assertIn(row, done.stdout.splitlines())
        with Image.open(self.folder / "speed.png") as picture:
            self.assertGreater(picture.width, 1000)

    def test_speed_of_a_mission_that_has_hardly_begun_is_refused(self):
        done = self.plot_speed(["10.000,begin,map,5.0\n"], ["10.000,world,0.02\n"])
        self.assertEqual((done.returncode, done.stdout), (1, ""))
        self.assertIn("has to leave two states at least", done.stderr)

    def test_counts_that_differ_are_told(self):
        self.make()
        judge = json.loads((self.folder / "judge.json").read_text())
        (self.folder / "judge.json").write_text(json.dumps({**judge, "stowed": 3}))
        done = self.report("--summary-only")
        self.assertIn("The mission's own count is 4: it differs from the judge's 3", done.stdout)
        self.assertEqual((self.summary()["bricks_stowed"], self.summary()["bricks_picked"]), (3, 4))

    def test_time_of_each_activity_is_that_of_its_states(self):
        made = self.make(8)
        run = mission_run.Run(self.folder)
        told = {}
        for from_s, to_s, index in run.periods():
            told[index] = told.get(index, 0.0) + to_s - from_s
        for index, (words, states) in enumerate(mission_run.ACTIVITIES):
            wanted = sum(made.seconds_of.get(state, 0.0) for state in states if state != "idle")  # before the start
            self.assertAlmostEqual(told.get(index, 0.0), wanted, places=6, msg=words)

    def test_failures_are_those_of_the_log_if_the_mission_left_no_summary(self):
        self.make(8)
        wanted = json.loads((self.folder / "summary.json").read_text())["failures"]
        self.assertGreater(len(wanted), 1, "a run with several kinds")
        (self.folder / "summary.json").unlink()
        run = mission_run.Run(self.folder)
        self.assertEqual({kind: times for kind, times, *_ in run.failures()}, wanted)
        self.assertEqual(mission_run.merged_summary(run)["failures"], wanted)

    def rows_of(self, page, heading):
        """Cells of the tables below a heading of the page."""
        part = (self.folder / "index.html").read_text().split(f"<h2>{heading}</h2>")[1].split("<h2>")[0]
        return [[html.unescape(re.sub("<[^>]*>", "", cell)) for cell in re.findall("<td.*?</td>", row)] for row in re.findall("<tr>.*?</tr>", part)], part

    def test_failed_plans_survive_the_next_pick(self):
        made = self.make(8)
        for path in (self.folder / "pictures").iterdir():
            path.unlink()
        self.assertGreaterEqual(sum(made.plans_failed.values()), 2, "a run with several")
        # The mission's own count is since the last pick: 0 at the end.
        self.assertFalse(any(brick["plans_failed"] for brick in json.loads((self.folder / "mission_state.json").read_text())["bricks"]))
        self.assertEqual(mission_run.Run(self.folder).plans_failed(), made.plans_failed)
        self.assertEqual(self.report().returncode, 0)
        rows, _ = self.rows_of(self.page(), "Bricks")
        self.assertEqual({int(row[0]): int(row[5]) for row in rows if row and row[5] != "0"}, made.plans_failed)

    def test_uneventful_bricks_are_collapsed(self):
        made = self.make(8)
        for path in (self.folder / "pictures").iterdir():
            path.unlink()
        self.assertEqual(self.report().returncode, 0)
        rows, part = self.rows_of(self.page(), "Bricks")
        self.assertEqual(len([row for row in rows if row]), 8)
        shown, hidden = part.split("<details>")
        eventful = {*made.plans_failed, 7}  # 7 falls
        self.assertEqual({int(brick) for brick in re.findall(r'<tr><td class="n">(\d+)', shown)}, eventful)
        self.assertIn(f"{8 - len(eventful)} bricks without a failure", hidden)

    def test_success_is_no_failure(self):
        self.make_without_maps()
        done = self.report()
        rows, _ = self.rows_of(self.page(), "What failed, and what was done about it")
        self.assertNotIn("no pile", done.stdout + str(rows))
        self.assertEqual(self.summary()["failures"]["select: no pile"], 1, "the mission's own figures stay")
        # It is one where bricks are left, and where it does not end the mission.
        path = self.folder / "summary.json"
        path.write_text(json.dumps({**self.summary(), "end_reason": "nothing_worth_going"}))
        self.assertIn("1 x select: no pile", self.report("--summary-only").stdout)
        path.write_text(json.dumps({**self.summary(), "end_reason": "no_brick_left", "failures": {"select: no pile": 3}}))
        self.assertIn("2 x select: no pile", self.report("--summary-only").stdout)

    def test_failures_have_a_cause_and_a_consequence(self):
        self.make_without_maps()
        self.assertEqual(self.report().returncode, 0)
        rows, part = self.rows_of(self.page(), "What failed, and what was done about it")
        self.assertEqual(re.findall("<th.*?>(.*?)</th>", part), ["what", "times", "last at", "why", "then"])
        told = {row[0]: row[3:] for row in rows if row}
        self.assertEqual(told["plan_pick: approach blocked"], ["its neighbour is in the way", "went on with the next brick or view"])
        self.assertEqual(told["drive: obstacle"], ["an obstacle on the path stays", "told the choice of views"])

    def test_page_tells_date_host_commit_and_command(self):
        self.make_without_maps()
        self.assertEqual(self.report().returncode, 0)
        for words in ("2026-01-02 03:04:05 UTC, on workbench, commit 0123456789", "scripts/run_mission --run results/made --seed 1"):
            self.assertIn(words, self.page().text)
        for text, wanted in (("scripts/run_mission --seed 1\n", {"command": "scripts/run_mission --seed 1"}), ("", {}), ("x\nhost\ncommit: \ndate: d\nother: y", {"command": "x", "date": "d"})):
            (self.folder / ".run_mission").write_text(text)
            self.assertEqual(mission_run.Run(self.folder).origin, wanted)
            self.assertEqual(self.report().returncode, 0)

    def test_page_tells_the_parameters_that_are_not_the_shipped_ones(self):
        self.make_without_maps()
        parameters = self.folder / "parameters.yaml"
        parameters.write_text("pick_mission: {bricks: {order: nearest}, map_frame: map, of_another_version: 1}\nnobody_ships_this: {a: 1}\n", encoding="utf-8")
        page = self.new_page()
        self.assertIn("pick_missionbricks/ordernearesthighest", page.text)
        for same in ("map_frame", "of_another_version", "nobody_ships_this"):
            self.assertNotIn(same, page.text)
        for given, row in (
                ("{gpis_mapping: {output: {rate_hz: 3}}}", ("gpis_mapping", "output/rate_hz", 3, 2)),
                ("{gpis_mapping: {map: {surface: {spacing_m: 0.03}}}}", ("gpis_mapping", "map/surface/spacing_m", 0.03, 0.02)),
                ("{octomap_baseline: {map: {resolution_m: 0.05}}}", ("octomap_baseline", "map/resolution_m", 0.05, 0.02)),
                ("{nbv_selection: {octomap_random: {choice: utility}}}", ("nbv_selection", "octomap_random/choice", "utility", "random_candidate")),
                ("{simulated_world: {clock: {mode: realtime}}}", ("simulated_world", "clock/mode", "realtime", "lockstep")),
                ("{brick_detection: {input: {use_depth: false}}}", ("brick_detection", "input/use_depth", False, True)),
                ('{brick_detection: {cuboids: {min_edges: 4}}, bringup: {detector: "surfaces\\n"}}', ("brick_detection", "cuboids/min_edges", 4, 3))):
            parameters.write_text(given, encoding="utf-8")
            self.assertEqual(report_mission.parameter_rows(mission_run.Run(self.folder)), [row])
        for broken in ("{", "- 1", "pick_mission: 3"):
            parameters.write_text(broken, encoding="utf-8")
            self.assertIn("parameters.yaml cannot be read", self.new_page().text)
        parameters.unlink()
        self.assertNotIn("differ from the shipped", self.new_page().text)

    def test_page_leads_to_the_run_before(self):
        self.make_without_maps()
        self.assertNotIn("The run before", self.new_page().text)
        for name, age_s in (("older", 200.0), ("just before", 100.0), ("later", -100.0)):
            page = self.folder.parent / name / "index.html"
            page.parent.mkdir()
            page.write_text("", encoding="utf-8")
            time_s = (self.folder / "mission.jsonl").stat().st_mtime - age_s
            os.utime(page, (time_s, time_s))
        page = self.new_page()
        self.assertIn("The run before: just before", page.text)
        address = next(link for link in page.links if "just before" in link)
        self.assertTrue((self.folder / address).is_file())

    def test_standing_poses_are_those_driven_to(self):
        made = self.make_without_maps()
        measured = [pose for _, pose in mission_run.Run(self.folder).standing_poses()]
        self.assertEqual(measured, made.standing)
        self.assertGreater(len(measured), 3)
        out = self.folder / "path.png"
        self.assertTrue(plot_mission.plot_path(mission_run.Run(self.folder), out))
        # Without a path the log's goals are what is known, to a centimetre.
        path = self.folder / "path.jsonl"
        path.write_text('{"time_s": 1, "base": [1, 2]}\n{"time_s": null, "base": [1, 2, 3]}\n{"base": 3}\n')
        told = [pose for _, pose in mission_run.Run(self.folder).standing_poses()]
        np.testing.assert_allclose(told, made.standing, atol=0.006)
        self.assertTrue(plot_mission.plot_path(mission_run.Run(self.folder), out))
        (self.folder / "mission.jsonl").write_text('{"time_s": 1, "state": "select", "decision": "drive", "reason": "at (1.2.3, 4) m, 5 rad"}\n'
                                                   '{"time_s": 2, "state": "drive", "event": "success"}\n')
        self.assertEqual(mission_run.Run(self.folder).standing_poses(), [])
        self.assertFalse(plot_mission.plot_path(mission_run.Run(self.folder), out))

    def test_maps_share_one_colour_scale(self):
        self.make(2)
        self.assertEqual(self.report().returncode, 0)
        page = (self.folder / "index.html").read_text()
        self.assertEqual(page.count('class="scale"'), 1)
        scale = page.split('class="scale">')[1].split("</div>")[0]
        self.assertIn("0.00", scale)
        self.assertEqual(scale.count("#"), 9, "colours")
        pictures = sorted((self.folder / "report").glob("map_*.png"))
        self.assertGreater(len(pictures), 1)
        for path in pictures:  # the shape of the world's pictures
            self.assertEqual(matplotlib.image.imread(path).shape[:2], (450, 800))

    def test_weights_of_the_factors_come_out_of_the_log(self):
        self.make()
        weights = mission_run.weights_of(mission_run.Run(self.folder).selections)
        for name, weight in run_folder.WEIGHTS.items():
            self.assertAlmostEqual(weights[name], weight, places=6, msg=name)
        broken = mission_run.Run(self.folder).selections
        broken[0]["segments"][0]["information"] += 0.1
        self.assertIsNone(mission_run.weights_of(broken), "a sum that they do not make")

    def test_a_factor_decides_where_another_view_is_the_best_without_it(self):
        rng = random.Random(3)

        def segment(travel, order, penalty=0.0):
            factors = {**dict.fromkeys(mission_run.FACTORS, 0.5), "travel": travel, "pick_order": order}
            return {"verdict": 0, "failure_penalty": penalty, "information": 0.4 * travel + 0.1 * order + 0.5 * 0.5, **{f"{name}_factor": value for name, value in factors.items()}}

        # The first is the best by travel alone, the second where it has not failed.
        choices = [{"outcome": 0, "segments": [segment(0.9, 0.1), segment(0.1, 0.9)]}, {"outcome": 0, "segments": [segment(0.5, 0.5, 0.9), segment(0.4, 0.5)]}]
        # Tell the weights apart; a single candidate is no choice.
        for _ in range(20):
            one = segment(0.0, 0.0)
            values = {name: rng.random() for name in mission_run.FACTORS}
            one.update({f"{name}_factor": value for name, value in values.items()},
                       information=0.4 * values["travel"] + 0.1 * values["pick_order"] + 0.5 / 3 * sum(values[name] for name in ("manipulability", "uncertainty", "frontier")))
            choices.append({"outcome": 0, "segments": [one]})
        self.assertEqual(mission_run.deciding_factors(choices), {"manipulability": 0, "pick_order": 0, "travel": 0.5, "uncertainty": 0, "frontier": 0, "failure_penalty": 0.5})
        self.assertEqual(mission_run.deciding_factors(choices[:1]), {}, "weights unknown")

    def test_crashed_run_is_reported_from_what_there_is(self):
        self.make(2)
        for name in ("judge.json", "summary.json", "mission_state.json"):
            (self.folder / name).unlink()
        (self.folder / "selections.jsonl").write_text("")
        lines = (self.folder / "mission.jsonl").read_text().splitlines()
        kept = lines[:len(lines) // 2]
        (self.folder / "mission.jsonl").write_text("\n".join(kept) + "\n" + lines[len(kept)][:25])
        rows = (self.folder / "judge.csv").read_text().splitlines()
        (self.folder / "judge.csv").write_text("\n".join(rows[:-5]) + "\n" + rows[-5][:9])
        for path in sorted((self.folder / "pictures").iterdir())[1:3]:
            path.write_bytes(path.read_bytes()[:300])
        done = self.report()
        self.assertEqual(done.returncode, 0, done.stderr)
        summary = self.summary()
        self.assertLessEqual(KEYS, set(summary))
        self.assertEqual(summary["end_reason"], "crashed")
        self.assertEqual(summary["bricks_picked"], json.loads(kept[-1])["bricks_picked"])
        self.assertEqual(summary["bricks_stowed"], int(rows[-6].split(",")[1]))
        page = self.page()
        for words in ("mission.jsonl: the last line is cut off", "judge.json is missing", "selections.jsonl is empty", "summary.json is missing", "judge.csv: 1 of"):
            self.assertIn(words, done.stdout)
            self.assertIn(words, page.text)
        again = self.report("--summary-only")
        self.assertEqual(again.returncode, 0)
        self.assertEqual(self.summary(), summary)

    def test_mission_that_was_broken_off_is_not_told_as_one_that_ended(self):
        self.make_without_maps()
        path = self.folder / "summary.json"  # as the mission leaves it at each step
        path.write_text(json.dumps({**json.loads(path.read_text()), "end_reason": "none", "end_message": ""}))
        lines = (self.folder / "mission.jsonl").read_text().splitlines()
        (self.folder / "mission.jsonl").write_text("\n".join(lines[:-2]) + "\n")
        done = self.report()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.summary()["end_reason"], "crashed")
        for words in ("The mission did not end by itself: its log breaks off.", "the mission's end: its summary is of its last step"):
            self.assertIn(words, done.stdout)
            self.assertIn(words, self.page().text)

    def test_robots_run_without_a_judge_is_drawn_from_the_log(self):
        made = self.make_without_maps()
        for name in ("judge.json", "judge.csv", "events.jsonl", ".run_mission"):
            (self.folder / name).unlink()
        done = self.report()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(f"{made.picked} bricks picked, by the mission's own count, in ", done.stdout)
        page = self.page()
        for word in ("simulat", "judge", "Missing", "Not everything"):
            self.assertNotIn(word, done.stdout + page.text)
        self.assertTrue((self.folder / "report/progress.png").exists())
        self.assertIn("Bricks over time.", page.text)
        self.assertIn("1970-01-01 00:00:13 UTC", page.text, "the log's first line, by the robot's clock")
        (self.folder / ".run_mission").write_text("")
        self.assertIn("the simulator did not end by itself", self.report("--summary-only").stdout)

    def test_missions_of_one_run_have_their_own_figures(self):
        made = self.make_without_maps()
        judge, rows = json.loads((self.folder / "judge.json").read_text()), (self.folder / "judge.csv").read_text().splitlines()
        alone = mission_run.merged_summary(mission_run.Run(self.folder))
        # The same once more, 1000 s later, in mission_2. Between the two the bricks are laid down again, and one falls.
        later = self.folder / "mission_2"
        later.mkdir()
        for name in ("mission.jsonl", "selections.jsonl"):
            entries = [json.loads(line) for line in (self.folder / name).read_text().splitlines()]
            (later / name).write_text("".join(json.dumps({**entry, "time_s": entry["time_s"] + 1000.0}) + "\n" for entry in entries))
        for name in ("summary.json", "mission_state.json"):
            shutil.copy(self.folder / name, later)
        events = [json.loads(line) for line in (self.folder / "events.jsonl").read_text().splitlines()]
        with open(self.folder / "events.jsonl", "a", encoding="utf-8") as stream:
            for event in ({"time_s": 1005.0, "event": "fall", "brick": 2}, *({**event, "time_s": event["time_s"] + 1000.0} for event in events)):
                stream.write(json.dumps(event) + "\n")
        with open(self.folder / "judge.csv", "a", encoding="utf-8") as stream:
            for line in rows[1:]:
                time_s, stowed, falls, dropped, collisions, load_contacts, coverage, precision, distance_m = line.split(",")
                stream.write(f"{float(time_s) + 1000.0:.3f},{stowed},{int(falls) + made.falls + 1},{dropped},{collisions},{load_contacts},{coverage or 0.5},{precision},"
                             f"{float(distance_m) + judge['distance_m']:.3f}\n")
        (self.folder / "judge.json").write_text(json.dumps({**judge, "falls": 2 * made.falls + 1, "distance_m": 2.0 * judge["distance_m"], "end_time_s": 2000.0}))
        for folder in (self.folder, later):
            run = mission_run.Run(folder)
            summary = mission_run.merged_summary(run)
            self.assertEqual(run.notes, [])
            for key in ("bricks_stowed", "bricks_total", "falls", "drops", "collisions", "sim_seconds", "end_reason"):
                self.assertEqual(summary[key], alone[key], (folder, key))
            for key in ("distance_m", "map_coverage", "map_precision"):
                self.assertAlmostEqual(summary[key], alone[key], places=3, msg=(folder, key))
            self.assertIsNone(summary["map_coverable"], "of the whole run alone")
            self.assertEqual([event["event"] for event in run.events], [event["event"] for event in events])
        (self.folder / "judge.json").unlink()  # it is still running
        self.folder = later
        done = self.report()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("4 bricks stowed in ", done.stdout)
        self.assertIn("one of several missions of a run", done.stdout)
        self.assertNotIn("simulator", done.stdout)
        self.assertEqual(len(self.page().addresses), 5, "plots; the pictures are of the first")
        (later / "mission.jsonl").write_text("")
        self.assertIn("4 bricks picked, by the mission's own count", self.report("--summary-only").stdout)

    def test_time_is_drawn_with_and_without_stowed_bricks(self):
        self.make_without_maps()
        path, out = self.folder / "events.jsonl", self.folder / "time.png"
        lines = path.read_text()
        for text in (lines, "", lines.replace('"time_s": ', '"time_s": 9'), lines.replace('"time_s": ', '"time_s": -')):
            path.write_text(text)
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # that there is no room for anything
                self.assertTrue(plot_mission.plot_time(mission_run.Run(self.folder), out))
            picture = matplotlib.image.imread(out)[:, :, :3]
            # The longest bar: as high as it ought to be, 0.72 of a row, which is 0.42 in of 110 pixels.
            longest = mission_run.ACTIVITIES[0][0]
            colour = matplotlib.colors.to_rgb(plot_mission.ACTIVITY_COLOURS[0])
            self.assertEqual(longest, "drives")
            bar = np.all(np.abs(picture[len(picture) // 2:] - colour) < 0.02, axis=2)
            self.assertGreater(bar.any(axis=1).sum(), 15, text)

    def test_plot_that_cannot_be_drawn_is_a_note(self):
        self.make_without_maps()
        run, out = mission_run.Run(self.folder), self.folder / "report"
        with unittest.mock.patch("interactive_mapping_tools.plot_mission.plot_utilities", side_effect=IndexError("no such\ncolumn")):
            drawn = plot_mission.draw(run, mission_run.merged_summary(run), out)
        self.assertEqual([path.name for path in drawn], ["progress.png", "path.png", "time.png", "places.png"])
        self.assertEqual(run.notes, ["utilities.png cannot be drawn: IndexError: no such column"])

    def test_rows_and_places_that_are_none_are_not_drawn(self):
        self.make_without_maps()
        path = self.folder / "judge.csv"
        header, *rows = path.read_text().splitlines()
        path.write_text("\n".join((header.replace("falls", "dropped"), "nan" + rows[0][6:], *rows, "inf" + rows[-1][6:])) + "\n")
        selections = [json.loads(line) for line in (self.folder / "selections.jsonl").read_text().splitlines()]
        selections = [row for row in selections if row["segments"]]
        for row in selections:
            for segment, midpoint in zip(row["segments"], (["x", "y"], None, 3, [1.0], [None, 1.0], [math.nan, 0.0], {"x": 1.0}, [[0.0], 1.0])):
                segment["midpoint"] = midpoint
        for best, row in enumerate(selections):
            row["best"] = best
        for segment in selections[-1]["segments"]:
            segment["midpoint"] = None
        (self.folder / "selections.jsonl").write_text("".join(json.dumps(row) + "\n" for row in selections))
        done = self.report()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertNotIn("cannot be drawn", done.stdout)
        self.assertTrue((self.folder / "report/places.png").exists())

    def test_summary_that_cannot_be_read_is_kept(self):
        for text in ('{"scene": "one_heap", "end_rea', "[]", "{}", '{"scene": "one_heap", "failures": ' + "[" * 100000):
            self.make_without_maps()
            (self.folder / "summary.json").write_text(text)
            for _ in range(2):
                done = self.report("--summary-only")
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertIn("Missing: the mission's summary cannot be read, summary.json.unreadable is it", done.stdout)
                self.assertNotIn("summary.json is missing", done.stdout)
                self.assertIn("It ended, but the reason is not known.", done.stdout)
                self.assertEqual((self.folder / "summary.json.unreadable").read_text(), text)
                self.assertEqual(self.summary()["bricks_stowed"], 4)
            shutil.rmtree(self.folder)

    def test_numbers_that_are_none_do_no_harm(self):
        self.make_without_maps()
        rows = [json.loads(line) for line in (self.folder / "selections.jsonl").read_text().splitlines()]
        for row in rows:
            for segment in row["segments"][::2]:
                segment.update(utility=None, manipulability_factor=None, information=None, distance="far", midpoint=None)
        rows[0]["best"] = 999
        rows.append({"time_s": None, "segments": ["no object"], "best": "none"})
        (self.folder / "selections.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
        (self.folder / "events.jsonl").write_text('{"event": "fall"}\n{"event": "stow", "brick": "x", "time_s": 1}\n[]\n')
        (self.folder / "summary.json").write_text('{"failures": 3, "bricks_picked": null, "end_reason": null}')
        done = self.report()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.page()

    def test_judges_figures_that_are_none_are_unknown(self):
        self.make_without_maps()
        judge = json.loads((self.folder / "judge.json").read_text())
        for exposed_m2, coverable_m2 in (("3.1", 3.0), (3.1, "3.0"), (0.0, 3.0), (-3.1, -3.0), (math.nan, 3.0), (3.1, math.inf), (3.1, None), ([], 1), (1e-300, 1e300)):
            (self.folder / "judge.json").write_text(json.dumps({**judge, "exposed_area_m2": exposed_m2, "coverable_area_m2": coverable_m2}))
            self.assertIsNone(mission_run.merged_summary(mission_run.Run(self.folder))["map_coverable"], (exposed_m2, coverable_m2))
        (self.folder / "judge.json").write_text(json.dumps({**judge, "stowed": -1, "falls": -2, "collisions": 10**400, "coverage": "all", "distance_m": 10**400}))
        done = self.report("--summary-only")
        self.assertEqual(done.returncode, 0, done.stderr)
        summary = self.summary()
        self.assertEqual([summary[key] for key in ("bricks_stowed", "falls", "collisions", "map_coverage", "distance_m")], [None] * 5)
        self.assertIn("4 of 4 bricks picked (100 %), by the mission's own count, in ", done.stdout)

    def test_tables_that_are_damaged_give_the_rows_that_are_whole(self):
        self.make_without_maps()
        path, memory = self.folder / "judge.csv", self.folder / "memory.csv"
        rows = path.read_text()
        memory.write_text("time_s,node,resident_mb\n" + "".join(f"{time_s},map,{time_s}\n" for time_s in range(101)))
        first = mission_run.merged_summary(mission_run.Run(self.folder))
        self.assertIn("map", first["memory"])
        for damage in (b"\0" * 200000, b"x" * 200000, b"nan,9,9,9,9,1,1,9", b"inf,9,9,9,9,1,1,9", b"1e999,9,9,9,9,1,1,9"):
            for text in (rows.encode() + damage, rows.encode().replace(b"\n", b"\n" + damage + b"\n", 1)):
                path.write_bytes(text)
                run = mission_run.Run(self.folder)
                self.assertIn(f"judge.csv: 1 of {len(rows.splitlines())} rows cannot be read", run.notes)
                self.assertEqual(mission_run.merged_summary(run), first)
        text = memory.read_bytes()
        memory.write_bytes(text + b"\0" * 200000)
        self.assertEqual(mission_run.merged_summary(mission_run.Run(self.folder)), first)
        path.write_text(rows.replace("falls", "stowed", 1))
        table = mission_run.Run(self.folder).table
        self.assertEqual({len(column) for column in table.values()}, {len(rows.splitlines()) - 1})

    def test_json_that_python_cannot_hold_is_named(self):
        self.make_without_maps()
        deep = {depth: "[" * depth + "]" * depth for depth in (100000, 900, 60)}
        for depth, text in deep.items():
            (self.folder / "mission_state.json").write_text(f'{{"bricks": {text}}}')
            (self.folder / "events.jsonl").write_text(f'{{"event": "fall", "brick": {text}}}\n')
            run = mission_run.Run(self.folder)
            self.assertEqual((run.bricks, run.events), ([], []))
            self.assertIn("mission_state.json cannot be read: nested too deeply", run.notes, depth)
        row = {"time_s": 10**400, "state": ["look"], "event": "x", "bricks_picked": 10**400, "failures": 10**400}
        with open(self.folder / "mission.jsonl", "a", encoding="utf-8") as log:
            log.write(json.dumps(row) + "\n" + json.dumps({**row, "time_s": 1e4}) + "\n")
        for name in ("world_1.2.3_001.png", "world_._001.png", "world_.5_001.png"):
            (self.folder / "pictures" / name).write_bytes(b"")
        done = self.report()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertNotIn("world_", done.stdout)

    def test_map_whose_header_tells_more_than_there_is_is_left_out(self):
        self.make(2)
        first, *others = sorted((self.folder / "pictures").glob("*.ply"))
        text = first.read_bytes()
        count = text.split(b"element vertex ")[1].split()[0]
        for other in others:
            other.unlink()
        ascii_header = b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n"
        for number, broken in enumerate((text.replace(b"vertex " + count, b"vertex 99999999999", 1), text.replace(b"vertex " + count, b"vertex -5", 1), ascii_header,
                                         text.replace(b"property float y", b"property float x", 1), text[:300])):
            (first.parent / f"map_{number:09.3f}_000.ply").write_bytes(broken)
        run = mission_run.Run(self.folder)
        out = self.folder / "report"
        out.mkdir()
        with unittest.mock.patch("interactive_mapping_tools.report_mission.pick_stages", lambda entries, wanted: entries):
            drawn, _ = report_mission.draw_maps(run, out)
        self.assertEqual([picture.stem for _, _, picture in drawn], [first.stem])
        self.assertEqual(len(run.notes), 5, run.notes)
        for number, note in enumerate(run.notes):
            self.assertIn(f"map_{number:09.3f}_000.ply", note)

    def test_words_that_are_none_are_told_and_left_out(self):
        self.make_without_maps()
        summary = json.loads((self.folder / "summary.json").read_text())
        (self.folder / "summary.json").write_text(json.dumps({**summary, "end_reason": ["time_up"], "end_message": 3, "scene": {}}))
        done = self.report()
        self.assertEqual(done.returncode, 0, done.stderr)
        for key in ("end_reason", "end_message", "scene"):
            self.assertIn(f"Missing: summary.json: {key} is no text.", done.stdout)
        self.assertEqual(self.summary()["end_reason"], "crashed")
        self.page()

    def test_text_of_nodes_cannot_change_the_page(self):
        self.make_without_maps()
        summary = json.loads((self.folder / "summary.json").read_text())
        summary.update(end_message="<script>alert(1)</script> & <b>", scene="</title><h1>")
        (self.folder / "summary.json").write_text(json.dumps(summary))
        self.assertEqual(self.report().returncode, 0)
        self.assertNotIn("<script", (self.folder / "index.html").read_text())
        self.assertIn("<script>alert(1)</script> & <b>", self.page().text)

    def test_what_is_no_run_folder_is_refused(self):
        self.assertEqual(self.report().returncode, 1)
        self.folder.mkdir()
        done = self.report()
        self.assertEqual(done.returncode, 1)
        self.assertIn("no mission left anything there", done.stderr)
        self.assertEqual(list(self.folder.iterdir()), [], "nothing is written there")

    def test_durations_are_rounded_as_people_read_them(self):
        self.assertEqual([mission_run.duration(value) for value in (0, 59.6, 754.2, 3599.7, 7325, None, math.nan)],
                         ["0:00 min", "1:00 min", "12:34 min", "1:00:00 h", "2:02:05 h", "?", "?"])


if __name__ == "__main__":
    rosunit.unitrun("experiments", "test_report_mission", ReportMission)
