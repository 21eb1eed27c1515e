#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Missions on a small scene, each with one disturbance: a node killed in a state of the mission, or a fault of the world.

Each mission is a process group of its own under scripts/run_mission; this program looks on by its master, disturbs it
once, and judges the end by the simulator's judge. A row of OUT/mission.csv for each; goes on where it was interrupted, and
tries those once more in which the moment did not come.
Exit code: 0 all met without a violation, 1 a violation, 2 bad usage, 3 no violation so far, but not all were run and met.
"""

import argparse
import csv
import dataclasses
import json
import math
import os
import pathlib
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.parse
import xmlrpc.client

ROOT = pathlib.Path(__file__).resolve().parent.parent
SCENE = "four_bricks"
CONFIG = ROOT / "sim_tests/config/soak_mission.yaml"
NODES = ("pick_mission", "gpis_mapping", "depth_self_filter", "brick_detection", "motion_planning", "ur_driver_bridge", "base_navigation",
         "nbv_selection", "system_diagnostics")
# begin and choose are left at once: nobody can meet a mission in them. In ended nothing is left to be disturbed.
# A state that an undisturbed mission does not come to needs something that leads to it, see Mission.lead().
STATES = {"plan_clear": "", "clear": "", "look": "", "detect": "", "plan_pick": "", "pick": "", "select": "", "drive": "",
          "idle": "start by hand", "paused": "pause", "held": "hold", "halting": "hold", "plan_stow": "hold with a brick in the hand",
          "stow": "hold with a brick in the hand", "let_go": "hold with a brick in the hand", "recover": "protective stop in pick",
          "wait": "no localisation in drive", "report": "the brick is taken away in pick"}
# Simulated seconds in the state after which the disturbance comes, at most: about how long the state lasts.
LONGEST_S = {"clear": 4.0, "look": 2.0, "detect": 0.5, "pick": 10.0, "drive": 8.0, "stow": 5.0, "recover": 0.5, "wait": 1.0, "paused": 2.0, "held": 2.0}
FAULTS = {"camera_gone": "look", "localisation_gone": "drive", "protective_stop": "pick", "drop_brick": "pick", "move_brick": "look",
          "unreachable_brick": "idle", "driver_gone": "pick", "obstacle": "drive"}
FAULT_S = {"camera_gone": 8.0, "localisation_gone": 8.0, "driver_gone": 5.0, "obstacle": 20.0}
FAULTS_EACH = 3
CARRY_S = 5.0  # simulated; a brick hangs about so long before it is over the chute
# The clock waits 20 s of wall time (simulation.launch) for what a killed node owes; a mission lasts 200 to 900 simulated seconds.
WALL_LIMIT_S = 1500.0
MASTER_S, BACK_S = 60.0, 60.0
# 3 times not met: then at the beginning of the state, whatever was drawn.
ATTEMPTS = 3
NOT_MET = "not met"
COLUMNS = ("number", "disturbance", "node", "state", "lead", "scene", "label", "seed", "happened", "at_s", "met_in", "end_reason", "picked", "stowed", "falls", "drops",
           "collisions", "sim_s", "wall_s", "back_wall_s", "rss_mb", "verdict", "why", "end_message")


@dataclasses.dataclass(frozen=True)
class Case:
    number: int
    disturbance: str  # kill, or a name of FAULTS
    node: str  # that is killed
    state: str  # of the mission in which it comes
    seed: int  # of pile, noise, moment

    @property
    def lead(self):
        return STATES[self.state] if self.disturbance == "kill" else ""


def plan():
    """All cases, in an order in which any beginning is a fair sample."""
    cases = [("kill", node, state) for node in NODES for state in STATES]
    cases += [(fault, "", state) for fault, state in FAULTS.items() for _ in range(FAULTS_EACH)]
    random.Random(1).shuffle(cases)
    return [Case(number, *case, seed=1 + number) for number, case in enumerate(cases)]


def verdict(case, facts):
    """(verdict, why) from what was seen. recovered: the pile is gone; ended safely: something is left, and the mission says why."""
    broken = []
    if None in [facts[key] for key in ("collisions", "falls", "drops", "stowed", "total")]:
        broken.append("no word of the judge")
    else:
        if facts["collisions"] > 0:
            broken.append(f"{facts['collisions']} collisions")
        # What the magnet loses, by the fault's own doing, may roll against a brick.
        if facts["falls"] > (1 if case.disturbance == "drop_brick" else 0):
            broken.append(f"{facts['falls']} falls")
        if facts["drops"] > (1 if case.disturbance == "drop_brick" else 0):
            broken.append(f"{facts['drops']} drops")
    if facts["end_reason"] in ("", "none", "crashed"):
        broken.append("it did not end by itself")
    elif facts["end_reason"] != "no_brick_left" and not facts["end_message"]:
        broken.append("it ended without a reason in words")
    if facts["picked"] is not None and facts["stowed"] is not None and facts["picked"] > facts["stowed"]:
        broken.append(f"says {facts['picked']} picked, {facts['stowed']} are")
    left = None if facts["stowed"] is None or facts["total"] is None else facts["total"] - facts["stowed"]
    # A brick that somebody has carried away the mission cannot know of.
    if facts["end_reason"] == "no_brick_left" and left and case.disturbance != "unreachable_brick":
        broken.append(f"says that none is left, {left} are")
    if facts["happened"] and case.disturbance == "kill" and facts["back_wall_s"] is None:
        broken.append("the node did not come back")
    if broken:
        return "VIOLATION", "; ".join(broken)
    if not facts["happened"]:
        return NOT_MET, "the moment did not come, or it was refused: see notes in soak.json"
    return ("recovered", "") if left == 0 else ("ended safely", f"{left} left")


def rss_mb(pid):
    try:
        for line in pathlib.Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmRSS:"):
                return round(int(line.split()[1]) / 1024.0)
    except (OSError, ValueError):
        pass
    return None


class NotUp(Exception):
    """The mission's nodes do not come up."""


