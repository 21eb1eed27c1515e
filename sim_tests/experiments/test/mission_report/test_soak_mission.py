#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""What scripts/soak_mission.py runs, and how it and scripts/soak_endurance.py judge; without a mission."""

import csv
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import unittest.mock

import rosunit

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[4] / "tools"))

from interactive_mapping_tools import run_mission, soak_endurance, soak_mission  # noqa: E402


def case_of(disturbance="kill", state="pick", number=0):
    return soak_mission.Case(number, disturbance, "gpis_mapping" if disturbance == "kill" else "", state, "gpis_mapping")


def facts_of(**changes):
    facts = {"happened": True, "back_wall_s": 2.0, "end_reason": "no_brick_left", "end_message": "", "picked": 4, "stowed": 4, "total": 4,
             "taken_away": 0, "falls": 0, "drops": 0, "collisions": 0}
    unknown = set(changes) - set(facts)
    assert not unknown, unknown
    return {**facts, **changes}


class Plan(unittest.TestCase):
    def test_has_each_node_in_each_state_once_and_each_fault(self):
        cases = soak_mission.plan()
        self.assertEqual([case.number for case in cases], list(range(len(cases))))
        kills = [(case.node, case.state) for case in cases if case.disturbance == "kill"]
        self.assertEqual(sorted(kills), sorted((node, state) for node in soak_mission.NODES for state in soak_mission.STATES))
        faults = [case.disturbance for case in cases if case.disturbance != "kill"]
        self.assertEqual(sorted(faults), sorted(list(soak_mission.FAULTS) * soak_mission.FAULTS_EACH))

    def test_is_the_same_each_time(self):
        self.assertEqual(soak_mission.plan(), soak_mission.plan())


    def test_missions_have_one_node_or_one_of_each_fault(self):
        missions = soak_mission.missions_of(soak_mission.plan())
        self.assertEqual(len(missions), len(soak_mission.NODES) + 2 * soak_mission.FAULTS_EACH)
        for mission in missions:
            self.assertEqual(len({case.node for case in mission}), 1)
            self.assertEqual(len({(case.disturbance, case.state) for case in mission}), len(mission))


class NextStep(unittest.TestCase):
    def step(self, state, *wanted, is_carrying=False):
        """What comes: a disturbance's kind, what leads to one, or None."""
        pending = [case_of(kind, state, number) for number, (kind, state) in enumerate(wanted)]
        case, lead = soak_mission.next_step(state, is_carrying, pending)
        self.assertTrue(case is None or lead is None)
        return (case.disturbance, case.number) if case else lead

    def test_what_is_for_this_state_comes_in_the_plans_order(self):
        self.assertEqual(self.step("look", ("kill", "pick"), ("camera_gone", "look"), ("move_brick", "look")), ("camera_gone", 1))
        self.assertIsNone(self.step("look", ("kill", "pick"), ("kill", "drive")))
        self.assertIsNone(self.step("pick"))

    def test_a_brick_falls_when_there_is_one_in_the_hand(self):
        self.assertIsNone(self.step("pick", ("drop_brick", "pick")))
        self.assertEqual(self.step("pick", ("drop_brick", "pick"), is_carrying=True), ("drop_brick", 0))
        self.assertEqual(self.step("pick", ("drop_brick", "pick"), ("driver_gone", "pick")), ("driver_gone", 1))

    def test_a_mission_that_waits_for_a_person_goes_on(self):
        for state, lead in (("idle", "start"), ("paused", "resume"), ("held", "resume")):
            self.assertEqual(self.step(state, ("kill", "look")), lead)
            self.assertEqual(self.step(state), lead)
            self.assertEqual(self.step(state, ("kill", state)), ("kill", 0))

    def test_each_state_that_does_not_come_by_itself_is_led_to(self):
        cases = {"paused": ("look", False, "pause"), "halting": ("pick", False, "hold"), "held": ("pick", False, "hold"), "plan_stow": ("pick", True, "hold"),
                 "stow": ("pick", True, "hold"), "let_go": ("pick", True, "hold"), "recover": ("pick", True, "protective_stop"),
                 "wait": ("drive", False, "localisation_gone"), "report": ("pick", False, "take_away")}
        self.assertEqual(set(cases) | {"idle"}, set(soak_mission.STATES[soak_mission.STATES.index("idle"):]))
        for wanted, (state, is_carrying, lead) in cases.items():
            self.assertEqual(self.step(state, ("kill", wanted), is_carrying=is_carrying), lead, wanted)
            # A mission of faults is led nowhere.
            self.assertIsNone(self.step(state, ("camera_gone", wanted), is_carrying=is_carrying), wanted)

    def test_a_brick_is_taken_away_last(self):
        self.assertIsNone(self.step("pick", ("kill", "report"), ("kill", "recover")))
        self.assertEqual(self.step("pick", ("kill", "report"), ("kill", "recover"), is_carrying=True), "protective_stop")
        self.assertEqual(self.step("pick", ("kill", "report"), ("kill", "held")), "hold")


