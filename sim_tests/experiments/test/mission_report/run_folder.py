#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Makes the run folder of a mission that never was, with files as mission and simulator write them:
    run_folder.py FOLDER [--bricks N] [--seed N]
For tests of what reads run folders. Its figures are known: see Made.
"""

import argparse
import json
import math
import pathlib
import random

import matplotlib

matplotlib.use("Agg")
import matplotlib.image
import numpy as np

START_S = 10.0
WEIGHTS = {"manipulability": 0.25, "pick_order": 0.15, "travel": 0.25, "uncertainty": 0.1, "frontier": 0.25}


class Made:
    """What is true of the folder."""

    def __init__(self):
        self.stowed = self.picked = self.falls = self.drops = self.failures = self.selections = 0
        self.coverage = self.precision = 0.0
        self.plans_failed = {}  # by brick
        self.standing = []  # poses
        self.seconds_of = {}  # by state
        self.end_s = START_S


def write_ply(path, points, triangles):
    """Binary, as the map's own."""
    vertices = np.zeros(len(points), [("xyz", "<f4", 3), ("normal", "<f4", 3), ("variance", "<f4")])
    vertices["xyz"] = points
    vertices["variance"] = 1e-6
    corners = np.asarray(points)[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for corner in range(3):
        np.add.at(vertices["normal"], np.asarray(triangles)[:, corner], area)
    length = np.linalg.norm(vertices["normal"], axis=1, keepdims=True)
    vertices["normal"] = vertices["normal"] / np.maximum(length, 1e-12)
    faces = np.zeros(len(triangles), [("count", "u1"), ("indices", "<i4", 3)])
    faces["count"] = 3
    faces["indices"] = triangles
    names = ("x", "y", "z", "nx", "ny", "nz", "variance")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}", *(f"property float {name}" for name in names),
              f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    path.write_bytes(("\n".join(header) + "\n").encode() + vertices.tobytes() + faces.tobytes())


def pile_mesh(middles, edge=0.2):
    """Ground of 5 x 5 m and a box at each of the middles."""
    lines = np.linspace(-2.5, 2.5, 26)
    x, y = np.meshgrid(lines, lines)
    points = [np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)]
    cell = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (part.ravel() for part in (cell[:-1, :-1], cell[:-1, 1:], cell[1:, 1:], cell[1:, :-1]))
    triangles = [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    corners = np.array([[i, j, k] for k in (-0.5, 0.5) for j in (-0.5, 0.5) for i in (-0.5, 0.5)]) * edge
    sides = np.array([[4, 5, 7], [4, 7, 6], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5], [0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3]])
    count = x.size
    for middle in middles:
        points.append(corners + middle)
        triangles.append(sides + count)
        count += len(corners)
    return np.concatenate(points), np.concatenate(triangles)


