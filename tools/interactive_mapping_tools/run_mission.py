# SPDX-License-Identifier: BSD-3-Clause
"""Runs one mission in the simulated world, to its end, and reports it. Needs a built workspace (scripts/demo builds it).

  scripts/run_mission --run FOLDER [options] [-- ARGUMENT:=VALUE ...]

What follows -- is for simulation.launch. Progress goes to the terminal, what the nodes say to FOLDER/log.
Exit code: 0 the mission has ended by itself, whatever it reached; 1 it has not; 2 bad usage; 3 given up at --wall-limit;
130 interrupted.
However it ends, everything that was started is ended, and what there is is reported.
"""

import contextlib
import datetime
import os
import pathlib
import re
import runpy
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time

from . import ROOT, strategies, workspace
from .cli import Parser, UsageError, one_line_errors
from .mission_recorder import is_of_run

LAUNCH_FILE = ROOT / "src/mp700_ur5e_bringup/launch/simulation.launch"
CHECK = ROOT / "src/interactive_mapping_common/scripts/check_launch_arguments"
OWN_ARGUMENTS = {"scene", "seed", "clock", "run_folder", "map", "strategy", "pictures", "rviz", "ideal"}  # each is set by an option
POLL_S = 0.2
ROSLAUNCH_ENDS_S = 60.0  # it ends its nodes by SIGINT, and those that do not within 15 s otherwise: the judge writes its report meanwhile
NODE_ENDS_S = 5.0


def parse(words):
    """Options, and arguments for the launch file. Raises UsageError before anything is touched."""
    split = words.index("--") if "--" in words else len(words)
    launch_arguments = words[split + 1:]
    parser = Parser(__doc__)
    parser.add_argument("--run", metavar="FOLDER", help="where everything goes, relative to the repository wherever this is called from; must not exist")
    parser.add_argument("--overwrite", action="store_true", help="an earlier run in FOLDER is deleted")
    parser.add_argument("--scene", default="one_heap", metavar="NAME", help="of sim_tests/simulated_world/worlds, or the absolute path of a file (default %(default)s)")
    parser.add_argument("--seed", default="1", metavar="N", help="of pile and noise, 0 to 2147483647 (default %(default)s)")
    parser.add_argument("--strategy", default="gpis", metavar="NAME", help="for the next best view: gpis (default), octomap_gradient_frontier, octomap_random, or your "
                        "own, with a section below nbv_selection in the file of -- params:=FILE and a package that exports its plugin")
    parser.add_argument("--removed-factor", metavar="F", help=f"of the utility, for the ablation: {', '.join(workspace.REMOVED_FACTORS)}")
    parser.add_argument("--time-limit", metavar="S", help="of the mission, simulated, 1 to 86400 (default: as configured)")
    parser.add_argument("--wall-limit", default="0", metavar="S", help="of the wall clock: then it is given up (default, and 0: none)")
    parser.add_argument("--clock", default="lockstep", metavar="MODE", help="lockstep (default: as fast as the machine allows) or realtime")
    parser.add_argument("--ideal", action="store_true", help="sensors, localisation and calibration without the faults that they have on the robot (default: with)")
    parser.add_argument("--port", metavar="N", help="of the master (default: a free one)")
    parser.add_argument("--rviz", action="store_true", help="show it")
    parser.add_argument("--no-pictures", action="store_true", help="none of the world")
    parser.add_argument("--no-page", action="store_true", help="summary.json alone: no plots, no page")
    options = parser.parse_args(words[:split])

    if not options.run:
        raise UsageError("--run FOLDER is needed")
    if not workspace.is_seed(options.seed):
        raise UsageError(f"--seed {options.seed}, must be a whole number in [0, {workspace.MAX_SEED}]")
    workspace.check_wall_limit(options.wall_limit)
    if options.port is not None:
        if not re.fullmatch("[1-9][0-9]{0,4}", options.port) or int(options.port) > 65535:
            raise UsageError(f"--port {options.port}, must be in [1, 65535]")
        with socket.socket() as probe:
            if probe.connect_ex(("localhost", int(options.port))) == 0:
                raise UsageError(f"--port {options.port}: something listens there, and the mission needs a master of its own")
    limit_s = options.time_limit
    if limit_s is not None:
        if not workspace.is_number(limit_s) or not 1 <= float(limit_s) <= 86400:
            raise UsageError(f"--time-limit {limit_s}, must be a number in [1, 86400] s")
        launch_arguments.append(f"time_limit_s:={limit_s}")
    removed = options.removed_factor
    if removed:
        if removed not in workspace.REMOVED_FACTORS:
            raise UsageError(f"--removed-factor {removed}, must be {', '.join(workspace.REMOVED_FACTORS[:-1])} or {workspace.REMOVED_FACTORS[-1]}")
        if options.strategy != "gpis":
            raise UsageError(f"--removed-factor {removed} is for --strategy gpis, not for {options.strategy}")
        launch_arguments.append(f"removed_factor:={removed}")
    # Before anything is deleted; simulation.launch would refuse it later.
    for argument in launch_arguments:
        name = argument.split(":=")[0]
        if not re.match("[a-z0-9_]+:=", argument):
            raise UsageError(f"{argument} after --, must be ARGUMENT:=VALUE")
        if name in OWN_ARGUMENTS:
            raise UsageError(f"{argument} after --: an option of this script sets {name}")
    if launch_arguments:
        for problem in runpy.run_path(str(CHECK))["problems_of"](launch_arguments, "mp700_ur5e_bringup", LAUNCH_FILE, strategies.rospack()):
            raise UsageError(problem)
    if options.clock not in ("lockstep", "realtime"):
        raise UsageError(f"--clock {options.clock}, must be lockstep or realtime")
    os.chdir(ROOT)
    given = dict(argument.split(":=", 1) for argument in launch_arguments)
    if given.get("params") and not os.path.isabs(given["params"]):
        raise UsageError(f"params:={given['params']} after --, must be an absolute path")
    options.map, = strategies.maps_of([options.strategy], given.get("params"))
    if options.scene.startswith("/"):
        if not os.path.isfile(options.scene):
            raise UsageError(f"--scene {options.scene}: no such file")
    elif not workspace.has_world(options.scene):
        raise UsageError(f"--scene {options.scene}: no such file in sim_tests/simulated_world/worlds")
    options.run = ROOT / options.run
    if options.run.exists() and not options.overwrite:
        raise UsageError(f"{options.run} is there already; --overwrite deletes it")
    return options, launch_arguments


