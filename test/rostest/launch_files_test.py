#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Every launch file parses with its required arguments, documents each argument and names files that exist."""

import glob
import os
import re
import shlex
import unittest
import xml.etree.ElementTree

import rospkg
import roslaunch.config
import rosunit
import yaml

PACKAGE = rospkg.RosPack().get_path("devo")
REQUIRED = {
    "replay.launch": ["bag:=/tmp/a.bag", "config:=%s/config/esim.yaml" % PACKAGE],
    "mvsec.launch": ["sequence:=indoor_flying1", "dir:=/tmp"],
    "vector.launch": ["sequence:=desk_normal1", "dir:=/tmp"],
    "live.launch": ["drivers:=false"],
    "simulation.launch": [],
    "devo.launch.xml": ["config:=%s/config/esim.yaml" % PACKAGE],
    "rviz.launch.xml": [],
}


def documented_commands(file, program):
    """Arguments of each call of a program in the documentation's shell blocks."""
    with open(os.path.join(PACKAGE, file)) as text:
        blocks = re.findall(r"```sh\n(.*?)```", text.read(), re.DOTALL)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [shlex.split(line)[3:] for line in lines if line.split()[1:3] == ["devo", program]]


def launch_files():
    return sorted(glob.glob(PACKAGE + "/launch/*.launch") + glob.glob(PACKAGE + "/launch/includes/*.launch.xml"))


