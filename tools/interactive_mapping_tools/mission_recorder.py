# SPDX-License-Identifier: BSD-3-Clause
"""Follows a running mission: says in the terminal what it does, keeps the map in RUN_FOLDER/pictures, in
RUN_FOLDER/parameters.yaml the nodes' parameters, in RUN_FOLDER/memory.csv what each node occupies, and in
RUN_FOLDER/processor.csv what each process has computed.

Maps are kept as map_<seconds>_<picked>.ply: after the first look, before the first pick, after the look that follows a
pick, and at the end. Exit code: 0 the mission has ended, 1 it is gone, 2 bad usage, 3 the time is up.
"""

import contextlib
import http.client
import os
import pathlib
import shutil
import signal
import struct
import sys
import threading
import time
import xmlrpc.client

import numpy as np
import yaml

from .cli import file_error, parser_of
from .mission_run import END_WORDS

MAX_MAPS = 60  # in a folder; those of a mission with more picks are left out, but for the last
POLL_S = 0.2
LOOK_PERIOD_S = 10.0  # wall time: for processes that have come or gone
SILENCE_S = 5.0  # of the mission, wall time: then its process is asked whether it is there
PING_TIMEOUT_S = 3.0
MAX_LINE = 200  # characters; the whole is in mission.jsonl
PRINTED_FAILURES = 3  # at once: what comes in a burst


class MeshError(Exception):
    """Bytes that are no SurfaceMesh; the text says why."""


def stamp_of(data):
    """[s] of a serialised message with a header."""
    _, seconds, nanoseconds = struct.unpack_from("<III", data)
    return seconds + 1e-9 * nanoseconds


def parse_surface_mesh(data):
    """(points Nx3 [m], normals Nx3, variance N [m^2], triangles Mx3) of a serialised
    interactive_mapping_msgs/SurfaceMesh. By hand: rospy would make an object of each vertex, 100 000 of them a second."""
    offset = 0

    def take(size):
        nonlocal offset
        if offset + size > len(data):
            raise MeshError(f"{len(data)} bytes, {offset + size} needed at least")
        offset += size
        return data[offset - size:offset]

    def array(kind, width):
        count, = struct.unpack("<I", take(4))
        return np.frombuffer(take(count * width * np.dtype(kind).itemsize), kind).reshape(count, width)

    take(12)
    frame_length, = struct.unpack("<I", take(4))
    take(frame_length)
    take(8)  # number of the update
    triangles = array("<u4", 3)
    points = array("<f8", 3)
    normals = array("<f4", 1)
    variance = array("<f4", 1)
    if len(normals) != 3 * len(points) or len(variance) != len(points):
        raise MeshError(f"{len(points)} vertices, {len(normals)} numbers of normals, {len(variance)} variances")
    if len(triangles) and triangles.max() >= len(points):
        raise MeshError("a triangle names a vertex that does not exist")
    return points, normals.reshape(-1, 3), variance.ravel(), triangles


