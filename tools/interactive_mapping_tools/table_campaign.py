# SPDX-License-Identifier: BSD-3-Clause
"""Tables of what scripts/campaign has left: strategies by scene (the paper's Table II), factors removed (Table I)."""

import collections
import pathlib
import sys

import numpy as np
import yaml

from . import mission_run
from .cli import Refusal, one_line_errors, parser_of


def time_limit(world):
    """Simulated seconds that a world allows: time_per_brick_s for each brick."""
    scene = yaml.safe_load(world.read_text())
    stacks = sum(stack.get("bricks", 3) for stack in scene.get("stacks", []))
    heaps = sum(heap["bricks"] for kind in ("heaps", "tipped") for heap in scene.get(kind, []))
    limit_s = scene.get("time_per_brick_s", 120) * (heaps + stacks + len(scene.get("bricks", [])))
    if not limit_s > 0.0:
        raise ValueError("no bricks")
    return limit_s


def words_of(error):
    """In one line: YAML's errors have several."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def read_runs(folder):
    """(summaries, what is to be told of others)"""
    runs, told = [], []
    for path in sorted(folder.glob("*/summary.json")):
        try:
            run = mission_run.loads(path.read_text())
            if not isinstance(run, dict):
                raise ValueError("no summary of a mission")
            # All that the tables are made of: what cannot be counted is named, and left out.
            row("", [run])
            for key in ("scene", "strategy", "removed_factor"):
                if not isinstance(run.get(key), (str, type(None))):
                    raise ValueError(f"{key} is no text")
        except (OSError, *BROKEN) as error:
            told.append(f"{path}: {words_of(error)}")
            continue
        try:
            list(memory_rows([run]))
        except BROKEN as error:
            told.append(f"{path}: left out of the memory's table, {words_of(error)}: scripts/report_mission.py {path.parent} --summary-only makes it anew")
            run = {**run, "memory": {}}
        runs.append(run)
    return runs, told


def picked_of(run):
    """By the judge; without one by the mission's own count."""
    stowed = run.get("bricks_stowed")
    return run.get("bricks_picked", 0) if stowed is None else stowed


def spread(values, scale=1.0, digits=0):
    values = [float(scale) * value for value in values if value is not None]
    if not values:
        return "-"
    text = f"{np.mean(values):.{digits}f}"
    return text if len(values) == 1 else f"{text} ± {np.std(values, ddof=1):.{digits}f}"


def row(name, runs):
    shares = [picked_of(run) / run["bricks_total"] for run in runs if run.get("bricks_total") and run["bricks_total"] > 0]
    return (f"| {name} | {len(runs)} | {spread(shares, 100)} | {spread([run.get('map_coverage') for run in runs], 100, 1)} | "
            f"{spread([run.get('map_coverable') for run in runs], 100, 1)} | "
            f"{spread([run.get('falls') for run in runs], digits=1)} | {spread([run.get('collisions') for run in runs], digits=1)} | "
            f"{spread([run.get('sim_seconds') for run in runs])} | {spread([run.get('views') for run in runs], digits=1)} | "
            f"{', '.join(sorted({str(run.get('end_reason')) for run in runs}))} |")


BROKEN = (ValueError, KeyError, TypeError, AttributeError, ArithmeticError)
HEAD = "| | runs | bricks % | map % | coverable % | falls | collisions | simulated s | views | ended by |\n|---|--:|--:|--:|--:|--:|--:|--:|--:|---|"


def memory_rows(runs):
    """Resident memory of each node over all the missions, and how fast it grows: the rows' sums, so that long missions weigh more."""
    nodes = collections.defaultdict(list)
    for run in runs:
        for node, sizes in (run.get("memory") or {}).items():
            if sizes["hours"] > 0.0:
                nodes[node].append((sizes["most_mb"], sizes["early_mb"], sizes["late_mb"], sizes["hours"]))
    for node, sizes in sorted(nodes.items()):
        most, early, late, hours = np.array(sizes).T
        yield f"| {node} | {most.max():.0f} | {early.mean():.0f} | {late.mean():.0f} | {(late - early).sum() / hours.sum():+.0f} |"


def time_limit_of(world):
    try:
        return time_limit(world)
    except (OSError, yaml.YAMLError, *BROKEN) as error:
        raise Refusal(f"{world}: no scene, {words_of(error)}") from error


def print_tables(folder):
    runs, told = read_runs(folder)
    for line in told:
        print(f"table_campaign: {line}", file=sys.stderr)
    if not runs:
        raise Refusal(f"no summary.json that can be read in the folders of {folder}")
    whole, without = collections.defaultdict(list), collections.defaultdict(list)
    for run in runs:
        if run.get("removed_factor"):
            without[run["removed_factor"]].append(run)
        else:
            whole[(run.get("scene"), run.get("strategy") or "gpis")].append(run)
    print("Mean ± standard deviation over the runs; truth by the simulator's judge.\n")
    print(HEAD, *(row(f"{scene}, {strategy}", group) for (scene, strategy), group in sorted(whole.items(), key=str)), sep="\n")
    memory = list(memory_rows(runs))
    if memory:
        print("\nResident memory in MB: the most of any mission; in the second and in the last quarter of the missions; growth between the two.\n")
        print("| node | most | second quarter | last quarter | MB per simulated hour |\n|---|--:|--:|--:|--:|", *memory, sep="\n")
    if without:
        print("\nWithout one factor of the utility:\n")
        print(HEAD, *(row(factor, group) for factor, group in sorted(without.items())), sep="\n")


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=pathlib.Path, nargs="?")
    parser.add_argument("--time-limit", type=pathlib.Path, metavar="WORLD", help="print a world's limit [s], nothing else")
    arguments = parser.parse_args()
    if arguments.time_limit:
        print(f"{time_limit_of(arguments.time_limit):g}")
    elif arguments.folder is None:
        parser.error("a folder is needed")
    else:
        print_tables(arguments.folder)
