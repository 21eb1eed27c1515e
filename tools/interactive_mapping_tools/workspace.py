# SPDX-License-Identifier: BSD-3-Clause
"""The workspace around the tools: what scripts/lib.sh does, its environment, values of options that several commands take."""

import hashlib
import os
import pathlib
import re
import shlex
import signal
import socket
import subprocess
import sys

from . import ROOT
from .cli import UsageError

REMOVED_FACTORS = ("manipulability", "pick_order", "travel", "uncertainty", "frontier", "failure_penalty")
MAX_SEED = 2147483647  # what the nodes take, in decimal for roslaunch, too


def library(command, **options):
    """Runs a command of lib.sh; ends this program if it fails. What it has said is on the terminal."""
    done = subprocess.run(["bash", "-c", f". {shlex.quote(str(ROOT))}/scripts/lib.sh; {command}"], check=False, **options)
    if done.returncode != 0:
        sys.exit(done.returncode)
    return done.stdout


def use():
    """Makes the packages built here known to this process and what it starts."""
    told = library("use_workspace; env -0", stdout=subprocess.PIPE).decode(errors="surrogateescape")
    os.environ.update(entry.split("=", 1) for entry in told.split("\0") if "=" in entry)
    sys.path[:0] = os.environ.get("PYTHONPATH", "").split(os.pathsep)


def software():
    """The state of what a mission runs: src, sim_tests and examples as they are, committed or not, but for tests and
    documents. "unknown" without git."""
    paths = "src sim_tests examples ':(exclude,glob)**/test/**' ':(exclude)*.md'"
    script = (f"git ls-files -s -- {paths} && git diff -- {paths} && "
              f"git ls-files -z --others --exclude-standard -- {paths} | xargs -0 -r sha1sum")
    done = subprocess.run(["bash", "-o", "pipefail", "-c", script], cwd=ROOT, capture_output=True, check=False)
    return hashlib.sha1(done.stdout).hexdigest()[:12] if done.returncode == 0 and done.stdout else "unknown"


def configuration(arguments):
    """Of a mission: the launch file's arguments; of a file among them what it holds, not where it is."""
    def known(argument):
        name, value = argument.split(":=", 1)
        is_file = value.startswith("/") and os.path.isfile(value)
        return name.encode() + b":=" + (pathlib.Path(value).read_bytes() if is_file else value.encode())
    return hashlib.sha1(b"\0".join(sorted(map(known, arguments)))).hexdigest()[:12]


def machine():
    with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as stream:
        name = re.search("model name.*: (.*)", stream.read())
    return f"{name.group(1) if name else 'unknown processor'}, {os.cpu_count()} cores"


def is_number(text):
    return re.fullmatch(r"[0-9]+(\.[0-9]+)?", text) is not None


def is_seed(text):
    return re.fullmatch(r"0|[1-9][0-9]{0,9}", text) is not None and int(text) <= MAX_SEED


def check_wall_limit(text):
    if not is_number(text):
        raise UsageError(f"--wall-limit {text}, must be a number of seconds >= 0")


def has_world(scene):
    return (ROOT / f"sim_tests/simulated_world/worlds/{scene}.yaml").is_file()


def check_world(scene):
    if not has_world(scene):
        raise UsageError(f"--scene {scene}: no such file in sim_tests/simulated_world/worlds")


def check_messages(part):
    try:
        import interactive_mapping_msgs.msg, rospy, simulated_world.msg  # noqa: F401, E401
    except ImportError as error:
        raise UsageError(f"{error}: source devel/setup.bash, or use scripts/soak {part}") from error


def free_port():
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        return probe.getsockname()[1]


def end_in_order():
    """A request to end is an exception, as Ctrl-C is: what was started is ended, too."""
    def end(*_):
        sys.exit(128 + signal.SIGTERM)
    signal.signal(signal.SIGTERM, end)


def run_child(command):
    """Its exit code. Whatever ends this ends it first, and in order."""
    with subprocess.Popen(command) as child:
        try:
            return child.wait()
        except BaseException:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough
            child.terminate()
            child.wait()  # after Ctrl-C subprocess itself waits for a moment only
            raise
