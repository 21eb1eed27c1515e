#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""scripts/figures on made results: the numbers beside each figure, the pages that hold them, and what is refused."""

import csv
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import rosunit
from PIL import Image

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[3]
sys.path[:0] = [str(HERE), str(ROOT / "tools")]

import run_folder  # noqa: E402
from interactive_mapping_tools import figure_accuracy, figure_mission, figures, results, table_campaign  # noqa: E402
from interactive_mapping_tools.cli import Refusal  # noqa: E402

STATISTICS = {"count": 9, "mean_m": 0.0001, "std_dev_m": 0.002, "rms_m": 0.002, "median_abs_m": 0.001, "p95_abs_m": 0.003}
SYSTEM = {"against_last_scan": STATISTICS, "against_truth": STATISTICS, "zones_against_last_scan": {"faces": STATISTICS, "edges": STATISTICS}, "ghost_area_m2": 0.01, "outside_share": 0.1}


def rows_of(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


class Figures(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="figures_"))
        self.addCleanup(shutil.rmtree, self.folder)

    def is_drawn(self, name):
        """A picture with more than a few colours."""
        self.assertGreater(len(Image.open(self.folder / name).convert("RGB").getcolors(1 << 24)), 50, name)

    def campaign(self, *missions):
        """missions: (variant, seed, rows of judge.csv from 10 s on, each (seconds, stowed of 4, coverage))."""
        rows, curves = [], []
        for variant, seed, judged in missions:
            folder = self.folder / f"decoys-paper-{variant}-{seed}"
            folder.mkdir()
            (folder / "mission.jsonl").write_text('{"event":"start","time_s":10.0}\n')
            (folder / "judge.csv").write_text("time_s,stowed,coverage\n" + "".join(f"{10 + time_s},{stowed},{coverage}\n" for time_s, stowed, coverage in judged))
            summary = {**dict.fromkeys(table_campaign.MEASURES, 1), "bricks_total": 4, "end_reason": "time_limit", "origin": {"software": "now"}}
            mission = {"scene": "decoys", "cycle": "paper_near", "variant": variant, "seed": seed, "folder": folder}
            rows.append(table_campaign.row_of(mission, summary))
            curves += table_campaign.curve_rows_of(mission, 4)
        table_campaign.write_csv(self.folder / "missions.csv", table_campaign.COLUMNS, rows)
        table_campaign.write_csv(self.folder / "curves.csv", table_campaign.CURVE_COLUMNS, curves)

    def test_curves_are_mean_and_range_of_the_seeds_that_all_systems_have(self):
        slow, fast = ((0, 0, 0.2), (12, 1, 0.5), (20, 1, 0.5)), ((0, 0, 0.0), (5, 2, 0.5), (7, 4, 1.0))  # the second ended early
        self.campaign(("complete", 101, slow), ("complete", 102, fast), ("complete", 103, fast), ("no_travel", 101, fast),
                      ("octomap_random", 101, slow), ("octomap_random", 102, slow))
        figures.curves(self.folder, self.folder)
        rows = {(row["system"], float(row["time_s"])): row for row in rows_of(self.folder / "fig7.csv")}
        self.assertEqual({(row["scene"], row["cycle"], row["n"]) for row in rows.values()}, {("decoys", "paper_near", "2")})
        self.assertEqual({system for system, _ in rows}, {"complete", "octomap_random"})

        def of(time_s):
            return [float(rows["complete", time_s][key]) for key in ("bricks_mean", "bricks_min", "bricks_max", "map_mean", "map_min", "map_max")]

        self.assertEqual(of(0.0), [0.0, 0.0, 0.0, 10.0, 0.0, 20.0])
        self.assertEqual(of(10.0), [50.0, 0.0, 100.0, 60.0, 20.0, 100.0])
        self.assertEqual(of(20.0), [62.5, 25.0, 100.0, 75.0, 50.0, 100.0])
        self.is_drawn("fig7.png")

    def test_scenes_are_drawn_with_their_bricks(self):
        figures.scenes(None, self.folder)
        self.assertEqual([tuple(row.values()) for row in rows_of(self.folder / "fig6.csv")], [("one_heap", "20", "0"), ("tipped_20", "20", "0"), ("decoys", "30", "5")])
        self.is_drawn("fig6.png")

    def test_curves_are_refused_without_their_missions(self):
        self.campaign(("no_travel", 101, ((0, 0, 0.2),)))
        with self.assertRaisesRegex(Refusal, "no missions of complete, octomap"):
            figures.curves(self.folder, self.folder)

    def test_pages_hold_what_their_files_do(self):
        for (page, mark), text in figures.page_parts(figures.DOCS / "figures").items():
            self.assertIn(f"<!-- {mark}: begin -->\n{text}<!-- {mark}: end -->", (figures.DOCS / page).read_text())
        text = figure_accuracy.table_of(results.read_rows(figures.DOCS / "figures/fig8.csv", ("scene", "sensor", "system")))
        self.assertIn(f"<!-- table: begin -->\n{text}<!-- table: end -->", (figures.DOCS / "fig8.md").read_text())

    def test_recipe_of_the_page_restores_the_recorded_software(self):
        recipe, commit = re.search("^git restore --source=([0-9a-f]+) [^#\\n]*", (figures.DOCS / "index.md").read_text(), re.MULTILINE).group(0, 1)
        if subprocess.run(["git", "cat-file", "-e", commit], cwd=ROOT, capture_output=True, check=False).returncode:
            self.skipTest("the history does not reach back to it")
        clone = self.folder / "clone"
        subprocess.run(["git", "clone", "-q", "--shared", ROOT, clone], check=True)
        subprocess.run(recipe.split(), cwd=clone, check=True)
        told = subprocess.run([sys.executable, "-c", "from interactive_mapping_tools import workspace; print(workspace.software())"],
                              cwd=clone / "tools", capture_output=True, text=True, check=True)
        self.assertEqual({told.stdout.strip()}, {row["software"] for row in rows_of(figures.DOCS / "figures/missions.csv")})

    def test_pages_tell_that_nothing_was_counted_only_then(self):
        self.assertEqual(set(figures.page_parts(self.folder).values()), {"No counted missions yet.\n"})
        self.campaign(("complete", 101, ((0, 0, 0.2), (5, 3, 0.2))), ("octomap_random", 101, ((0, 0, 0.2),)))
        (self.folder / "fig7.png").touch()
        parts = {mark: text for (_, mark), text in figures.page_parts(self.folder).items()}
        self.assertIn("(figures/fig7.png)", parts["curves"])
        self.assertEqual(parts["factors"], figures.NOTHING)  # its scene is another
        self.assertIn("| decoys | #3 | octomap_random | 1 | 25.0 | 57 \u00b1 6.8 | 100.0 | 57 \u00b1 12 | reached by 0 of 1 |", parts["systems"])
        self.assertIn("| less `complete` | pairs |", parts["measures"])
        self.assertTrue(parts["findings"].startswith("0 of 0 tests have a p below 0.1."), parts["findings"])

    def test_figures_of_a_mission_show_its_first_picks(self):
        made = run_folder.make_run_folder(self.folder / "run", bricks=6)
        figure_mission.order(self.folder / "run", self.folder)
        rows = [{key: float(value) for key, value in row.items()} for row in rows_of(self.folder / "fig9.csv")]
        self.assertEqual([row["brick"] for row in rows], [1, 2, 3, 4])
        # The bricks, 0.2 m, as they are piled: the highest first.
        for row, middle in zip(rows, ((-0.12, 0.0), (0.12, 0.0))):
            np.testing.assert_allclose([row["gone_x_m"], row["gone_y_m"]], middle, atol=0.11)
            self.assertTrue(0.4 <= row["gone_z_m"] <= 0.6, row)
        self.assertTrue(all(any(np.allclose([row["base_x_m"], row["base_y_m"]], pose[:2], atol=1e-3) for pose in made.standing) for row in rows))
        self.is_drawn("fig9.png")

        figure_mission.cycle(self.folder / "run", self.folder)
        rows = rows_of(self.folder / "fig1.csv")
        self.assertEqual([sum(row["panel"] == panel and row["chosen"] == "1" for row in rows) for panel in "ad"], [1, 1])
        self.is_drawn("fig1.png")

        figure_mission.utility(self.folder / "run", self.folder)
        rows = rows_of(self.folder / "fig4.csv")
        self.assertEqual(len(rows), 40)
        candidates = [float(row["utility"]) for row in rows if row["verdict"] == "0"]
        self.assertEqual([float(row["utility"]) for row in rows if row["chosen"] == "1"], [max(candidates)])
        self.assertTrue(any(row["kind"] == "2" for row in rows), "the choice with a side that nobody has seen")
        self.is_drawn("fig4.png")

    def test_a_run_that_does_not_hold_enough_is_refused(self):
        run_folder.make_run_folder(self.folder / "run", bricks=2)
        for path in (self.folder / "run/pictures").glob("map_*_001.ply"):
            path.unlink()
        with self.assertRaisesRegex(Refusal, "no maps before and after the first pick"):
            figure_mission.cycle(self.folder / "run", self.folder)
        with self.assertRaisesRegex(Refusal, "no picture and maps of a pick"):
            figure_mission.order(self.folder / "run", self.folder)
        (self.folder / "run/selections.jsonl").unlink()
        with self.assertRaisesRegex(Refusal, "holds no maps, choices and path"):
            figure_mission.utility(self.folder / "run", self.folder)

    def accuracy_run(self, name, text):
        (self.folder / name).mkdir(exist_ok=True)
        (self.folder / name / "summary.json").write_text(text)

    def test_accuracy_is_the_mean_over_seeds_beside_the_papers(self):
        for seed, mean_m in ((1, 0.0001), (2, 0.0003)):
            system = {**SYSTEM, "against_last_scan": {**STATISTICS, "mean_m": mean_m}}
            self.accuracy_run(f"fig8-full-{seed}", json.dumps({"sensor": "full", "seed": seed, "systems": {"gpis": system}}))
        text = figure_accuracy.table_of(figure_accuracy.read_runs(self.folder))
        self.assertIn("| one brick, one place | full | Dynamic GPIS | 2 | 0.020 [0.010, 0.030] | 0.200 [0.200, 0.200] | 0.200 [0.200, 0.200] | 0.200 [0.200, 0.200] | "
                      "100 [100, 100] | 0.100 [0.100, 0.100] | 0.005, 0.012 |", text)

    def test_accuracy_says_what_it_cannot_read(self):
        with self.assertRaisesRegex(Refusal, "no folders with a summary.json"):
            figure_accuracy.read_runs(self.folder)
        for text in ("[", "[]", '{"systems": []}', '{"systems": {"gpis": {}}}'):
            self.accuracy_run("fig8-full-1", text)
            with self.assertRaisesRegex(Refusal, "fig8-full-1/summary.json"):
                figure_accuracy.read_runs(self.folder)


if __name__ == "__main__":
    rosunit.unitrun("experiments", "test_figures", Figures)
