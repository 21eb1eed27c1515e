#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""scripts/campaign on made results: which of them count, which missions Snakemake runs, and the tables of a known CSV."""

import argparse
import base64
import contextlib
import csv
import fcntl
import io
import json
import os
import pathlib
import runpy
import shutil
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

import numpy as np
import rosunit
import scipy.stats
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[4]
sys.path.insert(0, str(ROOT / "tools"))

from interactive_mapping_tools import campaign, table_campaign, workspace  # noqa: E402
from interactive_mapping_tools.cli import Refusal, UsageError  # noqa: E402

ENDED = '{"event":"start","decision":"begin","time_s":12.0}\n{"event":"success","decision":"ended"}\n'
SUMMARY = {**dict.fromkeys(table_campaign.MEASURES, 1), "bricks_stowed": 3, "bricks_total": 4, "end_reason": "no_brick_left",
           "origin": {"software": "now", "configuration": "this", "commit": "c0ffee"}}
JUDGE = "time_s,stowed,coverage\n10.0,0,0.0\n12.0,0,0.5\n40.0,2,0.5\n52.0,3,1.0\n"
DEFINITION = """
wall_limit_s: 60
time_limit_s: {two_rows: 600, wall: 90.5}
cycles: {shipped: {}, paper: {mission_config: paper}}
variants: {complete: {}, no_travel: {removed_factor: travel}, random: {strategy: octomap_random}}
tables:
  one: {cycles: [paper, shipped], scenes: [two_rows], variants: [complete, no_travel], seeds: [101, 9]}
  two: {cycles: [paper], scenes: [two_rows, wall], variants: [complete, random], seeds: [101]}
"""
# Fails as often as the file of attempts says, then leaves a result that counts.
MISSION = """import pathlib, shutil, sys
folder, made, attempts = map(pathlib.Path, sys.argv[1:])
left = int(attempts.read_text())
attempts.write_text(str(left - 1))
if left <= 1:
    shutil.copytree(made, folder)
"""
# The first job reaches its time limit at once, others run to their end.
SLURM = {"sbatch": """#!/bin/bash
[ -e $JOBS/job1 ] || { echo -n JobState=TIMEOUT > $JOBS/job1; echo 1; exit; }
bash "${@: -1}" > /dev/null 2>&1 && state=COMPLETED || state=FAILED
echo -n JobState=$state > $JOBS/job2
echo 2
""", "scontrol": """#!/bin/bash
[ "$1 $2 $3" = "show job -o" ] && cat $JOBS/job$4
"""}