def write_ply(path, mesh):
    """Binary, in the form of the map's own tools. Under another name first: who reads sees whole files alone."""
    points, normals, variance, triangles = mesh
    vertices = np.zeros(len(points), [("xyz", "<f4", 3), ("normal", "<f4", 3), ("variance", "<f4")])
    vertices["xyz"], vertices["normal"], vertices["variance"] = points, normals, variance
    faces = np.zeros(len(triangles), [("count", "u1"), ("indices", "<i4", 3)])
    faces["count"], faces["indices"] = 3, triangles
    names = ("x", "y", "z", "nx", "ny", "nz", "variance")
    header = ["ply", "format binary_little_endian 1.0", "comment surface, metres, map frame", f"element vertex {len(vertices)}",
              *(f"property float {name}" for name in names), f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    unfinished = path.with_suffix(".part")
    with open(unfinished, "wb") as stream:
        stream.write(("\n".join(header) + "\n").encode())
        stream.write(vertices.tobytes())
        stream.write(faces.tobytes())
    os.replace(unfinished, path)


def clock_text(seconds):
    seconds = max(0, int(seconds))
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}" if seconds >= 3600 else f"{seconds // 60:3d}:{seconds % 60:02d}"


class Screen:
    """Lines that stay, and on a terminal one below them that is written anew."""

    def __init__(self, stream):
        self.stream = stream
        self.is_terminal = stream.isatty()
        self.has_status = False

    def line(self, text):
        self._clear()
        if len(text) > MAX_LINE:
            text = text[:MAX_LINE - 3].rstrip() + "..."
        self.stream.write(text + "\n")
        self.stream.flush()

    def status(self, text):
        if not self.is_terminal:
            return
        width = shutil.get_terminal_size().columns - 1
        self._clear()
        self.stream.write(text[:width])
        self.stream.flush()
        self.has_status = True

    def end(self):
        self._clear()
        self.stream.flush()

    def _clear(self):
        if self.has_status:
            self.stream.write("\r\x1b[K")
            self.has_status = False


class Recorder:
    """Callbacks come in rospy's threads; lock guards all."""

    def __init__(self, folder, screen, messages, processes):
        self.lock = threading.Lock()
        self.screen = screen
        self.messages = messages
        self.processes = processes
        self.states = {value: name.lower().replace("_", " ") for name, value in vars(messages).items()
                       if name in ("IDLE", "PAUSED", "HELD", "HALTING", "ENDED", "BEGIN", "CHOOSE", "PLAN_CLEAR", "CLEAR", "LOOK", "DETECT", "REPORT",
                                   "PLAN_PICK", "PICK", "PLAN_STOW", "STOW", "LET_GO", "SELECT", "DRIVE", "RECOVER", "WAIT", "UNLOAD")}
        self.mesh = None  # bytes of the newest one
        self.mesh_number = 0
        self.pictures = folder / "pictures"
        self.num_maps = 0
        self.saved = None  # (picked, has a pick begun) of the newest map kept
        self.saved_number = None
        self.look_began_s = 0.0  # the newest that has ended
        self.due = None  # map to be kept: (file, what saved will be, whether the mission has ended)
        self.state = None  # newest MissionState
        self.judged = None  # newest JudgeState
        self.shown_failures = 0
        self.heard_s = None  # when the mission was last heard, time.monotonic()
        self.ended = threading.Event()

    def on_mesh(self, message):
        with self.lock:
            self.mesh, self.mesh_number = message._buff, self.mesh_number + 1  # pylint: disable=protected-access
            self._write_due()

    def on_judge(self, message):
        with self.lock:
            self.judged = message

    def on_state(self, message):
        with self.lock:
            before, self.state = self.state, message
            self.heard_s = time.monotonic()
            self._tell(before, message)
            self._keep(before, message)
            if before is not None and before.state != message.state:
                self._on_disk(self.processes.left, message.header.stamp.to_sec(), self.states.get(before.state, "?"))
            if message.state == self.messages.ENDED:
                self.ended.set()

    def look_at_processes(self):
        with self.lock:
            if self.state is not None:
                self._on_disk(self.processes.update, self.state.header.stamp.to_sec())

    def _on_disk(self, write, *arguments):
        try:
            write(*arguments)
        except OSError as error:  # a full disk ends no mission
            self.screen.line(f"the recording cannot be written: {file_error(error)}")
            self.processes.mark = ""

    def _head(self, state):
        total = state.bricks_total if state.bricks_total >= 0 else self.judged.bricks_total if self.judged is not None else -1
        return f"{clock_text(state.used_s)}  {state.bricks_picked:2d}{f' of {total}' if total >= 0 else ''} bricks"

    def _tell(self, before, state):
        """A line for what a person wants to know; everything else on the line that is written anew."""
        head = self._head(state)
        entered = before is None or before.state != state.state or before.since != state.since
        failed = state.failures - self.shown_failures
        if failed > 0 and state.last_failures:
            for failure in reversed(state.last_failures[:min(failed, PRINTED_FAILURES)]):
                self.screen.line(f"{head}  ! {self.states.get(failure.state, '?')}: {failure.event}" + (f"; {failure.reason}" if failure.reason else ""))
            if failed > PRINTED_FAILURES:
                self.screen.line(f"{head}  ! and {failed - PRINTED_FAILURES} more failures")
        self.shown_failures = max(self.shown_failures, state.failures)
        if before is not None and state.bricks_picked > before.bricks_picked:
            self.screen.line(f"{head}  a brick is stowed")
        if entered:
            text = self._what(state)
            if text:
                self.screen.line(f"{head}  {text}")
        judged = ""
        if self.judged is not None:
            coverage = f", map {100 * self.judged.coverage:.0f} %" if self.judged.coverage == self.judged.coverage else ""
            judged = f" | judge: {self.judged.stowed} stowed, {self.judged.falls} fell, {self.judged.collisions} hit{coverage}"
        self.screen.status(f"{head}  {self.states.get(state.state, '?')}{judged} | {state.decision}")

    def _what(self, state):
        """In words, for the states that matter; else nothing."""
        messages = self.messages
        if state.state == messages.BEGIN:
            return "begins"
        if state.state == messages.PICK:
            return f"picks brick {state.brick}"
        if state.state == messages.DRIVE:
            return f"drives to a view of utility {state.view[0].utility:.2f}" if state.view else state.decision
        if state.state == messages.UNLOAD:
            return "unloads"
        if state.state == messages.ENDED:
            reasons = {value: name for name, value in vars(messages).items() if name.lower() in END_WORDS}
            reason = reasons.get(state.end_reason, "?").lower().replace("_", " ")
            return f"has ended: {reason}" + (f", {state.end_message}" if state.end_message else "")
        if state.state in (messages.PAUSED, messages.HELD, messages.RECOVER):
            return f"{self.states[state.state]}: {state.decision}"
        return ""

    def _keep(self, before, state):
        """Keeps the map when it shows something new: a pick's effect is in it after the look that follows."""
        has_looked = before is not None and before.state == self.messages.LOOK and state.state != self.messages.LOOK
        if has_looked:
            self.look_began_s = before.since.to_sec()
        stage = (state.bricks_picked, state.picks_begun > 0)
        is_first_pick = state.picks_begun > 0 and self.saved == (0, False)
        is_end = state.state == self.messages.ENDED and (before is None or before.state != self.messages.ENDED)
        is_new = self.saved is None or (self.saved != stage and state.bricks_picked != self.saved[0])
        if is_end or is_first_pick or (has_looked and is_new):
            self.due = (f"map_{state.header.stamp.to_sec():09.3f}_{state.bricks_picked:03d}.ply", stage, is_end)
            self._write_due()

    def _write_due(self):
        """A mesh comes after the look that it shows; at the end the newest is taken."""
        if self.due is None or self.mesh is None:
            return
        name, stage, is_end = self.due
        if not is_end and stamp_of(self.mesh) < self.look_began_s:
            return
        self.due = None
        if self.saved_number == self.mesh_number:
            self.saved = stage
            return
        if self.num_maps >= MAX_MAPS and not is_end:
            return
        try:
            mesh = parse_surface_mesh(self.mesh)
            if len(mesh[3]) == 0:
                return  # nothing seen yet
            self.pictures.mkdir(parents=True, exist_ok=True)
            write_ply(self.pictures / name, mesh)
        except (MeshError, OSError) as error:
            self.screen.line(f"the map cannot be kept: {error}")
            return
        self.num_maps += 1
        self.saved, self.saved_number = stage, self.mesh_number


def is_of_run(process, mark):
    return f"RUN_MISSION_MARK={mark}".encode() in (process / "environ").read_bytes().split(b"\0")


def rss_mb(process):
    """Of a folder of /proc. Raises OSError or ValueError."""
    return int(process.joinpath("status").read_text(encoding="utf-8", errors="replace").split("VmRSS:", 1)[-1].split()[0]) / 1024.0


def processor_s(process):
    """Of all threads, user and system, since it began. Raises OSError or ValueError."""
    cells = process.joinpath("stat").read_text(encoding="utf-8", errors="replace").rsplit(")", 1)[-1].split()
    if len(cells) < 13:
        raise ValueError("cut off")
    return (int(cells[11]) + int(cells[12])) / os.sysconf("SC_CLK_TCK")


def processes_of(mark, folder=pathlib.Path("/proc")):
    """{name: folder of /proc} of the run's processes, those with run_mission's mark. Nodes have the name that roslaunch gave them, the others their script's or program's."""
    found = {}
    for process in folder.glob("[0-9]*"):
        try:
            words = [word.decode(errors="replace") for word in (process / "cmdline").read_bytes().split(b"\0") if word]
            if words and is_of_run(process, mark):
                named = [word[len("__name:="):] for word in words if word.startswith("__name:=")]
                is_script = pathlib.Path(words[0]).name.startswith("python") and len(words) > 1
                found[named[-1] if named else "(" + pathlib.Path(words[1 if is_script else 0]).stem + ")"] = process
        except OSError:
            pass  # it has just ended, or is somebody else's
    return found


class ProcessTable:
    """A file with a line for each process."""

    def __init__(self, path, head, value_of):
        self.path, self.head, self.value_of = path, head, value_of

    def write(self, before, processes):
        is_new = not self.path.exists()
        with open(self.path, "a", encoding="utf-8") as stream:
            if is_new:
                stream.write(self.head + "\n")
            for name, process in sorted(processes.items()):
                with contextlib.suppress(OSError, ValueError):  # it has just ended
                    stream.write(f"{before},{name},{self.value_of(process)}\n")


class Processes:
    """memory.csv: each node every LOOK_PERIOD_S; processor.csv: each process when the mission leaves a state."""

    def __init__(self, folder, mark, processes=pathlib.Path("/proc")):
        self.mark, self.processes, self.due_s, self.found = mark, processes, 0.0, {}
        self.memory = ProcessTable(folder / "memory.csv", "time_s,node,resident_mb", lambda process: f"{rss_mb(process):.1f}")
        self.processor = ProcessTable(folder / "processor.csv", "time_s,state,process,processor_s", lambda process: f"{processor_s(process):.2f}")

    def update(self, time_s):
        now = time.monotonic()
        if not self.mark or now < self.due_s:
            return
        self.due_s = now + LOOK_PERIOD_S
        self.found = processes_of(self.mark, self.processes)
        self.memory.write(f"{time_s:.3f}", {name: process for name, process in self.found.items() if not name.startswith("(")})

    def left(self, time_s, state):
        if self.mark:
            self.processor.write(f"{time_s:.3f},{state}", self.found)


class TimedTransport(xmlrpc.client.Transport):
    """Waits PING_TIMEOUT_S at most. Not by socket.setdefaulttimeout: that would hold for rospy's own connections, too."""

    def make_connection(self, host):
        connection = super().make_connection(host)
        connection.timeout = PING_TIMEOUT_S
        return connection


def is_there(node):
    """Whether the node's process answers: one that was killed stays registered, and its connections count on."""
    import rosgraph
    try:
        code, _, uri = xmlrpc.client.ServerProxy(rosgraph.get_master_uri(), TimedTransport()).lookupNode("mission_recorder", node)
        return code == 1 and xmlrpc.client.ServerProxy(uri, TimedTransport()).getPid("mission_recorder")[0] == 1
    except (OSError, xmlrpc.client.Error, http.client.HTTPException):
        return False


def keep_parameters(folder, screen, get_param):
    """Those of the nodes as they are on the parameter server: what a node was not given is its default. Without them the recording goes on."""
    try:
        own = {name: values for name, values in get_param("/").items() if isinstance(values, dict) and name not in ("roslaunch", "run_id")}
        (folder / "parameters.yaml").write_text(yaml.safe_dump(own), encoding="utf-8")
    except (OSError, KeyError, xmlrpc.client.Error, http.client.HTTPException, yaml.YAMLError) as error:
        screen.line(f"the parameters cannot be kept: {error}")


def main():
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=pathlib.Path, metavar="RUN_FOLDER")
    parser.add_argument("--mission", default="/pick_mission", help="node of the mission")
    parser.add_argument("--mesh", default="/gpis_mapping/mesh", help="topic of the map's mesh; empty: maps are not kept")
    parser.add_argument("--judge", default="/simulated_world/judge", help="topic of the simulator's judge, for the terminal alone; empty: none")
    parser.add_argument("--wall-limit", type=float, default=0.0, metavar="S", help="give up after this time of the wall clock; 0: never")
    parser.add_argument("--begin-within", type=float, default=180.0, metavar="S", help="of the wall clock: the mission's node has to be there")
    parser.add_argument("--gone-after", type=float, default=60.0, metavar="S", help="time of the wall clock for which the node may be away, as in a restart")
    arguments = parser.parse_args()

    for option in ("wall_limit", "begin_within", "gone_after"):
        if not getattr(arguments, option) >= 0.0:
            parser.error(f"--{option.replace('_', '-')} {getattr(arguments, option)}, must be a number of seconds >= 0")
    if not arguments.folder.is_dir():
        parser.error(f"{arguments.folder} is no folder")

    import rosgraph  # late: --help needs no ROS
    import rospy
    try:
        from interactive_mapping_msgs.msg import MissionState
    except ImportError as error:
        parser.error(f"{error}: source devel/setup.bash")
    screen = Screen(sys.stdout)
    is_told_to_end = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: is_told_to_end.set())
    if not rosgraph.is_master_online():
        parser.error(f"no ROS master answers at {os.environ.get('ROS_MASTER_URI')}")
    rospy.init_node("mission_recorder", anonymous=True, disable_signals=True, disable_rosout=True, disable_rostime=True)  # the wall clock alone
    recorder = Recorder(arguments.folder, screen, MissionState, Processes(arguments.folder, os.environ.get("RUN_MISSION_MARK", "")))
    rospy.Subscriber(arguments.mission + "/state", MissionState, recorder.on_state, queue_size=100)
    if arguments.mesh:
        # Unparsed and only the newest: a mesh comes with each image and may be several MB.
        rospy.Subscriber(arguments.mesh, rospy.AnyMsg, recorder.on_mesh, queue_size=1, buff_size=1 << 24)
    if arguments.judge:
        from simulated_world.msg import JudgeState
        rospy.Subscriber(arguments.judge, JudgeState, recorder.on_judge, queue_size=1)

    begun = last_there = time.monotonic()
    code = None
    has_parameters = False
    while code is None:
        recorder.ended.wait(POLL_S)
        now = time.monotonic()
        heard_s = recorder.heard_s
        recorder.look_at_processes()
        if heard_s is not None and not has_parameters:
            has_parameters = True
            keep_parameters(arguments.folder, screen, rospy.get_param)
        if heard_s is not None:
            last_there = max(last_there, heard_s)
            # A clock that stands still makes a mission silent, too: that is no reason to give it up.
            if now - last_there > min(SILENCE_S, arguments.gone_after) and is_there(arguments.mission):
                last_there = now = time.monotonic()
        if recorder.ended.is_set():
            code = 0
        elif is_told_to_end.is_set() or rospy.is_shutdown():
            screen.line("stopped before the mission has ended")
            code = 1
        elif heard_s is not None and now - last_there > arguments.gone_after:
            screen.line(f"the mission's node {arguments.mission} has been gone for {arguments.gone_after:.0f} s")
            code = 1
        elif heard_s is None and now - begun > arguments.begin_within:
            screen.line(f"the mission's node {arguments.mission} did not come within {arguments.begin_within:.0f} s")
            code = 1
        elif arguments.wall_limit > 0.0 and now - begun > arguments.wall_limit:
            screen.line(f"the mission has not ended within {arguments.wall_limit:.0f} s of the wall clock")
            code = 3
    screen.end()
    rospy.signal_shutdown("done")
    return code
