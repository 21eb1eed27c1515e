# SPDX-License-Identifier: BSD-3-Clause
"""Runs the commands of README.md, the packages' READMEs and the pages in docs as they are written.

Each ```bash and ```python block says behind the language what becomes of it:
  run                  ends by itself, with exit code 0
  stays TOPIC...       a terminal of its own, until the next heading; ready when a message has come on each topic
  skip REASON          is not run; REASON is one of %s
A block without a mark, or commands in a block without a language, are failures.

What two pages have in common from a heading on is run once.
What differs from a user's terminals: rviz:=true is rviz:=false; HOME and the current folder are new ones for each
file, the latter with links to what is in the repository's root; the master has a port of its own.
"""

import itertools
import multiprocessing
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time

import rospy

from . import ROOT
from .cli import parser_of
from .workspace import free_port

REASONS = {"robot": "needs the robot or a part of it", "camera": "needs a camera", "mission": "a whole mission",
           "stack": "the whole simulation, which the mission's tests start, too", "build": "builds or tests everything",
           "long": "minutes to hours", "data": "needs a file of yours",
           "noetic": "needs packages that are not in Debian", "root": "needs root", "display": "needs a display",
           "docker": "needs Docker"}
COMMANDS = r"(source|ros[a-z]+|scripts/\w+|catkin\w*|cmake|ninja|ctest|apt(-get)?|sudo|cd|python3?)\s"
DEADLINE_S = 120.0  # wall time of a command, or until a terminal is ready: ten times what an idle machine takes
END_S = 60.0        # a roslaunch gives its nodes up to 17 s


class Block:
    def __init__(self, path, line, language, mark, section):
        self.path, self.line, self.language, self.section = path, line, language, section
        self.kind, *self.words = mark or [""]
        self.text = ""

    def __str__(self):
        return f"{self.path}:{self.line}"

    def error(self):
        """What is wrong with the mark; empty if nothing."""
        if self.language == "":
            return "commands in a block without a language, must be bash" if re.match(COMMANDS, self.text) else ""
        if self.kind == "run":
            return "" if not self.words else f"run takes no words, has {self.words}"
        if self.kind == "stays":
            is_good = self.words and all(word.startswith("/") for word in self.words)
            return "" if is_good else f"stays takes the topics that tell when it is ready, has {self.words}"
        if self.kind == "skip":
            is_good = len(self.words) == 1 and self.words[0] in REASONS
            return "" if is_good else f"skip takes one of {', '.join(REASONS)}, has {self.words}"
        return "no mark, must be one of run, stays TOPIC..., skip REASON"


def read_blocks(path, name):
    blocks, open_block, section, indent = [], None, 0, 0
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        fence = re.match(r"( *)(`{3,})(.*)$", line)
        if fence and open_block is None:
            language, *mark = fence.group(3).split() or [""]
            open_block, indent = Block(name, number, language, mark, section), len(fence.group(1))
            if language in ("bash", "sh", "shell", "console", "python", ""):
                blocks.append(open_block)
        elif fence:
            open_block = None
        elif open_block is not None:
            open_block.text += line[indent:] + "\n"
        elif re.match(r"#+ ", line):
            section += 1
    return blocks


