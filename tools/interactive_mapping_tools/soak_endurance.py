# SPDX-License-Identifier: BSD-3-Clause
"""Mission after mission for hours of simulated time, in the same processes.

When a mission has ended the base drives back to where it began, the bricks are laid down where they were, and the next mission is
started: what the map knows is from the one before. The map is
bounded to the place of work, so that it has all the ground there is from the first on. At the end no process may have grown: of each, what it holds in the last
quarter is compared with what it held in the second, when the map has had all the ground there is. The map's points are told
beside it: a view that no mission had before shows new ground.
Exit code: 0 all as it should be, 1 it is not, 2 bad usage.
"""

import contextlib
import csv
import json
import math
import os
import pathlib
import shutil
import signal
import statistics
import subprocess
import threading
import time

from . import ROOT, soak_mission
from .cli import one_line_errors, parser_of
from .mission_run import END_WORDS
from .workspace import check_messages, check_world, end_in_order, free_port

SCENE = "four_bricks"
PARAMS = ROOT / "sim_tests/integration_tests/config/endurance_map.yaml"
JITTER_M = 0.03  # of a brick that is laid down again
BACK_AHEAD_M = 0.3  # of where the robot stood at first: a place is come to straight on, over ground that the camera has seen
MISSION_S = 900.0  # simulated: time limit of one mission, several times what one takes
DRIVE_BACK_WALL_S, LAUNCH_WALL_S, STALL_WALL_S, MISSION_WALL_S = 600.0, 120.0, 120.0, 3600.0
JUDGED_EVERY_S = 1.0  # simulated
MEMORY_EVERY_S = 10.0  # of the wall clock
MOST_GROWTH, MOST_GROWTH_MB = 0.05, 5.0  # of what a process held; an allocator's step is a few MB
LEAST_STOWED, FALLS_IN_TEN = 0.95, 1  # of the bricks; of missions
HOLD_THE_MAP = ("gpis_mapping", "motion_planning", "nbv_selection")
COLUMNS, MAP_COLUMNS = ("time_s", "node", "resident_mb"), ("time_s", "map_points")


def started_for(master_uri):
    """Ids of the processes that were started with this master in their environment."""
    for environment in pathlib.Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            if f"ROS_MASTER_URI={master_uri}".encode() in environment.read_bytes().split(b"\0"):
                yield int(environment.parent.name)


