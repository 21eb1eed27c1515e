# SPDX-License-Identifier: BSD-3-Clause
"""Missions on a small scene that are disturbed: each node killed in each state of the mission, and faults of the world.

A mission takes the kills of one node, or one of each fault, one after the other as it comes to their states. It is a
process group of its own under scripts/run_mission; this program looks on by its master, disturbs it, and judges the end
by the simulator's judge. A row of OUT/mission.csv for each disturbance; goes on where it was interrupted, and tries those
again whose moment did not come, as long as any of them comes.
Exit code: 0 all met without a violation, 1 a violation, 2 bad usage, 3 no violation so far, but not all were run and met.
"""

import collections
import csv
import dataclasses
import json
import math
import os
import pathlib
import random
import shutil
import signal
import subprocess
import threading
import time
import urllib.parse
import xmlrpc.client

from . import ROOT, mission_recorder
from .cli import UsageError, one_line_errors, parser_of
from .workspace import check_messages, check_world, end_in_order, free_port, run_child

SCENE = "four_bricks"
PARAMS = ROOT / "sim_tests/integration_tests/config/soak_mission.yaml"
NODES = ("pick_mission", "gpis_mapping", "depth_self_filter", "brick_detection", "motion_planning", "ur_driver_bridge", "base_navigation",
         "nbv_selection", "system_diagnostics", "robot_state_publisher")
# begin and choose are left at once: nobody can meet a mission in them. In ended nothing is left to be disturbed.
# Those from idle on an undisturbed mission does not come to: next_step() leads there.
STATES = ("plan_clear", "clear", "look", "detect", "plan_pick", "pick", "select", "drive",
          "idle", "paused", "halting", "held", "plan_stow", "stow", "let_go", "recover", "wait", "report")
# Simulated seconds in the state after which the disturbance comes, at most: about how long the state lasts.
LONGEST_S = {"clear": 4.0, "look": 2.0, "detect": 0.5, "pick": 10.0, "drive": 8.0, "stow": 5.0, "recover": 0.5, "wait": 1.0, "paused": 2.0, "held": 2.0}
FAULTS = {"unreachable_brick": "idle", "camera_gone": "look", "localisation_gone": "drive", "protective_stop": "pick", "drop_brick": "pick",
          "move_brick": "look", "driver_gone": "pick", "obstacle": "drive"}
FAULT_S = {"camera_gone": 8.0, "localisation_gone": 8.0, "driver_gone": 5.0, "obstacle": 20.0}
# A person steps in so far before the base: braking_share of base_navigation.yaml times linear_m_per_s2 of base_profile.yaml.
FREE_M, REACTION_S, BRAKING_M_S2 = 0.3, 0.5, 0.7 * 0.2
FAULTS_EACH = 3
CARRY_S = 5.0  # simulated; a brick hangs about so long before it is over the container
# Simulated, from the end of one disturbance to the next: what is judged is what comes of each, not of the sum.
GAP_S = 5.0
# Without the heartbeat, which a mission whose hold has reached nobody stops, the clock all but stands: then the wall's.
STANDS_S = 20.0
WALL_LIMIT_S = 3000.0  # a mission lasts 200 to 900 simulated seconds
MASTER_S, BACK_S = 60.0, 60.0
# 3 times not met: then at the beginning of the state, whatever was drawn.
ATTEMPTS = 3
NOT_MET = "not met"
COLUMNS = ("number", "disturbance", "node", "state", "mission", "scene", "label", "seed", "happened", "at_s", "met_in", "on_s", "end_reason", "picked", "stowed", "falls",
           "drops", "collisions", "sim_s", "wall_s", "back_wall_s", "rss_mb", "verdict", "why", "end_message")


@dataclasses.dataclass(frozen=True)
class Case:
    number: int
    disturbance: str  # kill, or a name of FAULTS
    node: str  # that is killed
    state: str  # of the mission in which it comes
    mission: str  # those of one name come in one mission, if it comes to all of them