class Verdict(unittest.TestCase):
    def expect(self, verdict, case, **changes):
        result, why = soak_mission.verdict(case, facts_of(**changes))
        self.assertEqual(result, verdict, (changes, why))
        self.assertTrue(why or result == "recovered")

    def test_recovered_is_a_pile_that_is_gone(self):
        self.expect("recovered", case_of())
        # The mission may not know of a brick whose pick it did not see end.
        self.expect("recovered", case_of(), end_reason="bricks_exhausted", end_message="one is left", picked=3)

    def test_ended_safely_needs_a_reason_in_words(self):
        self.expect("ended safely", case_of(), end_reason="needs_person", end_message="it has stopped", picked=2, stowed=2)
        self.expect("VIOLATION", case_of(), end_reason="needs_person", picked=2, stowed=2)

    def test_what_the_judge_saw_counts_whatever_the_mission_says(self):
        for key in ("collisions", "falls", "drops"):
            self.expect("VIOLATION", case_of(), **{key: 1})
        for key in ("collisions", "falls", "drops", "stowed", "total"):
            self.expect("VIOLATION", case_of(), **{key: None})
        self.expect("VIOLATION", case_of(), stowed=3)
        self.expect("VIOLATION", case_of(), end_reason="bricks_exhausted", end_message="one is left", stowed=3)

    def test_a_mission_that_does_not_end_is_a_violation(self):
        for reason in ("", "none", "crashed"):
            self.expect("VIOLATION", case_of(), end_reason=reason, end_message="x", picked=2, stowed=2)

    def test_a_node_that_does_not_come_back_is_a_violation(self):
        self.expect("VIOLATION", case_of(), back_wall_s=None)
        self.expect("recovered", case_of("camera_gone"), back_wall_s=None)

    def test_what_did_not_happen_proves_nothing(self):
        self.expect("not met", case_of(), happened=False, back_wall_s=None)
        self.expect("VIOLATION", case_of(), happened=False, collisions=1)

    def test_a_dropped_brick_may_fall_once_and_no_other(self):
        self.expect("recovered", case_of("drop_brick"), drops=1, falls=1)
        self.expect("VIOLATION", case_of("drop_brick"), drops=2)
        self.expect("VIOLATION", case_of("drop_brick"), falls=2)
        self.expect("VIOLATION", case_of("camera_gone"), drops=1)

    def test_a_brick_that_was_carried_away_may_be_unknown(self):
        self.expect("ended safely", case_of("unreachable_brick"), picked=3, stowed=3, taken_away=1)
        self.expect("VIOLATION", case_of("unreachable_brick"), picked=2, stowed=2, taken_away=1)
        self.expect("VIOLATION", case_of("move_brick"), picked=3, stowed=3)

    def test_each_dropped_brick_of_a_mission_may_fall_once(self):
        kill, drop = case_of(), case_of("drop_brick")
        self.assertEqual(soak_mission.verdict(kill, facts_of(falls=1, drops=1), [kill, drop])[0], "recovered")
        self.assertEqual(soak_mission.verdict(kill, facts_of(falls=2, drops=1), [kill, drop])[0], "VIOLATION")
        self.assertEqual(soak_mission.verdict(drop, facts_of(falls=1, drops=1), [kill])[0], "VIOLATION", "it was not met")