def arguments_of(options, launch_arguments):
    """All arguments of the launch file but run_folder."""
    return [f"scene:={options.scene}", f"seed:={options.seed}", f"clock:={options.clock}", f"map:={options.map}", f"strategy:={options.strategy}", "autostart:=true",
            f"pictures:={str(not options.no_pictures).lower()}", f"rviz:={str(options.rviz).lower()}", f"ideal:={str(options.ideal).lower()}", *launch_arguments]


def not_built(launch_arguments):
    """Nodes of the launch file that are not there: roslaunch goes on without them, and the clock waits for them for ever."""
    import roslaunch.config
    import roslib.packages
    import rospkg

    def is_there(node):
        try:
            return bool(roslib.packages.find_node(node.package, node.type))
        except rospkg.ResourceNotFound:
            return False
    try:
        nodes = roslaunch.config.load_config_default([(str(LAUNCH_FILE), launch_arguments)], None, assign_machines=False).nodes
    except (roslaunch.RLException, rospkg.ResourceNotFound) as error:
        sys.exit(f"error: simulation.launch cannot be read: {error}")
    return sorted({f"{node.package}/{node.type}" for node in nodes if not is_there(node)})


def is_gone_within(seconds, is_gone):
    end = time.monotonic() + seconds
    while not is_gone():
        if time.monotonic() > end:
            return False
        time.sleep(POLL_S)  # nobody tells of the end of a process that is not this one's child
    return True


class Launched:
    """roslaunch and the recorder. All that is started carries the mark, by which it is found again whoever its parent is."""

    def __init__(self, run, mark):
        self.run, self.mark, self.processes, self.is_interrupted = run, mark, {}, False
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, self.interrupt)

    def interrupt(self, *_):
        self.is_interrupted = True

    def start(self, name, command, **options):
        with open(self.run / f"log/{name}.log", "wb") as log:
            self.processes[name] = subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=log, **{"stdout": log, **options} if name == "roslaunch" else options)

    def code_of(self, name):
        """None: it still runs."""
        return self.processes[name].poll()

    def marked(self):
        for process in pathlib.Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if int(process.name) != os.getpid() and is_of_run(process, self.mark):
                    yield int(process.name)

    def end(self):
        for name, number in (("recorder", signal.SIGTERM), ("roslaunch", signal.SIGINT)):
            if name in self.processes and self.code_of(name) is None:
                self.processes[name].send_signal(number)
        if "roslaunch" in self.processes and not is_gone_within(ROSLAUNCH_ENDS_S, lambda: self.code_of("roslaunch") is not None):
            print("roslaunch does not end: it is ended", flush=True)
        for number in (signal.SIGTERM, signal.SIGKILL):
            left = list(self.marked())
            for pid in left:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, number)
            if left:
                is_gone_within(NODE_ENDS_S, lambda: not list(self.marked()))