def plan():
    """All cases, those of a mission one after the other."""
    def kills(nodes):
        return [("kill", node, state, node) for node in nodes for state in STATES]
    # The number of a case is the seed of its mission: what comes later is put behind.
    cases = kills(NODES[:-1])
    # People who stay are in the way of all that comes after them.
    cases += [(fault, "", state, f"{'people' if fault == 'unreachable_brick' else 'faults'}_{turn}") for turn in range(FAULTS_EACH) for fault, state in FAULTS.items()]
    cases += kills(NODES[-1:])
    return [Case(number, *case) for number, case in enumerate(cases)]


def missions_of(cases):
    """[[case]], the missions that take them."""
    missions = {}
    for case in cases:
        missions.setdefault(case.mission, []).append(case)
    return list(missions.values())


def next_step(state, is_carrying, pending):
    """What to do with a mission in this state: (case that comes now or None, what leads to one that does not come by itself or None)."""
    for case in pending:
        if case.state == state and (is_carrying or case.disturbance != "drop_brick"):
            return case, None
    wanted = {case.state for case in pending if case.disturbance == "kill"}
    lead = None
    if state == "idle":
        lead = "start"
    elif state in ("paused", "held"):
        lead = "resume"
    elif state == "look" and "paused" in wanted:
        lead = "pause"
    elif state == "drive" and "wait" in wanted:
        lead = "localisation_gone"
    elif state == "pick" and wanted & ({"plan_stow", "stow", "let_go"} if is_carrying else {"halting", "held"}):
        lead = "hold"
    elif state == "pick" and is_carrying and "recover" in wanted:
        lead = "protective_stop"
    elif state == "pick" and not is_carrying and "report" in wanted and not wanted & {"plan_stow", "stow", "let_go", "recover"}:
        lead = "take_away"  # last: a brick less to go on with
    return None, lead


def verdict(case, facts, cases=()):
    """(verdict, why) from what was seen of a case and of its mission, which `cases` have disturbed.

    recovered: the pile is gone; ended safely: something is left, and the mission says why.
    """
    broken = []
    disturbances = [other.disturbance for other in cases or (case,)]
    if None in [facts[key] for key in ("collisions", "falls", "drops", "stowed", "total")]:
        broken.append("no word of the judge")
    else:
        if facts["collisions"] > 0:
            broken.append(f"{facts['collisions']} collisions")
        # What the magnet loses, by the fault's own doing, may roll against a brick.
        if facts["falls"] > disturbances.count("drop_brick"):
            broken.append(f"{facts['falls']} falls")
        if facts["drops"] > disturbances.count("drop_brick"):
            broken.append(f"{facts['drops']} drops")
    if facts["end_reason"] in ("", "none", "crashed"):
        broken.append("it did not end by itself")
    elif facts["end_reason"] != "no_brick_left" and not facts["end_message"]:
        broken.append("it ended without a reason in words")
    if facts["picked"] is not None and facts["stowed"] is not None and facts["picked"] > facts["stowed"]:
        broken.append(f"says {facts['picked']} picked, {facts['stowed']} are")
    left = None if facts["stowed"] is None or facts["total"] is None else facts["total"] - facts["stowed"]
    # A brick that somebody has carried away the mission cannot know of.
    if facts["end_reason"] == "no_brick_left" and left and left > facts["taken_away"]:
        broken.append(f"says that none is left, {left} are")
    if facts["happened"] and case.disturbance == "kill" and facts["back_wall_s"] is None:
        broken.append("the node did not come back")
    if broken:
        return "VIOLATION", "; ".join(broken)
    if not facts["happened"]:
        return NOT_MET, "the moment did not come, or it was refused: see notes in soak.json"
    return ("recovered", "") if left == 0 else ("ended safely", f"{left} left")


def rss_mb(pid):
    """None: it is not there."""
    try:
        return round(mission_recorder.rss_mb(pathlib.Path(f"/proc/{pid}")))
    except (OSError, ValueError):
        return None


class NotUp(UsageError):
    """The mission's nodes do not come up."""


