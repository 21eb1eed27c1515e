# SPDX-License-Identifier: BSD-3-Clause
"""A mission on two computers whose link is cut: once while the arm approaches a brick, once while the base drives.

Two network namespaces stand for the computers. With `--arm-at robot` (machine:=robot, machine:=laptop of robot.launch) one
runs the master, the simulated drivers, the arm's bridge and the navigation, the other map, detection, planning, choice of
views and the mission. With `--arm-at laptop` (machine:=base, machine:=arm) the first keeps master and navigation alone; the
simulated devices are a third namespace, which each computer reaches by a cable of its own that stays, and what the base's
driver tells - odometry and tf - goes through the base's computer. The link between the two stays down for a while; until it
is back the robot has to stand still, and then the mission has to go on to its end. Needs root and iproute2.
Exit code: 0 all as it should be, 1 it is not, 2 bad usage.
"""

import json
import math
import os
import pathlib
import signal
import shutil
import subprocess
import sys
import threading
import time
import urllib.parse
from argparse import SUPPRESS

from . import ROOT
from .cli import one_line_errors, parser_of
from .workspace import check_messages, check_world, end_in_order, run_child

ROBOT, LAPTOP, DEVICES = "gpis_robot", "gpis_laptop", "gpis_devices"  # namespaces, and the ends of the cables
ADDRESS = {ROBOT: "10.77.0.1", LAPTOP: "10.77.0.2", DEVICES: "10.77.1.1"}
DEVICES_CABLES = {ROBOT: ("10.77.1.2", "10.77.1.1"), LAPTOP: ("10.77.2.2", "10.77.2.1")}  # the computer's end, the devices' end
PORT = 11311
PARAMS = ROOT / "sim_tests/integration_tests/config/soak_network.yaml"
CUTS = ("pick", "drive")  # states of the mission, in this order
REALTIME_FACTOR = 0.4  # of two cores that also draw, map and plan; at 1 joint states come too late for the arm's watch
CUT_S = 40.0  # wall time
ARM_STILL_RAD_S, BASE_STILL_M_S = 0.02, 0.02
# Simulated, by where the arm's driver is. robot: 0.13 s of the heartbeat, 0.1 s of the stop, and what the network holds;
# laptop: 1 s of tf (state/max_tf_age_s of motion_planning), 0.1 s until that is looked at, 0.25 s until the bridge misses it.
ARM_STOPS_WITHIN_S = {"robot": 1.0, "laptop": 1.5}
BASE_STOPS_WITHIN_S = 6.0  # simulated: 0.5 s of the heartbeat, 4 s of braking from full speed (base_profile.yaml), and what the network holds
# Wall time for the mission to be heard again, the longer of both: TCP's next try is at most as far away as the cut was long.
BACK_S, BACK_PER_CUT = 90.0, 1.5
ARM_JOINTS = ("shoulder_", "elbow_", "wrist_")
START_S, WALL_LIMIT_S = 120.0, 1500.0


def run(*command):
    subprocess.run(command, check=True)


def remove_network():
    for name in ADDRESS:
        subprocess.run(["ip", "netns", "delete", name], check=False, stderr=subprocess.DEVNULL)


def make_network(has_devices):
    remove_network()
    for name in (ROBOT, LAPTOP):
        run("ip", "netns", "add", name)
        run("ip", "-n", name, "link", "set", "lo", "up")
    run("ip", "link", "add", ROBOT, "netns", ROBOT, "type", "veth", "peer", "name", LAPTOP, "netns", LAPTOP)
    for name in (ROBOT, LAPTOP):
        run("ip", "-n", name, "address", "add", ADDRESS[name] + "/24", "dev", name)
        run("ip", "-n", name, "link", "set", name, "up")
    if not has_devices:
        return
    run("ip", "netns", "add", DEVICES)
    run("ip", "-n", DEVICES, "link", "set", "lo", "up")
    for name, (its, devices) in DEVICES_CABLES.items():
        run("ip", "link", "add", DEVICES, "netns", name, "type", "veth", "peer", "name", name, "netns", DEVICES)
        for namespace, end, address in ((name, DEVICES, its), (DEVICES, name, devices)):
            run("ip", "-n", namespace, "address", "add", address + "/24", "dev", end)
            run("ip", "-n", namespace, "link", "set", end, "up")
        # Each is known by one address to all; nothing is forwarded.
        run("ip", "-n", DEVICES, "route", "add", ADDRESS[name] + "/32", "via", its)
        if devices != ADDRESS[DEVICES]:
            run("ip", "-n", name, "route", "add", ADDRESS[DEVICES] + "/32", "via", devices)