class LaunchFilesTest(unittest.TestCase):
    def load(self, path):
        arguments = REQUIRED[os.path.basename(path)]
        return roslaunch.config.load_config_default([(path, arguments)], None, verbose=False)

    def test_every_launch_file_is_known_to_this_test(self):
        self.assertEqual(sorted(os.path.basename(path) for path in launch_files()), sorted(REQUIRED))

    def test_every_launch_file_parses_and_its_configurations_exist(self):
        for path in launch_files():
            config = self.load(path)
            self.assertEqual(config.config_errors, [], path)
            configs = [p.value for name, p in config.params.items() if name.endswith("/config")]
            self.assertTrue(all(os.path.isfile(c) for c in configs), "%s: %s" % (path, configs))

    def test_every_launch_of_the_odometry_has_the_three_nodelets_and_one_manager(self):
        for path in launch_files():
            if os.path.basename(path) == "rviz.launch.xml":
                continue
            arguments = [node.args.split() for node in self.load(path).nodes if node.type == "nodelet"]
            self.assertEqual(sum(a == ["manager"] for a in arguments), 1, path)
            loaded = {a[1] for a in arguments if a[0] == "load"}
            self.assertLessEqual({"devo/TimeSurface", "devo/Mapping", "devo/Tracking"}, loaded, path)

    def test_the_data_sets_launch_files_choose_the_source_of_depth(self):
        for name, topic in (("mvsec.launch", "/velodyne_point_cloud"), ("vector.launch", "/ouster/point_cloud")):
            path = os.path.join(PACKAGE, "launch", name)
            for source, expected in (("camera", False), ("lidar", True)):
                config = roslaunch.config.load_config_default(
                    [(path, REQUIRED[name] + ["depth_source:=" + source])], None, verbose=False)
                overrides = [p.value for key, p in config.params.items() if key.endswith("mapping/set")]
                self.assertEqual(["topics.points=" + topic in value.split() for value in overrides], [expected])
            with self.assertRaises(Exception):
                roslaunch.config.load_config_default(
                    [(path, REQUIRED[name] + ["depth_source:=sonar"])], None, verbose=False)

    def test_the_documented_commands_of_a_data_set_name_the_same_files_to_launch_and_offline(self):
        for name in ("mvsec", "vector"):
            launches = [c for file in ("README.md", "docs/datasets.md") for c in documented_commands(file, name + ".launch")]
            offline = [c for c in documented_commands("docs/datasets.md", "devo_offline") if name + ".yaml" in " ".join(c)][0]
            self.assertGreaterEqual(len(launches), 2)
            calibration = [a for a in offline if a.startswith("calibration.path=")]
            bags = {a for a in offline if a.endswith(".bag")}
            for arguments in launches:
                config = roslaunch.config.load_config_default(
                    [(os.path.join(PACKAGE, "launch", name + ".launch"), arguments)], None, verbose=False)
                self.assertEqual(config.params["/devo/surface/set"].value.split()[:1], calibration)
                play = [node.args for node in config.nodes if node.name == "replay"][0]
                self.assertEqual({word.strip("'") for word in play.split() if ".bag" in word}, bags)

    def test_vectors_imu_is_played_where_it_is_there(self):
        path = os.path.join(PACKAGE, "launch", "vector.launch")
        config = roslaunch.config.load_config_default([(path, REQUIRED["vector.launch"])], None, verbose=False)
        replay = [node.args for node in config.nodes if node.type == "play_to_the_end.py"]
        self.assertRegex(replay[0], r"--if-there '\S+\.synced\.imu\.bag'")

    def test_every_argument_that_can_be_given_is_documented(self):
        for path in launch_files():
            for argument in xml.etree.ElementTree.parse(path).getroot().iter("arg"):
                if "value" not in argument.attrib:
                    self.assertTrue(argument.get("doc"), "%s: %s" % (path, argument.get("name")))

    def test_arguments_reach_the_nodelets(self):
        path = PACKAGE + "/launch/mvsec.launch"
        params = self.load(path).params
        self.assertIn("camchain-imucam-indoor_flying.yaml", params["/devo/surface/set"].value)
        play = [node for node in self.load(path).nodes if node.name == "replay"][0]
        self.assertIn("/tmp/indoor_flying1_data.bag /tmp/indoor_flying1_gt.bag", play.args)

    def test_the_event_cameras_frame_reaches_all_nodelets(self):
        path = PACKAGE + "/launch/includes/devo.launch.xml"
        config = roslaunch.config.load_config_default(
            [(path, REQUIRED["devo.launch.xml"] + ["event_frame:=optical"])], None, verbose=False)
        for nodelet in ("surface", "tracking", "mapping"):
            self.assertEqual(config.params["/devo/%s/event_frame" % nodelet].value, "optical")

    def test_a_driver_that_live_does_not_know_is_refused(self):
        path = PACKAGE + "/launch/live.launch"
        with self.assertRaises(Exception):
            roslaunch.config.load_config_default([(path, ["drivers:=false", "event_driver:=metavison"])], None, verbose=False)
        for driver in ("prophesee", "metavision"):
            roslaunch.config.load_config_default([(path, ["drivers:=false", "event_driver:=" + driver])], None, verbose=False)

    def test_live_odometry_begins_with_z_up_of_the_camera_and_of_the_base(self):
        for base, expected in (("", "0 0 0 -0.5 0.5 -0.5 0.5"), ("base_link", "0 0 0 0 0 0 1")):
            config = roslaunch.config.load_config_default(
                [(PACKAGE + "/launch/live.launch", REQUIRED["live.launch"] + ["base_frame:=" + base])], None, verbose=False)
            for nodelet in ("tracking", "mapping"):
                self.assertEqual(config.params["/devo/%s/initial_pose" % nodelet].value, expected)

    def test_rviz_opens_on_the_frame_and_topics_of_the_nodelets(self):
        with open(PACKAGE + "/config/devo.rviz") as text:
            manager = yaml.safe_load(text)["Visualization Manager"]
        self.assertEqual(manager["Global Options"]["Fixed Frame"], "odom")
        topics = {d.get("Topic") or d.get("Image Topic") for d in manager["Displays"]}
        self.assertLessEqual({"path", "ground_truth_path", "local_map", "global_map", "time_surface/image",
                              "reprojection/image", "depth_overlay/image"}, topics)


if __name__ == "__main__":
    rosunit.unitrun("devo", "launch_files", LaunchFilesTest)