class WatchedMission:
    """One mission, looked on. Callbacks come in rospy's threads and only store; one thread does the rest."""

    def __init__(self, folder, port, scene, seed):
        self.folder, self.port, self.scene, self.seed = folder, port, scene, seed
        self.random = random.Random(seed)
        self.state, self.judge, self.bridge, self.odometry, self.tf = None, None, None, None, {}
        self.changed = threading.Condition()
        self.notes = []

    def launch(self, options, arguments):
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        self.log = open(self.folder.with_suffix(".txt"), "w", encoding="utf-8")
        self.process = subprocess.Popen([str(ROOT / "scripts/run_mission"), "--run", str(self.folder), "--overwrite", "--scene", self.scene, "--seed", str(self.seed),
                                         "--ideal", "--no-pictures", "--no-page", "--port", str(self.port), *options, "--", *arguments],
                                        stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log)

    def end(self):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough
        if self.process.poll() is None:
            self.process.terminate()  # in the background an interrupt is ignored
            self.process.wait()
        self.log.close()

    def connect(self):
        import rosgraph
        import rospy
        from interactive_mapping_msgs.msg import ArmBridgeState, MissionState
        from nav_msgs.msg import Odometry
        from simulated_world.msg import JudgeState
        from tf2_msgs.msg import TFMessage
        self.rospy, self.rosgraph = rospy, rosgraph
        self.names = {value: name.lower() for name, value in vars(MissionState).items() if name in {state.upper() for state in STATES} | {"ENDED"}}
        # rospy asks once, when it begins, which clock there is.
        if not self.until(lambda: rosgraph.is_master_online() and rosgraph.Master("soak_mission").hasParam("/use_sim_time"), MASTER_S):
            raise NotUp(f"the mission does not begin; see {self.log.name}")
        rospy.init_node("soak_mission", anonymous=True, disable_signals=True, disable_rosout=True)
        self.topics = {"state": ("/pick_mission/state", MissionState), "bridge": ("/ur_driver_bridge/state", ArmBridgeState),
                       "judge": ("/simulated_world/judge", JudgeState), "odometry": ("/odom", Odometry)}
        self.subscribers = {name: self.subscribe(name) for name in self.topics}
        for topic in ("/tf", "/tf_static"):
            rospy.Subscriber(topic, TFMessage, self.on_tf, queue_size=10)

    def subscribe(self, name):
        return self.rospy.Subscriber(*self.topics[name], lambda message: self.store(name, message), queue_size=100)

    def subscribe_again(self, node):
        """rospy asks a publisher that has just come once, and if that is too early never again."""
        for name, (topic, _) in self.topics.items():
            if topic.split("/")[1] == node:
                self.subscribers[name].unregister()
                self.subscribers[name] = self.subscribe(name)

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
        from simulated_world.srv import InjectFault, InjectFaultRequest
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

    def visit(self):
        """Changes with each entering of a state."""
        with self.changed:
            return None if self.state is None else (self.state.state, self.state.since.to_sec())

    def pid_of(self, node):
        try:
            with xmlrpc.client.ServerProxy(self.rosgraph.Master("soak_mission").lookupNode("/" + node)) as proxy:
                return proxy.getPid("soak_mission")[2]
        except (OSError, self.rosgraph.MasterException, xmlrpc.client.Error):
            return None


