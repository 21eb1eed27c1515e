#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""What the launch files start, read by roslaunch itself; nothing is started.

The drivers' packages are not installed where tests run. In their place stand packages with launch files that take the
arguments of the real ones (roslaunch refuses an argument that the included file does not declare) and set what the real
ones must not set here: a second robot_description.
"""

import os
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest
from xml.etree import ElementTree

import rosunit
import yaml

UR_CONTROL_ARGS = ("use_tool_communication", "controller_config_file", "robot_ip", "reverse_ip", "reverse_port",
                   "script_sender_port", "trajectory_port", "kinematics_config", "tf_prefix", "controllers",
                   "stopped_controllers", "headless_mode", "servoj_gain", "servoj_lookahead_time")
RS_CAMERA_ARGS = ("camera", "serial_no", "color_width", "color_height", "color_fps", "depth_width", "depth_height",
                  "depth_fps", "align_depth", "enable_sync", "publish_tf", "publish_odom_tf", "filters")
SECOND_ROBOT = """<launch><param name="/robot_description" value="a second robot"/>
  <node pkg="robot_state_publisher" type="robot_state_publisher" name="second_state_publisher"/></launch>"""
PARTS = {"arm": {"/ur_hardware_interface", "/realsense", "/depth_self_filter", "/gpis_mapping", "/brick_detection",
                 "/motion_planning", "/nbv_selection", "/ur_driver_bridge", "/pick_mission", "/robot_state_publisher",
                 "/system_diagnostics"},
         "base": {"/relayboard", "/kinematics", "/scanner", "/relay_wheels", "/localisation", "/base_navigation"}}
PARTS["robot"] = PARTS["base"] | {"/ur_hardware_interface", "/realsense", "/ur_driver_bridge", "/robot_state_publisher"}
PARTS["laptop"] = PARTS["arm"] - PARTS["robot"]
OURS = PARTS["arm"] - {"/ur_hardware_interface", "/realsense", "/robot_state_publisher"} | {"/base_navigation"}


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def make_package(folder, name):
    write(folder / name / "package.xml", f"""<package format="2"><name>{name}</name><version>0.0.1</version>
      <description>stand-in</description><maintainer email="a@example.org">a</maintainer><license>BSD</license></package>""")
    return folder / name


def launch_with(node, args):
    declared = "".join(f'<arg name="{arg}" default=""/>' for arg in args)
    params = "".join(f'<param name="{arg}" value="$(arg {arg})"/>' for arg in args)
    return f'<launch>{declared}<node pkg="{node[0]}" type="node" name="{node[1]}">{params}</node></launch>'


def make_program(package):
    path = package / "node"
    write(path, "#!/bin/sh\n")
    path.chmod(0o755)


def make_drivers(folder):
    ur = make_package(folder, "ur_robot_driver")
    write(ur / "launch/ur_control.launch", launch_with(("ur_robot_driver", "ur_hardware_interface"), UR_CONTROL_ARGS))
    write(ur / "launch/ur5e_bringup.launch", SECOND_ROBOT)
    write(ur / "config/ur5e_controllers.yaml", "{}")
    camera = make_package(folder, "realsense2_camera")
    write(camera / "launch/rs_camera.launch", launch_with(("realsense2_camera", "realsense"), RS_CAMERA_ARGS))
    write(make_package(folder, "azure_kinect_ros_driver") / "launch/driver.launch", SECOND_ROBOT)
    base = make_package(folder, "neo_mp_500")
    make_program(base)
    write(base / "launch/bringup.launch", SECOND_ROBOT)
    for path, node in (("relayboard_v2/relayboard_v2", "relayboard"), ("kinematics/kinematics", "kinematics"),
                       ("lidar/sick/s300/sick_s300", "scanner")):
        write(base / f"configs/{path}.launch", launch_with(("neo_mp_500", node), ()))
    for name in ("controller_manager", "neo_relayboard_v2", "neo_kinematics_differential"):
        make_package(folder, name)
    write(folder / "localisation.launch", launch_with(("amcl", "localisation"), ()))
    write(folder / "ur5e.yaml", arm_calibration(0.0))


# Where the shipped URDF has the joints: x, y, z [m], roll, pitch, yaw [rad].
ARM = {"shoulder": (0, 0, 0.1625, 0, 0, 0), "upper_arm": (0, 0, 0, 1.570796327, 0, 0), "forearm": (-0.425, 0, 0, 0, 0, 0),
       "wrist_1": (-0.3922, 0, 0.1333, 0, 0, 0), "wrist_2": (0, -0.0997, 0, 1.570796327, 0, 0),
       "wrist_3": (0, 0.0996, 0, 1.570796326589793, 3.141592653589793, 3.141592653589793)}


def arm_calibration(longer_m):
    """As ur_calibration writes it, of an arm whose forearm is so much longer than the shipped URDF's."""
    lines = ["kinematics:"]
    for link, values in ARM.items():
        lines.append(f"  {link}:")
        for name, value in zip(("x", "y", "z", "roll", "pitch", "yaw"), values):
            lines.append(f"    {name}: {value - (longer_m if (link, name) == ('wrist_1', 'x') else 0.0)}")
    return "\n".join([*lines, "  hash: calib_1", ""])


class Loaded:
    """A launch file as roslaunch understands it."""

    def __init__(self, path, *argv):
        import roslaunch
        self.config = roslaunch.config.ROSLaunchConfig()
        roslaunch.xmlloader.XmlLoader(resolve_anon=False).load(path, self.config, argv=list(argv), verbose=False)
        self.nodes = {node.namespace + node.name: node for node in self.config.nodes}
        self.params = {name: param.value for name, param in self.config.params.items()}

    def remaps(self, node):
        return dict(self.nodes[node].remap_args)