def follow(launched, mesh, wall_limit):
    """The recorder's exit code when the mission has ended; 1 if roslaunch has ended before, None if interrupted."""
    import rosgraph
    while not rosgraph.is_master_online():  # the recorder asks for the master when it starts
        if launched.code_of("roslaunch") is not None:
            text = (launched.run / "log/roslaunch.log").read_text(encoding="utf-8", errors="replace")
            print(*text.splitlines()[-15:], f"error: the launch failed; see {launched.run}/log/roslaunch.log", sep="\n", file=sys.stderr)
            sys.exit(1)
        if launched.is_interrupted:
            sys.exit(130)
        time.sleep(POLL_S)  # nobody tells of a master that has come
    launched.start("recorder", [str(ROOT / "scripts/mission_recorder.py"), str(launched.run), "--mesh", mesh, "--wall-limit", wall_limit])
    while not launched.is_interrupted:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return launched.processes["recorder"].wait(POLL_S)
        if launched.code_of("roslaunch") is not None:
            print(f"roslaunch has ended before the mission; see {launched.run}/log/roslaunch.log", flush=True)
            return 1
    return None


@one_line_errors
def main():
    words = sys.argv[1:]
    options, launch_arguments = parse(words)
    run = options.run
    if run.exists() and not (run / ".run_mission").is_file():  # nothing but a run is ever deleted
        sys.exit(f"error: {run} was not made by scripts/run_mission: not deleted.")
    workspace.use()
    launch_arguments = [f"run_folder:={run}", *arguments_of(options, launch_arguments)]
    missing = not_built(launch_arguments)
    if missing:
        with contextlib.suppress(OSError):
            run.rmdir()  # the launch file has made it when it was read; an earlier run is not empty
        sys.exit(f"error: simulation.launch would start what is not there: {' '.join(missing)}; scripts/demo and scripts/test build it.")
    shutil.rmtree(run, ignore_errors=True)
    (run / "log").mkdir(parents=True)
    commit = subprocess.run(["git", "describe", "--always", "--dirty", "--abbrev=10"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False)
    now = datetime.datetime.now(datetime.timezone.utc)
    (run / ".run_mission").write_text(f"{shlex.join(['scripts/run_mission', *words])}\ndate: {now:%Y-%m-%dT%H:%M:%SZ}\nhost: {os.uname().nodename}\n"
                                      f"commit: {commit.stdout.strip() or 'unknown'}\nsoftware: {workspace.software()}\n"
                                      f"configuration: {workspace.configuration(launch_arguments[1:])}\nmachine: {workspace.machine()}\n", encoding="utf-8")
    port = options.port or str(workspace.free_port())
    mark = f"{os.getpid()}-{port}"
    scheme = os.environ["ROS_MASTER_URI"].split(":")[0]
    os.environ.update(ROS_MASTER_URI=f"{scheme}://localhost:{port}", ROS_LOG_DIR=str(run / "log/ros"), RUN_MISSION_MARK=mark)

    print(f"Mission on {options.scene}, seed {options.seed}, strategy {options.strategy}: {run}", flush=True)
    launched = Launched(run, mark)
    try:
        # Its own session: Ctrl-C in the terminal is for this script, which ends things in order.
        launched.start("roslaunch", ["roslaunch", "-p", port, "mp700_ur5e_bringup", "simulation.launch", *launch_arguments], start_new_session=True)
        code = follow(launched, "/octomap_baseline/mesh" if options.map == "octomap" else "/gpis_mapping/mesh", options.wall_limit)
        if launched.is_interrupted:
            print("Interrupted: ending everything ...", flush=True)
    finally:
        launched.end()
    print(flush=True)
    report_code = subprocess.run([str(ROOT / "scripts/report_mission.py"), str(run), *(["--summary-only"] if options.no_page else [])], check=False).returncode
    if launched.is_interrupted:
        return 130
    if code == 3:
        print(f"error: the mission was given up after {options.wall_limit} s; see {run}/log", file=sys.stderr)
        return 3
    if code != 0:
        sys.exit(f"error: the mission did not come to its end; see {run}/log")
    return report_code
