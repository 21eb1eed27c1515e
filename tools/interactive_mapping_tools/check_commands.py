# SPDX-License-Identifier: BSD-3-Clause
"""Checks the commands of the Markdown pages against the repository, without a build and without running them.

Looks at blocks of shell commands and at `code` in the text. It knows
  roslaunch PACKAGE FILE.launch NAME:=VALUE...   the file exists, and takes each argument
  rosrun PACKAGE PROGRAM --OPTION...             the package makes the program, whose source has each option
  rosservice, rostopic VERB /NODE/NAME...        the package of one of our nodes has that name in its source
  scripts/NAME --OPTION...                       the script exists, and its source has each option
and that files of this repository which a command names are there. CHANGELOG.md names what was, and is left out.
"""

import pathlib
import re
import runpy
import shlex
import sys
import xml.etree.ElementTree as ElementTree

from . import ROOT
from .cli import parser_of

# Packages outside of this repository that pages name in commands: what they hold is not checked.
OTHERS = {"amcl", "azure_kinect_ros_driver", "dynamic_reconfigure", "map_server", "move_base", "realsense2_camera", "rosbag",
          "rqt_reconfigure", "rviz", "tf", "tf2_ros", "topic_tools", "ur_calibration", "ur_robot_driver"}
SHELL = {"bash", "sh", "shell", "console", ""}
CHECK_LAUNCH_ARGUMENTS = ROOT / "src/interactive_mapping_common/scripts/check_launch_arguments"  # which roslaunch asks
ARGUMENT = re.compile(r"([A-Za-z]\w*):=(.*)", re.S)
PLACEHOLDER = re.compile(r"^[A-Z][A-Z_]*(\.\w+)?$|\.\.\.|[<$*…]")
FOLDERS = ("src", "sim_tests", "examples", "tools", "docs", "scripts")


class Packages:
    """The catkin packages of a source tree."""

    def __init__(self, root):
        self.root = root
        self.folders = {path.parent.name: path.parent for part in ("src/**", "sim_tests/*", "examples/*")
                        for path in root.glob(f"{part}/package.xml")}

    def get_path(self, name):
        return str(self.folders[name])

    def launch_file(self, package, name):
        return next(iter(sorted(self.folders[package].rglob(name))), None)

    def programs(self, package):
        folder = self.folders[package]
        text = re.sub(r"#.*", "", "\n".join(path.read_text(encoding="utf-8") for path in folder.rglob("CMakeLists.txt")))
        names = set(re.findall(r"add_executable\(\s*([\w.-]+)", text))
        renamed = re.findall(r"set_target_properties\(\s*(\S+)\s+PROPERTIES\s+OUTPUT_NAME\s+([\w.-]+)", text)
        names = names - {target for target, _ in renamed} | {name for target, name in renamed if target in names}
        for programs in re.findall(r"catkin_install_python\(\s*PROGRAMS([^)]*)DESTINATION", text):
            names |= {pathlib.PurePath(program).name for program in programs.split()}
        sources = [*folder.glob("benchmark/*.cpp"), *folder.glob("test/**/test_*.cpp")]
        return names | {source.stem for source in sources}

    def nodes(self):
        """{name of a node in a launch file: its package}, those of this tree."""
        tags = [tag for path in self.root.rglob("*.launch") if path.parent.name == "launch" for tag in ElementTree.parse(path).getroot().iter("node")]
        # A node that may also be a nodelet has its package in an argument, and its name.
        named = {tag.get("name"): tag.get("name") if "$(" in tag.get("pkg") else tag.get("pkg") for tag in tags}
        return {name: package for name, package in named.items() if package in self.folders}

    def has_name(self, package, name):
        """As a topic, service or action: the beginning of a string in the sources of the package."""
        pattern = re.compile(rf"\"[~/]*{re.escape(name)}[\"/]")
        folder = self.folders[package]
        return any(pattern.search(path.read_text(encoding="utf-8", errors="replace")) for part in ("src", "include", "launch")
                   for path in (folder / part).rglob("*.*"))

    def has_option(self, package, option):
        """In the sources of any of its programs: --NAME, or NAME as boost::program_options has it."""
        folder = self.folders[package]
        pattern = re.compile(rf"--{option}\b|\"{option}[\",]")
        sources = [path for part in ("src", "benchmark", "scripts") for path in (folder / part).rglob("*")]
        return any(pattern.search(path.read_text(encoding="utf-8", errors="replace")) for path in sources if path.is_file())