class Table(unittest.TestCase):
    def row(self, number, verdict, scene="x", label="x"):
        return {**dict.fromkeys(soak_mission.COLUMNS, "x"), "number": number, "verdict": verdict, "seed": None, "scene": scene, "label": label}

    def write_all(self, path, verdict, scene, label):
        soak_mission.append(path, [self.row(case.number, verdict, scene, label) for case in soak_mission.plan()])

    def judge(self, folder, *options):
        return subprocess.run([str(soak_mission.ROOT / "scripts/soak_mission.py"), "--judge", "--out", str(folder), *options], capture_output=True, text=True,
                              timeout=60, check=False)

    def test_rows_come_back_but_for_one_that_was_cut_off(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "mission.csv"
            self.assertEqual(soak_mission.rows_of(path), [])
            for number in range(2):
                soak_mission.append(path, [self.row(number, "recovered")])
            with open(path, "a", encoding="utf-8") as stream:
                stream.write("2,kill,x")
            rows = soak_mission.rows_of(path)
            self.assertEqual([row["number"] for row in rows], ["0", "1"])
            self.assertEqual(rows[0]["seed"], "")
            soak_mission.append(path, [self.row(2, "recovered")])
            self.assertEqual([(row["number"], row["end_message"]) for row in soak_mission.rows_of(path)], [("0", "x"), ("1", "x"), ("2", "x")])

    def test_only_rows_of_this_scene_and_state_of_the_software_count(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "mission.csv"
            self.write_all(path, "recovered", "four_bricks", "old")
            done = self.judge(folder, "--label", "old")
            self.assertEqual((done.returncode, done.stdout), (0, "204 of 204 disturbances: 204 recovered\n"))
            self.assertEqual(self.judge(folder).returncode, 0, "without a label the scene alone is compared")
            for options in (("--label", "new"), ("--label", ""), ("--scene", "single_brick"), ("--scene", "single_brick", "--label", "old")):
                done = self.judge(folder, *options)
                self.assertEqual(done.returncode, 1, options)
                self.assertEqual(done.stdout, "0 of 204 disturbances: none\n204 rows of another scene or state of the software are not counted\n")
            soak_mission.append(path, [self.row(0, "recovered", "four_bricks", "new")])
            self.assertEqual(self.judge(folder, "--label", "new").returncode, 3)
            rows, cases = soak_mission.rows_of(path), soak_mission.plan()
            self.assertEqual(soak_mission.left_of(cases, soak_mission.of_this(rows, "four_bricks", "old")), [])
            self.assertEqual(soak_mission.left_of(cases, soak_mission.of_this(rows, "four_bricks", "new")), cases[1:])

    def test_what_was_not_met_is_tried_again_last_and_is_no_pass(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "mission.csv"
            self.write_all(path, "not met", "four_bricks", "now")
            done = self.judge(folder, "--label", "now")
            self.assertEqual((done.returncode, done.stdout), (3, "0 of 204 disturbances: 204 not met\n"))
        cases = soak_mission.plan()[:4]
        rows = [self.row(str(number), verdict) for number, verdict in ((0, "not met"), (1, "recovered"), (2, "not met"), (2, "ended safely"))]
        self.assertEqual([case.number for case in soak_mission.left_of(cases, rows)], [0, 3])

    def run_with(self, folder, cases, num_met, *options):
        """The missions that one call begins, when of each this many disturbances are met."""
        begun, path = [], pathlib.Path(folder) / "mission.csv"

        def mission(command):
            self.assertIn("--label=new", command)
            # run_mission would take another path as relative to the repository.
            self.assertEqual(command[command.index("--out") + 1], str(pathlib.Path(folder).resolve()))
            numbers = [int(number) for number in command[command.index("--only") + 1:]]
            begun.append(numbers)
            soak_mission.append(path, [self.row(number, "recovered" if index < num_met else "not met", "four_bricks", "new") for index, number in enumerate(numbers)])
            return 0

        arguments = ["soak_mission.py", "--out", os.path.relpath(folder), "--label", "new", *options]
        with unittest.mock.patch("interactive_mapping_tools.soak_mission.run_child", mission), unittest.mock.patch("interactive_mapping_tools.soak_mission.plan", lambda: cases), \
                unittest.mock.patch("sys.argv", arguments):
            return begun, soak_mission.main()

    def test_what_is_left_comes_again_as_long_as_it_gets_less(self):
        cases = [case for case in soak_mission.plan() if case.mission in ("gpis_mapping", "faults_0")]
        cases = [soak_mission.Case(number, case.disturbance, case.node, case.state, case.mission) for number, case in enumerate(cases[:20])]
        self.assertEqual([len(mission) for mission in soak_mission.missions_of(cases)], [18, 2])
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "mission.csv"
            self.write_all(path, "recovered", "four_bricks", "old")
            soak_mission.append(path, [self.row(1, "recovered", "four_bricks", "new")])
            self.assertEqual(self.run_with(folder, cases, 0), ([[0, *range(2, 18)], [18, 19]], 3))
            self.assertEqual(self.run_with(folder, cases, 10), ([[0, *range(2, 18)], [18, 19], list(range(11, 18))], 0))
            self.assertEqual(self.run_with(folder, cases, 10), ([], 0))
        with tempfile.TemporaryDirectory() as folder:
            self.assertEqual(self.run_with(folder, cases, 10, "--mission", "faults_0"), ([[18, 19]], 0))

    def test_what_is_no_table_is_refused_in_one_line(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "mission.csv"
            header = ",".join(soak_mission.COLUMNS)
            for content, words in ((b"\x80\x00\xff\n", "mission.csv: "), (header.replace("number,", "").encode() + b"\n1,2\n", "no column number"),
                                   (header.replace(",end_message", "").encode() + b"\n", "no column end_message")):
                path.write_bytes(content)
                done = self.judge(folder)
                self.assertEqual((done.returncode, done.stdout), (2, ""), done.stderr)
                self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
                self.assertIn(words, done.stderr)
                self.assertEqual(path.read_bytes(), content)
            path.write_bytes(b"")
            self.assertEqual(self.judge(folder).stdout, "0 of 204 disturbances: none\n")

    def test_tables_have_each_kill_fault_and_mission(self):
        rows = []
        for case in soak_mission.plan():
            row = {**self.row(str(case.number), "recovered"), "disturbance": case.disturbance, "node": case.node, "state": case.state, "mission": case.mission}
            rows.append({**row, "on_s": "1.25", "sim_s": "100.0", "seed": "1"})
        rows[0]["verdict"], rows[0]["on_s"] = "VIOLATION", ""
        rows[1]["verdict"], rows[19]["verdict"] = "not met", "ended safely"
        lines = soak_mission.tables(rows).splitlines()
        self.assertEqual(lines[0].count("|"), len(soak_mission.NODES) + 2)
        self.assertEqual(lines[2].split(" | ")[:3], ["| plan_clear", "0 **V**", "1.2"])
        self.assertEqual(lines[3].split(" | ")[1:3], ["-", "1.2 e"])
        self.assertIn("| obstacle | drive | 1.2, 1.2, 1.2 |", lines)
        self.assertIn("| gpis_mapping | 18 | x | x | x, x, x | 100 | x |", lines)
        self.assertIn("| pick_mission | 17 | x | x | x, x, x | 100 | x |", lines)

    def test_exit_code_tells_violation_all_and_some(self):
        rows = [self.row(0, "recovered"), self.row(1, "ended safely")]
        self.assertEqual(soak_mission.judged(rows, 2), 0)
        self.assertEqual(soak_mission.judged(rows, 3), 3)
        self.assertEqual(soak_mission.judged(rows + [self.row(2, "VIOLATION")], 3), 1)
        self.assertEqual(soak_mission.judged([], 3), 1)
        # Of one that was run again the last counts.
        self.assertEqual(soak_mission.judged([self.row(1, "VIOLATION")] + rows, 2), 0)
        self.assertEqual(soak_mission.judged(rows + [self.row(1, "VIOLATION")], 2), 1)


class Ending(unittest.TestCase):
    FAKE = "#!/bin/bash\ntrap 'sleep 0.5; echo ended >>{0}; exit' TERM\necho begun >>{0}\nwhile true; do sleep 0.1; done\n"
    MISSION = """
import pathlib, sys
sys.path.insert(0, {tools!r})
from interactive_mapping_tools import soak_mission
soak_mission.ROOT = pathlib.Path({tree!r})
soak_mission.end_in_order()
mission = soak_mission.WatchedMission(soak_mission.ROOT / "run", 1, "x", 1)
mission.launch([], [])
try:
    mission.process.wait()
finally:
    mission.end()
"""
    PARENT = "import sys; sys.path.insert(0, {tools!r}); from interactive_mapping_tools import soak_mission; soak_mission.end_in_order(); soak_mission.run_child([sys.executable, {child!r}])"

    def test_one_that_is_told_to_end_ends_its_mission(self):
        tools = str(pathlib.Path(soak_mission.__file__).parents[1])
        with tempfile.TemporaryDirectory() as folder:
            tree = pathlib.Path(folder)
            said, child, fake = tree / "said", tree / "child.py", tree / "scripts/run_mission"
            fake.parent.mkdir()
            fake.write_text(self.FAKE.format(said), encoding="utf-8")
            fake.chmod(0o755)
            child.write_text(self.MISSION.format(tools=tools, tree=folder), encoding="utf-8")
            parent = ["-c", self.PARENT.format(tools=tools, child=str(child))]
            for arguments, told, code in (([str(child)], signal.SIGTERM, 143), (parent, signal.SIGTERM, 143), (parent, signal.SIGINT, -signal.SIGINT)):
                said.write_text("", encoding="utf-8")
                process = subprocess.Popen(["/usr/bin/python3", *arguments], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                self.addCleanup(process.kill)
                end = time.monotonic() + 60.0
                while not said.read_text(encoding="utf-8"):
                    self.assertLess(time.monotonic(), end, "the mission does not begin")
                    time.sleep(0.02)
                process.send_signal(told)
                self.assertEqual(process.wait(60.0), code)
                self.assertEqual(said.read_text(encoding="utf-8"), "begun\nended\n")

    def test_run_mission_ends_what_carries_its_mark(self):
        with tempfile.TemporaryDirectory() as folder, unittest.mock.patch("signal.signal"):
            launched = run_mission.Launched(pathlib.Path(folder), f"{os.getpid()}-1")

            def start(mark):
                process = subprocess.Popen(["bash", "-c", "trap '' TERM; echo; sleep 60 & wait"], env={**os.environ, "RUN_MISSION_MARK": mark}, start_new_session=True,
                                           stdout=subprocess.PIPE)
                self.addCleanup(process.wait)
                self.addCleanup(process.kill)
                process.stdout.read(1)  # it ignores the request from now on
                return process
            left, other = start(launched.mark), start(launched.mark + "0")
            launched.end()
            self.assertEqual(left.wait(60.0), -signal.SIGKILL)
            self.assertEqual(list(launched.marked()), [])
            self.assertIsNone(other.poll(), "it is of another run")


class Endurance(unittest.TestCase):
    def growth(self, samples):
        """Of one node that holds so many MB at equal steps of time."""
        return soak_endurance.growth_of([(10.0 * (i + 1), "map", mb) for i, mb in enumerate(samples)])

    def problems(self, growth=None, missions=20, **changes):
        """Of so many missions as they should be, the last with these changes."""
        row = {"bricks": 4, "stowed": 4, "falls": 0, "drops": 0, "collisions": 0}
        return soak_endurance.problems_of([row] * (missions - 1) + [{**row, **changes}], growth or {})

    def test_what_a_launch_leaves_behind_is_found_by_its_master(self):
        master = "http://localhost:1"
        left = subprocess.Popen(["sleep", "60"], env={**os.environ, "ROS_MASTER_URI": master}, start_new_session=True)
        self.addCleanup(left.wait)
        self.addCleanup(left.kill)
        end = time.monotonic() + 60.0
        while not pathlib.Path(f"/proc/{left.pid}/environ").read_bytes():  # on a loaded machine it comes a little after the process
            self.assertLess(time.monotonic(), end, "it has no environment")
            time.sleep(0.01)
        self.assertEqual(list(soak_endurance.started_for(master)), [left.pid])
        self.assertEqual(list(soak_endurance.started_for(master + "0")), [])

    def test_second_and_last_quarter_are_compared(self):
        self.assertEqual(self.growth([10.0] * 10 + [20.0] * 10 + [90.0] * 10 + [30.0] * 10), {"map": (20.0, 30.0)})
        with self.assertRaisesRegex(ValueError, "nobody has looked"):
            self.growth([])
        with self.assertRaisesRegex(ValueError, "map has not been there"):
            self.growth([1.0])

    def endurance(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        endurance = soak_endurance.Endurance(pathlib.Path(folder.name), 1, "four_bricks", 1, 0.1)
        endurance.now_s = lambda: 5.0
        return endurance

    def test_a_node_that_was_started_anew_is_a_problem(self):
        other = subprocess.Popen(["sleep", "60"])
        self.addCleanup(other.wait)
        self.addCleanup(other.kill)
        endurance, pids, stop = self.endurance(), [os.getpid(), os.getpid(), None, other.pid, other.pid], unittest.mock.Mock()
        stop.wait.side_effect = [False] * len(pids) + [True]
        endurance.map = unittest.mock.Mock(map_points=123)
        endurance.pid_of = lambda node: pids.pop(0) if node == "gpis_mapping" else None
        endurance.watch_memory(stop)
        self.assertEqual(endurance.problems, ["5 s: gpis_mapping was restarted"])
        self.assertEqual(len(endurance.memory), 4)
        self.assertEqual(len((endurance.folder / "memory.csv").read_text().splitlines()), 5)
        self.assertEqual((endurance.folder / "map.csv").read_text().split(), ["time_s,map_points", *["5.00,123"] * 5])

    def test_a_brick_that_cannot_be_laid_down_is_a_problem(self):
        endurance = self.endurance()
        endurance.rospy = unittest.mock.Mock(ROSException=OSError, ServiceException=OSError)
        endurance.state = unittest.mock.Mock(bricks=[unittest.mock.Mock(id=i, status=status, PICKED=2) for i, status in enumerate((2, 1, 2, 2))])
        endurance.pose_like = lambda pose: pose
        endurance.notes.append("move_brick: brick_3 is there")
        endurance.inject = lambda kind, brick_id, pose: brick_id == 0 and pose == "left"
        self.assertEqual(endurance.lay_down({0: "left", 1: "middle", 2: "right"}), 1)
        self.assertEqual(endurance.problems, ["5.0 s: brick 2 cannot be laid down: move_brick: brick_3 is there"])
        endurance.inject = unittest.mock.Mock(side_effect=OSError("gone"))
        endurance.log = unittest.mock.Mock()
        with self.assertRaisesRegex(soak_mission.NotUp, "does not answer: gone"):
            endurance.lay_down({0: "left"})

    def test_what_went_wrong_on_the_way_back_counts_to_the_next_mission(self):
        endurance = self.endurance()
        endurance.state = unittest.mock.Mock(end_reason=1, NO_BRICK_LEFT=1, end_message="")
        counts = [unittest.mock.Mock(stowed=stowed, falls=0, drops=0, collisions=hits) for stowed, hits in ((4, 0), (0, 1), (3, 1))]
        before, laid, after = counts
        row = endurance.row(laid, before, after, 4, 60.0)
        self.assertEqual((row["stowed"], row["collisions"], row["end_reason"]), (3, 1, "no_brick_left"))

    def test_what_grows_is_named(self):
        self.assertEqual(self.problems({"map": (400.0, 424.0)}), [])
        self.assertEqual(self.problems({"map": (400.0, 426.0)}), ["map has grown from 400 to 426 MB"])
        self.assertEqual(self.problems({"map": (400.0, 300.0), "small": (2.0, 7.0)}), [])

    def test_of_what_holds_the_map_the_maps_growth_is_told(self):
        def problems(node, *points):
            return soak_endurance.problems_of([], {node: (400.0, 426.0)}, *points)

        self.assertEqual(problems("gpis_mapping", (100000, 120000)), ["gpis_mapping has grown from 400 to 426 MB, the map by 20%"])
        self.assertEqual(problems("pick_mission", (100000, 120000)), ["pick_mission has grown from 400 to 426 MB"])

    def test_missions_have_to_be_as_they_should(self):
        for changes, words in (({"collisions": 1}, "1 collisions, must be 0"), ({"drops": 2}, "2 drops, must be 0"), ({"falls": 3}, "3 falls in 20 missions"),
                               ({"bricks": 8, "stowed": 3}, "79 of 84 bricks stowed, must be 95% at least")):
            problems = self.problems(**changes)
            self.assertEqual(len(problems), 1, problems)
            self.assertIn(words, problems[0])
        self.assertEqual(self.problems(falls=2, stowed=0), [])


class SoakMission(Plan, NextStep, Verdict, Table, Ending, Endurance):
    """rosunit takes one."""


if __name__ == "__main__":
    rosunit.unitrun("experiments", "test_soak_mission", SoakMission)
