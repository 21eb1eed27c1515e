#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""One mission that goes on for hours of simulated time, in the same processes: what is stowed somebody puts back.

The robot picks as it does in any mission; whenever it looks, the bricks in the chute are laid down between the others again.
At the end, the time being up, no process may have grown: of each, what it holds in the last quarter is compared with what
it held in the second, when the map has had all the ground there is. Exit code: 0 all as it should be, 1 it is not, 2 bad usage.
"""

import argparse
import csv
import json
import math
import os
import pathlib
import statistics
import sys
import time

import soak_mission
from soak_mission import ROOT

SCENE = "four_bricks"
CONFIG = ROOT / "sim_tests/config/soak_endurance.yaml"
PLACE_X_M, PLACE_Y_M = 0.5, 0.6  # of a brick that is put back, from the middle of the pile, at most: always there, or the map grows with new ground
# Before the camera: nobody lays one where the robot has looked and does not look again before its arm goes by.
FAR_M, BEARING_RAD = 2.4, 0.4
ROUND_M, OUT_OF_REACH_M = 1.2, 1.6  # where the pile's place is out of sight: this far about its middle, and beyond arm and brick
# From base_link, at least: 0.60 m to the farthest corner of the base, half a brick's diagonal of 0.36 m, and a hand's breadth.
FROM_BASE_M = 0.9
APART_M = 0.45  # the middles of two bricks: a brick's diagonal, and a hand's breadth
TRIES = 20
MOST_GROWTH, MOST_GROWTH_MB = 0.05, 5.0  # of what a process held; an allocator's step is a few MB
LONGEST_PICK_S = 180.0  # simulated, of all picks in the mean: slower, and it has done something else
FALLS_IN_TEN = 1


class Endurance(soak_mission.WatchedMission):
    def __init__(self, folder, port, scene, seed, hours):
        super().__init__(folder, port, scene, seed)
        self.limit_s = 3600.0 * hours
        self.put_back = 0

    def is_in_view(self, x, y):
        base, ahead = self.in_map(0.0, 0.0), self.in_map(1.0, 0.0)
        bearing = math.atan2(y - base[1], x - base[0]) - math.atan2(ahead[1] - base[1], ahead[0] - base[0])
        return FROM_BASE_M <= math.dist(base, (x, y)) <= FAR_M and abs(math.remainder(bearing, 2.0 * math.pi)) <= BEARING_RAD

    def is_out_of_reach(self, x, y):
        return math.dist(self.in_map(0.0, 0.0), (x, y)) >= OUT_OF_REACH_M

    def places(self):
        """Points of the map where a brick may be laid, the best first."""
        def within(x_m, y_m):
            return [(self.random.uniform(-x_m, x_m), self.random.uniform(-y_m, y_m)) for _ in range(TRIES)]
        pile, about = within(PLACE_X_M, PLACE_Y_M), within(ROUND_M, ROUND_M)
        return [place for place in pile if self.is_in_view(*place)] + [place for place in pile + about if self.is_out_of_reach(*place)]

    def lay_down(self):
        """Each brick that is in the chute, where there is a place for it."""
        bricks = list(self.state.bricks)
        taken = [(brick.pose.position.x, brick.pose.position.y) for brick in bricks if brick.status not in (brick.PICKED, brick.AWAY)]
        for brick in bricks:
            if brick.status != brick.PICKED:
                continue
            for place in self.places():
                if all(math.dist(place, other) >= APART_M for other in taken) and self.inject("move_brick", brick_id=brick.id, pose=self.pose(*place, 0.1)):
                    self.notes.append(f"brick {brick.id} to {place[0]:.3f}, {place[1]:.3f} at {self.now_s():.2f} s")
                    taken.append(place)
                    self.put_back += 1
                    break

    def run(self):
        self.launch(["--time-limit", f"{self.limit_s:g}"], [f"mission_config:={CONFIG}"])
        begun, visit, told_s = time.monotonic(), None, 0.0
        try:
            self.connect()
            self.until(lambda: self.state is not None and self.judge is not None)
            while self.until(lambda seen=visit: self.in_state("look") and self.visit() != seen):
                visit = self.visit()
                # Whom the camera is to see next; the arm stands still, and nothing is planned.
                if self.judge.stowed > 0:
                    self.lay_down()
                if self.now_s() >= told_s:
                    told_s = self.now_s() + 300.0
                    print(f"{self.now_s():7.0f} of {self.limit_s:.0f} s  put back {self.put_back}  falls {self.judge.falls}  drops {self.judge.drops}  "
                          f"collisions {self.judge.collisions}  wall {time.monotonic() - begun:.0f} s", flush=True)
            self.process.wait()
        finally:
            self.end()


def growth_of(path):
    """{node: (MB in the second quarter, MB in the last)}, medians. Raises OSError, ValueError."""
    with open(path, newline="", encoding="utf-8") as stream:
        rows = [(float(row["time_s"]), row["node"], float(row["resident_mb"])) for row in csv.DictReader(stream)]
    if not rows:
        raise ValueError(f"{path}: no rows")
    end_s, growth = max(row[0] for row in rows), {}
    for node in sorted({row[1] for row in rows}):
        parts = [[mb for time_s, name, mb in rows if name == node and low * end_s < time_s <= high * end_s] for low, high in ((0.25, 0.5), (0.75, 1.0))]
        if not all(parts):
            raise ValueError(f"{path}: {node} has not been there all the time")
        growth[node] = tuple(statistics.median(part) for part in parts)
    return growth


def problems_of(summary, growth, put_back, limit_s):
    problems = [f"{summary.get(key)} {key}, must be 0" for key in ("drops", "collisions") if summary.get(key) != 0]
    if summary.get("end_reason") != "time_up":
        problems.append(f"it ended {summary.get('end_reason') or 'not by itself'}, {summary.get('end_message') or 'without a reason'}")
    picks = put_back + (summary.get("bricks_stowed") or 0)
    if summary.get("falls") is None or summary["falls"] * 10 > FALLS_IN_TEN * picks:
        problems.append(f"{summary.get('falls')} falls in {picks} picks, may be {FALLS_IN_TEN} in ten")
    if picks * LONGEST_PICK_S < limit_s:
        problems.append(f"{picks} picks, must be one in {LONGEST_PICK_S:.0f} s at least")
    for node, (before, after) in growth.items():
        if after > before * (1.0 + MOST_GROWTH) + MOST_GROWTH_MB:
            problems.append(f"{node} has grown from {before:.0f} to {after:.0f} MB")
    return problems


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "results/soak", help="folder of endurance.json and the run")
    parser.add_argument("--scene", default=SCENE, help=f"of sim_tests/worlds (default {SCENE})")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sim-hours", type=float, default=2.0, metavar="H", help="of simulated time (default 2), 0.1 to 24")
    arguments = parser.parse_args()
    if not (ROOT / f"sim_tests/worlds/{arguments.scene}.yaml").is_file():
        parser.error(f"--scene {arguments.scene}: no such file in sim_tests/worlds")
    if not 0.1 <= arguments.sim_hours <= 24.0:
        parser.error(f"--sim-hours {arguments.sim_hours}, must be in [0.1, 24]")
    try:
        import interactive_mapping_msgs.msg, rospy, sim_tests.msg  # noqa: F401, E401
    except ImportError as error:
        print(f"error: {error}: source devel/setup.bash, or use scripts/soak endurance", file=sys.stderr)
        return 2
    folder = arguments.out.resolve() / "endurance"
    port = soak_mission.free_port()
    soak_mission.end_in_order()
    os.environ.update(ROS_MASTER_URI=soak_mission.master_uri(port), ROS_HOSTNAME="localhost")
    mission = Endurance(folder, port, arguments.scene, arguments.seed, arguments.sim_hours)
    try:
        mission.run()
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        growth = growth_of(folder / "memory.csv")
    except (soak_mission.NotUp, OSError, ValueError) as error:
        print(f"error: {error}; see {folder}.txt", file=sys.stderr)
        return 1
    problems = problems_of(summary, growth, mission.put_back, mission.limit_s)
    for node, (before, after) in growth.items():
        print(f"{node:20s} {before:6.0f} MB in the second quarter, {after:6.0f} in the last")
    print(f"{mission.put_back + summary['bricks_stowed']} picks in {summary['sim_seconds']:.0f} s simulated, {summary['falls']} falls, {summary['drops']} drops, "
          f"{summary['collisions']} collisions")
    for problem in problems:
        print(f"PROBLEM: {problem}")
    (arguments.out / "endurance.json").write_text(json.dumps({"summary": summary, "put_back": mission.put_back, "growth_mb": growth, "problems": problems,
                                                              "notes": mission.notes}, indent=2) + "\n", encoding="utf-8")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