def split(text):
    """Words of one line of shell, in commands; None if a quotation is open at the end."""
    lexer = shlex.shlex(text, posix=True, punctuation_chars=";&|<>()")
    lexer.whitespace_split = True
    try:
        words = list(lexer)
    except ValueError:
        return None
    commands = [[]]
    for word in words:
        if word and all(letter in ";&|()" for letter in word):
            commands.append([])
        elif not all(letter in "<>" for letter in word) or not word:
            commands[-1].append(word)
    return [command for command in commands if command]


def with_packages(text, packages):
    """`$(rospack find PACKAGE)` becomes the package's folder, any other $(...) a placeholder."""
    def place(match):
        found = re.fullmatch(r"rospack find (\w+)", match.group(1).strip())
        return packages.get_path(found.group(1)) if found and found.group(1) in packages.folders else "..."
    return re.sub(r"\$\(([^()]*)\)", place, text)


def commands_of(text, packages):
    """Yields (line number, words) for each command of a page's text."""
    lines = text.splitlines()
    is_open, language, begin, waiting = False, "", 0, ""
    rest = list(lines)
    for number, line in enumerate(lines, 1):
        fence = re.match(r" *`{3,}(.*)$", line)
        if fence or is_open:
            rest[number - 1] = ""
        if fence:
            is_open = not is_open
            language, waiting = (fence.group(1).split() or [""])[0], ""
            continue
        if not is_open or language not in SHELL:
            continue
        begin = begin if waiting else number
        waiting += line
        if waiting.endswith("\\"):
            waiting = waiting[:-1] + " "
            continue
        commands = split(with_packages(waiting, packages))
        if commands is None:
            waiting += "\n"
            continue
        waiting = ""
        yield from ((begin, words) for words in commands)
    text = "\n".join(rest)
    for match in re.finditer(r"(?<!`)(`+)(?!`)((?:(?!\n\s*\n).)+?)(?<!`)\1(?!`)", text, re.S):
        code = match.group(2).replace("\\|", "|")
        for words in split(with_packages(" ".join(code.split()), packages)) or []:
            yield text.count("\n", 0, match.start()) + 1, words