class Endurance(soak_mission.WatchedMission):
    def __init__(self, folder, port, scene, seed, hours):
        super().__init__(folder, port, scene, seed)
        self.limit_s = 3600.0 * hours
        self.truth, self.driven, self.map = None, None, None
        self.rows = []  # a mission each
        self.memory = []  # (simulated time, node, MB)
        self.map_sizes = []  # (simulated time, "map", points)
        self.pids = {}  # of the nodes, as they came up
        self.problems = []

    def launch(self):
        if self.folder.exists():
            shutil.rmtree(self.folder)
        self.folder.mkdir(parents=True)
        (self.folder.parent / "endurance.json").unlink(missing_ok=True)
        self.log = open(self.folder / "roslaunch.log", "w", encoding="utf-8")
        scene = [f"scene:={self.scene}", f"seed:={self.seed}", "clock:=lockstep", "ideal:=true", f"run_folder:={self.folder / 'run'}"]
        self.process = subprocess.Popen(["roslaunch", "-p", str(self.port), "mp700_ur5e_bringup", "simulation.launch", *scene, "autostart:=true",
                                         f"params:={PARAMS}", f"time_limit_s:={MISSION_S:g}"],
                                        env={**os.environ, "ROS_LOG_DIR": str(self.folder / "ros")}, stdin=subprocess.DEVNULL, stdout=self.log,
                                        stderr=self.log, start_new_session=True)

    def end(self):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if self.process.poll() is None:
            os.kill(self.process.pid, signal.SIGINT)  # roslaunch's handler: it ends its nodes in order
            try:
                self.process.wait(90.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        for pid in started_for(soak_mission.master_uri(self.port)):  # a node that roslaunch has left behind is in a session of its own
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.log.close()

    def connect(self):
        from interactive_mapping_msgs.msg import MapUpdate
        from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
        from visualization_msgs.msg import MarkerArray
        super().connect()
        for name, topic in (("truth", ("/simulated_world/truth", MarkerArray)), ("driven", ("/move_base/result", MoveBaseActionResult)),
                            ("map", ("/gpis_mapping/update", MapUpdate))):
            self.topics[name] = topic
            self.subscribers[name] = self.subscribe(name)
        self.goals = self.rospy.Publisher("/move_base/goal", MoveBaseActionGoal, queue_size=1)

    def is_over(self):
        return self.process.poll() is not None

    def watch_memory(self, stop):
        with open(self.folder / "memory.csv", "w", newline="", encoding="utf-8") as stream, open(self.folder / "map.csv", "w", newline="", encoding="utf-8") as map_stream:
            table, map_table = csv.writer(stream), csv.writer(map_stream)
            table.writerow(COLUMNS)
            map_table.writerow(MAP_COLUMNS)
            while not stop.wait(MEMORY_EVERY_S):
                for node in (*soak_mission.NODES, "simulated_world"):
                    pid = self.pid_of(node)
                    size = soak_mission.rss_mb(pid or 0)
                    if pid and self.pids.setdefault(node, pid) != pid:
                        self.problems.append(f"{self.now_s():.0f} s: {node} was restarted")
                        self.pids[node] = pid
                    if size is not None:
                        self.memory.append((self.now_s(), node, size))
                        table.writerow((f"{self.now_s():.2f}", node, size))
                if self.map is not None:
                    self.map_sizes.append((self.now_s(), "map", self.map.map_points))
                    map_table.writerow((f"{self.now_s():.2f}", self.map.map_points))
                stream.flush()
                map_stream.flush()

    def moves_on(self, what, condition):
        """Waits for it as long as the simulated time moves on, and MISSION_WALL_S at most."""
        seen_s, end = None, time.monotonic() + MISSION_WALL_S
        while not self.until(condition, STALL_WALL_S):
            if self.is_over():
                raise soak_mission.NotUp(f"roslaunch has ended; see {self.log.name}")
            if self.now_s() == seen_s:
                raise soak_mission.NotUp(f"the simulated clock stands at {seen_s:.1f} s; see {self.log.name}")
            if time.monotonic() > end:
                raise soak_mission.NotUp(f"{what} has not come within {MISSION_WALL_S:.0f} s; see {self.log.name}")
            seen_s = self.now_s()

    def drive_back(self, x, y, yaw):
        from actionlib_msgs.msg import GoalStatus
        from geometry_msgs.msg import Quaternion
        from move_base_msgs.msg import MoveBaseActionGoal
        message = MoveBaseActionGoal()
        message.goal_id.id = f"back after {len(self.rows)} missions"
        message.goal.target_pose.header.frame_id = "map"
        message.goal.target_pose.pose = self.pose(x, y)
        message.goal.target_pose.pose.orientation = Quaternion(0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))
        self.goals.publish(message)
        self.until(lambda: self.driven is not None and self.driven.status.goal_id.id == message.goal_id.id, DRIVE_BACK_WALL_S)
        if self.driven is None or self.driven.status.goal_id.id != message.goal_id.id:
            self.problems.append(f"{self.now_s():.1f} s: nobody tells whether the base is back")
        elif self.driven.status.status != GoalStatus.SUCCEEDED:
            self.problems.append(f"{self.now_s():.1f} s: the base did not get back: {self.driven.status.text}")

    def lay_down(self, places):
        """Bricks that were stowed, where they were at first. How many."""
        state, laid = self.state, 0
        for brick in state.bricks:
            if brick.status != brick.PICKED or brick.id not in places:
                continue
            for _ in range(5):
                try:
                    is_laid = self.inject("move_brick", brick_id=brick.id, pose=self.pose_like(places[brick.id]))
                except (self.rospy.ROSException, self.rospy.ServiceException) as error:
                    raise soak_mission.NotUp(f"the simulated world does not answer: {error}; see {self.log.name}") from error
                if is_laid:
                    laid += 1
                    break
            else:
                self.problems.append(f"{self.now_s():.1f} s: brick {brick.id} cannot be laid down: {self.notes[-1]}")
        return laid

    def pose_like(self, pose):
        other = self.pose(pose.position.x + self.random.uniform(-JITTER_M, JITTER_M), pose.position.y + self.random.uniform(-JITTER_M, JITTER_M), pose.position.z)
        other.orientation = pose.orientation
        return other

    def judged_now(self):
        """What the judge has counted until now: it counts once a second, and may tell between what it counted before."""
        least_s = self.now_s() + 2.0 * JUDGED_EVERY_S
        self.moves_on("the judge's count", lambda: self.judge.header.stamp.to_sec() >= least_s)
        return self.judge

    def row(self, laid, before, after, num_lying, wall_s):
        """Of a mission: what was stowed since `laid`, and what went wrong since `before`, the way back before it included."""
        reason = next((name for name in END_WORDS if getattr(self.state, name.upper()) == self.state.end_reason), str(self.state.end_reason))
        return {"begun_s": laid.header.stamp.to_sec(), "ended_s": self.now_s(), "end_reason": reason, "end_message": self.state.end_message, "bricks": num_lying,
                "wall_s": round(wall_s), "stowed": after.stowed - laid.stowed,
                **{key: getattr(after, key) - getattr(before, key) for key in ("falls", "drops", "collisions")}}

    def run(self):
        self.launch()
        begun, stop = time.monotonic(), threading.Event()
        try:
            self.connect()
            if not self.until(lambda: self.state is not None and self.judge is not None and self.truth is not None, LAUNCH_WALL_S):
                raise soak_mission.NotUp(f"the nodes do not come up; see {self.log.name}")
            places = {marker.id: marker.pose for marker in self.truth.markers if marker.ns == "bricks"}
            self.moves_on("tf", lambda: "odom" in self.tf and "base_link" in self.tf)
            (x, y), ahead = self.in_map(BACK_AHEAD_M, 0.0), self.in_map(BACK_AHEAD_M + 1.0, 0.0)
            start, num_lying = (x, y, math.atan2(ahead[1] - y, ahead[0] - x)), len(places)
            threading.Thread(target=self.watch_memory, args=(stop,), daemon=True).start()
            before = laid = self.judged_now()
            while True:
                self.moves_on("the mission's end", lambda: self.in_state("ended"))
                after = self.judged_now()
                row = self.row(laid, before, after, num_lying, time.monotonic() - begun)
                self.rows.append(row)
                print(f"{row['ended_s']:7.0f} of {self.limit_s:.0f} s  mission {len(self.rows):3d}: {row['end_reason']}, {row['stowed']} of {row['bricks']} stowed, "
                      f"{row['falls']} falls, {row['drops']} drops, {row['collisions']} collisions  wall {row['wall_s']} s", flush=True)
                if self.now_s() >= self.limit_s:
                    break
                self.write()
                self.drive_back(*start)
                num_laid = self.lay_down(places)
                num_lying += num_laid - row["stowed"]
                before, laid = after, self.judged_now()
                if not self.call("start") or not self.until(lambda: not self.in_state("ended"), LAUNCH_WALL_S):
                    raise soak_mission.NotUp(f"mission {len(self.rows) + 1} does not begin: {self.notes[-1]}")
        finally:
            stop.set()
            self.end()

    def write(self, growth=None, problems=None):
        """endurance.json, after each mission: what is cut off has told what there was."""
        report = {"missions": self.rows, "growth_mb": growth or {}, "problems": [*self.problems, "it has not ended"] if problems is None else problems, "notes": self.notes}
        (self.folder.parent / "endurance.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")