class Mission:
    """One mission, looked on and disturbed. Callbacks come in rospy's threads and only store; one thread does the rest."""

    def __init__(self, case, out, port, scene, label):
        self.case, self.port, self.scene, self.label = case, port, scene, label
        self.folder = out / "mission" / f"{case.number:03d}"
        self.random = random.Random(case.seed)
        self.state, self.judge, self.bridge, self.tf = None, None, None, {}
        self.memory = {}
        self.facts = {"happened": False, "at_s": None, "met_in": "", "back_wall_s": None}
        self.changed = threading.Condition()
        self.notes = []

    def launch(self):
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        arguments = [f"mission_config:={CONFIG}"]
        arguments += ["autostart:=false"] if self.case.lead == "start by hand" or self.case.disturbance == "unreachable_brick" else []
        self.log = open(self.folder.parent / f"{self.case.number:03d}.txt", "w", encoding="utf-8")
        self.process = subprocess.Popen([str(ROOT / "scripts/run_mission"), "--run", str(self.folder), "--overwrite", "--scene", self.scene, "--seed",
                                         str(self.case.seed), "--no-pictures", "--no-page", "--port", str(self.port), "--wall-limit",
                                         str(WALL_LIMIT_S), "--", *arguments], stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log)

    def connect(self):
        import rosgraph
        import rospy
        from interactive_mapping_msgs.msg import ArmBridgeState, MissionState
        from sim_tests.msg import JudgeState
        from tf2_msgs.msg import TFMessage
        self.rospy, self.rosgraph = rospy, rosgraph
        self.names = {value: name.lower() for name, value in vars(MissionState).items() if name in {state.upper() for state in STATES} | {"ENDED"}}
        # rospy asks once, when it begins, which clock there is.
        if not self.until(lambda: rosgraph.is_master_online() and rosgraph.Master("soak_mission").hasParam("/use_sim_time"), MASTER_S):
            raise NotUp(f"the mission does not begin; see {self.log.name}")
        rospy.init_node("soak_mission", anonymous=True, disable_signals=True, disable_rosout=True)
        rospy.Subscriber("/pick_mission/state", MissionState, lambda message: self.store("state", message), queue_size=100)
        rospy.Subscriber("/simulated_world/judge", JudgeState, lambda message: self.store("judge", message), queue_size=1)
        rospy.Subscriber("/ur_driver_bridge/state", ArmBridgeState, lambda message: self.store("bridge", message), queue_size=1)
        for topic in ("/tf", "/tf_static"):
            rospy.Subscriber(topic, TFMessage, self.on_tf, queue_size=10)

    def store(self, name, message):
        with self.changed:
            setattr(self, name, message)
            self.changed.notify_all()

    def on_tf(self, message):
        for transform in message.transforms:
            if transform.child_frame_id.lstrip("/") in ("odom", "base_link"):
                self.tf[transform.child_frame_id.lstrip("/")] = transform.transform

    def is_over(self):
        return self.process.poll() is not None or self.in_state("ended")

    def in_state(self, *states):
        return self.state is not None and self.names.get(self.state.state) in states

    def until(self, condition, wall_s=math.inf):
        """False: the time is up, or the mission is over. Looks again with each message, and 50 times a second at least."""
        end = time.monotonic() + wall_s
        with self.changed:
            while not condition():
                if time.monotonic() > end or self.is_over():
                    return False
                self.changed.wait(0.02)
        return True

    def is_carrying(self):
        """In the pick, by the bridge's word: the mission hears it at the pick's end."""
        return self.in_state("pick") and self.bridge is not None and self.bridge.is_holding

    def now_s(self):
        return self.rospy.get_time()

    def call(self, name):
        """A button of the mission; its node may be just coming back."""
        from std_srvs.srv import Trigger
        for _ in range(30):  # refused while what it calls is not there yet
            try:
                self.rospy.wait_for_service(f"/pick_mission/{name}", 10.0)
                answer = self.rospy.ServiceProxy(f"/pick_mission/{name}", Trigger)()
                self.notes.append(f"{name}: {answer.message}")
                if answer.success:
                    return True
            except (self.rospy.ROSException, self.rospy.ServiceException) as error:
                self.notes.append(f"{name}: {error}")
            self.until(lambda: False, 2.0)
            if self.is_over():
                return False
        return False

    def inject(self, kind, **fields):
        from sim_tests.srv import InjectFault, InjectFaultRequest
        self.rospy.wait_for_service("/simulated_world/inject_fault", 30.0)
        answer = self.rospy.ServiceProxy("/simulated_world/inject_fault", InjectFault)(InjectFaultRequest(kind=kind, **fields))
        self.notes.append(f"{kind}: {answer.message or 'injected'}")
        return answer.success

    def pose(self, x, y, z=0.0):
        from geometry_msgs.msg import Point, Pose, Quaternion
        return Pose(position=Point(x, y, z), orientation=Quaternion(0, 0, 0, 1))

    def in_map(self, x, y):
        """A point of base_link in the map, by the newest transforms."""
        for child in ("base_link", "odom"):
            transform = self.tf[child]
            yaw = 2.0 * math.atan2(transform.rotation.z, transform.rotation.w)
            x, y = (transform.translation.x + math.cos(yaw) * x - math.sin(yaw) * y, transform.translation.y + math.sin(yaw) * x + math.cos(yaw) * y)
        return x, y

    def lead(self):
        """Brings the mission to a state that it would not come to by itself."""
        lead = self.case.lead
        if lead == "pause":
            self.until(lambda: self.in_state("look"))
            self.call("pause")
        elif lead == "hold":
            self.until(lambda: self.in_state("pick"))
            # halting lasts for as long as the arm takes to stop: whoever calls is too late to see it.
            threading.Thread(target=self.call, args=("hold",), daemon=True).start()
        elif lead == "hold with a brick in the hand":
            self.until(self.is_carrying)
            self.call("hold")
            self.until(lambda: self.in_state("held"))
            threading.Thread(target=self.call, args=("resume",), daemon=True).start()
        elif lead == "protective stop in pick":
            self.until(self.is_carrying)
            self.inject("protective_stop")
        elif lead == "no localisation in drive":
            self.until(lambda: self.in_state("drive"))
            self.inject("localisation_gone", duration_s=8.0)
        elif lead == "the brick is taken away in pick":
            self.until(lambda: self.in_state("pick"))
            brick = self.state.brick
            self.inject("move_brick", brick_id=brick, pose=self.pose(2.0, 2.0, 0.1))

    def go_on(self):
        if self.case.lead == "start by hand" or self.case.disturbance == "unreachable_brick":
            self.call("start")
        elif self.case.lead in ("pause", "hold"):
            if self.until(lambda: self.in_state("paused", "held"), BACK_S) or not self.is_over():
                self.call("resume")

    def meet(self):
        """Waits for the state, and for the drawn moment in it; true when the mission is in it. Leading there is done once."""
        delay_s = self.random.random() * LONGEST_S.get(self.case.state, 0.0)
        for attempt in range(ATTEMPTS):
            if not self.until(lambda: self.in_state(self.case.state) or self.is_held_too_early()):
                return False
            if self.is_held_too_early():
                return False
            since_s = self.now_s()
            self.until(lambda: not self.in_state(self.case.state) or self.now_s() >= since_s + delay_s)
            if self.in_state(self.case.state):
                return True
            delay_s = 0.0 if attempt + 2 >= ATTEMPTS else delay_s / 2.0
        return False

    def is_held_too_early(self):
        """It went through halting unseen: nothing more comes by itself."""
        return self.case.lead == "hold" and self.case.state != "held" and self.in_state("held")

    def pid_of(self, node):
        try:
            with xmlrpc.client.ServerProxy(self.rosgraph.Master("soak_mission").lookupNode("/" + node)) as proxy:
                return proxy.getPid("soak_mission")[2]
        except (OSError, self.rosgraph.MasterException, xmlrpc.client.Error):
            return None

    def kill(self, node, pid):
        # Whatever answered: nothing but what this run has started is ended.
        environment = pathlib.Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
        if not any(entry.startswith(b"RUN_MISSION_MARK=") and entry.endswith(f"-{self.port}".encode()) for entry in environment):
            raise RuntimeError(f"process {pid}, which answers for {node}, is not of this run")
        begun = time.monotonic()
        os.kill(pid, signal.SIGKILL)
        while self.process.poll() is None and time.monotonic() < begun + BACK_S:
            if self.pid_of(node) not in (pid, None):
                self.facts["back_wall_s"] = round(time.monotonic() - begun, 1)
                return
            time.sleep(0.1)  # the master tells nobody of a node that has come

    def disturb(self):
        kind = self.case.disturbance
        pid = self.pid_of(self.case.node) if kind == "kill" else None
        self.lead()
        if kind == "drop_brick":
            met = self.until(self.is_carrying)
            # From the weighing to the chute: a drawn moment, or before it is let go.
            lost_s = self.now_s() + self.random.random() * CARRY_S
            self.until(lambda: self.now_s() >= lost_s or not self.is_carrying())
            met = met and self.is_carrying()
        else:
            met = self.meet()
        if not met:
            self.go_on()
            return
        self.facts.update(happened=True, at_s=round(self.now_s(), 2), met_in=self.names.get(self.state.state, "?"))
        if kind == "kill":
            # Looked up before, so that the state is not over meanwhile, and again if it was not there yet.
            self.kill(self.case.node, pid or self.pid_of(self.case.node))
        elif kind == "unreachable_brick":
            # Far from the others, people on all four sides of it.
            done = self.inject("move_brick", brick_id=self.judge.bricks_total - 1, pose=self.pose(0.25, 1.4, 0.1))
            for x, y in ((0.45, 0.0), (-0.45, 0.0), (0.0, 0.45), (0.0, -0.45)):
                done = self.inject("obstacle", pose=self.pose(0.25 + x, 1.4 + y)) and done
            self.facts["happened"] = done
        elif kind == "move_brick":
            # Of those not picked; where it would not be free it is refused: another place then.
            picked = {brick.id for brick in self.state.bricks if brick.status == brick.PICKED}
            brick = self.random.choice(sorted({brick.id for brick in self.state.bricks} - picked) or [0])
            self.facts["happened"] = any(self.inject(kind, brick_id=brick, pose=self.pose(self.random.uniform(-0.7, 0.7), self.random.uniform(-0.8, 0.8), 0.1))
                                         for _ in range(20))
        elif kind == "obstacle":
            # Front of the base 0.3 m before base_link, a person 0.2 m about its middle: half a metre is left to stop in.
            self.facts["happened"] = self.inject(kind, duration_s=FAULT_S[kind], pose=self.pose(*self.in_map(1.0, 0.0)))
        else:
            self.facts["happened"] = self.inject(kind, duration_s=FAULT_S.get(kind, 0.0))
        self.go_on()

    def watch_memory(self, stop):
        while not stop.wait(5.0):
            for node in (*NODES, "simulated_world"):
                size = rss_mb(self.pid_of(node) or 0)
                if size is not None:
                    self.memory[node] = size

    def run(self):
        begun = time.monotonic()
        self.launch()
        stop = threading.Event()
        try:
            self.connect()
            self.until(lambda: self.state is not None and self.judge is not None)
            threading.Thread(target=self.watch_memory, args=(stop,), daemon=True).start()
            self.disturb()
            self.until(lambda: False)
            self.process.wait()
        finally:
            stop.set()
            if self.process.poll() is None:
                self.process.send_signal(signal.SIGINT)
                self.process.wait()
            self.log.close()
        return self.row(time.monotonic() - begun)

    def row(self, wall_s):
        try:
            summary = json.loads((self.folder / "summary.json").read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            self.notes.append(f"summary.json: {error}")
            summary = {}
        facts = dict(self.facts, end_reason=summary.get("end_reason") or "", end_message=summary.get("end_message") or "", picked=summary.get("bricks_picked"),
                     stowed=summary.get("bricks_stowed"), total=summary.get("bricks_total"), falls=summary.get("falls"), drops=summary.get("drops"), collisions=summary.get("collisions"))
        result, why = verdict(self.case, facts)
        (self.folder / "soak.json").write_text(json.dumps({"case": dataclasses.asdict(self.case), "facts": facts, "verdict": result, "why": why,
                                                           "notes": self.notes}, indent=2) + "\n", encoding="utf-8")
        return dict(dataclasses.asdict(self.case), scene=self.scene, label=self.label, lead=self.case.lead, **facts, sim_s=summary.get("sim_seconds"), wall_s=round(wall_s),
                    rss_mb=" ".join(f"{node}={size}" for node, size in sorted(self.memory.items())), verdict=result, why=why)


class NoTable(Exception):
    """mission.csv is something else."""


def rows_of(path):
    """Raises NoTable. Tables of earlier versions have no label."""
    try:
        with open(path, newline="", encoding="utf-8") as stream:
            table = csv.DictReader(stream)
            missing = set(COLUMNS) - {"label"} - set(table.fieldnames or COLUMNS)
            if missing:
                raise NoTable(f"{path}: no column {', '.join(column for column in COLUMNS if column in missing)}")
            return [row for row in table if row["end_message"] is not None]
    except FileNotFoundError:
        return []
    except (OSError, ValueError, csv.Error) as error:
        raise NoTable(f"{path}: {error}") from error


def append(path, row):
    is_new = not path.exists()
    if not is_new:
        text = path.read_bytes()
        # Of an earlier version, or cut off when it was written.
        if text.split(b"\n", 1)[0].strip() != ",".join(COLUMNS).encode() or not text.endswith(b"\n"):
            write(path, rows_of(path))
    with open(path, "a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS)
        if is_new:
            writer.writeheader()
        writer.writerow({column: "" if row[column] is None else row[column] for column in COLUMNS})


def write(path, rows):
    unfinished = path.with_name(path.name + ".part")
    with open(unfinished, "w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS, restval="", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    os.replace(unfinished, path)


def of_this(rows, scene, label):
    """Those of this scene and, if a label is given, of this state of the software."""
    return [row for row in rows if row["scene"] == scene and (label is None or row.get("label", "") == label)]


def latest(rows):
    """{number: row}; of one that was run again the last."""
    return {row["number"]: row for row in rows}


def left_of(cases, rows):
    """What is still to be run, and after that once more what was not met."""
    verdicts = {number: row["verdict"] for number, row in latest(rows).items()}
    left = [case for case in cases if verdicts.get(str(case.number), NOT_MET) == NOT_MET]
    return sorted(left, key=lambda case: str(case.number) in verdicts)


def judged(rows, wanted, num_others=0):
    """Prints what came of them; the exit code."""
    rows, counts = latest(rows).values(), {}
    for row in rows:
        counts[row["verdict"]] = counts.get(row["verdict"], 0) + 1
        if row["verdict"] == "VIOLATION":
            print(f"VIOLATION: mission {row['number']}, {row['disturbance']} {row['node']} in {row['state']}, seed {row['seed']}: {row['why']}")
    met = len(rows) - counts.get(NOT_MET, 0)
    print(f"{met} of {wanted} missions: " + (", ".join(f"{count} {name}" for name, count in sorted(counts.items())) or "none"))
    if num_others > 0:
        print(f"{num_others} rows of another scene or state of the software are not counted")
    return 1 if "VIOLATION" in counts or not rows else 0 if met == wanted else 3


def free_port():
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        return probe.getsockname()[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "results/soak", help="folder of mission.csv and the runs")
    parser.add_argument("--scene", default=SCENE, help=f"of sim_tests/worlds (default {SCENE})")
    parser.add_argument("--label", metavar="TEXT", help="state of the software: rows of others are not counted (default: rows of any are)")
    parser.add_argument("--hours", type=float, default=math.inf, metavar="H", help="begin no other mission after this time of the wall clock")
    parser.add_argument("--plan", action="store_true", help="print the missions and do nothing")
    parser.add_argument("--only", type=int, metavar="N", help="this one, again if it was run before")
    parser.add_argument("--fresh", action="store_true", help="forget what was run before")
    parser.add_argument("--judge", action="store_true", help="tell what came of those that were run")
    arguments = parser.parse_args()
    cases = plan()
    if not (ROOT / f"sim_tests/worlds/{arguments.scene}.yaml").is_file():
        parser.error(f"--scene {arguments.scene}: no such file in sim_tests/worlds")
    if not arguments.hours >= 0.0:
        parser.error(f"--hours {arguments.hours}, must be >= 0")
    if arguments.plan:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # a reader that has enough
        for case in cases:
            print(f"{case.number:3d}  {case.disturbance:18s} {case.node:18s} {case.state:10s} seed {case.seed:3d}  {case.lead}")
        return 0
    if arguments.only is not None and not 0 <= arguments.only < len(cases):
        parser.error(f"--only {arguments.only}, must be in [0, {len(cases) - 1}]")
    arguments.out = arguments.out.resolve()
    table = arguments.out / "mission.csv"
    try:
        return run_or_judge(arguments, cases, table)
    except NoTable as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def run_or_judge(arguments, cases, table):
    def judge():
        rows = rows_of(table)
        mine = of_this(rows, arguments.scene, arguments.label)
        return judged(mine, len(cases), len(rows) - len(mine))

    if arguments.judge:
        return judge()
    try:
        import interactive_mapping_msgs.msg, rospy, sim_tests.msg  # noqa: F401, E401
    except ImportError as error:
        print(f"error: {error}: source devel/setup.bash, or use scripts/soak mission", file=sys.stderr)
        return 2
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.only is not None:
        rows_of(table)  # rather now than after the mission
        port = free_port()
        os.environ.update(ROS_MASTER_URI=urllib.parse.urlunsplit(("http", f"localhost:{port}", "", "", "")), ROS_HOSTNAME="localhost")
        try:
            row = Mission(cases[arguments.only], arguments.out, port, arguments.scene, arguments.label or "").run()
        except NotUp as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        append(table, row)
        print(f"{row['number']}: {row['disturbance']} {row['node']} in {row['met_in'] or row['state']} at {row['at_s']} s: {row['verdict']}"
              f"{', ' + row['why'] if row['why'] else ''}; {row['end_reason']}, {row['stowed']} stowed, {row['wall_s']} s", flush=True)
        return 1 if row["verdict"] == "VIOLATION" else 0
    if arguments.fresh:
        table.unlink(missing_ok=True)
        shutil.rmtree(arguments.out / "mission", ignore_errors=True)
    end = time.monotonic() + 3600.0 * arguments.hours
    command = [sys.executable, __file__, "--out", str(arguments.out), "--scene", arguments.scene]
    if arguments.label is not None:
        command.append(f"--label={arguments.label}")
    for case in left_of(cases, of_this(rows_of(table), arguments.scene, arguments.label)):
        if time.monotonic() > end:
            break
        num_before = len(rows_of(table))
        # rospy knows one master per process. One that breaks down exits with 1, too, and leaves no row.
        code = subprocess.call([*command, "--only", str(case.number)])
        if code not in (0, 1) or len(rows_of(table)) <= num_before:
            return 2
    return judge()


if __name__ == "__main__":
    sys.exit(main())
