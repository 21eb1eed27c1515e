# SPDX-License-Identifier: BSD-3-Clause
"""Missions in the simulated world for the paper's tables: strategies in three scenes, and the utility without each factor.

A mission lasts as long as its scene allows, time_per_brick_s for each brick. Resumable: a mission that has ended, however, or was
given up at --wall-limit is not run again; one that broke down is. Days of computing on a laptop.
"""

import os
import re
import signal
import sys

from . import ROOT, strategies, table_campaign, workspace
from .cli import Parser, UsageError, one_line_errors


def parse():
    parser = Parser(__doc__)
    parser.add_argument("--scenes", default="one_heap two_ridges three_heaps", metavar='"A B"', help="of sim_tests/simulated_world/worlds (default %(default)s)")
    parser.add_argument("--seeds", default="1 2 3", metavar='"1 2 3"', help=f"whole numbers from 0 to {workspace.MAX_SEED} (default %(default)s)")
    parser.add_argument("--strategies", default="gpis octomap_gradient_frontier octomap_random", metavar='"X Y"',
                        help="default %(default)s, or your own, as in run_mission")
    parser.add_argument("--selection-config", metavar="FILE", help="absolute path of a file with sections of your own strategies")
    parser.add_argument("--removed", default="", metavar='"F G"', help="factors of gpis' utility to do without, one at a time, in the first scene "
                        "(default: none; all: Table I)")
    parser.add_argument("--wall-limit", default="5400", metavar="S", help="of each mission [s of the wall clock] (default %(default)s): then it is given up, and "
                        "counts with what it reached")
    parser.add_argument("--out", default="results/campaign", metavar="DIR", help="folder, relative to the repository (default %(default)s)")
    parser.add_argument("--table", action="store_true", help="print the tables of what there is, run nothing")
    options = parser.parse_args()
    for name, value in vars(options).items():
        if name != "removed" and isinstance(value, str) and not value.strip():
            raise UsageError(f"--{name.replace('_', '-')} is empty")
    options.scenes, options.seeds, options.strategies = options.scenes.split(), options.seeds.split(), options.strategies.split()
    for seed in options.seeds:
        if not workspace.is_seed(seed):
            raise UsageError(f"--seeds: {seed}, must be whole numbers in [0, {workspace.MAX_SEED}]")
    for scene in options.scenes:
        if not workspace.has_world(scene):
            raise UsageError(f"--scenes: {scene}: no such file in sim_tests/simulated_world/worlds")
    strategies.maps_of(options.strategies, options.selection_config)
    options.removed = list(workspace.REMOVED_FACTORS) if options.removed == "all" else options.removed.split()
    for factor in options.removed:
        if factor not in workspace.REMOVED_FACTORS:
            raise UsageError(f"--removed: {factor}, must be all alone, or some of {', '.join(workspace.REMOVED_FACTORS)}")
    workspace.check_wall_limit(options.wall_limit)
    return options


def has_logged(folder, key, value):
    try:
        log = (folder / "mission.jsonl").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return re.search(f'"{key}": *"{value}"', log) is not None


def mission(options, name, scene, seed, strategy, factor=None):
    folder = ROOT / options.out / name
    # The log, too: earlier versions took missions for done that never began.
    summary = folder / "summary.json"
    if (folder / ".done").exists() and summary.exists() and summary.stat().st_size > 0 and has_logged(folder, "event", "start"):
        print(f"{name}: done before", flush=True)
        return
    limit_s = table_campaign.time_limit_of(ROOT / f"sim_tests/simulated_world/worlds/{scene}.yaml")
    print(f"\n{name}: at most {limit_s:g} simulated seconds ...", flush=True)
    command = [str(ROOT / "scripts/run_mission"), "--run", str(folder), "--overwrite", "--scene", scene, "--seed", seed, "--strategy", strategy, "--time-limit",
               f"{limit_s:g}", "--wall-limit", options.wall_limit, "--no-page", *(["--removed-factor", factor] if factor else []),
               *(["--", f"selection_config:={options.selection_config}"] if options.selection_config else [])]
    code = workspace.run_child(command)
    if code == 130:
        sys.exit(130)
    if code == 2:
        sys.exit(f"error: scripts/run_mission refuses what it was given for {name}")
    if code == 0 or has_logged(folder, "decision", "ended") or (code == 3 and has_logged(folder, "event", "start")):
        (folder / ".done").touch()
    else:
        print(f"{name}: broken off; the next call runs it again", flush=True)


@one_line_errors
def main():
    options = parse()
    os.chdir(ROOT)
    if not options.table:
        workspace.library("install_packages; build_workspace all")
        workspace.use()
        workspace.end_in_order()
        signal.signal(signal.SIGINT, lambda *_: None)  # Ctrl-C reaches the mission, too: its exit code says so
        (ROOT / options.out).mkdir(parents=True, exist_ok=True)
        for seed in options.seeds:
            for scene in options.scenes:
                for strategy in options.strategies:
                    mission(options, f"{scene}-{strategy}-{seed}", scene, seed, strategy)
            first = options.scenes[0]
            for factor in options.removed:
                mission(options, f"{first}-without_{factor}-{seed}", first, seed, "gpis", factor)
        print(flush=True)
    return table_campaign.print_tables(ROOT / options.out)