def set_link(state):
    run("ip", "-n", ROBOT, "link", "set", ROBOT, state)


def environment(name):
    return dict(os.environ, ROS_IP=ADDRESS[name], ROS_MASTER_URI=urllib.parse.urlunsplit(("http", f"{ADDRESS[ROBOT]}:{PORT}", "", "", "")))


class Watcher:
    """What the robot does, heard where its devices are, and what the mission says: with the arm at the robot across the link."""

    def __init__(self, odom):
        import rospy
        from interactive_mapping_msgs.msg import ArmBridgeState, MissionState
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import JointState
        from simulated_world.msg import JudgeState
        self.rospy, self.MissionState = rospy, MissionState
        self.changed = threading.Condition()
        self.mission = self.judge = self.bridge = None
        self.mission_heard = 0
        self.arm_rad_s = self.base_m_s = math.inf
        rospy.init_node("soak_network", disable_signals=True, disable_rosout=True)
        rospy.Subscriber("/pick_mission/state", MissionState, self.on_mission, queue_size=100)
        rospy.Subscriber("/simulated_world/judge", JudgeState, lambda message: self.store(judge=message), queue_size=1)
        rospy.Subscriber("/ur_driver_bridge/state", ArmBridgeState, lambda message: self.store(bridge=message), queue_size=1)
        rospy.Subscriber("/joint_states", JointState, self.on_joints, queue_size=1)
        rospy.Subscriber(odom, Odometry, self.on_odometry, queue_size=1)

    def store(self, **values):
        with self.changed:
            vars(self).update(values)
            self.changed.notify_all()

    def on_mission(self, message):
        self.store(mission=message, mission_heard=self.mission_heard + 1)

    def on_joints(self, message):
        arm = [abs(velocity) for name, velocity in zip(message.name, message.velocity) if name.startswith(ARM_JOINTS)]
        if arm:
            self.store(arm_rad_s=max(arm))

    def on_odometry(self, message):
        twist = message.twist.twist
        self.store(base_m_s=max(math.hypot(twist.linear.x, twist.linear.y), abs(twist.angular.z)))

    def in_state(self, name):
        return self.mission is not None and self.mission.state == getattr(self.MissionState, name.upper())

    def is_moving(self, state):
        if state == "pick":
            return self.bridge is not None and self.bridge.stage == "approach" and self.arm_rad_s > 10.0 * ARM_STILL_RAD_S
        return self.base_m_s > 10.0 * BASE_STILL_M_S

    def is_still(self):
        return self.arm_rad_s < ARM_STILL_RAD_S and self.base_m_s < BASE_STILL_M_S

    def until(self, condition, wall_s):
        end = time.monotonic() + wall_s
        with self.changed:
            while not condition():
                left_s = end - time.monotonic()
                if left_s <= 0.0:
                    return False
                self.changed.wait(min(left_s, 0.1))
        return True

    def now_s(self):
        return self.rospy.get_time()