class Campaign(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="campaign_"))
        self.addCleanup(shutil.rmtree, self.folder)

    def make(self, name="run", summary=SUMMARY, log=ENDED, launch="", judge=JUDGE):
        """A result's folder, and the mission that it should be of."""
        folder = self.folder / name
        (folder / "log").mkdir(parents=True)
        (folder / "summary.json").write_text(summary if isinstance(summary, str) else json.dumps(summary))
        (folder / "mission.jsonl").write_text(log)
        (folder / "log/roslaunch.log").write_text(launch)
        (folder / "judge.csv").write_text(judge)
        return {"scene": "one_heap", "cycle": "paper", "variant": "complete", "seed": "1", "folder": str(folder), "software": "now", "configuration": "this"}

    def test_a_whole_result_counts(self):
        self.assertEqual(campaign.state_of(self.make()), (None, SUMMARY))

    def test_what_does_not_count_is_named(self):
        def of(**origin):
            return {**SUMMARY, "origin": {**SUMMARY["origin"], **origin}}

        cases = (({"summary": of(software="before")}, "stale: of commit c0ffee"), ({"summary": of(configuration="other")}, "stale: of another configuration"),
                 ({"summary": json.dumps(SUMMARY)[:80]}, "broken: JSONDecodeError"), ({"summary": "[]"}, "broken: TypeError"),
                 ({"summary": "[" * 100000}, "broken: "), ({"summary": {**SUMMARY, "falls": 10**400}}, "broken: OverflowError"),
                 ({"summary": {**SUMMARY, "bricks_stowed": None}}, "broken: ValueError"), ({"summary": {**SUMMARY, "falls": []}}, "broken: TypeError"),
                 ({"summary": {key: SUMMARY[key] for key in SUMMARY if key != "origin"}}, "broken: KeyError"),
                 ({"judge": "time_s,stowed\n10.0,0\n"}, "broken: KeyError: 'coverage'"), ({"judge": ""}, "broken: KeyError: 'time_s'"),
                 ({"log": ENDED.splitlines()[0]}, "the mission did not end by itself"),
                 ({"log": '{"event":"STALE_MAP"}\n' + ENDED}, "stale input: STALE_MAP"), ({"log": '{"event": "stale scan"}\n' + ENDED}, "stale input: stale scan"),
                 ({"launch": "[gpis_mapping-3] process has died [pid 1, exit code -9]"}, "a node ended: gpis_mapping-3"),
                 ({"launch": "clock: waited 60 s for x, now continues without it; this run cannot be repeated exactly"}, "an answer was given up"))
        for number, (changes, words) in enumerate(cases):
            problem, _ = campaign.state_of(self.make(str(number), **changes))
            self.assertTrue(problem and problem.startswith(words), (words, problem))
        whole = self.make()
        for name in ("judge.csv", "log/roslaunch.log", "mission.jsonl"):
            (self.folder / "run" / name).unlink()
            self.assertEqual(campaign.state_of(whole)[0], f"broken: no {pathlib.Path(name).name}")
        (self.folder / "run/summary.json").unlink()
        self.assertEqual(campaign.state_of(whole)[0], "missing")

    def options(self, *words):
        path = self.folder / "definition.yaml"
        if not path.exists():
            path.write_text(DEFINITION)
        return campaign.parse(["--definition", str(path), "--out", str(self.folder / "out"), *words])

    def test_a_combination_of_several_tables_is_one_mission(self):
        missions = campaign.missions_of(self.options())
        self.assertEqual(list(missions)[:4], [f"two_rows-{cycle}-{variant}-9" for cycle in ("paper", "shipped") for variant in ("complete", "no_travel")])
        self.assertEqual(len(missions), 2 * 2 * 2 + 3)
        self.assertEqual(len({mission["configuration"] for mission in missions.values()}), len(missions))
        command = missions["two_rows-paper-no_travel-101"]["command"]
        self.assertEqual(command[4:], ["--scene", "two_rows", "--seed", "101", "--time-limit", "600", "--wall-limit", "60", "--no-page", "--removed-factor", "travel",
                                       "--", "mission_config:=paper"])
        self.assertEqual(len(campaign.missions_of(self.options("--seeds", "1 2", "--scenes", "wall"))), 4)

    def test_a_definition_is_refused_before_anything_runs(self):
        for options, words in ((("--seeds", " "), "--seeds is empty"), (("--seeds", "1.5"), "seed 1.5, must be"), (("--scenes", "nope"), "no mission in nope")):
            with self.assertRaisesRegex(UsageError, words):
                campaign.missions_of(self.options(*options))
        for text, replaced, words in (("octomap_random", "nope", "strategy nope: must be one of"), ("travel}", "nope}", "--removed-factor nope"), ("[101, 9]", "9", "TypeError"),
                                      ("mission_config:", "mission_confi:", "no argument mission_confi"), ("variants: {complete: {}", "variants: {other: {}", "complete"),
                                      ("two_rows: 600", "two_rows: soon", "ValueError"), ("two_rows: 600", "other: 600", "KeyError: 'two_rows'")):
            (self.folder / "definition.yaml").write_text(DEFINITION.replace(text, replaced))
            with self.assertRaisesRegex(UsageError, words):
                campaign.missions_of(self.options())

    def test_a_strategy_of_an_example_package_is_taken(self):
        own = ROOT / "examples/nearest_strategy/mission.yaml"
        (self.folder / "definition.yaml").write_text(DEFINITION.replace("octomap_random", f"nearest, params: {own}"))
        command = campaign.missions_of(self.options())["two_rows-paper-random-101"]["command"]
        self.assertEqual(command[command.index("--strategy"):], ["--strategy", "nearest", "--", "mission_config:=paper", f"params:={own}"])
        (self.folder / "beside.yaml").write_text(own.read_text())
        (self.folder / "definition.yaml").write_text(DEFINITION.replace("octomap_random", "nearest, params: beside.yaml"))
        self.assertEqual(campaign.missions_of(self.options())["two_rows-paper-random-101"]["command"][-1], f"params:={self.folder.resolve() / 'beside.yaml'}")
        # Without its file, and with one that is not beside the definition.
        for variant, words in (("nearest", "strategy nearest: must be one of"), (f"nearest, params: {own.relative_to(ROOT)}", "No such file or directory")):
            (self.folder / "definition.yaml").write_text(DEFINITION.replace("octomap_random", variant))
            with self.assertRaisesRegex(UsageError, words):
                campaign.missions_of(self.options())

    def test_parameters_of_a_cycle_and_a_variant_are_made_one(self):
        (self.folder / "cycle.yaml").write_text("a: {b: 1, c: [1, 2]}\nd: 1\n")
        (self.folder / "variant.yaml").write_text("a: {c: [3], e: 2}\n")
        text = DEFINITION.replace("mission_config: paper", "params: cycle.yaml").replace("strategy: octomap_random", "params: variant.yaml")
        (self.folder / "definition.yaml").write_text(text)
        options = self.options()
        missions = campaign.missions_of(options)
        of = {name: pathlib.Path(missions[f"two_rows-paper-{name}-101"]["command"][-1].split(":=")[1]) for name in ("complete", "random")}
        self.assertEqual(of["complete"], self.folder.resolve() / "cycle.yaml")
        self.assertEqual(yaml.safe_load(of["random"].read_text()), {"a": {"b": 1, "c": [3], "e": 2}, "d": 1})
        self.assertIn(options.out, of["random"].parents)
        (self.folder / "definition.yaml").write_text(text.replace("params: variant", "params: other"))
        with self.assertRaisesRegex(UsageError, "No such file or directory: .*other.yaml"):
            campaign.missions_of(options)

    def test_the_shipped_definition_is_taken(self):
        missions = campaign.missions_of(campaign.parse([]))
        self.assertEqual(len(missions), 247)
        self.assertTrue(all(int(mission["seed"]) > 100 for mission in missions.values()))
        self.assertIn(f"```yaml\n{(ROOT / 'tools/campaign/paper.yaml').read_text()}```", (ROOT / "docs/results/design.md").read_text())

    def test_configuration_holds_what_is_in_the_files_wherever_they_are(self):
        path, elsewhere = self.folder / "params.yaml", self.folder / "others.yaml"
        path.write_text("a: 1")
        elsewhere.write_text("a: 1")
        before = workspace.configuration([f"params:={path}", "seed:=1"])
        self.assertEqual(workspace.configuration([f"params:={elsewhere}", "seed:=1"]), before)
        self.assertNotEqual(workspace.configuration([f"params:={path}.no", "seed:=1"]), before)
        self.assertEqual(workspace.configuration(["seed:=1", f"params:={path}"]), before)
        self.assertNotEqual(workspace.configuration([f"params:={path}", "seed:=2"]), before)
        path.write_text("a: 2")
        self.assertNotEqual(workspace.configuration([f"params:={path}", "seed:=1"]), before)

    def test_software_is_what_a_mission_runs(self):
        def git(*words):
            subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *words], cwd=self.folder, check=True, capture_output=True)

        files = {"src/a/a.cpp": True, "sim_tests/b/world.yaml": True, "examples/c/c.py": True, "src/a/test/t.cpp": False, "src/a/docs/a.md": False, "tools/d.py": False}
        with unittest.mock.patch.object(workspace, "ROOT", self.folder):
            self.assertEqual(workspace.software(), "unknown")  # no git
            for name in files:
                (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
                (self.folder / name).write_text("1")
            git("init")
            git("add", ".")
            git("commit", "-m", "first")
            before = workspace.software()
            for name, counts in files.items():
                for path in (self.folder / name, self.folder / name.replace(".", "_new.")):
                    path.write_text("2")
                    self.assertEqual(workspace.software() != before, counts, path)
                    git("clean", "-fd")
                    git("checkout", ".")
            (self.folder / "src/a/a.cpp").write_text("2")
            git("commit", "-am", "second")
            self.assertNotEqual(workspace.software(), before)

    def test_what_is_recorded_is_not_run_again(self):
        def printed(*words):
            with contextlib.redirect_stdout(io.StringIO()) as text, contextlib.redirect_stderr(io.StringIO()):
                options = self.options(*words)
                return campaign.report(options, campaign.missions_of(options)), text.getvalue()

        def files():
            return [(self.folder / "out" / name).read_text() for name in ("missions.csv", "curves.csv", "tables.md")]

        cells = ("two_rows-paper-complete-9", "two_rows-paper-no_travel-9")
        found = campaign.missions_of(self.options())
        for cell in cells:
            self.make(f"out/{cell}", {**SUMMARY, "origin": {key: found[cell][key] for key in ("software", "configuration")}})
        self.assertIn("2 of 11 missions count", printed()[1])
        first = files()
        # On another machine, where nothing has run yet.
        (self.folder / "out").rename(self.folder / "recorded")
        recorded = self.options("--recorded", str(self.folder / "recorded"))
        self.assertEqual([name for name, mission in campaign.missions_of(recorded).items() if not campaign.state_of(mission)[0]], list(cells))
        self.assertIn("2 of 11 missions count", printed("--recorded", str(self.folder / "recorded"))[1])
        self.assertEqual(files(), first)
        with unittest.mock.patch.object(workspace, "software", return_value="another state"):
            self.assertIn("0 of 11 missions count", printed("--recorded", str(self.folder / "recorded"))[1])

    def test_recorded_files_that_are_not_whole_are_refused(self):
        cell, found = "two_rows-paper-complete-9", campaign.missions_of(self.options())
        self.make(f"out/{cell}", {**SUMMARY, "origin": {key: found[cell][key] for key in ("software", "configuration")}})
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            campaign.report(self.options(), found)
        recorded = self.folder / "recorded"
        with self.assertRaisesRegex(UsageError, "is the folder of --out"):
            self.options("--recorded", str(self.folder / "out"))
        with self.assertRaisesRegex(UsageError, "recorded has no missions.csv, must hold missions.csv and curves.csv"):
            self.options("--recorded", str(recorded))
        for name, change, words in (("curves.csv", lambda text: text[:text.index("\n") + 1], "curves.csv: KeyError: .*two_rows"), ("curves.csv", lambda text: text[:-20], "curves.csv: ValueError"),
                                    ("curves.csv", lambda text: text.replace(",75.0,", ",50.0,"), "ends with 50.0 % of the bricks, in missions.csv with 3"),
                                    ("missions.csv", lambda text: "", "missions.csv: ValueError: missions of 0 states"), ("missions.csv", lambda text: text.replace(",", ";"), "missions.csv: KeyError"),
                                    ("missions.csv", lambda text: text + text.splitlines()[1], "is there twice"), ("missions.csv", lambda text: text.replace("fruitless", "fewer"), "KeyError: 'fruitless_views'"),
                                    ("curves.csv", lambda text: text + '"' + 200000 * "x", "curves.csv: Error: field larger")):
            shutil.rmtree(recorded, ignore_errors=True)
            shutil.copytree(self.folder / "out", recorded)
            (recorded / name).write_text(change((recorded / name).read_text()))
            with self.assertRaisesRegex(Refusal, words):
                campaign.missions_of(self.options("--recorded", str(recorded), "--out", str(self.folder / "other")))

    def test_snakemake_runs_what_does_not_count_up_to_three_times(self):
        try:
            campaign.check_snakemake()
        except UsageError as error:
            self.skipTest(str(error))
        local = ["--profile", str(campaign.FILES / "local"), "--cores", "2"]
        script = self.folder / "mission.py"
        script.write_text(MISSION)
        good = self.make("made")["folder"]
        options, missions = argparse.Namespace(out=self.folder / "out", snakemake=local), {}
        for name, attempts in (("first", 1), ("third", 3), ("fourth", 4)):
            (self.folder / name).write_text(str(attempts))
            missions[name] = {**self.make(f"unused_{name}"), "folder": str(self.folder / "out" / name), "variant": name,
                              "command": ["/usr/bin/python3", str(script), str(self.folder / "out" / name), good, str(self.folder / name)]}

        def left_after_a_call():
            campaign.run_all(options, missions)
            return [int((self.folder / name).read_text()) for name in missions], campaign.report(options, missions)

        self.assertEqual(left_after_a_call(), ([0, 0, 1], 1))
        # Only the one that is missing; this time on a cluster, which ends the first job.
        options.snakemake = ["--profile", str(campaign.FILES / "slurm")]
        for name, text in SLURM.items():
            (self.folder / "bin" / name).parent.mkdir(exist_ok=True)
            (self.folder / "bin" / name).write_text(text)
            (self.folder / "bin" / name).chmod(0o755)
        with unittest.mock.patch.dict(os.environ, PATH=f"{self.folder / 'bin'}:{os.environ['PATH']}", JOBS=str(self.folder / "bin")):
            self.assertEqual(left_after_a_call(), ([0, 0, 0], 0))
            self.assertEqual([path.read_text() for path in sorted((self.folder / "bin").glob("job*"))], ["JobState=TIMEOUT", "JobState=COMPLETED"])
        options.snakemake = local
        missions["first"]["software"] = "later"
        (self.folder / "first").write_text("9")
        with (options.out / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            with self.assertRaisesRegex(UsageError, "another campaign runs in"):
                campaign.run_all(options, missions)
        locks = options.out / ".snakemake/locks"  # as a killed Snakemake leaves them
        locks.mkdir(parents=True, exist_ok=True)
        (locks / "0.output.lock").write_text("complete/first\n")
        running = options.out / ".snakemake/incomplete"  # a mission ended after Snakemake was interrupted
        running.mkdir(exist_ok=True)
        (running / base64.b64encode(b"complete/third").decode()).write_text("")
        self.assertEqual(left_after_a_call(), ([6, 0, 0], 1))

    def test_a_workspace_that_was_built_of_another_state_is_refused(self):
        (self.folder / "devel").mkdir()
        with unittest.mock.patch.object(campaign, "ROOT", self.folder):
            campaign.check_built("now")  # it does not tell
            (self.folder / "devel/.software").write_text("before\n")
            campaign.check_built("before")
            with self.assertRaisesRegex(UsageError, "built of state before, src, sim_tests and examples are of now"):
                campaign.check_built("now")

    def test_slurm_tells_only_of_final_states_that_a_job_has_ended(self):
        scontrol = self.folder / "scontrol"
        for told, expected in (("JobId=7 JobState=COMPLETED Reason=None", "success"), ("JobState=TIMEOUT", "failed"), ("JobState=OUT_OF_MEMORY", "failed"),
                               ("slurm_load_jobs error: Invalid job id specified", "failed"), ("JobState=SIGNALING", "running"), ("JobState=REQUEUE_HOLD", "running"),
                               ("slurm_load_jobs error: Unable to contact slurm controller", "running")):
            scontrol.write_text(f"#!/bin/bash\n[ $4 = 7 ] && echo '{told}' >&2\n")
            scontrol.chmod(0o755)
            found = subprocess.run([campaign.FILES / "slurm/status", "7;other"], env={"PATH": f"{self.folder}:/usr/bin:/bin"}, capture_output=True, text=True, check=True).stdout
            self.assertEqual(found, f"{expected}\n", told)

    def test_progress_tells_the_time_to_go(self):
        with unittest.mock.patch("time.monotonic", side_effect=[100.0, 100.0 + 3600.0]), contextlib.redirect_stdout(io.StringIO()) as printed:
            handler = runpy.run_path(str(campaign.FILES / "progress.py"))["log_handler"]
            for message in ({"level": "job_info"}, {"level": "progress", "done": 2, "total": 6}, {"level": "progress", "done": 6, "total": 6}):
                handler(message)
        self.assertEqual(printed.getvalue(), "Campaign: 2 missions done in this call, 3 left, about 1.5 h to go\n")  # the last step is no mission

    def table(self, *rows):
        """The tables as printed, and {(variant, measure): row} of tables.csv."""
        path, mission = self.folder / "missions.csv", self.folder / "mission"
        mission.mkdir(exist_ok=True)
        with path.open("w", newline="") as stream:
            writer = csv.DictWriter(stream, table_campaign.COLUMNS)
            writer.writeheader()
            for cell, changes in rows:
                summary = {**SUMMARY, **changes}
                # A brick every ten seconds.
                (mission / "judge.csv").write_text("time_s,stowed,coverage\n" + "".join(f"{10.0 * (1 + count)},{count},0.9\n" for count in range(summary["bricks_stowed"] + 1)))
                writer.writerow(table_campaign.row_of({**cell, "folder": mission}, summary))
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            table_campaign.print_tables(path)
        self.assertEqual(printed.getvalue(), "\n" + (self.folder / "tables.md").read_text())
        with (self.folder / "tables.csv").open(newline="") as stream:
            return printed.getvalue(), {(row["variant"], row["measure"]): row for row in csv.DictReader(stream)}

    @staticmethod
    def row(variant, seed, stowed, scene="one_heap", **summary):
        return {"scene": scene, "cycle": "paper", "variant": variant, "seed": seed}, {"bricks_stowed": stowed, "bricks_total": 4, **summary}

    def test_table_has_means_and_paired_differences(self):
        # Bricks vary from seed to seed, the difference does not: seed 3 has no partner.
        text, cells = self.table(self.row("complete", 1, 4, falls=0), self.row("no_travel", 1, 3), self.row("complete", 2, 2, falls=2, map_coverage=None),
                                 self.row("no_travel", 2, 1, collisions=0), self.row("no_travel", 3, 4))
        lines = text.splitlines()
        for begin in ("| one_heap | paper | complete | 2 | 3.0 [2.0, 4.0] | 17 | 100.0 | 100 | 1.0 [0.0, 2.0] | 1 | 2 of 2 | N |",  # beside the paper's
                      "| one_heap | paper | no_travel | 2 | 2.0 [1.0, 3.0] | 11 | 100.0 [100.0, 100.0] | 80 | 1.0 [1.0, 1.0] | 3 | 1 of 2 | Y |",  # seeds of all
                      "| complete | 2 | 75.0 [50.0, 100.0] | 100.0 (of 1) | 100.0 [100.0, 100.0] | 1.0 [0.0, 2.0] |",
                      "| no_travel | 3 | 66.7 [25.0, 100.0] |", "| no_travel | 2 | -25.0 [-25.0, -25.0] | +0.0 | +0.0 [+0.0, +0.0] | +0.0 [-1.0, +1.0] |"):
            self.assertTrue(any(line.startswith(begin) for line in lines), (begin, text))
        self.assertEqual({key: cells["no_travel", "bricks"][key] for key in ("missions", "n", "pairs")}, {"missions": "3", "n": "3", "pairs": "2"})
        self.assertEqual([float(cells["no_travel", "bricks"][key]) for key in ("mean_low", "mean_high", "difference")], [25.0, 100.0, -25.0])

    def test_table_one_has_each_place_where_factors_were_removed(self):
        text, _ = self.table(self.row("complete", 1, 4, scene="decoys"), *(({**cell, "cycle": "shipped"}, summary) for cell, summary in (self.row("complete", 1, 4), self.row("no_travel", 1, 3))),
                             self.row("complete", 1, 4), self.row("no_travel", 1, 2))
        self.assertEqual([" | ".join(line.split(" | ")[:6]) for line in text.splitlines()[3:7]],
                         ["| one_heap | paper | complete | 1 | 4.0 | 17", "| one_heap | paper | no_travel | 1 | 2.0 | 11", "| one_heap | shipped | complete | 1 | 4.0 | ", "| one_heap | shipped | no_travel | 1 | 3.0 | "])

    def test_findings_tell_what_is_better_and_worse(self):
        seeds = range(1, 6)
        self.table(*(self.row("complete", seed, 3, falls=2, drops=seed, map_coverage=0.5) for seed in seeds),
                   *(self.row("no_travel", seed, 1 + seed % 2, falls=1, drops=2 * seed - 1) for seed in seeds),  # of the drops one pair is equal: p 0.12
                   *(self.row("no_frontier", seed, 3, falls=seed, map_coverage=0.5) for seed in seeds))
        self.assertEqual(table_campaign.findings_text(table_campaign.read_rows(self.folder / "missions.csv")),
                         "- `one_heap`, cycle `paper`, `no_travel`: better in map % **+50.0 [+50.0, +50.0]** (p 0.062, 5 pairs), falls **-1.0 [-1.0, -1.0]** (p 0.062, 5 pairs); "
                         "worse in bricks % **-35.0 [-45.0, -25.0]** (p 0.062, 5 pairs).\n"
                         "\n3 of 19 tests have a p below 0.1. If no variant differed from `complete`, about 0 would.\n")  # three can: 3 * 2 / 32
        missing = [self.row("no_travel", 1, 1), *(self.row(variant, seed, bricks) for seed in range(2, 7) for variant, bricks in (("complete", 3), ("no_travel", 1)))]
        self.table(*missing)  # of the first seed there is no mission of the complete system
        self.assertIn("`no_travel`: worse in bricks", table_campaign.findings_text(table_campaign.read_rows(self.folder / "missions.csv")))
        self.table(self.row("complete", 1, 4), self.row("no_travel", 1, 3))
        self.assertEqual(table_campaign.findings_text(table_campaign.read_rows(self.folder / "missions.csv")),
                         "0 of 0 tests have a p below 0.1. If no variant differed from `complete`, about 0 would.\n")

    def test_nothing_is_minus_zero(self):
        self.assertEqual(table_campaign.interval_text(-0.01, -0.06, 0.0, 2, "+.1f"), "+0.0 [-0.1, +0.0]")

    def test_seeds_without_a_brick_of_complete_are_left_out(self):
        self.table(*(self.row("complete", seed, stowed) for seed, stowed in ((1, 2), (2, 0), (3, 3))), *(self.row("no_travel", seed, 4 - seed, map_coverage=0.5) for seed in (1, 2, 3, 4)))
        self.assertEqual(table_campaign.lasting_text(table_campaign.read_rows(self.folder / "missions.csv")).splitlines()[2:],
                         ["| one_heap | paper | no_travel | 2 | -0.5 [-2.0, +1.0] | 1 | -50.0 [-50.0, -50.0] | 0.5 |"])

    def test_every_measure_of_the_design_is_in_the_tables(self):
        text, cells = self.table(self.row("complete", 1, 4))
        for title, _ in table_campaign.SHOWN.values():
            self.assertIn(f"| {title} |", text)
        self.assertEqual({measure for _, measure in cells}, {"bricks", *table_campaign.MEASURES, *table_campaign.GRADED, *table_campaign.TIMES} - {"bricks_stowed", "bricks_total", "wall_seconds", "choices", "stays"})

    def test_a_time_that_one_mission_did_not_reach_is_no_mean(self):
        # After 2 of 4 bricks: 20 s. After 4: 40 s, in two missions of three.
        text, cells = self.table(*(self.row("complete", seed, 4, scene="tipped_20") for seed in (1, 2)), self.row("complete", 3, 3, scene="tipped_20"),
                                 *(self.row("octomap_random", seed, stowed, scene="tipped_20") for seed, stowed in ((1, 2), (2, 1), (3, 1))))
        self.assertIn("| tipped_20 | #2 | complete | 3 | 91.7 [75.0, 100.0] | 100 \u00b1 6 | 100.0 [100.0, 100.0] | 82 \u00b1 8.5 | 20.0 [20.0, 20.0] | reached by 2 of 3 | reached by 2 of 3 |", text)
        self.assertIn("| reached by 1 of 3 | reached by 0 of 3 | reached by 0 of 3 |", text)
        self.assertEqual([cells["octomap_random", "seconds_to_50"][key] for key in ("n", "mean", "difference", "pairs")], ["1", "", "", "0"])
        self.assertEqual([cells["complete", "seconds_to_100"][key] for key in ("n", "mean")], ["2", ""])

    def test_time_counts_from_the_start_of_the_mission(self):
        row = table_campaign.row_of(self.make(), {**SUMMARY, "bricks_total": 3})
        self.assertEqual([row[key] for key in table_campaign.TIMES], [28.0, 40.0, 40.0])

    def test_views_stops_and_choices_are_counted_in_the_log(self):
        # View 1: a pick, a stop, a choice to stay; 2: a pick that is stopped; 3: nothing, the mission ends; before the first view nothing counts.
        rows = (("select", "success", "drive", 0), ("drive", "base stopped", "select", 0), ("drive", "success", "look", 1), ("pick", "SUCCESS", "begin", 1), ("clear", "PATH_BLOCKED", "clear", 1),
                ("select", "success", "choose", 1), ("pick", "CONTACT_TOO_EARLY", "begin", 2), ("select", "no pile", "ended", 2), ("drive", "success", "look", 3))
        log = "".join(json.dumps({"state": state, "event": event, "decision": decision, "views": views, "time_s": 12.0}) + "\n" for state, event, decision, views in rows)
        mission = self.make(log=ENDED + log)
        row = table_campaign.row_of(mission, SUMMARY)
        self.assertEqual([row[key] for key in table_campaign.GRADED], [2, 3, 2, 1])
        self.table(self.row("complete", 9, 3), self.row("complete", 10, 1), self.row("no_travel", 10, 2))
        curves = [dict(zip(table_campaign.CURVE_COLUMNS, ("one_heap", "paper", variant, seed, 10.0 * index, share))) for variant, seed, shares in
                  (("complete", 9, (0, 75, 75, 150)), ("complete", 10, (75, 75, 75, 150)), ("no_travel", 10, (0, 100))) for index, share in enumerate(shares)]
        text = table_campaign.choices_text(table_campaign.read_rows(self.folder / "missions.csv"), curves)
        for line in ("| driven [m] | 3 bricks [s] | bricks, 9 | bricks, 10 |", "| one_heap | paper | complete | 0 of 0 | 1.0 | 0.0 | 1.0 | 25 | 3 | 1 |",
                     "| no_travel | 0 of 0 | 1.0 | 0.0 | 1.0 | - |  | 2 |"):
            self.assertIn(line, text)

    def test_loads_are_timed_from_one_full_container_to_the_next(self):
        for total, shares, expected in ((10, (0, 20, 30, 50, 50, 60, 100), [30, 10]), (10, (0, 30, 20, 30, 60), [30]), (6, (0, 66.667, 100), [10]), (6, (0, 50, 50), []), (6, (0, 0), [])):
            np.testing.assert_array_equal(table_campaign.load_times([{"bricks": share} for share in shares], total), expected)

    def test_states_of_the_software_are_not_mixed(self):
        cell = {"scene": "one_heap", "cycle": "paper", "variant": "complete", "seed": 1}
        other = {"origin": {**SUMMARY["origin"], "software": "before"}}
        with self.assertRaisesRegex(Refusal, "of 2 states of the software: before, now"):
            self.table((cell, {}), ({**cell, "seed": 2}, other))
        with self.assertRaisesRegex(Refusal, "is there twice"):
            self.table((cell, {}), (cell, {}))
        with self.assertRaisesRegex(Refusal, "of 0 states"):
            self.table()

    def test_p_counts_the_signs_that_give_as_much(self):
        # The sums of 1, 2 and 4 with any signs: -7, -5, -3, -1, 1, 3, 5, 7.
        for values, expected in (((1.0, 2.0, 4.0), 2 / 8), ((1.0, 2.0, -4.0), 1.0), ((1.0, -2.0, 4.0), 6 / 8), ((0.0, 0.0), 1.0), ((3.0,), np.nan), ((), np.nan)):
            np.testing.assert_allclose(table_campaign.p_of_flips(values)[0], expected)

    def test_flips_tell_how_likely_a_low_p_is_by_chance(self):
        for pairs, expected in ((4, 0.0), (5, 2 / 32), (8, 24 / 256)):  # of powers of two no two sums are equal: p is 2/2^n, 4/2^n, ...
            self.assertEqual(np.mean(table_campaign.p_of_flips(2.0 ** np.arange(pairs)) < 0.1), expected)
        self.assertEqual(np.mean(table_campaign.p_of_flips((0.0,) * 6) < 0.1), 0.0)

    def test_p_of_many_pairs_is_near_the_binomial(self):
        for plus, count in ((14, 20), (30, 50)):
            expected = 2.0 * scipy.stats.binom.sf(plus - 1, count, 0.5)
            atol = 4.0 * np.sqrt(expected / 2 ** table_campaign.MAX_EXACT)  # four times the standard deviation of the share
            np.testing.assert_allclose(table_campaign.p_of_flips([1.0] * plus + [-1.0] * (count - plus))[0], expected, atol=atol)
        self.assertEqual(table_campaign.p_of_flips([1.0] * 60)[0], 2.0 ** -table_campaign.MAX_EXACT)

    def test_interval_of_yes_and_no_is_the_binomial(self):
        for successes, total in ((3, 8), (5, 10), (1, 5)):
            values = [1.0] * successes + [0.0] * (total - successes)
            expected = scipy.stats.binom.ppf((0.025, 0.975), total, successes / total) / total
            np.testing.assert_allclose(table_campaign.interval(values), expected, atol=1e-12)  # both are whole numbers over the total


if __name__ == "__main__":
    rosunit.unitrun("experiments", "test_campaign", Campaign)