class BringupLaunch(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp())
        make_drivers(cls.folder)
        cls.plain_environment = dict(os.environ)
        # Before roslaunch looks for its first package: it keeps what it has found.
        os.environ["ROS_PACKAGE_PATH"] = f"{cls.folder}:{os.environ['ROS_PACKAGE_PATH']}"
        os.environ["ROS_IP"] = "127.0.0.1"
        os.environ.pop("ROS_HOSTNAME", None)
        import rospkg
        cls.package = rospkg.RosPack().get_path("mp700_ur5e_bringup")

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def robot_args(self, *more):
        given = ["robot_ip:=192.168.56.101", f"kinematics_config:={self.folder}/ur5e.yaml", "base_package:=neo_mp_500",
                 f"localisation:={self.folder}/localisation.launch"]
        names = {word.split(":=")[0] for word in more}
        return [word for word in given if word.split(":=")[0] not in names] + list(more)

    def robot(self, *more):
        return Loaded(f"{self.package}/launch/robot.launch", *self.robot_args(*more))

    def simulation(self, *args):
        return Loaded(f"{self.package}/launch/simulation.launch", *args)

    def run_robot(self, args, **environment):
        """roslaunch as its user calls it, without the stand-ins; --nodes reads everything and starts nothing."""
        env = {**self.plain_environment, "ROS_IP": "127.0.0.1", **environment}
        env = {name: value for name, value in env.items() if value and name != "ROS_HOSTNAME"}
        return subprocess.run(["/usr/bin/roslaunch", "--nodes", "mp700_ur5e_bringup", "robot.launch", *args], env=env,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, check=False)

    def nodes_of(self, *words):
        """(exit code, output) of roslaunch as its user calls it."""
        done = subprocess.run(["/usr/bin/roslaunch", "--nodes", *words], env=self.plain_environment, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, universal_newlines=True, check=False)
        return done.returncode, done.stdout

    def test_the_target_mission_builds_all_that_the_simulation_starts(self):
        import rospkg
        spaces = [pathlib.Path(space) for space in os.environ["CMAKE_PREFIX_PATH"].split(":")]
        written = [path for path in (space / "share/mp700_ur5e_bringup/mission_targets.txt" for space in spaces) if path.is_file()]
        targets = written and written[0].read_text(encoding="utf-8")
        if not targets:
            self.skipTest("no simulation, or a workspace of single packages")
        packages, workspace = rospkg.RosPack(), pathlib.Path(self.package).parents[1]
        started = set()
        for args in ((), ("map:=octomap",), ("detector:=surfaces",)):
            for nodelets in ("false", "true"):
                for node in self.simulation(f"nodelets:={nodelets}", *args).nodes.values():
                    words = node.args.split()
                    is_nodelet = node.package == "nodelet" and words[0] == "load"
                    package = words[1].split("/")[0] if is_nodelet else node.package
                    if workspace in pathlib.Path(packages.get_path(package)).parents and package != "mp700_ur5e_bringup":
                        started.add(package + ("_nodelet" if is_nodelet else "_node"))
        # Compiled programs that make a parameter.
        for launch in workspace.glob("*/*/launch/*.launch"):
            started.update(re.findall(r'command="\$\(find \w+\)/(\w+) ', launch.read_text(encoding="utf-8")))
        self.assertLess({"simulated_world_node", "gpis_mapping_nodelet", "calibrated_urdf"}, started)
        self.assertEqual(started - set(targets.split(";")), set())

    def test_missing_parts_end_the_launch_in_one_list_with_where_to_get_them(self):
        result = self.run_robot([])
        self.assertNotEqual(result.returncode, 0)
        for part in ("package ur_robot_driver: apt-get install ros-noetic-ur-robot-driver", "package realsense2_camera:",
                     "package neo_relayboard_v2:", "base_package: must be given", "robot_ip:=''", "kinematics_config:=''",
                     "localisation:=''"):
            self.assertIn(part, result.stdout)
        self.assertNotIn("/gpis_mapping", result.stdout)

    def test_without_drivers_the_rest_is_started(self):
        result = self.run_robot(["arm_driver:=none", "camera_driver:=none", "base_driver:=none", "localisation:=odom"])
        self.assertEqual(result.returncode, 0, result.stdout)
        self.assertIn("/gpis_mapping", result.stdout)
        self.assertIn("NOTHING CORRECTS ODOMETRY", result.stdout)

    def test_an_unrestricted_network_ends_the_launch(self):
        none = ["arm_driver:=none", "camera_driver:=none", "base_driver:=none", "localisation:=none"]
        result = self.run_robot(none, ROS_IP="")
        self.assertNotEqual(result.returncode, 0)
        self.assertIn("network.env", result.stdout)
        result = self.run_robot(none + ["machine:=base"])
        self.assertNotEqual(result.returncode, 0)
        self.assertIn("cannot reach this one", result.stdout)
        self.assertEqual(self.run_robot(none + ["machine:=base"], ROS_IP="192.168.57.1").returncode, 0)

    def test_a_calibration_that_is_none_is_refused(self):
        write(self.folder / "broken.yaml", "kinematics: {shoulder: {x: 0}}\n")
        with self.assertRaises(Exception):
            self.robot(f"kinematics_config:={self.folder}/broken.yaml")

    def check_parts(self, *more):
        return subprocess.run([f"{self.package}/scripts/check_parts", *self.robot_args(*more)], env=dict(os.environ),
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, check=False)

    def test_a_calibration_that_is_not_in_the_urdf_is_spoken_of_with_its_size(self):
        import rospkg
        import roslib.packages
        shipped = f"{rospkg.RosPack().get_path('mp700_ur5e_description')}/urdf/mp700_ur5e.urdf"
        result = self.check_parts(f"urdf:={shipped}")
        self.assertEqual(result.returncode, 0, result.stdout)
        self.assertIn("the arm's calibration is in the URDF", result.stdout)
        own = self.folder / "own_arm.yaml"
        write(own, arm_calibration(0.002))  # of one link: the tip is off by as much in every posture
        result = self.check_parts(f"urdf:={shipped}", f"kinematics_config:={own}")
        self.assertEqual(result.returncode, 0, result.stdout)
        self.assertIn("CALIBRATION IS NOT IN THE URDF: the magnet's tip is up to 2.00 mm and 0.00 degrees", result.stdout)
        tool, = roslib.packages.find_node("mp700_ur5e_description", "calibrated_urdf")
        with open(self.folder / "calibrated.urdf", "w", encoding="utf-8") as urdf:
            subprocess.run([tool, shipped, "--arm", own], stdout=urdf, check=True)
        result = self.check_parts(f"urdf:={self.folder}/calibrated.urdf", f"kinematics_config:={own}")
        self.assertEqual(result.returncode, 0, result.stdout)
        self.assertNotIn("NOT IN THE URDF", result.stdout)
        write(own, arm_calibration(0.0).replace("    yaw: 0.0\n", "", 1))
        result = self.check_parts(f"urdf:={shipped}", f"kinematics_config:={own}")
        self.assertEqual(result.returncode, 1, result.stdout)
        self.assertIn("kinematics/shoulder/yaw = (missing)", result.stdout)

    def test_an_omnidirectional_base_is_refused_by_name(self):
        path = self.folder / "neo_mp_500/configs/kinematics/kinematics.launch"
        whole = path.read_text(encoding="utf-8")
        self.addCleanup(path.write_text, whole, encoding="utf-8")
        write(path, launch_with(("neo_kinematics_omnidrive", "kinematics"), ()))
        result = self.check_parts()
        self.assertEqual(result.returncode, 1, result.stdout)
        self.assertIn("neo_mp_500 is an omnidirectional base", result.stdout)

    def test_a_camera_driver_without_publish_tf_is_refused_by_its_version(self):
        path = self.folder / "realsense2_camera/launch/rs_camera.launch"
        whole = path.read_text(encoding="utf-8")
        self.addCleanup(path.write_text, whole, encoding="utf-8")
        write(path, whole.replace('<arg name="publish_tf" default=""/>', "").replace("publish_tf", "camera"))
        result = self.check_parts()
        self.assertEqual(result.returncode, 1, result.stdout)
        self.assertIn("must be 2.2.11 or newer", result.stdout)

    def test_the_right_wheel_turns_as_the_left_one(self):
        relay = self.robot().nodes["/relay_wheels"]
        self.assertEqual((relay.package, relay.type), ("mp700_ur5e_bringup", "relay_wheels"))
        inverted = self.robot().params["/relay_wheels/inverted"].split()
        import runpy
        from sensor_msgs.msg import JointState
        with_our_signs = runpy.run_path(f"{self.package}/scripts/relay_wheels")["with_our_signs"]
        driven = JointState(name=["wheel_front_left_joint", "wheel_front_right_joint"], velocity=[3.74, -3.74], position=[1.0, -1.0])
        turned = with_our_signs(driven, inverted)
        self.assertEqual((turned.velocity, turned.position, list(turned.effort)), ([3.74, 3.74], [1.0, 1.0], []))

    def test_the_robot_has_one_description_and_one_publisher_of_it(self):
        robot = self.robot()
        publishers = [name for name, node in robot.nodes.items() if node.package == "robot_state_publisher"]
        self.assertEqual(publishers, ["/robot_state_publisher"])
        self.assertIn("ur5e_tool0", robot.params["/robot_description"])
        self.assertEqual(robot.params["/ur_hardware_interface/tf_prefix"], "ur5e_")
        self.assertIn('<link name="ur5e_base"/>', robot.params["/robot_description"])
        self.assertEqual(robot.params["/realsense/publish_tf"], False)
        self.assertEqual(robot.params["/realsense/align_depth"], True)
        self.assertEqual(robot.params["/use_sim_time"], False)

    def test_an_azure_kinect_brings_no_second_robot_either(self):
        robot = self.robot("camera_driver:=azure_kinect")
        self.assertIn("/azure_kinect", robot.nodes)
        self.assertNotIn("/second_state_publisher", robot.nodes)
        self.assertIn("ur5e_tool0", robot.params["/robot_description"])
        self.assertEqual(robot.remaps("/brick_detection")["color/image_raw"], "/rgb/image_raw")
        for node in ("/depth_self_filter", "/gpis_mapping", "/brick_detection"):
            self.assertEqual(robot.params[f"{node}/input/camera_frame"], "camera_color_optical_frame")

    def test_two_machines_share_the_parts_of_one(self):
        everything = set(self.robot().nodes)
        os.environ["ROS_IP"] = "192.168.57.1"  # two computers: not the loopback
        self.addCleanup(os.environ.__setitem__, "ROS_IP", "127.0.0.1")
        for one, other in (("arm", "base"), ("laptop", "robot")):
            here, there = set(self.robot(f"machine:={one}").nodes), set(self.robot(f"machine:={other}").nodes)
            self.assertEqual(here, PARTS[one])
            self.assertEqual(there, PARTS[other])
            self.assertEqual(here | there, everything)
            self.assertFalse(here & there)
        common = f"{self.package}/launch/common.launch"
        for machine in ("arm", "base", "laptop", "robot"):
            self.assertEqual(set(Loaded(common, f"machine:={machine}").nodes), PARTS[machine] & set(Loaded(common).nodes))

    def test_two_machines_hear_of_the_same_mission(self):
        os.environ["ROS_IP"] = "192.168.57.1"  # two computers: not the loopback
        self.addCleanup(os.environ.__setitem__, "ROS_IP", "127.0.0.1")
        for one, base, bridge in (("laptop", "robot", "robot"), ("arm", "base", "arm")):
            heartbeat = "/pick_mission/heartbeat"
            self.assertIn("/pick_mission", self.robot(f"machine:={one}").nodes)
            self.assertEqual(self.robot(f"machine:={base}").remaps("/base_navigation")["heartbeat"], heartbeat)
            self.assertGreater(self.robot(f"machine:={base}").params["/base_navigation/drive/max_heartbeat_age_s"], 0.0)
            loaded = self.robot(f"machine:={bridge}")
            self.assertEqual(loaded.remaps("/ur_driver_bridge")["heartbeat"], heartbeat)
            self.assertEqual(loaded.params["/ur_driver_bridge/gate/max_heartbeat_silence_s"], 0.25)

    def params_file(self, text, name="params.yaml"):
        path = self.folder / name
        write(path, text)
        return f"params:={path}"

    def test_a_robots_own_files_and_scan_reach_all_who_use_them(self):
        own = {name: f"{self.folder}/{name}" for name in ("sectors", "bricks", "base_profile")}
        users = {"sectors": ("motion_planning", "nbv_selection", "pick_mission"), "bricks": ("brick_detection", "motion_planning", "ur_driver_bridge", "pick_mission"),
                 "base_profile": ("base_navigation", "nbv_selection")}
        given = [f"{name}:={value}" for name, value in {**own, "scan": "/base/scan"}.items()]
        for loaded in (self.robot(*given), self.simulation(*given)):
            for name, nodes in users.items():
                for node in nodes:
                    self.assertEqual(loaded.params[f"/{node}/{name}_file"], own[name])
            self.assertEqual(loaded.remaps("/base_navigation")["scan"], "/base/scan")
        self.assertEqual([load().remaps("/base_navigation")["scan"] for load in (self.robot, self.simulation)], ["/lidar_1/scan_filtered", "/lidar_1/scan"])

    def test_a_users_params_count_above_all_else(self):
        # One key that the camera's file sets, one of each of our files, and of each node one that its launch file or an argument sets.
        theirs = {"gpis_mapping/map/sensor/min_range_m": 0.9, "gpis_mapping/map/sensor/noise_preset": "kinect_v2", "gpis_mapping/storage/autosave_period_s": 77.0,
                  "gpis_mapping/storage/autosave_file": "/a/b.gpis", "gpis_mapping/output/every_image": False, "gpis_mapping/input/map_frame": "odom",
                  "brick_detection/input/map_frame": "odom", "depth_self_filter/mask/baseline_m": 0.09, "motion_planning/pick/overtravel_m": 0.004,
                  "motion_planning/map_frame": "odom", "ur_driver_bridge/gate/max_heartbeat_silence_s": 0.7, "ur_driver_bridge/lockstep_wait_s": 3.0,
                  "base_navigation/drive/max_heartbeat_age_s": 0.9, "base_navigation/pose/wait_s": 2.0, "nbv_selection/strategies": ["mine"],
                  "nbv_selection/mine/plugin": "my/View", "gpis_mapping/input/camera_frame": "eye",
                  "nbv_selection/seed": 99, "pick_mission/time/limit_s": 7.0, "pick_mission/unlocks_protective_stop": False, "pick_mission/strategy": "mine",
                  "system_diagnostics/arrival/warn_ahead_s": 1.5}
        simulated = {"simulated_world/camera/rate_hz": 3.0, "simulated_world/clock/wait_for": [], "simulated_world/clock/computing": [],
                     "simulated_world/clock/wait_timeout_wall_s": 6.0, "simulated_world/judge/pick_action": "/mine", "simulated_world/seed": 98,
                     "simulated_world/description/arm_pose": "/my.yaml",
                     "octomap_baseline/map/sensor/max_range_m": 2.0, "octomap_baseline/output/projected_min_z_m": 0.2}

        def file_of(params):
            sections = {}
            for name, value in params.items():
                *path, key = name.split("/")
                section = sections
                for part in path:
                    section = section.setdefault(part, {})
                section[key] = value
            return self.params_file(yaml.safe_dump(sections))

        run = ["time_limit_s:=450", f"run_folder:={self.folder}/run"]
        for loaded, params in ((self.robot(file_of(theirs), *run), theirs),
                               (self.simulation(file_of({**theirs, **simulated}), *run, "clock:=lockstep", "map:=octomap"), {**theirs, **simulated})):
            for name, value in params.items():
                self.assertEqual(loaded.params[f"/{name}"], value, name)
        # Without a file of the user's the camera's stands.
        for loaded in (self.robot(), self.simulation()):
            self.assertEqual(loaded.params["/gpis_mapping/map/sensor/min_range_m"], 0.3)
            self.assertEqual(loaded.params["/gpis_mapping/map/sensor/noise_preset"], "realsense_d435")
            self.assertNotIn("/bringup/params", loaded.params)

    def test_params_of_an_unknown_node_end_the_launch(self):
        start = ("mp700_ur5e_bringup", "simulation.launch")
        for text, words in (("gpis_maping: {map: {}}\n", "section gpis_maping: no such node, but gpis_mapping; must be one of base_navigation, "),
                            ("sensor: {min_range_m: 0.9}\n", "section sensor: no such node; must be one of"), ("gpis_mapping: 3\n", "gpis_mapping = 3, must hold parameters"),
                            ("- gpis_mapping\n", "must hold sections, one per node"), ("gpis_mapping: {\n", "cannot be read: ")):
            code, output = self.nodes_of(*start, self.params_file(text))
            self.assertNotEqual(code, 0, text)
            self.assertIn(words, output)
            self.assertNotIn("/pick_mission", output)
        for path, words in ((f"{self.folder}/none.yaml", "cannot be read: "), ("params.yaml", "must be an absolute path")):
            code, output = self.nodes_of(*start, f"params:={path}")
            self.assertNotEqual(code, 0)
            self.assertIn(f"params:={path}: {words}", output)
        self.assertEqual(self.nodes_of(*start, self.params_file("", "empty.yaml"))[0], 0)
        example = pathlib.Path(f"{self.package}/README.md").read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
        self.assertEqual(self.nodes_of(*start, self.params_file(example))[0], 0)
        self.assertEqual(self.simulation(self.params_file(example)).params["/pick_mission/views/exclusion_radius_m"], 0.3)
        # A section for each node that reads parameters, the comparison's too.
        import runpy
        nodes = runpy.run_path(f"{self.package}/scripts/check_params", run_name="checked")["NODES"]
        self.assertEqual({f"/{name}" for name in nodes}, OURS | {"/simulated_world", "/octomap_baseline"})

    def test_a_users_file_counts_above_the_cameras(self):
        files = {"map": "sensor: {min_range_m: 0.9, baseline_m: 0.09, noise_preset: kinect_v2}\n",
                 "node": "input: {camera_frame: eye, image_transport: compressedDepth}\noutput: {every_image: true}\n",
                 "detection": "continuous: false\ninput: {use_depth: false, image_transport: compressed}\npose: {depth: {inverse_depth_std: 0.5}}\n",
                 "filter": "mask: {baseline_m: 0.09}\ninput: {image_transport: compressedDepth}\n"}
        for name, text in files.items():
            write(self.folder / f"user_{name}.yaml", text)
        own = {name: f"{self.folder}/user_{name}.yaml" for name in files}

        def expect(loaded, node, **params):
            for key, value in params.items():
                self.assertEqual(loaded.params[f"/{node}/{key.replace('__', '/')}"], value, f"{node} {key}")

        of_map = {"map__sensor__min_range_m": 0.9, "map__sensor__baseline_m": 0.09, "map__sensor__noise_preset": "kinect_v2",
                  "input__camera_frame": "eye", "output__every_image": True}
        for args in (["camera:=realsense"], ["camera:=azure_kinect", "manager:=m"]):

            def load(package, *more, args=args):
                import rospkg
                launch = "mapping" if package == "gpis_mapping" else package
                return Loaded(f"{rospkg.RosPack().get_path(package)}/launch/{launch}.launch", *args, *more)

            for package in ("gpis_mapping", "octomap_baseline"):
                loaded = load(package, f"config:={own['map']}", f"node_config:={own['node']}")
                expect(loaded, package, **of_map, input__image_transport="compressedDepth")
                # A coefficient would count above the user's preset.
                self.assertFalse([key for key in loaded.params if f"{package}/map/sensor/noise_" in key and "preset" not in key])
                given = load(package, f"node_config:={own['node']}", "camera_frame:=other", "image_transport:=raw")
                expect(given, package, input__camera_frame="other", input__image_transport="raw")
            expect(load("depth_self_filter", f"config:={own['filter']}"), "depth_self_filter", mask__baseline_m=0.09,
                   input__image_transport="compressedDepth")
            expect(load("brick_detection", f"config:={own['detection']}"), "brick_detection", continuous=False,
                   input__use_depth=False, input__image_transport="compressed", pose__depth__inverse_depth_std=0.5)

    def test_a_played_bag_waits_for_the_map(self):
        import rospkg
        folder = f"{rospkg.RosPack().get_path('gpis_mapping')}/launch"

        def played(launch, *args):
            words = Loaded(f"{folder}/{launch}", "bag:=/a.bag", *args).nodes["/bag"].args.split()
            self.assertIn("--wait-for-subscribers", words)
            # It would wait forever for a subscriber to another topic of the bag.
            return words[words.index("--topics") + 1:] if "--topics" in words else None
        self.assertEqual(played("mapping.launch", "depth_topic:=/d/image"), ["/d/image", "/d/camera_info", "/tf", "/tf_static"])
        self.assertEqual(played("mapping.launch", "depth_topic:=/d/image", "image_transport:=compressedDepth")[0], "/d/image/compressedDepth")
        self.assertEqual(played("mapping.launch", "bag_topics:=/x /y"), ["/x", "/y"])
        self.assertIsNone(played("mapping.launch", "self_filter:=true"))  # the filter's topics, too
        self.assertEqual(played("mapping_cloud.launch", "cloud_topic:=/c"), ["/c", "/tf", "/tf_static"])

    def test_an_argument_with_an_empty_default_says_what_that_means(self):
        # roslaunch lists them as required.
        import rospkg
        packages = rospkg.RosPack()
        count = 0
        for name in sorted({node[1:] for node in OURS} | {"mp700_ur5e_bringup", "mp700_ur5e_description", "octomap_baseline", "simulated_world", "synthetic_depth"}):
            for path in sorted(pathlib.Path(packages.get_path(name)).glob("launch/**/*.launch")):
                for arg in ElementTree.parse(path).getroot().iter("arg"):
                    if arg.get("default") == "":
                        self.assertRegex(arg.get("doc", ""), "empty: |there is no default", (str(path), arg.get("name")))
                        count += 1
        self.assertGreater(count, 50)

    def test_an_argument_that_there_is_not_ends_the_launch(self):
        none = ["arm_driver:=none", "camera_driver:=none", "base_driver:=none", "localisation:=odom"]
        # Arguments of common.launch and of the drivers' files count as its own, apart from those that robot.launch decides.
        result = self.run_robot(none + ["headless:=true", "base_hartbeat:=none", "autostart:=true", "bridge:=false", "nodelets:=true", "reverse_ip:=::1"])
        self.assertNotEqual(result.returncode, 0)
        self.assertIn("robot.launch has no argument headless any more: the argument is headless_mode", result.stdout)
        self.assertIn("robot.launch has no argument base_hartbeat, but base_heartbeat:", result.stdout)
        self.assertIn("robot.launch has no argument autostart", result.stdout)
        self.assertIn("robot.launch has no argument bridge", result.stdout)
        self.assertNotIn("no argument nodelets", result.stdout)
        self.assertNotIn("no argument reverse_ip", result.stdout)
        # Somebody's own file, of the same name even, has arguments of its own.
        own = self.folder / "own/robot.launch"
        write(own, """<launch><arg name="rig" default=""/><include file="$(find mp700_ur5e_bringup)/launch/robot.launch">"""
              + "".join(f'<arg name="{name}" value="{value}"/>' for name, value in (word.split(":=") for word in none)) + "</include></launch>")
        result = subprocess.run(["/usr/bin/roslaunch", "--nodes", str(own), "rig:=seven"], env={**self.plain_environment, "ROS_IP": "127.0.0.1"},
                                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, check=False)
        self.assertEqual(result.returncode, 0, result.stdout)

    def test_launch_files_refuse_unknown_arguments(self):
        import rospkg
        world = f"{rospkg.RosPack().get_path('simulated_world')}/launch/simulated_world.launch"
        simulation, common = ("mp700_ur5e_bringup", "simulation.launch"), ("mp700_ur5e_bringup", "common.launch")
        for start, wrong, right, node in (
                (simulation, "sceen", "scene", "/pick_mission"), (("-p", "11399", *simulation), "sceen", "scene", "/pick_mission"),
                (("simulated_world", "simulated_world.launch"), "sceen", "scene", "/relay_wheels"), ((world,), "sceen", "scene", "/relay_wheels"),
                (simulation, "realtime_facter", "realtime_factor", "/pick_mission"), (simulation, "strategie", "strategy", "/pick_mission"),
                (simulation, "deployment", "", "/pick_mission"), (common, "machin", "machine", "/pick_mission"),
                (("mp700_ur5e_bringup", "replay.launch", "bag:=/a.bag"), "rates", "rate", "/play_mission"),
                (("gpis_mapping", "mapping.launch"), "autosave_fil", "autosave_file", "/gpis_mapping"),
                (("brick_detection", "brick_detection.launch"), "colour_topic", "color_topic", "/brick_detection")):
            code, output = self.nodes_of(*start, f"{wrong}:=two_rows", "rviz:=false")
            self.assertNotEqual(code, 0, output)
            file = next(pathlib.Path(word).name for word in start if word.endswith(".launch"))
            self.assertIn(f"{file} has no argument {wrong}" + (f", but {right}: roslaunch --ros-args " if right else ""), output)
            self.assertNotIn("no argument rviz", output)
            self.assertNotIn(node, output.split())
        code, output = self.nodes_of(*common, "machine:=robto")
        self.assertNotEqual(code, 0, output)
        self.assertIn("machine:=robto, must be all, robot, laptop, base or arm", output)
        code, output = self.nodes_of(*simulation, "scene:=two_rows", "seed:=3", "realtime_factor:=0.5", "mission_config:=paper")
        self.assertEqual(code, 0, output)
        self.assertIn("/pick_mission", output)
        # A file of the user's includes ours, and two files share a command line: their arguments are not ours to judge.
        own = self.folder / "rig.launch"
        write(own, f"""<launch><arg name="rig" default=""/><include file="{world}"/></launch>""")
        self.assertEqual(self.nodes_of(str(own), "rig:=seven")[0], 0)
        self.assertEqual(self.nodes_of(world, str(self.folder / "localisation.launch"), "rig:=seven")[0], 0)

    def test_an_argument_of_old_names_what_stands_in(self):
        stand_ins = yaml.safe_load(pathlib.Path(f"{self.package}/config/removed_arguments.yaml").read_text(encoding="utf-8"))
        code, output = self.nodes_of("mp700_ur5e_bringup", "simulation.launch", *(f"{name}:=1" for name in stand_ins))
        self.assertNotEqual(code, 0)
        for name, text in stand_ins.items():
            self.assertIn(f"simulation.launch has no argument {name} any more: {text}", output)
        # The parameters that stand in exist: a file with all of them is taken, and each is what a node reads in some launch.
        loaded = {**self.robot().params, **self.simulation("clock:=lockstep", "map:=octomap").params}
        for text in stand_ins.values():
            words = text.replace(",", "").split()
            if "/" in words[1] and "below" not in words:
                self.assertIn(f"/{words[1]}", {**loaded, "/depth_self_filter/input/image_transport": ""}, text)

    def test_own_robot_and_bricks_reach_all(self):
        own = {name: f"{self.folder}/{name}" for name in ("urdf", "base_profile", "bricks", "sectors")}
        write(pathlib.Path(own["urdf"]), "<robot name='mine'><link name='base_link'/></robot>")
        given = [f"{name}:={path}" for name, path in own.items()]
        simulated = self.simulation(*given)
        users = {"bricks": ("brick_detection/bricks_file", "motion_planning/bricks_file", "ur_driver_bridge/bricks_file", "pick_mission/bricks_file",
                            "simulated_world/description/bricks"),
                 "base_profile": ("base_navigation/base_profile_file", "nbv_selection/base_profile_file", "simulated_world/description/base_profile"),
                 "sectors": ("motion_planning/sectors_file", "nbv_selection/sectors_file", "pick_mission/sectors_file"),
                 "urdf": ("simulated_world/description/urdf",)}
        for name, params in users.items():
            for param in params:
                self.assertEqual(simulated.params[f"/{param}"], own[name], param)
        self.assertIn("mine", simulated.params["/robot_description"])
        shipped = {"urdf": "urdf/mp700_ur5e.urdf", "base_profile": "config/base_profile.yaml", "bricks": "config/bricks.yaml",
                   "sectors": "config/manipulability_sectors.yaml"}
        # No shipped file is left beside the user's.
        left = [f"{name} = {value}" for name, value in simulated.params.items() for file in shipped.values() if str(value).endswith(file)]
        self.assertEqual(left, [])

    def test_tags_can_be_off_in_any_scene(self):
        self.assertIs(self.simulation().params["/simulated_world/has_tags"], True)
        self.assertIs(self.simulation("tags:=false", "scene:=tipped_20").params["/simulated_world/has_tags"], False)

    def test_rviz_fits_a_small_screen(self):
        import rospkg
        rospack = rospkg.RosPack()
        files = sorted({path for name in ("mp700_ur5e_bringup", "gpis_mapping", "nbv_selection", "motion_planning", "base_navigation", "brick_detection", "simulated_world",
                                     "mp700_ur5e_description")
                        for path in pathlib.Path(rospack.get_path(name)).glob("rviz/*.rviz")})
        self.assertEqual(len(files), 8)
        for path in files:
            window = yaml.safe_load(path.read_text(encoding="utf-8"))["Window Geometry"]
            # Without a window manager what is beyond the screen cannot be reached: HOLD of the Mission panel is on the right.
            self.assertLessEqual(window["Width"], 1280, path)
            self.assertLessEqual(window["Height"], 800, path)

    def test_rviz_names_a_brick_once(self):
        displays = yaml.safe_load(pathlib.Path(f"{self.package}/rviz/bringup.rviz").read_text(encoding="utf-8"))["Visualization Manager"]["Displays"]
        naming = [display["Name"] for display in displays if display["Enabled"] and display.get("Namespaces", {}).get("ids")]
        self.assertEqual(naming, ["Mission"])

    def test_shipped_sectors_with_another_urdf_are_spoken_of(self):
        none = ["arm_driver:=none", "camera_driver:=none", "base_driver:=none", "localisation:=odom", f"urdf:={self.folder}/own.urdf"]
        write(self.folder / "own.urdf", "<robot name='own'><link name='base_link'/></robot>")
        self.assertIn("sectors.yaml, then sectors:=", self.run_robot(none).stdout)
        self.assertNotIn("sectors.yaml, then sectors:=", self.run_robot([*none, f"sectors:={self.folder}/sectors"]).stdout)

    def test_a_base_whose_scanners_driver_is_missing_ends_the_launch(self):
        path = self.folder / "neo_mp_500/configs/lidar/sick/s300/sick_s300.launch"
        whole = path.read_text(encoding="utf-8")
        self.addCleanup(path.write_text, whole, encoding="utf-8")
        write(path, launch_with(("neo_sick_s300", "scanner"), ()))
        with self.assertRaises(Exception):
            self.robot()
        checked = subprocess.run([f"{self.package}/scripts/check_parts", *self.robot_args("machine:=base")], env={**os.environ, "ROS_IP": "192.168.57.1"},
                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, check=False)
        self.assertEqual(checked.returncode, 1)
        self.assertIn("neo_mp_500 starts neo_sick_s300/node, which is not installed", checked.stdout)

    def test_the_localisation_is_the_one_chosen(self):
        self.assertTrue(self.robot("localisation:=odom").nodes["/nothing_corrects_odometry"].respawn)
        chosen = self.robot().nodes
        self.assertIn("/localisation", chosen)
        self.assertNotIn("/nothing_corrects_odometry", chosen)
        for wrong in ("launch", "/no/such.launch"):
            result = self.run_robot(["arm_driver:=none", "camera_driver:=none", "base_driver:=none", f"localisation:={wrong}"])
            self.assertNotEqual(result.returncode, 0)
            self.assertIn(f"localisation:='{wrong}': must be the absolute path of a launch file", result.stdout)

    def test_the_map_sees_what_the_self_filter_leaves(self):
        for camera, depth in (("realsense", "/camera/aligned_depth_to_color/image_raw"), ("azure_kinect", "/depth_to_rgb/image_raw")):
            common = Loaded(f"{self.package}/launch/common.launch", f"camera:={camera}")
            self.assertEqual(common.remaps("/depth_self_filter")["depth/image_rect"], depth)
            self.assertEqual(common.remaps("/brick_detection")["depth/image_rect"], depth)
            self.assertEqual(common.remaps("/gpis_mapping")["depth/image_rect"], "/depth_self_filter/image_rect")

    def test_the_planned_touch_goes_on_for_the_guarded_move(self):
        for launch, args in (("common", []), ("simulation", []), ("robot", self.robot_args())):
            loaded = Loaded(f"{self.package}/launch/{launch}.launch", *args)
            self.assertEqual(loaded.params["/motion_planning/pick/overtravel_m"], 0.01, launch)

    def test_the_dead_man_by_the_wall_clock_is_the_real_robots_alone(self):
        def by_the_wall(loaded):
            return loaded.params["/ur_driver_bridge/gate/max_heartbeat_silence_s"]
        self.assertEqual(by_the_wall(self.robot()), 0.25)
        self.assertEqual(by_the_wall(Loaded(f"{self.package}/launch/simulation.launch")), 0)

    def test_the_base_stands_without_the_missions_heartbeat_where_there_is_a_mission(self):
        def watched(loaded):
            return loaded.remaps("/base_navigation").get("heartbeat") if loaded.params.get("/base_navigation/drive/max_heartbeat_age_s", 0.0) > 0.0 else None
        os.environ["ROS_IP"] = "192.168.57.1"  # two computers: not the loopback
        self.addCleanup(os.environ.__setitem__, "ROS_IP", "127.0.0.1")
        for loaded in (self.robot(), self.robot("machine:=base"), self.simulation(), self.simulation("clock:=lockstep")):
            self.assertEqual(watched(loaded), "/pick_mission/heartbeat")
        for args in (("mission:=false",), ("machine:=base", "base_heartbeat:=none")):
            self.assertIsNone(watched(self.robot(*args)), args)
        self.assertIsNone(watched(self.simulation("mission:=false")))

    def test_in_lock_step_the_clock_waits_for_all_who_answer(self):
        def waited_for(loaded):
            return {rule["topic"] for rule in loaded.params["/simulated_world/clock/wait_for"]}
        answers = {"/gpis_mapping/update", "/brick_detection/update", "/base_navigation/state", "/ur_driver_bridge/state",
                   "/motion_planning/path_monitor"}
        simulated = self.simulation("clock:=lockstep")
        self.assertEqual(waited_for(simulated), answers | {"/pick_mission/heartbeat"})
        self.assertEqual(waited_for(self.simulation("clock:=lockstep", "mission:=false")), answers)
        self.assertEqual(waited_for(self.simulation("clock:=lockstep", "detector:=none")),
                         answers - {"/brick_detection/update"} | {"/pick_mission/heartbeat"})
        self.assertEqual(waited_for(self.simulation("clock:=lockstep", "detector:=none", "mission:=false")), answers - {"/brick_detection/update"})
        self.assertEqual(waited_for(self.simulation("clock:=lockstep", "map:=octomap", "mission:=false")),
                         answers - {"/gpis_mapping/update"} | {"/octomap_baseline/update"})
        # Who publishes what the clock waits for has to be started: it would not begin otherwise.
        for topic in waited_for(self.simulation("clock:=lockstep", "map:=octomap")):
            self.assertIn(topic.rsplit("/", 1)[0], self.simulation("clock:=lockstep", "map:=octomap").nodes)
        surfaces = self.simulation("clock:=lockstep", "detector:=surfaces")
        self.assertEqual(waited_for(surfaces), waited_for(simulated))
        hears = {rule["topic"]: rule.get("subscriber") for rule in surfaces.params["/simulated_world/clock/wait_for"]}
        self.assertEqual(hears["/brick_detection/update"], "/depth_self_filter")  # the detection itself hears no image
        self.assertEqual(simulated.params["/simulated_world/camera/rate_hz"], 1.0)
        self.assertEqual(simulated.params["/gpis_mapping/output/every_image"], True)
        watched = self.simulation()
        self.assertEqual(watched.params["/simulated_world/camera/rate_hz"], 5.0)
        self.assertFalse(watched.params.get("/simulated_world/clock/wait_for"))
        self.assertFalse(watched.params.get("/gpis_mapping/output/every_image", False))

    def test_simulation_and_robot_run_the_same_software_above_the_drivers(self):
        above = {name: (node.package, node.type) for name, node in Loaded(f"{self.package}/launch/common.launch").nodes.items()}
        for loaded in (Loaded(f"{self.package}/launch/simulation.launch"), self.robot()):
            for name, program in above.items():
                self.assertEqual((loaded.nodes[name].package, loaded.nodes[name].type), program)

    def test_another_detector_takes_the_place_of_the_first(self):
        tags, surfaces = self.simulation(), self.simulation("detector:=surfaces")
        self.assertEqual(set(tags.nodes), set(surfaces.nodes))
        changed = {name for name in tags.nodes if tags.nodes[name].package != surfaces.nodes[name].package}
        self.assertEqual(changed, {"/brick_detection"})
        self.assertEqual(surfaces.nodes["/brick_detection"].package, "surface_picking")
        self.assertEqual(surfaces.remaps("/brick_detection")["map/get_mesh"], "/gpis_mapping/get_mesh")
        self.assertTrue(surfaces.params["/brick_detection/bricks_file"].endswith("/bricks.yaml"))
        self.assertEqual(set(tags.nodes) - set(self.simulation("detector:=none").nodes), {"/brick_detection"})
        for args in (("detector:=magic",), ("detector:=surfaces", "map:=octomap")):
            with self.assertRaises(Exception, msg=args):
                self.simulation(*args)

    def test_our_nodes_come_back_after_a_crash_or_end_everything(self):
        for load in (self.simulation, self.robot):
            for name in OURS:
                node = load().nodes[name]
                self.assertTrue(node.respawn, name)
                self.assertEqual(node.respawn_delay, 1.0, name)
                self.assertFalse(node.required, name)
            for name in ("/robot_state_publisher", "/relay_wheels"):
                self.assertTrue(load().nodes[name].respawn, name)
            ending = load("required:=true").nodes  # roslaunch itself refuses both at once
            self.assertFalse(any(ending[name].respawn for name in OURS))
            for name in OURS - {"/depth_self_filter", "/system_diagnostics"}:
                self.assertTrue(ending[name].required, name)
        # Drivers and world are not ours to start anew: what they stood for is gone.
        self.assertFalse(self.simulation().nodes["/simulated_world"].respawn)

    def test_nodelets_do_what_the_nodes_do(self):
        for mapping, args in (("/gpis_mapping", ("clock:=lockstep",)), ("/octomap_baseline", ("map:=octomap", "clock:=lockstep")),
                              ("/octomap_baseline", ("map:=octomap", "required:=true"))):
            loads = {"/depth_self_filter", mapping, "/brick_detection"}
            nodes, nodelets = self.simulation(*args), self.simulation(*args, "nodelets:=true")
            waits = "/simulated_world/clock/wait_for"
            other_params = [{name: value for name, value in loaded.params.items() if name != waits} for loaded in (nodes, nodelets)]
            self.assertEqual(*other_params)
            # The clock begins when these have subscribed, and a process that only loads a nodelet never does.
            waited_for = [{rule.get("subscriber") for rule in loaded.params.get(waits, [])} for loaded in (nodes, nodelets)]
            self.assertEqual(waited_for[1], {"/camera_nodelets" if name in loads else name for name in waited_for[0]})
            self.assertEqual(set(nodelets.nodes) - set(nodes.nodes), {"/camera_nodelets"})
            for name, node in nodes.nodes.items():
                other = nodelets.nodes[name]
                self.assertEqual((node.remap_args, node.respawn, node.required), (other.remap_args, other.respawn, other.required), name)
                self.assertEqual(other.type == "nodelet", name in loads, name)
            manager = nodelets.nodes["/camera_nodelets"]
            self.assertEqual((manager.args, manager.respawn), ("manager", "required:=true" not in args))
            for name in loads:
                # Without a bond the loader would not hear that the manager has ended, and load nothing into the next one.
                word, _, into, *rest = nodelets.nodes[name].args.split()
                self.assertEqual((word, into, rest), ("load", "camera_nodelets", [] if manager.respawn else ["--no-bond"]))
        self.assertIn("/camera_nodelets", self.robot("nodelets:=true").nodes)

    def test_the_map_of_a_run_outlives_a_crash(self):
        for load in (self.simulation, self.robot):
            self.assertEqual(load("run_folder:=/tmp/run").params["/gpis_mapping/storage/autosave_file"], "/tmp/run/map.gpis")
            self.assertEqual(load("run_folder:=/tmp/run").params["/pick_mission/run_folder"], "/tmp/run")
            self.assertEqual(load().params.get("/gpis_mapping/storage/autosave_file", ""), "")
            self.assertLessEqual(load().params["/gpis_mapping/storage/autosave_period_s"], 10.0)

    def test_the_mission_is_told_what_it_is_about(self):
        mission = self.simulation("scene:=two_rows", "seed:=3", "autostart:=true", "time_limit_s:=450",
                                  self.params_file("pick_mission: {bricks_total: 10}\n")).params
        for key, value in (("scene", "two_rows"), ("seed", 3), ("autostart", True), ("time/limit_s", 450.0), ("bricks_total", 10),
                           ("strategy", "gpis"), ("unlocks_protective_stop", True)):
            self.assertEqual(mission[f"/pick_mission/{key}"], value, key)
        self.assertEqual(mission["/nbv_selection/strategies"], ["gpis"])
        # The paper's cycle by its name, a file of one's own by its path.
        self.assertEqual(mission["/pick_mission/bricks/order"], "highest")
        self.assertEqual(self.simulation("mission_config:=paper").params["/pick_mission/bricks/order"], "nearest")
        with open(f"{self.folder}/mission.yaml", "w", encoding="utf-8") as own:
            own.write("bricks: {order: nearest}\n")
        own = self.simulation(f"mission_config:={self.folder}/mission.yaml").params
        self.assertEqual((own["/pick_mission/bricks/order"], own["/pick_mission/bricks/carriers_wait_views"]), ("nearest", 8))
        # A robot does not begin by itself, nor go on after a protective stop that nobody has looked at.
        robot = self.robot().params
        self.assertFalse(robot["/pick_mission/autostart"])
        self.assertFalse(robot["/pick_mission/unlocks_protective_stop"])
        self.assertNotIn("/pick_mission", self.simulation("mission:=false").nodes)
        self.assertNotIn("/pick_mission", self.robot("mission:=false").nodes)

    def test_with_an_octomap_view_base_and_judge_have_no_other_map(self):
        for args, strategy in (((), "octomap_gradient_frontier"), (("strategy:=octomap_random",), "octomap_random")):
            loaded = self.simulation("map:=octomap", "clock:=lockstep", "seed:=3", *args)
            self.assertEqual(loaded.remaps("/octomap_baseline")["depth/image_rect"], "/depth_self_filter/image_rect")
            self.assertEqual(loaded.remaps("/base_navigation")["map/ground"], "/projected_map")
            # Nobody asks our map: it does not run.
            self.assertNotIn("/gpis_mapping", loaded.nodes)
            self.assertEqual(loaded.remaps("/motion_planning")["map/get_mesh"], "/octomap_baseline/get_mesh")
            self.assertEqual(loaded.remaps("/motion_planning")["map/update"], "/octomap_baseline/update")
            self.assertEqual(loaded.remaps("/motion_planning")["map/query"], "/octomap_baseline/query")
            self.assertEqual(loaded.remaps("/brick_detection")["map/query"], "/octomap_baseline/query")
            self.assertEqual(loaded.remaps("/ur_driver_bridge")["map/update"], "/octomap_baseline/update")
            self.assertEqual(loaded.params["/pick_mission/nodes/map"], "/octomap_baseline")
            self.assertEqual(loaded.params["/simulated_world/judge/surface_topic"], "/octomap_point_cloud_centers")
            self.assertEqual(loaded.params["/nbv_selection/strategies"], [strategy])
            self.assertEqual(loaded.params["/pick_mission/strategy"], strategy)
            self.assertEqual(loaded.params["/nbv_selection/seed"], 3)
            self.assertEqual(loaded.params["/octomap_baseline/map/sensor/max_range_m"], 3.0)
            self.assertGreater(loaded.params["/octomap_baseline/output/projected_min_z_m"], 0.05)
            self.assertTrue(loaded.params["/octomap_baseline/output/filter_speckles"])
            self.assertTrue(loaded.params["/octomap_baseline/output/every_image"])
            self.assertTrue(loaded.nodes["/octomap_baseline"].respawn)
        ours = self.simulation()
        self.assertNotIn("/octomap_baseline", ours.nodes)
        self.assertEqual(ours.remaps("/base_navigation")["map/ground"], "/gpis_mapping/ground")
        self.assertEqual(ours.params["/simulated_world/judge/surface_topic"], "/gpis_mapping/mesh")

    def test_a_grid_of_ones_own_takes_the_place_of_the_ground(self):
        def grids(loaded):
            return tuple(loaded.remaps(node)[topic] for node, topic in (("/base_navigation", "map/ground"), ("/nbv_selection", "grid"))
                         if node in loaded.nodes)
        for args in ((), ("map:=octomap",)):
            self.assertEqual(grids(self.simulation("grid:=/room", *args)), ("/room", "/base_navigation/grid"))
        self.assertEqual(grids(self.robot("grid:=/room")), ("/room", "/base_navigation/grid"))
        self.assertEqual(grids(self.robot()), ("/gpis_mapping/ground", "/base_navigation/grid"))
        for machine, own, none in (("base", "/room", "/gpis_mapping/ground"), ("laptop", "/base_navigation/grid", "/base_navigation/grid"),
                                   ("arm", "/room", "/base_navigation/grid")):
            common = f"{self.package}/launch/common.launch", f"machine:={machine}"
            self.assertEqual(grids(Loaded(*common, "grid:=/room")), (own,))
            self.assertEqual(grids(Loaded(*common)), (none,))

    def source_network(self, *args):
        script = 'set -eu; file=$1; shift; . "$file" "$@"; echo "$ROS_IP $ROS_MASTER_URI ${ROS_HOSTNAME:-none}"'
        return subprocess.run(["/bin/bash", "-c", script, "bash", f"{self.package}/config/network.env", *args],
                              env={**self.plain_environment, "ROS_HOSTNAME": "elsewhere"}, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, universal_newlines=True, check=False)

    def test_the_network_is_the_loopback_unless_an_interface_is_named(self):
        result = self.source_network("lo")
        self.assertIn("127.0.0.1 http://127.0.0.1:11311 none", result.stdout)
        self.assertEqual(result.returncode, 0)
        for args in (("no_such_interface",), ("lo", "192.168.57.2")):
            self.assertNotEqual(self.source_network(*args).returncode, 0)


if __name__ == "__main__":
    rosunit.unitrun("mp700_ur5e_bringup", "test_bringup_launch", BringupLaunch)