def cut(watcher, state, arm_at, cut_s):
    """One row of the report, and what is wrong with it."""
    row, wrong = {"state": state}, []
    back_s = max(BACK_S, BACK_PER_CUT * cut_s)
    if not watcher.until(lambda: (watcher.in_state(state) and watcher.is_moving(state)) or watcher.in_state("ended"), WALL_LIMIT_S) \
            or watcher.in_state("ended"):
        return row, [f"no motion in {state} was met"]
    since_s, wall = watcher.now_s(), time.monotonic()
    set_link("down")
    row["cut_at_s"] = round(since_s, 2)
    print(f"{since_s:8.1f} s  the link is cut in {state}", flush=True)
    try:
        is_still = watcher.until(watcher.is_still, cut_s)
        row["still_after_s"] = round(watcher.now_s() - since_s, 2) if is_still else None
        row["speeds"] = [round(watcher.arm_rad_s, 4), round(watcher.base_m_s, 4)]
        limit_s = ARM_STOPS_WITHIN_S[arm_at] if state == "pick" else BASE_STOPS_WITHIN_S
        if not is_still or row["still_after_s"] > limit_s:
            wrong.append(f"{state}: not still {limit_s} s after the cut")
        # And it stays so: nothing may begin without the laptop.
        if is_still and watcher.until(lambda: not watcher.is_still(), max(0.0, cut_s - (time.monotonic() - wall))):
            wrong.append(f"{state}: moves again while the link is down")
        row["bridge_says"] = watcher.bridge.reason
    finally:
        heard = watcher.mission_heard
        set_link("up")
    wall = time.monotonic()
    is_back = watcher.until(lambda: watcher.mission_heard > heard, back_s)  # with the arm at the laptop it was never lost
    row["heard_again_after_wall_s"] = round(time.monotonic() - wall, 1) if is_back else None
    if not is_back:
        wrong.append(f"{state}: the mission is not heard within {back_s} s of the link's return")
    elif watcher.until(lambda: not watcher.is_still() or watcher.in_state("ended"), back_s):
        row["goes_on_after_wall_s"] = round(time.monotonic() - wall, 1)
    else:
        wrong.append(f"{state}: nothing moves within {back_s} s of the mission's return")
    print(f"{watcher.now_s():8.1f} s  {json.dumps(row)}", flush=True)
    return row, wrong


def devices_at(options):
    return ROBOT if options.arm_at == "robot" else DEVICES


def name_of(options):
    return "network" if options.arm_at == "robot" else "network_arm_at_laptop"


