#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings through the launch files as a user starts them, against the offline runner and ground truth: simulated ones
in the data sets' own dialects, and those of ../shared/data where that folder is."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

import rosbag
import rospkg
import rospy
import rostest
import std_msgs.msg

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from devo_testing import program, stamps_of  # noqa: E402

PACKAGE = rospkg.RosPack().get_path("devo")
# A replay whose first pose is this much later than offline was held up by what else the machine does: it is repeated.
HELD_UP_S = 0.3
ATTEMPTS = 3
SHARED = os.path.join(PACKAGE, "..", "shared", "data")


class RecordingsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("recordings_test")
        cls.folder = tempfile.mkdtemp(prefix="devo_recordings_")

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder, ignore_errors=True)

    def offline(self, name, config, bags, overrides):
        out = os.path.join(self.folder, name + "_offline")
        command = [program("devo_offline"), "--config", config, "--out", out]
        for bag in bags:
            command += ["--bag", bag]
        for override in overrides:
            command += ["--set", override]
        result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
        self.assertEqual(result.returncode, 0, result.stdout)
        return os.path.join(out, "trajectory.txt"), os.path.join(out, "report.json")

    def launched(self, name, launch, arguments):
        """What the nodelets wrote until the bag was over, and what they said about it."""
        trajectory = os.path.join(self.folder, name + "_nodelets.txt")
        command = ["roslaunch", "devo", launch, "rviz:=false", "trajectory_file:=" + trajectory] + arguments
        result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True,
                                timeout=60)
        self.assertTrue(os.path.exists(trajectory), result.stdout)
        return trajectory, [line for line in result.stdout.splitlines() if "poses written" in line]

    def check(self, name, config, bags, launch, arguments, overrides=(), floor_m=0.001):
        offline, report = self.offline(name, config, bags, overrides)
        expected = stamps_of(offline)
        for _ in range(ATTEMPTS):
            nodelets, said = self.launched(name, launch, arguments)
            stamps = stamps_of(nodelets)
            if stamps[0] < expected[0] + HELD_UP_S:
                break
        self.assertLess(stamps[0], expected[0] + HELD_UP_S)
        with open(report) as text:
            evaluation = json.load(text)["evaluation"]
        print("%s: offline ATE %.2f mm of %.2f m; %s" % (
            name, 1e3 * evaluation["ate_rmse_m"], evaluation["path_length_m"], said[0] if said else "?"))
        self.assertTrue(said and "ATE RMSE" in said[0], said)
        ate_m = float(said[0].split("ATE RMSE ")[1].split()[0])
        self.assertLess(ate_m, max(1.5 * evaluation["ate_rmse_m"], floor_m))
        # Which depth image begins the map depends on how messages arrive. From then on there is a pose for every tick.
        self.assertGreater(len(stamps), 0.98 * sum(stamp >= stamps[0] for stamp in expected))
        self.assertGreater(stamps[-1], expected[-1] - 0.0101)

    def recording(self, *parts):
        path = os.path.join(SHARED, *parts)
        if not os.path.exists(path):
            self.skipTest("no recording at %s" % path)
        return os.path.abspath(path)

    def replay(self, name, config, bag, **options):
        config = os.path.join(PACKAGE, "config", config)
        self.check(name, config, [bag], "replay.launch", ["bag:=" + bag, "config:=" + config], **options)

    def test_mvsec_is_replayed_by_name_as_well_as_offline(self):
        folder = rospy.get_param("~mvsec")
        bags = [os.path.join(folder, "indoor_flying1_%s.bag" % kind) for kind in ("data", "gt")]
        calibration = os.path.join(folder, "camchain-imucam-indoor_flying.yaml")
        self.check("mvsec", PACKAGE + "/config/mvsec.yaml", bags, "mvsec.launch",
                   ["sequence:=indoor_flying1", "dir:=" + folder],
                   ["calibration.path=" + calibration])

    def test_vector_is_replayed_by_name_as_well_as_offline(self):
        folder = rospy.get_param("~vector")
        bags = [os.path.join(folder, "desk_normal1.synced.%s.bag" % kind)
                for kind in ("left_event", "kinect_depth", "gt", "imu")]
        calibration = os.path.join(folder, "yaml")
        self.check("vector", PACKAGE + "/config/vector.yaml", bags, "vector.launch",
                   ["sequence:=desk_normal1", "dir:=" + folder],
                   ["calibration.path=" + calibration])

    def test_a_replay_faster_than_the_machine_loses_no_pose_and_ends_with_the_last_one(self):
        bag = os.path.join(PACKAGE, "test/data/sample_davis240.bag")
        expected = stamps_of(self.offline("fast", os.path.splitext(bag)[0] + ".yaml", [bag], [])[0])
        trajectory, said = self.launched("fast", "replay.launch", [
            "bag:=" + bag, "config:=%s.yaml" % os.path.splitext(bag)[0], "rate:=10", "max_backlog_s:=10"])
        stamps = stamps_of(trajectory)
        print("fast: %s" % said[0])
        self.assertGreater(stamps[-1], expected[-1] - 0.0101)
        self.assertLess(max(b - a for a, b in zip(stamps, stamps[1:])), 0.0101)

    def test_a_replay_that_ends_sends_its_last_messages_first(self):
        count, size = 20, 4000000
        bag = os.path.join(self.folder, "large.bag")
        with rosbag.Bag(bag, "w") as out:
            for i in range(count):
                out.write("/large", std_msgs.msg.String("%d" % i + " " * size), rospy.Time(1000 + 1e-4 * i))
        received = []
        subscriber = rospy.Subscriber("/large", std_msgs.msg.String, lambda m: received.append(m.data.split()[0]))
        subprocess.check_call([program("play_to_the_end.py"), "--odometry", "/nobody", "--", "--quiet", "--delay", "2", bag])
        subscriber.unregister()
        self.assertEqual(received, ["%d" % i for i in range(count)])

    def test_mvsec_with_depth_from_the_lidar_is_replayed_by_name_as_well_as_offline(self):
        folder = rospy.get_param("~mvsec")
        bags = [os.path.join(folder, "indoor_flying1_%s.bag" % kind) for kind in ("data", "gt")]
        calibration = os.path.join(folder, "camchain-imucam-indoor_flying.yaml")
        self.check("mvsec_lidar", PACKAGE + "/config/mvsec.yaml", bags, "mvsec.launch",
                   ["sequence:=indoor_flying1", "dir:=" + folder, "depth_source:=lidar"],
                   ["calibration.path=" + calibration, "topics.points=/velodyne_point_cloud"], floor_m=0.005)

    # Which sweep begins the map, and with it the error, depends on how messages arrive: 0.8 to 1 mm on an idle machine,
    # up to 3.6 beside two busy programs.
    def test_vector_with_depth_from_the_lidar_is_replayed_by_name_as_well_as_offline(self):
        folder = rospy.get_param("~vector")
        bags = [os.path.join(folder, "desk_normal1.synced.%s.bag" % kind)
                for kind in ("left_event", "lidar", "gt", "imu")]
        calibration = os.path.join(folder, "yaml")
        self.check("vector_lidar", PACKAGE + "/config/vector.yaml", bags, "vector.launch",
                   ["sequence:=desk_normal1", "dir:=" + folder, "depth_source:=lidar"],
                   ["calibration.path=" + calibration, "topics.points=/ouster/point_cloud"], floor_m=0.005)

    def test_the_sample_in_the_repository_is_replayed_as_well_as_offline(self):
        self.replay("sample", "../test/data/sample_davis240.yaml", os.path.join(PACKAGE, "test/data/sample_davis240.bag"),
                    floor_m=0.002)

    def test_the_real_recordings_are_replayed_as_well_as_offline(self):
        for name in ("seq1", "seq2"):
            bag = self.recording("real_davis_kinect", name, name + ".bag")
            # A second long and in motion from its begin: live, seq1 has 3.7 to 6 mm by when its first map comes.
            self.replay(name, "davis_kinect.yaml", bag, floor_m=0.007)

    def test_the_third_party_simulations_are_replayed_as_well_as_offline(self):
        unpack = self.recording("recording.py")
        for name, config in (("desk_slow", "esim.yaml"), ("room_davis", "esim_offset_depth.yaml")):
            bag = os.path.join(self.folder, name + ".bag")
            subprocess.check_call(["/usr/bin/python3", unpack, "unpack", self.recording("esim", name + ".rec"), bag])
            # Offline 0.4 and 1.0 mm, live 0.4 to 3.2 by how much else the machine has to do.
            self.replay(name, config, bag, floor_m=0.004)
            os.remove(bag)


if __name__ == "__main__":
    rostest.rosrun("devo", "recordings", RecordingsTest)
