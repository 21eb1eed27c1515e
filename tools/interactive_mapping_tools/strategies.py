# SPDX-License-Identifier: BSD-3-Clause
"""Strategies for the next best view, checked before a mission starts.

A strategy is a section with a `plugin` in nbv_selection's configuration or below nbv_selection in the user's
parameters. A package on ROS_PACKAGE_PATH must export that plugin.
"""

import contextlib
import functools
import pathlib
import xml.etree.ElementTree as ElementTree

import rospkg
import yaml

from . import ROOT
from .cli import UsageError

CONFIGS = ROOT / "src/nbv_selection/config"
SHIPPED = ("octomap_strategies.yaml", "nbv_selection.yaml")  # nbv_selection.launch loads them in this order
BASE_CLASS = "nbv_selection_ros::Strategy"


def read_plugins(files, params=None):
    """{strategy: its plugin}; a later file counts above an earlier one, and section nbv_selection of params above all.
    Raises OSError, ValueError, yaml.YAMLError."""
    plugins = {}
    for path in files + ([params] if params else []):
        sections = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
        if path == params and isinstance(sections, dict):
            sections = sections.get("nbv_selection") or {}
        if not isinstance(sections, dict):
            raise ValueError("must hold sections of parameters")
        plugins.update({str(name): str(section["plugin"])
                        for name, section in sections.items() if isinstance(section, dict) and "plugin" in section})
    return plugins


@functools.lru_cache(None)
def rospack():
    """The packages of this repository, built or not, and those on ROS_PACKAGE_PATH."""
    return rospkg.RosPack(ros_paths=[str(ROOT / "src"), str(ROOT / "sim_tests"), str(ROOT / "examples"),
                                     *rospkg.get_ros_paths()])


@functools.lru_cache(None)
def exported_plugins():
    """Names of the strategies' classes that packages export. Packages that cannot be read export nothing."""
    packages = rospack()
    found = set()
    for folder in map(packages.get_path, packages.list()):
        with contextlib.suppress(OSError, ElementTree.ParseError):
            for export in ElementTree.parse(f"{folder}/package.xml").getroot().iterfind("export/nbv_selection"):
                plugins = ElementTree.parse(export.get("plugin", "").replace("${prefix}", folder)).getroot()
                found |= {element.get("name", element.get("type"))
                          for element in plugins.iter("class") if element.get("base_class_type") == BASE_CLASS}
    return found


def maps_of(strategies, params=None):
    """The maps, gpis or octomap, that they choose by. Raises UsageError with those that there are."""
    try:
        plugins = read_plugins([CONFIGS / name for name in SHIPPED], pathlib.Path(params) if params else None)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise UsageError(f"strategies cannot be read: {' '.join(str(error).split())}") from error
    exported = exported_plugins()
    there = sorted(name for name, plugin in plugins.items() if plugin in exported)
    for strategy in strategies:
        if strategy not in there:
            why = ""
            if strategy in plugins:
                why = f"its plugin {plugins[strategy]} is exported by no package on ROS_PACKAGE_PATH; "
            raise UsageError(f"strategy {strategy}: {why}must be one of {', '.join(there)}")
    return ["octomap" if "Octomap" in plugins[strategy] else "gpis" for strategy in strategies]