def inside(options):
    """In the namespace of the devices."""
    here = devices_at(options)
    out = pathlib.Path(options.out).resolve()
    os.environ.update(environment(here))
    os.environ.pop("ROS_HOSTNAME", None)
    groups, wrong, rows = [], [], []
    log = open(out / f"{name_of(options)}.txt", "w", encoding="utf-8")

    def start(name, *command):
        prefix = [] if name == here else ["ip", "netns", "exec", name]
        groups.append(subprocess.Popen(prefix + list(command), env=environment(name), stdin=subprocess.DEVNULL, stdout=log,
                                       stderr=log, start_new_session=True))

    def launch(name, *arguments):
        start(name, "roslaunch", "--wait", *arguments)

    try:
        run_folder = out / name_of(options)
        shutil.rmtree(run_folder, ignore_errors=True)
        start(ROBOT, "roscore", "-p", str(PORT))
        launch(here, "simulated_world", "simulated_world.launch", f"scene:={options.scene}", "seed:=1", "clock:=realtime", f"realtime_factor:={REALTIME_FACTOR}",
               "pick_action:=/ur_driver_bridge/pick", "base_driver:=" + ("/base_driver" if here == DEVICES else ""),
               f"arm_pose:={ROOT}/src/mp700_ur5e_description/config/arm_poses/inspect.yaml", "surface_topic:=/gpis_mapping/mesh")
        import rosgraph
        end = time.monotonic() + START_S
        # rospy asks once, when it begins, which clock there is.
        while not (rosgraph.is_master_online() and rosgraph.Master("soak_network").hasParam("/use_sim_time")):
            if time.monotonic() > end:
                return ["no master"], rows
            time.sleep(0.1)  # nobody tells of a master that has come
        watcher = Watcher("/base_driver/odom" if here == DEVICES else "/odom")
        if not watcher.until(lambda: watcher.judge is not None, START_S):
            return ["the simulated world does not come up"], rows
        if here == DEVICES:
            for topic in ("odom", "tf"):
                start(ROBOT, "rosrun", "topic_tools", "relay", f"/base_driver/{topic}", f"/{topic}", f"__name:=base_driver_{topic}")
        machine = {ROBOT: "robot", LAPTOP: "laptop"} if options.arm_at == "robot" else {ROBOT: "base", LAPTOP: "arm"}
        launch(ROBOT, "mp700_ur5e_bringup", "common.launch", "machine:=" + machine[ROBOT], f"params:={PARAMS}")
        launch(LAPTOP, "mp700_ur5e_bringup", "common.launch", "machine:=" + machine[LAPTOP], "autostart:=true",
               f"params:={PARAMS}", f"run_folder:={run_folder}", f"scene:={options.scene}")
        if not watcher.until(lambda: watcher.mission is not None, START_S):
            return ["the mission does not come up"], rows
        for state in CUTS:
            row, problems = cut(watcher, state, options.arm_at, options.cut_s)
            rows.append(row)
            wrong += problems
        if not watcher.until(lambda: watcher.in_state("ended"), WALL_LIMIT_S):
            wrong.append(f"the mission has not ended within {WALL_LIMIT_S:.0f} s")
        mission, judge = watcher.mission, watcher.judge
        rows.append({"end_message": mission.end_message, "picked": mission.bricks_picked, "stowed": judge.stowed, "bricks": judge.bricks_total,
                     "falls": judge.falls, "drops": judge.drops, "collisions": judge.collisions, "sim_s": round(watcher.now_s(), 1)})
        if judge.stowed != judge.bricks_total:
            wrong.append(f"{judge.stowed} of {judge.bricks_total} bricks stowed")
        if judge.falls or judge.drops or judge.collisions:
            wrong.append(f"{judge.falls} falls, {judge.drops} drops, {judge.collisions} collisions")
        return wrong, rows
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough
        for group in reversed(groups):
            os.killpg(group.pid, signal.SIGINT)
        for group in groups:
            try:
                group.wait(30.0)
            except subprocess.TimeoutExpired:
                os.killpg(group.pid, signal.SIGKILL)
        log.close()


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("--out", default=str(ROOT / "results/soak"), help="folder for network.json, network.txt and the run's folder; network_arm_at_laptop... with that")
    parser.add_argument("--arm-at", choices=list(ARM_STOPS_WITHIN_S), default="robot", help="the computer into which arm and camera are plugged")
    parser.add_argument("--scene", default="four_bricks")
    parser.add_argument("--cut-s", type=float, default=CUT_S, help="how long the link stays down each time [s of wall time] (default %(default)s)")
    parser.add_argument("--inside", action="store_true", help=SUPPRESS)
    options = parser.parse_args()
    check_world(options.scene)
    check_messages("network")
    if not 5.0 <= options.cut_s <= 600.0:
        parser.error(f"--cut-s {options.cut_s}, must be in [5, 600] s")
    out = pathlib.Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    end_in_order()
    if options.inside:
        wrong, rows = inside(options)
        (out / f"{name_of(options)}.json").write_text(json.dumps({"rows": rows, "wrong": wrong}, indent=2) + "\n", encoding="utf-8")
        for row in rows:
            print(json.dumps(row))
        for problem in wrong:
            print("FAILED: " + problem)
        return 1 if wrong else 0
    if os.geteuid() != 0 or shutil.which("ip") is None:
        print("network namespaces need root and the program ip (package iproute2)", file=sys.stderr)
        return 2
    try:
        make_network(devices_at(options) == DEVICES)
        return run_child(["ip", "netns", "exec", devices_at(options), str(ROOT / "scripts/soak_network.py"), "--inside", "--out", str(out),
                                       "--scene", options.scene, "--arm-at", options.arm_at, "--cut-s", str(options.cut_s)])
    finally:
        remove_network()