class DisturbedMission(WatchedMission):
    """One that is disturbed by each of `cases`."""

    def __init__(self, cases, out, port, scene, label):
        super().__init__(out / "mission" / f"{cases[0].number:03d}", port, scene, seed=1 + cases[0].number)
        self.cases, self.label = cases, label
        self.memory = {}
        self.facts = {case: {"happened": False, "at_s": None, "met_in": "", "on_s": None, "back_wall_s": None} for case in cases}
        self.misses = collections.Counter()
        self.taken_away = 0

    def lead(self, what):
        """Towards a state that the mission would not come to by itself."""
        if what in ("start", "pause", "resume"):
            self.call(what)
        elif what == "hold":
            # halting lasts for as long as the arm takes to stop: whoever waits for the call's end is too late to see it.
            threading.Thread(target=self.call, args=("hold",), daemon=True).start()
        elif what == "take_away":
            if self.inject("move_brick", brick_id=self.state.brick, pose=self.pose(2.0, 2.0, 0.1)):
                self.taken_away += 1
        else:
            self.inject(what, duration_s=FAULT_S.get(what, 0.0))

    def meets(self, case):
        """Waits for the drawn moment in the case's state; false when the mission has left it before."""
        longest_s = CARRY_S if case.disturbance == "drop_brick" else LONGEST_S.get(case.state, 0.0)
        delay_s = 0.0 if self.misses[case] >= ATTEMPTS else self.random.random() * longest_s / 2 ** self.misses[case]
        since_s = self.now_s()

        def is_there():
            return self.in_state(case.state) and (self.is_carrying() or case.disturbance != "drop_brick")

        self.until(lambda: not is_there() or self.now_s() >= since_s + delay_s, STANDS_S)
        self.misses[case] += not is_there()
        return is_there()

    def kill(self, case):
        """Ends the node; true when it has come back."""
        # The master forgets nobody who was killed: whoever does not answer is not back yet.
        if not self.until(lambda: self.pid_of(case.node) is not None, BACK_S):
            return False
        pid = self.pid_of(case.node)
        # Whatever answered: nothing but what this run has started is ended.
        environment = pathlib.Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
        if not any(entry.startswith(b"RUN_MISSION_MARK=") and entry.endswith(f"-{self.port}".encode()) for entry in environment):
            raise RuntimeError(f"process {pid}, which answers for {case.node}, is not of this run")
        begun = time.monotonic()
        os.kill(pid, signal.SIGKILL)
        if case.node == "pick_mission":
            self.store("state", None)
        while self.process.poll() is None and time.monotonic() < begun + BACK_S:
            if self.pid_of(case.node) not in (pid, None):
                self.facts[case]["back_wall_s"] = round(time.monotonic() - begun, 1)
                self.subscribe_again(case.node)
                return
            time.sleep(0.1)  # the master tells nobody of a node that has come

    def fault(self, kind):
        """Makes the world do it; false when it refuses."""
        if kind == "unreachable_brick":
            # Far from the others, people on all four sides of it.
            done = self.inject("move_brick", brick_id=self.judge.bricks_total - 1, pose=self.pose(0.25, 1.4, 0.1))
            for x, y in ((0.45, 0.0), (-0.45, 0.0), (0.0, 0.45), (0.0, -0.45)):
                done = self.inject("obstacle", pose=self.pose(0.25 + x, 1.4 + y)) and done
            self.taken_away += done
            return done
        if kind == "move_brick":
            # Of those not picked; where it would not be free it is refused: another place then.
            picked = {brick.id for brick in self.state.bricks if brick.status == brick.PICKED}
            brick = self.random.choice(sorted({brick.id for brick in self.state.bricks} - picked) or [0])
            return any(self.inject(kind, brick_id=brick, pose=self.pose(self.random.uniform(-0.7, 0.7), self.random.uniform(-0.8, 0.8), 0.1)) for _ in range(20))
        if kind == "obstacle":
            # Nobody can stop for whoever steps in closer: front of the base 0.3 m before base_link, a person 0.2 m about its middle.
            speed_m_s = abs(self.odometry.twist.twist.linear.x)
            free_m = FREE_M + REACTION_S * speed_m_s + speed_m_s ** 2 / (2.0 * BRAKING_M_S2)
            return self.inject(kind, duration_s=FAULT_S[kind], pose=self.pose(*self.in_map(0.5 + free_m, 0.0)))
        return self.inject(kind, duration_s=FAULT_S.get(kind, 0.0))

    def disturb(self):
        """Each case when the mission comes to its state, and what it waits for a person to do, until it is over."""
        pending, next_s, next_wall_s, led, last = list(self.cases), 0.0, math.inf, None, None
        while True:
            # Of the last: when the mission has gone on from where it met it.
            if last is not None and self.state is not None and self.visit() != last[1]:
                self.facts[last[0]]["on_s"] = round(self.now_s() - self.facts[last[0]]["at_s"], 2)
                last = None
            if self.is_over():
                return
            visit = self.visit()
            case, lead = (None, None) if visit is None else next_step(self.names.get(visit[0], ""), self.is_carrying(), pending)
            is_due = self.now_s() >= next_s or time.monotonic() >= next_wall_s
            if case is not None and is_due and (last is None or last[1] != visit):
                if not self.meets(case):
                    continue
                visit = self.visit()
                facts = self.facts[case]
                facts.update(happened=True, at_s=round(self.now_s(), 2), met_in=self.names.get(self.state.state, "?"))
                if case.disturbance == "kill":
                    self.kill(case)
                    led = None  # one that has come anew may wait in a visit just like that before
                else:
                    facts["happened"] = self.fault(case.disturbance)
                pending.remove(case)
                last = (case, visit)
                gap_s = FAULT_S.get(case.disturbance, 0.0) + GAP_S
                next_s, next_wall_s = self.now_s() + gap_s, time.monotonic() + gap_s + STANDS_S
            elif lead is not None and (visit, lead) != led:
                self.lead(lead)
                led = (visit, lead)
            else:
                self.until(lambda seen=visit: self.visit() != seen or self.is_carrying(), 0.1)

    def watch_memory(self, stop):
        while not stop.wait(5.0):
            for node in (*NODES, "simulated_world"):
                size = rss_mb(self.pid_of(node) or 0)
                if size is not None:
                    self.memory[node] = size

    def run(self):
        begun = time.monotonic()
        autostart = ["autostart:=false"] if any(case.state == "idle" for case in self.cases) else []
        self.launch(["--wall-limit", str(WALL_LIMIT_S)], [f"params:={PARAMS}", *autostart])
        stop = threading.Event()
        try:
            self.connect()
            self.until(lambda: self.state is not None and self.judge is not None)
            threading.Thread(target=self.watch_memory, args=(stop,), daemon=True).start()
            self.disturb()
            self.process.wait()
        finally:
            stop.set()
            self.end()
        return self.rows(time.monotonic() - begun)

    def rows(self, wall_s):
        try:
            summary = json.loads((self.folder / "summary.json").read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            self.notes.append(f"summary.json: {error}")
            summary = {}
        end = {"end_reason": summary.get("end_reason") or "", "end_message": summary.get("end_message") or "", "picked": summary.get("bricks_picked"),
               "stowed": summary.get("bricks_stowed"), "total": summary.get("bricks_total"), "taken_away": self.taken_away,
               **{key: summary.get(key) for key in ("falls", "drops", "collisions")}}
        met = [case for case in self.cases if self.facts[case]["happened"]]
        rows = []
        for case in self.cases:
            facts = {**self.facts[case], **end}
            result, why = verdict(case, facts, met)
            rows.append(dict(dataclasses.asdict(case), seed=self.seed, scene=self.scene, label=self.label, **facts, sim_s=summary.get("sim_seconds"), wall_s=round(wall_s),
                             rss_mb=" ".join(f"{node}={size}" for node, size in sorted(self.memory.items())), verdict=result, why=why))
        (self.folder / "soak.json").write_text(json.dumps({"rows": rows, "notes": self.notes}, indent=2) + "\n", encoding="utf-8")
        return rows


class NoTable(UsageError):
    """mission.csv is something else."""


def rows_of(path):
    """Raises NoTable."""
    try:
        with open(path, newline="", encoding="utf-8") as stream:
            table = csv.DictReader(stream)
            missing = set(COLUMNS) - set(table.fieldnames or COLUMNS)
            if missing:
                raise NoTable(f"{path}: no column {', '.join(column for column in COLUMNS if column in missing)}")
            return [row for row in table if row["end_message"] is not None]
    except FileNotFoundError:
        return []
    except (OSError, ValueError, csv.Error) as error:
        raise NoTable(f"{path}: {error}") from error


def append(path, rows):
    is_new = not path.exists()
    if not is_new:
        text = path.read_bytes()
        # Cut off when it was written.
        if not text.endswith(b"\n"):
            write(path, rows_of(path))
    with open(path, "a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS)
        if is_new:
            writer.writeheader()
        writer.writerows({column: "" if row[column] is None else row[column] for column in COLUMNS} for row in rows)


def write(path, rows):
    unfinished = path.with_name(path.name + ".part")
    with open(unfinished, "w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS, restval="", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    os.replace(unfinished, path)


def of_this(rows, scene, label):
    """Those of this scene and, if a label is given, of this state of the software."""
    return [row for row in rows if row["scene"] == scene and label in (None, row["label"])]


def latest(rows):
    """{number: row}; of one that was run again the last."""
    return {row["number"]: row for row in rows}


def left_of(cases, rows):
    """What is still to be run or met."""
    verdicts = {number: row["verdict"] for number, row in latest(rows).items()}
    return [case for case in cases if verdicts.get(str(case.number), NOT_MET) == NOT_MET]


def judged(rows, wanted, num_others=0):
    """Prints what came of them; the exit code."""
    rows, counts = latest(rows).values(), {}
    for row in rows:
        counts[row["verdict"]] = counts.get(row["verdict"], 0) + 1
        if row["verdict"] == "VIOLATION":
            print(f"VIOLATION: {row['number']}, {row['disturbance']} {row['node']} in {row['state']}, seed {row['seed']}: {row['why']}")
    met = len(rows) - counts.get(NOT_MET, 0)
    print(f"{met} of {wanted} disturbances: " + (", ".join(f"{count} {name}" for name, count in sorted(counts.items())) or "none"))
    if num_others > 0:
        print(f"{num_others} rows of another scene or state of the software are not counted")
    return 1 if "VIOLATION" in counts or not rows else 0 if met == wanted else 3


def tables(rows):
    """Markdown: kills as nodes by states, the simulated seconds until the mission went on; faults a line each; missions a line each."""
    rows = list(latest(rows).values())
    marks = {"recovered": "", "ended safely": " e", "VIOLATION": " **V**"}

    def cell(row):
        return "" if row is None else "-" if row["verdict"] == NOT_MET else (f"{float(row['on_s']):.1f}" if row["on_s"] else "0") + marks[row["verdict"]]

    kills = {(row["node"], row["state"]): row for row in rows if row["disturbance"] == "kill"}
    lines = ["| killed in | " + " | ".join(NODES) + " |", "| --- |" + " --: |" * len(NODES)]
    lines += [f"| {state} | " + " | ".join(cell(kills.get((node, state))) for node in NODES) + " |" for state in STATES]
    lines += ["", "| fault | in | went on after [s] |", "| --- | --- | --- |"]
    for fault, state in FAULTS.items():
        of_it = [row for row in rows if row["disturbance"] == fault]
        lines.append(f"| {fault} | {state} | " + ", ".join(cell(row) for row in of_it) + " |")
    lines += ["", "| mission | met | end reason | stowed | falls, drops, collisions | simulated [s] | wall [s] |", "| --- | --: | --- | --: | --- | --: | --: |"]
    missions = {}
    for row in rows:
        missions.setdefault((row["mission"], row["seed"], row["sim_s"]), []).append(row)
    for (name, _, sim_s), of_it in missions.items():
        met, row = sum(row["verdict"] != NOT_MET for row in of_it), of_it[0]
        lines.append(f"| {name} | {met} | {row['end_reason']} | {row['stowed']} | {row['falls']}, {row['drops']}, {row['collisions']} | "
                     f"{float(sim_s or 'nan'):.0f} | {row['wall_s']} |")
    return "\n".join(lines)


def master_uri(port):
    return urllib.parse.urlunsplit(("http", f"localhost:{port}", "", "", ""))


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "results/soak", help="folder of mission.csv and the runs")
    parser.add_argument("--scene", default=SCENE, help=f"of sim_tests/simulated_world/worlds (default {SCENE})")
    parser.add_argument("--label", metavar="TEXT", help="state of the software: rows of others are not counted (default: rows of any are)")
    parser.add_argument("--hours", type=float, default=math.inf, metavar="H", help="begin no other mission after this time of the wall clock")
    parser.add_argument("--plan", action="store_true", help="print what there is to meet and do nothing")
    parser.add_argument("--only", type=int, nargs="+", metavar="N", help="these in one mission, again if they were met before")
    parser.add_argument("--mission", nargs="+", metavar="NAME", help="these of the plan's missions only")
    parser.add_argument("--fresh", action="store_true", help="forget what was run before")
    parser.add_argument("--judge", action="store_true", help="tell what came of those that were run")
    parser.add_argument("--tables", action="store_true", help="the same as Markdown, for docs/results/mission_soak.md")
    arguments = parser.parse_args()
    cases = plan()
    check_world(arguments.scene)
    if not arguments.hours >= 0.0:
        parser.error(f"--hours {arguments.hours}, must be >= 0")
    if arguments.plan:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # a reader that has enough
        for case in cases:
            print(f"{case.number:3d}  {case.disturbance:18s} {case.node:18s} {case.state:10s} {case.mission}")
        return 0
    for number in arguments.only or ():
        if not 0 <= number < len(cases):
            parser.error(f"--only {number}, must be in [0, {len(cases) - 1}]")
    for name in arguments.mission or ():
        if name not in {case.mission for case in cases}:
            parser.error(f"--mission {name}, must be of {', '.join(dict.fromkeys(case.mission for case in cases))}")
    arguments.out = arguments.out.resolve()
    table = arguments.out / "mission.csv"
    return run_or_judge(arguments, cases, table)


def run_or_judge(arguments, cases, table):
    if (arguments.judge or arguments.tables) and not table.exists():
        raise NoTable(f"no {table.name} in {table.parent}")
    wanted = [case for case in cases if not arguments.mission or case.mission in arguments.mission]

    def judge():
        rows, numbers = rows_of(table), {str(case.number) for case in wanted}
        mine = of_this(rows, arguments.scene, arguments.label)
        return judged([row for row in mine if row["number"] in numbers], len(wanted), len(rows) - len(mine))

    if arguments.tables:
        print(tables(of_this(rows_of(table), arguments.scene, arguments.label)))
        return 0
    if arguments.judge:
        return judge()
    check_messages("mission")
    arguments.out.mkdir(parents=True, exist_ok=True)
    end_in_order()
    if arguments.only is not None:
        rows_of(table)  # rather now than after the mission
        port = free_port()
        os.environ.update(ROS_MASTER_URI=master_uri(port), ROS_HOSTNAME="localhost")
        rows = DisturbedMission([cases[number] for number in sorted(set(arguments.only))], arguments.out, port, arguments.scene, arguments.label or "").run()
        append(table, rows)
        for row in rows:
            print(f"{row['number']:3d}: {row['disturbance']} {row['node']} in {row['met_in'] or row['state']} at {row['at_s']} s: {row['verdict']}"
                  f"{', ' + row['why'] if row['why'] else ''}")
        print(f"     {row['end_reason']}, {row['stowed']} of {row['total']} stowed, {row['sim_s']} s simulated, {row['wall_s']} s", flush=True)
        return 1 if any(row["verdict"] == "VIOLATION" for row in rows) else 0
    if arguments.fresh:
        table.unlink(missing_ok=True)
        shutil.rmtree(arguments.out / "mission", ignore_errors=True)
    end = time.monotonic() + 3600.0 * arguments.hours
    command = [str(ROOT / "scripts/soak_mission.py"), "--out", str(arguments.out), "--scene", arguments.scene]
    if arguments.label is not None:
        command.append(f"--label={arguments.label}")
    num_left = len(wanted) + 1
    while True:
        left = left_of(wanted, of_this(rows_of(table), arguments.scene, arguments.label))
        # Once more for what was not met, as long as that gets less.
        if not left or len(left) >= num_left:
            return judge()
        num_left = len(left)
        for mission in missions_of(left):
            if time.monotonic() > end:
                return judge()
            num_before = len(rows_of(table))
            # rospy knows one master per process. One that breaks down exits with 1, too, and leaves no row.
            code = run_child([*command, "--only", *(str(case.number) for case in mission)])
            if code not in (0, 1) or len(rows_of(table)) <= num_before:
                return 2