class Checker:
    def __init__(self, root):
        self.root = root
        self.packages = Packages(root)
        self.count = 0
        self.nodes = self.packages.nodes()
        self.arguments_of = runpy.run_path(str(CHECK_LAUNCH_ARGUMENTS))["arguments_of"]

    def page(self, name):
        """Yields a line for each thing that a command of the page names and that is not there."""
        text = (self.root / name).read_text(encoding="utf-8")
        for number, words in commands_of(text, self.packages):
            for problem in self.command(words, name):
                yield f"{name}:{number}: {problem}"

    def command(self, words, page):
        for index, word in enumerate(words):
            rest = words[index + 1:]
            if word in ("roslaunch", "rosrun"):
                yield from self.launch(rest) if word == "roslaunch" else self.run(rest)
                return
            if word in ("rosservice", "rostopic"):
                yield from self.graph(word, rest)
                return
            if re.fullmatch(r"(\./)?scripts/[\w.]+", word):
                yield from self.script(word, rest, page)
                return

    def launch(self, words):
        names = [word for word in words if not word.startswith("-")]
        if not names or PLACEHOLDER.search(names[0]):
            return
        self.count += 1
        if names[0].endswith(".launch"):
            path, arguments = self.root / names[0], names[1:]
            if not path.is_file():
                yield f"roslaunch {names[0]}: no such file"
                return
        elif len(names) < 2 or PLACEHOLDER.search(names[1]):
            return
        elif names[0] not in self.packages.folders:
            yield from self.other(names[0])
            return
        else:
            path, arguments = self.packages.launch_file(*names[:2]), names[2:]
            if path is None:
                yield f"roslaunch {names[0]} {names[1]}: the package has no such file"
                return
        yield from self.arguments(path, arguments)

    def arguments(self, path, words):
        known = self.arguments_of(path, self.packages)
        for match in filter(None, map(ARGUMENT.match, words)):
            if match.group(1) not in known:
                yield f"{path.name} has no argument {match.group(1)}"
        given = {match.group(1) for match in map(ARGUMENT.match, words) if match}
        needed = {arg.get("name") for arg in ElementTree.parse(path).getroot().findall("arg") if arg.get("default") is None and arg.get("value") is None}
        if needed - given and words and not any("..." in word for word in words):
            yield f"{path.name} needs {', '.join(sorted(needed - given))}"
        yield from self.files(words)

    def run(self, words):
        if len(words) < 2 or any(map(PLACEHOLDER.search, words[:2])):
            return
        self.count += 1
        package, program, *rest = words
        if package not in self.packages.folders:
            yield from self.other(package)
            return
        if program not in self.packages.programs(package):
            yield f"rosrun {package} {program}: the package makes no such program"
            return
        for option in options_of(rest):
            if not self.packages.has_option(package, option):
                yield f"rosrun {package} {program}: no option --{option}"
        yield from self.files(rest)

    def graph(self, tool, words):
        parts = next((word[1:].split("/") for word in words if re.match(r"/\w+/\w", word)), [""])
        if parts[0] not in self.nodes:
            return
        self.count += 1
        if not self.packages.has_name(self.nodes[parts[0]], parts[1]):
            yield f"{tool} /{'/'.join(parts)}: {self.nodes[parts[0]]} has no {parts[1]}"

    def script(self, word, rest, page):
        if PLACEHOLDER.search(pathlib.PurePath(word).name):
            return
        self.count += 1
        folders = [self.root / folder for folder in pathlib.PurePath(page).parents]  # a package's pages name its own scripts
        path = next((folder / word for folder in folders if (folder / word).is_file()), None)
        if path is None:
            yield f"{word}: no such script"
            return
        text = self.source_of(path)
        split_at = rest.index("--") if "--" in rest else len(rest)
        own, passed_on = rest[:split_at], rest[split_at + 1:]
        for option in options_of(own):
            if not re.search(rf"--{option}\b|\"{option}\"", text):
                yield f"{word}: no option --{option}"
        if path.stem == "run_mission":
            yield from self.arguments(self.packages.launch_file("mp700_ur5e_bringup", "simulation.launch"), passed_on)
        yield from self.files(own)

    def source_of(self, path):
        """Of a script; of a link to tools/run, of its module and those which that imports."""
        tools = self.root / "tools/interactive_mapping_tools"
        text = path.read_text(encoding="utf-8")
        module = tools / f"{path.stem}.py"
        if path.is_symlink() and module.is_file():
            text = module.read_text(encoding="utf-8")
            names = re.findall(r"^from \.(\w+) import", text, re.M) + re.findall(r"\w+", " ".join(re.findall(r"^from \. import (.*)", text, re.M)))
            text += "".join((tools / f"{name}.py").read_text(encoding="utf-8") for name in names if (tools / f"{name}.py").is_file())
        return text

    def files(self, words):
        for word in words:
            value = word.split(":=", 1)[-1]
            path = self.root / value
            inside = path.parts[len(self.root.parts):] if path.parts[:len(self.root.parts)] == self.root.parts else ()
            if len(inside) > 1 and inside[0] in FOLDERS and not PLACEHOLDER.search(value) and not path.exists():
                yield f"{pathlib.PurePath(*inside)}: no such file"

    def other(self, package):
        if package not in OTHERS:
            yield f"{package}: no package of this repository, nor one that check_commands.py knows"


def options_of(words):
    return [match.group(1) for match in map(re.compile(r"--([a-z][\w-]*)").match, words) if match and match.group(1) != "help"]


def check(root, pages):
    """How many commands were checked, and a line for each that cannot work as written."""
    checker = Checker(root)
    found = [problem for page in pages for problem in checker.page(page)]
    return checker.count, found


def main():
    parser = parser_of(__doc__)
    parser.add_argument("pages", nargs="*", help="Markdown files, relative to the repository; none: all but CHANGELOG.md")
    parser.add_argument("--root", type=pathlib.Path, default=ROOT, help="of the repository")
    args = parser.parse_args()
    root = args.root.resolve()
    parts = ("*.md", "docker/*.md", "docs/**/*.md", "src/**/*.md", "sim_tests/**/*.md", "examples/**/*.md", "tools/**/*.md")
    pages = args.pages or sorted({str(path.relative_to(root)) for part in parts for path in root.glob(part)} - {"CHANGELOG.md"})
    count, found = check(root, pages)
    print("\n".join([*found, f"{count} commands, {len(found)} problems"]))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
