# SPDX-License-Identifier: BSD-3-Clause
"""Table of what scripts/fig8 measured, beside the paper's numbers and, if it is installed, CloudCompare's."""

import json
import os
import pathlib
import re
import shutil
import subprocess

from .cli import Refusal, one_line_errors, parser_of

PAPER = {"gpis": (0.005, 0.012), "octomap": (0.033, 0.015)}  # mean and standard deviation [cm]


def judge_by_cloudcompare(program, folder, key):
    """(mean, standard deviation) [cm] of CloudCompare's cloud-to-mesh distance; None when it gave none."""
    command = [program, "-SILENT", "-AUTO_SAVE", "OFF", "-O", f"{key}_common.ply", "-O", f"{key}_last_scan.ply", "-C2M_DIST"]
    environment = dict(os.environ, QT_QPA_PLATFORM="offscreen")
    try:
        done = subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=300, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    found = re.findall(r"Mean distance = (\S+) / std deviation = (\S+)", done.stdout.decode(errors="replace"))
    return tuple(100.0 * float(value) for value in found[-1]) if found else None


def read_rows(folder):
    """[(folder of the run, system, title, its numbers as printed)]. Raises Refusal."""
    rows = []
    for path in sorted(folder.glob("*/summary.json")):
        try:
            for key, entry in json.loads(path.read_text(encoding="utf-8"))["systems"].items():
                s = entry["against_last_scan"]
                values = "".join(f"{100.0 * s[name]:8.4f}" for name in ("mean_m", "std_dev_m", "rms_m", "median_abs_m", "p95_abs_m"))
                rows.append((path.parent, key, entry["title"], f"{values}{s['count']:8d}{100.0 * entry['against_truth']['rms_m']:10.4f}"
                             f"{1e4 * entry['ghost_area_m2']:10.1f}{entry['outside_share']:8.3f}"))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise Refusal(f"{path}: no summary of fig8_experiment, {type(error).__name__}: {error}") from error
    if not rows:
        raise Refusal(f"{folder}: no folders with a summary.json of fig8_experiment")
    return rows


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=pathlib.Path)
    folder = parser.parse_args().folder
    rows = read_rows(folder)
    program = shutil.which("CloudCompare") or shutil.which("cloudcompare.CloudCompare")
    print("Map after the removal against a map of the last scan alone, signed, cm. Paper: real scene; ours: simulated.")
    if program is None:
        print("CloudCompare is not installed: its column is empty.")
    print(f"{'':58}{'mean':>8}{'sigma':>8}{'rms':>8}{'median':>8}{'95 %':>8}{'n':>8}{'truth rms':>10}{'ghost cm2':>10}{'outside':>8}  CloudCompare   paper")
    for run, key, title, values in rows:
        other = judge_by_cloudcompare(program, run, key) if program else None
        other = "{:.4f} {:.4f}".format(*other) if other else "-"
        paper = "{:.3f} {:.3f}".format(*PAPER[key]) if key in PAPER else "-"
        print(f"{run.name + ', ' + title:58}{values}  {other:13}  {paper}")
