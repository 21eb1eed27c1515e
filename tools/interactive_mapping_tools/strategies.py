# SPDX-License-Identifier: BSD-3-Clause
"""Checks strategies for the next best view before a mission starts: prints for each the map that it chooses by, gpis or octomap.

A strategy is a section with a `plugin` in nbv_selection's configuration or in --selection-config. A package on
ROS_PACKAGE_PATH must export that plugin. Exit code 2: a strategy is not there; the message lists those that are.
"""

import contextlib
import pathlib
import sys
import xml.etree.ElementTree as ElementTree

import rospkg
import yaml

from . import ROOT
from .cli import parser_of

CONFIGS = ROOT / "src/nbv_selection/config"
SHIPPED = ("octomap_strategies.yaml", "nbv_selection.yaml")  # nbv_selection.launch loads them in this order, then the user's
BASE_CLASS = "nbv_selection_ros::Strategy"


def read_plugins(files):
    """{strategy: its plugin}; a later file counts above an earlier one. Raises OSError, ValueError, yaml.YAMLError."""
    plugins = {}
    for path in files:
        sections = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
        if not isinstance(sections, dict):
            raise ValueError("must hold sections of parameters")
        plugins.update({str(name): str(section["plugin"]) for name, section in sections.items() if isinstance(section, dict) and "plugin" in section})
    return plugins


def exported_plugins():
    """Names of the strategies' classes that packages export. Packages that cannot be read export nothing."""
    rospack = rospkg.RosPack(ros_paths=[str(ROOT / "src"), *rospkg.get_ros_paths()])
    found = set()
    for folder in map(rospack.get_path, rospack.list()):
        with contextlib.suppress(OSError, ElementTree.ParseError):
            for export in ElementTree.parse(f"{folder}/package.xml").getroot().iterfind("export/nbv_selection"):
                plugins = ElementTree.parse(export.get("plugin", "").replace("${prefix}", folder)).getroot()
                found |= {element.get("name", element.get("type")) for element in plugins.iter("class") if element.get("base_class_type") == BASE_CLASS}
    return found


def main():
    parser = parser_of(__doc__)
    parser.add_argument("strategy", nargs="+")
    parser.add_argument("--selection-config", type=pathlib.Path, metavar="FILE", help="the selection_config of simulation.launch")
    arguments = parser.parse_args()
    files = [CONFIGS / name for name in SHIPPED] + ([arguments.selection_config] if arguments.selection_config else [])
    try:
        plugins = read_plugins(files)
    except (OSError, ValueError, yaml.YAMLError) as error:
        print(f"error: strategies cannot be read: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    exported = exported_plugins()
    there = sorted(name for name, plugin in plugins.items() if plugin in exported)
    for strategy in arguments.strategy:
        if strategy in there:
            continue
        why = f"its plugin {plugins[strategy]} is exported by no package on ROS_PACKAGE_PATH; " if strategy in plugins else ""
        print(f"error: strategy {strategy}: {why}must be one of {', '.join(there)}", file=sys.stderr)
        return 2
    for strategy in arguments.strategy:
        print("octomap" if "Octomap" in plugins[strategy] else "gpis")
    return 0
