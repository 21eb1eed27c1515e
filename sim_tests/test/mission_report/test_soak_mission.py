#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""What scripts/soak_mission.py runs, and how it judges; without a mission."""

import csv
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

import rosunit

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[3] / "scripts"))

import soak_mission  # noqa: E402


def case_of(disturbance="kill", state="pick"):
    return soak_mission.Case(0, disturbance, "gpis_mapping" if disturbance == "kill" else "", state, 1)


def facts_of(**changes):
    facts = {"happened": True, "back_wall_s": 2.0, "end_reason": "no_brick_left", "end_message": "", "picked": 4, "stowed": 4, "total": 4, "falls": 0,
             "drops": 0, "collisions": 0}
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
        self.expect("ended safely", case_of("unreachable_brick"), picked=3, stowed=3)
        self.expect("VIOLATION", case_of("move_brick"), picked=3, stowed=3)


class Table(unittest.TestCase):
    def row(self, number, verdict, scene="x", label="x"):
        return {**dict.fromkeys(soak_mission.COLUMNS, "x"), "number": number, "verdict": verdict, "seed": None, "scene": scene, "label": label}

    def write_all(self, path, verdict, scene, label):
        for case in soak_mission.plan():
            soak_mission.append(path, self.row(case.number, verdict, scene, label))

    def judge(self, folder, *options):
        return subprocess.run(["/usr/bin/python3", soak_mission.__file__, "--judge", "--out", str(folder), *options], capture_output=True, text=True,
                              timeout=60, check=False)

    def test_rows_come_back_but_for_one_that_was_cut_off(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "mission.csv"
            self.assertEqual(soak_mission.rows_of(path), [])
            for number in range(2):
                soak_mission.append(path, self.row(number, "recovered"))
            with open(path, "a", encoding="utf-8") as stream:
                stream.write("2,kill,x")
            rows = soak_mission.rows_of(path)
            self.assertEqual([row["number"] for row in rows], ["0", "1"])
            self.assertEqual(rows[0]["seed"], "")
            soak_mission.append(path, self.row(2, "recovered"))
            self.assertEqual([(row["number"], row["end_message"]) for row in soak_mission.rows_of(path)], [("0", "x"), ("1", "x"), ("2", "x")])

    def test_a_table_without_labels_is_gone_on_with(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "mission.csv"
            columns = [column for column in soak_mission.COLUMNS if column != "label"]
            with open(path, "w", newline="", encoding="utf-8") as stream:
                writer = csv.DictWriter(stream, columns, extrasaction="ignore")
                writer.writeheader()
                writer.writerow(self.row(0, "ended safely"))
            soak_mission.append(path, self.row(1, "recovered", label="new"))
            rows = soak_mission.rows_of(path)
            self.assertEqual([(row["number"], row["verdict"], row["label"], row["end_message"]) for row in rows],
                             [("0", "ended safely", "", "x"), ("1", "recovered", "new", "x")])

    def test_only_rows_of_this_scene_and_state_of_the_software_count(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "mission.csv"
            self.write_all(path, "recovered", "four_bricks", "old")
            done = self.judge(folder, "--label", "old")
            self.assertEqual((done.returncode, done.stdout), (0, "186 of 186 missions: 186 recovered\n"))
            self.assertEqual(self.judge(folder).returncode, 0, "without a label the scene alone is compared")
            for options in (("--label", "new"), ("--label", ""), ("--scene", "single_brick"), ("--scene", "single_brick", "--label", "old")):
                done = self.judge(folder, *options)
                self.assertEqual(done.returncode, 1, options)
                self.assertEqual(done.stdout, "0 of 186 missions: none\n186 rows of another scene or state of the software are not counted\n")
            soak_mission.append(path, self.row(0, "recovered", "four_bricks", "new"))
            self.assertEqual(self.judge(folder, "--label", "new").returncode, 3)
            rows, cases = soak_mission.rows_of(path), soak_mission.plan()
            self.assertEqual(soak_mission.left_of(cases, soak_mission.of_this(rows, "four_bricks", "old")), [])
            self.assertEqual(soak_mission.left_of(cases, soak_mission.of_this(rows, "four_bricks", "new")), cases[1:])

    def test_what_was_not_met_is_tried_again_last_and_is_no_pass(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "mission.csv"
            self.write_all(path, "not met", "four_bricks", "now")
            done = self.judge(folder, "--label", "now")
            self.assertEqual((done.returncode, done.stdout), (3, "0 of 186 missions: 186 not met\n"))
        cases = soak_mission.plan()[:4]
        rows = [self.row(str(number), verdict) for number, verdict in ((0, "not met"), (1, "recovered"), (2, "not met"), (2, "ended safely"))]
        self.assertEqual([case.number for case in soak_mission.left_of(cases, rows)], [3, 0])

    def test_a_call_tries_each_that_is_left_once(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "mission.csv"
            self.write_all(path, "recovered", "four_bricks", "old")
            soak_mission.append(path, self.row(1, "recovered", "four_bricks", "new"))
            tried = []

            def never_met(command):
                tried.append(int(command[command.index("--only") + 1]))
                soak_mission.append(path, self.row(tried[-1], "not met", "four_bricks", "new"))
                self.assertIn("--label=new", command)
                # run_mission would take another path as relative to the repository.
                self.assertEqual(command[command.index("--out") + 1], str(pathlib.Path(folder).resolve()))
                return 0

            cases = soak_mission.plan()[:4]
            arguments = ["soak_mission.py", "--out", os.path.relpath(folder), "--label", "new"]
            for _ in range(2):
                with unittest.mock.patch("soak_mission.subprocess.call", never_met), unittest.mock.patch("soak_mission.plan", lambda: cases), \
                        unittest.mock.patch("sys.argv", arguments):
                    self.assertEqual(soak_mission.main(), 3)
            self.assertEqual(tried, [0, 2, 3] * 2)

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
            self.assertEqual(self.judge(folder).stdout, "0 of 186 missions: none\n")

    def test_exit_code_tells_violation_all_and_some(self):
        rows = [self.row(0, "recovered"), self.row(1, "ended safely")]
        self.assertEqual(soak_mission.judged(rows, 2), 0)
        self.assertEqual(soak_mission.judged(rows, 3), 3)
        self.assertEqual(soak_mission.judged(rows + [self.row(2, "VIOLATION")], 3), 1)
        self.assertEqual(soak_mission.judged([], 3), 1)
        # Of one that was run again the last counts.
        self.assertEqual(soak_mission.judged([self.row(1, "VIOLATION")] + rows, 2), 0)
        self.assertEqual(soak_mission.judged(rows + [self.row(1, "VIOLATION")], 2), 1)


class SoakMission(Plan, Verdict, Table):
    """rosunit takes one."""


if __name__ == "__main__":
    rosunit.unitrun("sim_tests", "test_soak_mission", SoakMission)