class Terminals:
    """What runs at one time: the blocks between two headings."""

    def __init__(self, folder, is_verbose):
        self.folder, self.is_verbose, self.port, self.open = folder, is_verbose, free_port(), []
        self.env = {"HOME": str(folder / "home"), "ROS_HOME": str(folder / "ros_home"),
                    "PATH": "/usr/bin:/bin:/usr/sbin", "LANG": "C.UTF-8", "ROS_HOSTNAME": "localhost",
                    "ROS_MASTER_URI": f"http://localhost:{self.port}"}

    def start(self, text, language="bash"):
        log = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")
        text = text.replace("rviz:=true", "rviz:=false")
        # Python's examples are for a terminal in which the workspace is known.
        if language == "python":
            text = f"source devel/setup.bash; exec /usr/bin/python3 -c {shlex.quote(text)}"
        process = subprocess.Popen(["bash", "-e", "-o", "pipefail", "-c", text], cwd=self.folder, env=self.env,
                                   stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                                   start_new_session=True)
        process.log = log
        return process

    def dead(self):
        return next((process for process in self.open if process.poll() is not None), None)

    def run(self, block):
        """Raises RuntimeError."""
        process = self.start(block.text, block.language)
        try:
            self.wait(lambda timeout: wait_for(process, timeout), lambda: process.poll() is not None,
                      f"{block}: ", time.monotonic() + DEADLINE_S)
            if process.returncode != 0:
                raise RuntimeError(f"{block}: exit code {process.returncode}\n{tail(process)}")
            if self.is_verbose:
                print(tail(process), end="")
        finally:
            end(process)

    def stay(self, blocks):
        """Until a message has come on each topic of each. Raises RuntimeError."""
        self.open += [self.start(block.text) for block in blocks]
        topics = [topic for block in blocks for topic in block.words]
        what = f"{', '.join(map(str, blocks))}: nothing on {' or '.join(topics)}: "
        listener = multiprocessing.get_context("fork").Process(target=listen, args=(self.port, topics))
        listener.start()
        try:
            self.wait(listener.join, lambda: listener.exitcode is not None, what, time.monotonic() + DEADLINE_S)
            if listener.exitcode != 0:
                raise RuntimeError(f"{what}they cannot be listened to")
        finally:
            listener.kill()
            listener.join()

    def wait(self, join, is_over, what, deadline):
        """Until it is over, as long as all terminals live. Raises RuntimeError."""
        while not is_over():
            if self.dead() is not None:
                raise RuntimeError(f"{what}a terminal has ended with {self.dead().returncode}\n{tail(self.dead())}")
            if time.monotonic() > deadline:
                raise RuntimeError(f"{what}not done after {DEADLINE_S:.0f} s\n" +
                                   "".join(f"--- terminal\n{tail(process)}" for process in self.open))
            join(0.2)

    def close(self):
        for process in self.open:
            end_group(process, signal.SIGINT)
        for process in self.open:
            end(process)
        self.open = []


def listen(port, topics):
    """In a process of its own, for a node is of one master: until a message has come on each topic."""
    os.environ["ROS_MASTER_URI"] = f"http://localhost:{port}"
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    # Tries, and says so, until the first terminal has its master.
    rospy.init_node("run_examples", anonymous=True, disable_rosout=True, disable_rostime=True, disable_signals=True)
    for topic in topics:
        rospy.wait_for_message(topic, rospy.AnyMsg)


def wait_for(process, timeout):
    try:
        process.wait(timeout)
    except subprocess.TimeoutExpired:
        pass


def end_group(process, number):
    try:
        os.killpg(process.pid, number)
    except ProcessLookupError:
        pass


def end(process):
    """Leaves nothing of it."""
    if process.poll() is None:
        end_group(process, signal.SIGINT)
        wait_for(process, END_S)
    end_group(process, signal.SIGKILL)
    process.wait()


def tail(process):
    process.log.flush()
    process.log.seek(0)
    return "".join(f"    {line}\n" for line in process.log.read().replace("\r", "\n").splitlines()[-25:])


def steps(blocks):
    """What is started together: the first terminal has master and clock, the others may open at once."""
    together = []
    for block in blocks:
        if block.kind == "stays" and len(together) > 1 and together[-1][0].kind == "stays":
            together[-1].append(block)
        else:
            together.append([block])
    return together