def growth_of(samples):
    """{node: (MB in the second quarter, MB in the last)}, medians, of (time_s, node, MB). Raises ValueError."""
    if not samples:
        raise ValueError("nobody has looked at the memory")
    end_s, growth = max(time_s for time_s, _, _ in samples), {}
    for node in sorted({node for _, node, _ in samples}):
        parts = [[mb for time_s, name, mb in samples if name == node and low * end_s < time_s <= high * end_s] for low, high in ((0.25, 0.5), (0.75, 1.0))]
        if not all(parts):
            raise ValueError(f"{node} has not been there all the time")
        growth[node] = tuple(statistics.median(part) for part in parts)
    return growth


def problems_of(rows, growth, map_points=(1, 1)):
    """What is not as it should be, a sentence each; rows of missions, growth_of() the memory and of the map's points."""
    problems = [f"{sum(row[key] for row in rows)} {key}, must be 0" for key in ("drops", "collisions") if any(row[key] for row in rows)]
    falls, bricks, stowed = (sum(row[key] for row in rows) for key in ("falls", "bricks", "stowed"))
    if falls * 10 > FALLS_IN_TEN * len(rows):
        problems.append(f"{falls} falls in {len(rows)} missions, may be {FALLS_IN_TEN} in ten")
    if stowed < LEAST_STOWED * bricks:
        problems.append(f"{stowed} of {bricks} bricks stowed, must be {LEAST_STOWED:.0%} at least")
    for node, (before, after) in growth.items():
        if after > before * (1.0 + MOST_GROWTH) + MOST_GROWTH_MB:
            told = f", the map by {map_points[1] / map_points[0] - 1.0:.0%}" if node in HOLD_THE_MAP else ""
            problems.append(f"{node} has grown from {before:.0f} to {after:.0f} MB{told}")
    return problems


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "results/soak", help="folder of endurance.json and the run")
    parser.add_argument("--scene", default=SCENE, help=f"of sim_tests/simulated_world/worlds (default {SCENE})")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sim-hours", type=float, default=2.0, metavar="H", help="of simulated time, then the mission that runs is the last (default 2), 0.1 to 24")
    arguments = parser.parse_args()
    check_world(arguments.scene)
    if not 0 <= arguments.seed <= 2147483647:
        parser.error(f"--seed {arguments.seed}, must be in [0, 2147483647]")
    if not 0.1 <= arguments.sim_hours <= 24.0:
        parser.error(f"--sim-hours {arguments.sim_hours}, must be in [0.1, 24]")
    check_messages("endurance")
    end_in_order()
    port = free_port()
    os.environ.update(ROS_MASTER_URI=soak_mission.master_uri(port), ROS_HOSTNAME="localhost")
    folder = arguments.out.resolve() / "endurance"
    endurance, failed = Endurance(folder, port, arguments.scene, arguments.seed, arguments.sim_hours), []
    try:
        endurance.run()
    except soak_mission.NotUp as error:
        failed.append(str(error))
    try:
        growth, map_points = growth_of(endurance.memory), growth_of(endurance.map_sizes)["map"]
    except ValueError as error:
        growth, map_points, failed = {}, (1, 1), [*failed, str(error)]
    rows, problems = endurance.rows, [*failed, *endurance.problems, *problems_of(endurance.rows, growth, map_points)]
    if growth:
        print(f"The map has {map_points[0]:.0f} points in the second quarter, {map_points[1]:.0f} in the last")
    for node, (before, after) in growth.items():
        print(f"{node:20s} {before:6.0f} MB in the second quarter, {after:6.0f} in the last")
    if rows:
        print(f"{len(rows)} missions, {sum(row['stowed'] for row in rows)} of {sum(row['bricks'] for row in rows)} bricks stowed, {rows[-1]['ended_s']:.0f} s simulated, "
              f"{sum(row['falls'] for row in rows)} falls, {sum(row['drops'] for row in rows)} drops, {sum(row['collisions'] for row in rows)} collisions")
    for problem in problems:
        print(f"PROBLEM: {problem}")
    endurance.write(growth, problems)
    return 1 if problems else 0