def make_run_folder(folder, bricks=20, seed=1):
    """A run as a mission leaves it. Long: one file after the other."""
    folder = pathlib.Path(folder)
    pictures = folder / "pictures"
    pictures.mkdir(parents=True)
    rng = random.Random(seed)
    made = Made()
    middles = []
    for layer, (columns, rows) in enumerate(((4, 3), (3, 2), (2, 1))):
        middles += [((i - (columns - 1) / 2) * 0.24, (j - (rows - 1) / 2) * 0.26, 0.1 + 0.2 * layer) for i in range(columns) for j in range(rows)]
    middles = sorted(middles, key=lambda middle: -middle[2])
    middles = (middles * (bricks // len(middles) + 1))[:bricks]
    log, selections, events, table, path = [], [], [], [], []
    base = [-3.0, 0.0, 0.0]
    counts = {"bricks_picked": 0, "bricks_open": bricks, "bricks_exhausted": 0, "picks_begun": 0, "views": 0, "failures": 0}
    kinds, ledger = {}, {}
    now = [START_S]
    judged = {"stowed": 0, "falls": 0, "dropped": 0, "collisions": 0, "coverage": 0.0, "precision": 0.0, "distance": 0.0}

    def judge_row(time_s):
        table.append((time_s, judged["stowed"], judged["falls"], judged["dropped"], judged["collisions"], 0,
                      f"{judged['coverage']:.5f}" if judged["coverage"] else "", f"{judged['precision']:.5f}" if judged["precision"] else "", judged["distance"]))

    def step(state, event, decision, seconds, reason="", failed=False):
        begun = now[0]
        end = round(begun + seconds, 3)
        for second in range(int(begun) + 1, int(end) + 1):
            if state == "look":
                judged["coverage"] += 0.25 * (0.97 - judged["coverage"])
                judged["precision"] = 0.96 + 0.02 * math.sin(second)
            if state == "drive":
                judged["distance"] += 0.2
            judge_row(float(second))
        now[0] = end
        if failed:
            counts["failures"] += 1
            kinds[f"{state}: {event}"] = kinds.get(f"{state}: {event}", 0) + 1
        made.seconds_of[state] = made.seconds_of.get(state, 0.0) + end - begun
        log.append({"time_s": end, "state": state, "event": event, "decision": decision, "reason": reason, "state_s": round(end - begun, 3), **counts})

    def drive(goal, event, decision, seconds, reason=""):
        """The step before has told the goal; a failed drive stops half way."""
        is_success = event == "success"
        share = 1.0 if is_success else 0.5
        for k in range(1, 11):
            pose = [round(old + share * k / 10 * (new - old), 3) for old, new in zip(base, goal)]
            path.append({"time_s": round(now[0] + seconds * k / 10, 3), "base": pose})
        base[:] = path[-1]["base"]
        step("drive", event, decision, seconds, reason, failed=not is_success)
        if is_success:
            made.standing.append(tuple(base))

    def told(pose):
        return f"at ({pose[0]:.2f}, {pose[1]:.2f}) m, {pose[2]:.2f} rad"

    def select():
        segments = []
        for k in range(40):
            angle = 2 * math.pi * k / 40
            factors = {name: rng.random() * 0.8 for name in WEIGHTS}
            information = sum(WEIGHTS[name] * value for name, value in factors.items())
            penalty = 0.5 if rng.random() < 0.05 else 0.0
            kind = 2 if not selections and math.cos(angle) > 0.3 else 0
            segments.append({"midpoint": [0.75 * math.cos(angle), 0.6 * math.sin(angle)], "kind": kind, "verdict": 1 if kind == 2 else 3 if k % 11 == 0 else 0,
                             "manipulability": rng.random(), "height": 0.4, "distance": None if k % 11 == 0 else 2.0, "uncertainty": 1e-4, "frontier": 1e-6,
                             **{name + "_factor": value for name, value in factors.items()}, "information": information,
                             "failure_penalty": penalty, "utility": (1 - penalty) * information})
        best = max((k for k in range(40) if segments[k]["verdict"] == 0), key=lambda k: segments[k]["utility"])
        selections.append({"time_s": now[0], "strategy": "gpis", "outcome": 0, "message": "", "best": best, "segments": segments})
        angle = 2 * math.pi * best / 40
        goal = (round(1.3 * math.cos(angle), 2), round(1.2 * math.sin(angle), 2), round(math.remainder(angle + math.pi, 2 * math.pi), 2))
        step("select", "success", "drive", 0.3, f"the best view {told(goal)}")
        return goal

    def world_picture():
        image = np.full((54, 96, 3), 0.55)
        for number, (x, y, z) in enumerate(middles[judged["stowed"]:]):
            column, row = int(48 + 30 * x), int(40 - 30 * z + 5 * y)
            image[row - 3:row + 3, column - 3:column + 3] = (0.7, 0.3, 0.2)
        matplotlib.image.imsave(pictures / f"world_{now[0]:09.3f}_{judged['stowed']:03d}.png", image)

    def map_mesh():
        write_ply(pictures / f"map_{now[0]:09.3f}_{counts['bricks_picked']:03d}.ply", *pile_mesh(middles[counts["bricks_picked"]:]))

    judge_row(START_S)
    world_picture()
    step("idle", "hand", "idle", 3.0, "unknown, now empty")
    step("idle", "start", "begin", 0.5, "hand empty")
    survey = ((-2.4, 0.0, 0.0), (-1.8, 0.0, 0.0))
    step("begin", "entered", "drive", 0.0, f"survey not finished; survey pose 1 of 2 {told(survey[0])}")
    for place in range(2):
        drive(survey[place], "success", "look", 9.0)
        step("look", "success", "detect", 6.0)
        step("detect", "success", "drive" if place == 0 else "choose", 1.0, f"survey pose 2 of 2 {told(survey[1])}" if place == 0 else "")
    map_mesh()
    brick = 0
    while brick < bricks:
        step("choose", "entered", "select", 0.0, "no brick in reach")
        goal = select()
        if rng.random() < 0.2:
            drive(goal, "obstacle", "report", 6.0, "an obstacle on the path stays")
            step("report", "success", "select", 0.1)
            goal = select()
        counts["views"] += 1
        drive(goal, "success", "look", 8.0 + 8.0 * rng.random())
        step("look", "success", "detect", 6.0)
        step("detect", "success", "choose", 1.0)
        for _ in range(rng.randint(1, 3)):
            if brick >= bricks:
                break
            chosen = f"brick to be tried from here; brick {brick}, the highest that is graspable"
            step("choose", "entered", "plan_pick", 0.0, chosen)
            ledger[brick] = {"id": brick, "is_picked": False, "picks_begun": 0, "picks_failed": 0, "plans_failed": 0, "failures": {}, "last_failure": ""}
            if rng.random() < 0.3:
                step("plan_pick", "approach blocked", "choose", 0.5, "its neighbour is in the way", failed=True)
                made.plans_failed[brick] = 1
                step("choose", "entered", "plan_pick", 0.0, chosen)
            step("plan_pick", "success", "pick", 0.5)
            counts["picks_begun"] += 1
            ledger[brick]["picks_begun"] = 1
            pick_s = 14.0 + 6.0 * rng.random()
            if brick == 3:
                events.append({"time_s": round(now[0] + 5.0, 3), "event": "fall", "brick": 7, "distance_m": 0.21, "tilt_rad": 0.6})
                judged["falls"] += 1
            events.append({"time_s": round(now[0] + pick_s - 1.0, 3), "event": "stow", "brick": brick})
            judged["stowed"] += 1
            counts["bricks_picked"] += 1
            counts["bricks_open"] -= 1
            ledger[brick]["is_picked"] = True
            step("pick", "success", "plan_clear", pick_s)
            world_picture()
            step("plan_clear", "success", "clear", 0.3)
            step("clear", "success", "look", 3.0)
            step("look", "success", "detect", 4.0)
            step("detect", "success", "choose", 1.0)
            map_mesh()
            brick += 1
    step("choose", "entered", "select", 0.0, "no brick known")
    selections.append({"time_s": now[0], "strategy": "gpis", "outcome": 8, "message": "nothing above the ground", "best": -1, "segments": []})
    step("select", "no pile", "ended", 0.3, "nothing left, or nothing seen", failed=True)  # as the mission counts it
    made.end_s = now[0]
    judge_row(now[0] + 0.01)

    def lines(name, rows):
        (folder / name).write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")

    lines("mission.jsonl", log)
    lines("selections.jsonl", selections)
    lines("events.jsonl", events)
    lines("path.jsonl", path)
    (folder / ".run_mission").write_text("scripts/run_mission --run results/made --seed 1 \ndate: 2026-01-02T03:04:05Z\nhost: workbench\ncommit: 0123456789\n",
                                         encoding="utf-8")
    (folder / "judge.csv").write_text("time_s,stowed,falls,dropped,collisions,load_contacts,coverage,precision,distance_m\n" +
                                      "".join(f"{t:.3f},{s},{f},{d},{c},{load},{cov},{pre},{dist:.3f}\n" for t, s, f, d, c, load, cov, pre, dist in table), encoding="utf-8")
    judge = {"start_time_s": START_S, "end_time_s": now[0] + 0.01, "bricks_total": bricks, "stowed": judged["stowed"], "falls": judged["falls"],
             "dropped": judged["dropped"], "collisions": judged["collisions"], "load_contacts": 0, "max_collision_force_N": 0.0, "coverage": judged["coverage"],
             "precision": judged["precision"], "exposed_area_m2": 3.1, "coverable_area_m2": 3.038, "covered_area_m2": 3.0, "surfaces_judged": 400, "surfaces_refused": 0,
             "distance_m": judged["distance"]}
    (folder / "judge.json").write_text(json.dumps(judge, indent=2), encoding="utf-8")
    summary = {"scene": "one_heap", "seed": seed, "strategy": "gpis", "removed_factor": "", "bricks_total": None, "bricks_picked": counts["bricks_picked"],
               "bricks_exhausted": 0, "picks_begun": counts["picks_begun"], "views": counts["views"], "end_reason": "no_brick_left",
               "end_message": "nothing left above the ground", "failures": kinds, "sim_seconds": round(now[0] - START_S - 0.5, 3), "wall_seconds": 411.0,
               "map_coverage": None, "map_precision": None, "falls": None, "collisions": None}
    (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    (folder / "mission_state.json").write_text(json.dumps({"version": 1, "has_ended": True, "bricks": list(ledger.values())}), encoding="utf-8")
    made.stowed, made.picked, made.falls, made.drops = judged["stowed"], counts["bricks_picked"], judged["falls"], judged["dropped"]
    precisions = [float(row[7]) for row in table if row[7]]
    made.coverage, made.precision, made.failures, made.selections = judged["coverage"], sum(precisions) / len(precisions), counts["failures"], len(selections)
    return made


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--bricks", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    make_run_folder(arguments.folder, arguments.bricks, arguments.seed)
