#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""The check of the pages' commands, on a made repository."""

import pathlib
import shutil
import sys
import tempfile
import unittest

import rosunit

ROOT = pathlib.Path(__file__).resolve().parents[4]
sys.path.insert(0, str(ROOT / "tools"))

from interactive_mapping_tools import check_commands  # noqa: E402

LAUNCH = """<launch>
  <arg name="rate_hz" default="1"/>
  <arg name="derived" value="2"/>
  <arg name="file"/>
  <node pkg="maps" type="maps" name="mapper"/>
  <include file="$(find maps)/launch/inner.launch" pass_all_args="true"><arg name="fixed" value="1"/></include>
</launch>"""
INNER = '<launch><arg name="inner" default="1"/><arg name="fixed" default="1"/></launch>'
FILES = {
    "src/maps/package.xml": "<package/>",
    "src/maps/launch/outer.launch": LAUNCH,
    "src/maps/launch/inner.launch": INNER,
    "src/maps/CMakeLists.txt": "add_library(maps_core a.cpp)\nadd_executable(map_it map_it.cpp)\n# add_executable(gone)\n"
                               "add_executable(maps_node n.cpp)\nset_target_properties(maps_node PROPERTIES OUTPUT_NAME maps)\n"
                               "catkin_install_python(PROGRAMS scripts/plot DESTINATION bin)\n",
    "src/maps/src/map_it.cpp": 'options.add_options()("out,o", "")("stride", ""); nh.advertiseService("query", f); nh.advertise("~grid/raw");',
    "src/maps/scripts/plot": "#!/usr/bin/python3\n",
    "src/maps/test/test_maps.cpp": "",
    "src/maps/scene.yaml": "",
    "scripts/do_it": 'case $1 in --fast) ;; esac',
}


class CheckCommands(unittest.TestCase):
    def setUp(self):
        self.root = pathlib.Path(tempfile.mkdtemp(prefix="commands_")).resolve()
        self.addCleanup(shutil.rmtree, self.root)
        for name, text in FILES.items():
            (self.root / name).parent.mkdir(parents=True, exist_ok=True)
            (self.root / name).write_text(text)

    def check(self, page, name="page.md"):
        (self.root / name).write_text(page)
        return check_commands.check(self.root, [name])

    def assert_clean(self, page, count):
        self.assertEqual(self.check(page), (count, []))

    def assert_found(self, command, *parts):
        """Both in a block and in the text."""
        for page in (f"text\n\n```bash skip long\n{command}\n```\n", f"text\n\n\nor `{command}`, so\n"):
            _, found = self.check(page)
            self.assertEqual(len(found), 1, (page, found))
            for part in ("page.md:4:", *parts):
                self.assertIn(part, found[0])

    def test_right_commands_pass(self):
        self.assert_clean("```bash skip long\nroslaunch maps outer.launch rate_hz:=3 \\\n  file:=$(rospack find maps)/scene.yaml inner:=2   # as fast\n"
                          "rosrun maps map_it src/maps/scene.yaml -o out --stride 2 && rosrun maps plot; rosrun maps test_maps\n"
                          "rosrun maps maps\n"
                          "scripts/do_it --fast\nroslaunch src/maps/launch/inner.launch\n```\n", 7)

    def test_what_is_no_command_of_ours_passes(self):
        self.assert_clean("`roslaunch`, `roslaunch PACKAGE FILE.launch x:=1`, `scripts/NAME`, `robot.launch ...`, `it's`\n"
                          "```cpp\nroslaunch gone gone.launch\n```\n`/other/scripts/gone`", 0)
        self.assert_clean("`rosrun tf tf_echo a b`", 1)

    def test_code_over_two_lines_is_read(self):
        self.assertIn("no argument rate", self.check("use `roslaunch maps outer.launch file:=a\nrate:=1` here")[1][0])

    def test_launch_file_is_missing(self):
        self.assert_found("roslaunch maps gone.launch", "roslaunch maps gone.launch: the package has no such file")
        self.assert_found("roslaunch src/maps/gone.launch", "no such file")

    def test_launch_arguments_are_wrong(self):
        self.assert_found("roslaunch maps outer.launch file:=a rate:=3", "outer.launch has no argument rate")
        self.assert_found("roslaunch maps outer.launch file:=a derived:=3", "no argument derived")
        self.assert_found("roslaunch maps outer.launch file:=a fixed:=3", "no argument fixed")
        self.assert_found("roslaunch maps outer.launch rate_hz:=3", "outer.launch needs file")

    def test_program_is_missing(self):
        for name in ("gone", "maps_core", "maps_node"):
            self.assert_found(f"rosrun maps {name}", f"rosrun maps {name}: the package makes no such program")
        self.assert_found("rosrun maps map_it --strides 2", "no option --strides")

    def test_package_is_unknown(self):
        self.assert_found("roslaunch mapps outer.launch", "mapps: no package")
        self.assert_found("rosrun mapps map_it", "mapps: no package")

    def test_topic_or_service_is_missing(self):
        self.assert_clean("`rosservice call /mapper/query '{}'`, `rostopic echo -n 1 /mapper/grid/raw`, `rostopic hz /other/thing`, `rostopic list`", 2)
        self.assert_found("rosservice call /mapper/querry", "rosservice /mapper/querry: maps has no querry")
        self.assert_found("timeout 4 rostopic echo /mapper/stride_x/field", "maps has no stride_x")

    def test_script_is_missing(self):
        self.assert_found("scripts/gone --fast", "scripts/gone: no such script")
        self.assert_found("FAST=1 scripts/do_it --slow", "scripts/do_it: no option --slow")

    def test_package_names_its_own_scripts(self):
        self.assertEqual(self.check("`scripts/plot` and `scripts/do_it`", "src/maps/scene.md"), (2, []))
        self.assertEqual(len(self.check("`scripts/plot`")[1]), 1)

    def test_file_is_missing(self):
        self.assert_found("rosrun maps map_it $(rospack find maps)/gone.yaml", "src/maps/gone.yaml: no such file")


if __name__ == "__main__":
    rosunit.unitrun("experiments", "test_check_commands", CheckCommands)