def run_file(blocks, is_verbose):
    """Prints a line per step; the number of failures. What follows one, to the next heading, is not run."""
    failed = 0
    with tempfile.TemporaryDirectory(prefix="run_examples.") as folder:
        folder = pathlib.Path(folder)
        (folder / "home").mkdir()
        for entry in ROOT.iterdir():
            (folder / entry.name).symlink_to(entry)
        for _, section in itertools.groupby(blocks, lambda block: block.section):
            terminals = Terminals(folder, is_verbose)
            try:
                for step in steps(section):
                    begin = time.monotonic()
                    terminals.stay(step) if step[0].kind == "stays" else terminals.run(step[0])
                    spent_s = time.monotonic() - begin
                    print(f"ok     {', '.join(map(str, step))} {step[0].kind}, {spent_s:.1f} s", flush=True)
            except RuntimeError as error:
                failed += 1
                print(f"FAILED {error}", flush=True)
            finally:
                terminals.close()
    return failed


def twins(files):
    """Blocks of sections that are the beginning of another section, each with its twin there: they are run once."""
    sections = {}
    for block in (block for blocks in files for block in blocks if block.kind != "skip"):
        sections.setdefault((block.path, block.section), []).append(block)
    done = []
    for blocks in sorted(sections.values(), key=len, reverse=True):
        said = [(block.kind, block.words, block.text) for block in blocks]
        # Terminals alone: what a command leaves in its page's folder may be needed there.
        is_terminals = all(block.kind == "stays" for block in blocks)
        twin = next((other for other, heard in done if is_terminals and heard[:len(said)] == said), None)
        if twin is None:
            done.append((blocks, said))
        else:
            yield from zip(blocks, twin)


def documents():
    packages = [*ROOT.glob("src/**/package.xml"), *ROOT.glob("sim_tests/*/package.xml"), *ROOT.glob("examples/*/package.xml")]
    readmes = {package.parent / "README.md" for package in packages} | {ROOT / name for name in (
        "README.md", "CONTRIBUTING.md", "docker/README.md")}
    pages = set(ROOT.glob("docs/**/*.md")) | set(ROOT.glob("src/*/docs/*.md"))
    return sorted(path for path in readmes | pages if path.exists())


def main():
    parser = parser_of(__doc__ % ", ".join(REASONS))
    parser.add_argument("files", nargs="*", type=pathlib.Path, help="Markdown files; none: all of the repository")
    parser.add_argument("--check", action="store_true", help="look at the marks only")
    parser.add_argument("--verbose", action="store_true", help="show what blocks marked `run` have printed")
    args = parser.parse_args()
    blocks = {}
    for path in args.files or documents():
        path = path.resolve()
        name = path.relative_to(ROOT) if ROOT in path.parents else path
        try:
            blocks[name] = read_blocks(path, name)
        except (OSError, UnicodeDecodeError) as error:
            sys.exit(f"{name}: cannot be read: {error}")
    wrong = [f"{block}: {block.error()}" for found in blocks.values() for block in found if block.error()]
    for line in wrong:
        print(f"FAILED {line}")
    commands = {name: [block for block in found if block.kind] for name, found in blocks.items()}
    count = sum(block.kind != "skip" for found in commands.values() for block in found)
    if args.check or wrong:
        print(f"{count} blocks to run, {len(wrong)} with a wrong mark")
        sys.exit(1 if wrong else 0)
    if not (ROOT / "devel/setup.bash").exists():
        sys.exit("devel/setup.bash is missing: build first")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    skipped = [f"{block}: {REASONS[block.words[0]]}"
               for found in commands.values() for block in found if block.kind == "skip"]
    twin_of = dict(twins(commands.values()))
    skipped += [f"{block}: the same as {twin}" for block, twin in twin_of.items()]
    failed = sum(run_file([block for block in found if block.kind != "skip" and block not in twin_of], args.verbose)
                 for found in commands.values())
    for line in skipped:
        print(f"skip   {line}")
    print(f"{count - len(twin_of)} blocks to run, {failed} failed, {len(skipped)} skipped")
    sys.exit(1 if failed else 0)
