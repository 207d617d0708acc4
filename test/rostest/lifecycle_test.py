#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""The nodelets without input, with a bag that stops, jumps and goes back, with a manager that dies, and with
subscribers that come late."""

import os
import signal
import subprocess
import sys
import time
import unittest
import xmlrpc.client

import rosgraph
import rospkg
import rospy
import rostest
from nav_msgs.msg import Path
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from devo_testing import Record, stamps_of  # noqa: E402

# So long that the rest of a start, or of another program, does not pass for the nodelets'.
IDLE_S = 20


def pid_of(node):
    uri = rosgraph.Master("/lifecycle_test").lookupNode(node)
    return xmlrpc.client.ServerProxy(uri).getPid("/lifecycle_test")[2]


def cpu_seconds(pid):
    with open("/proc/%d/stat" % pid) as stat:
        fields = stat.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def await_true(condition, timeout=30):
    deadline = time.time() + timeout
    while not condition() and time.time() < deadline:
        time.sleep(0.05)
    return condition()


class LifecycleTest(unittest.TestCase):
    """One story in the order of the names: each test goes on where the one before ended."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node("lifecycle_test")
        cls.bag = rospy.get_param("~bag")
        cls.record = Record()
        cls.players, cls.log = [], []
        cls.log_subscriber = rospy.Subscriber("/rosout", Log, cls.log.append)

    @classmethod
    def tearDownClass(cls):
        for player in cls.players:
            cls.stop(player)

    @classmethod
    def start(cls, *options):
        cls.players.append(subprocess.Popen(
            ["rosbag", "play", "--clock", "--hz", "500", "--quiet", "--delay", "1.5"] + list(options) + [cls.bag],
            stdin=subprocess.DEVNULL))
        return cls.players[-1]

    @staticmethod
    def stop(player):
        if player.poll() is None:
            player.send_signal(signal.SIGINT)
        player.wait()

    def play(self, start_s, duration_s):
        """Plays a part of the bag, and returns the status messages that it caused."""
        before = len(self.record.status)
        self.assertEqual(self.start("--start", str(start_s), "--duration", str(duration_s)).wait(), 0)
        time.sleep(0.5)
        return list(self.record.status)[before:]

    def await_tracking(self, since, timeout=30):
        self.assertTrue(await_true(lambda: any(s.state_name == "tracking" for s in list(self.record.status)[since:]),
                                   timeout), "not tracking after %d s" % timeout)

    def test_1_without_input_the_three_nodelets_take_less_than_a_hundredth_of_a_core(self):
        for service in ("/devo/surface/reset", "/devo/mapping/save_map", "/devo/tracking/save_trajectory"):
            rospy.wait_for_service(service, 30)
        time.sleep(1)
        pids = [pid_of("/devo/manager"), pid_of("/empty_manager")]
        before = [cpu_seconds(pid) for pid in pids]
        time.sleep(IDLE_S)
        full, empty = [(cpu_seconds(pid) - begin) / IDLE_S for pid, begin in zip(pids, before)]
        print("idle: %.2f %% of a core, of which an empty manager takes %.2f" % (100 * full, 100 * empty))
        # What a manager's threads cost to wake for nothing is the machine's: four times as much on some.
        self.assertLess(full - empty, 0.01)

    def test_2_small_jumps_go_on_and_large_and_backward_ones_begin_a_new_epoch(self):
        first = self.play(0, 0.9)
        small_gap = self.play(1.1, 0.2)
        large_gap = self.play(1.85, 0.1)
        backwards = self.play(0, 0.9)
        self.assertTrue(first and small_gap and large_gap and backwards)
        print("epochs %s" % [[s.epoch for s in (p[0], p[-1])] for p in (first, small_gap, large_gap, backwards)])
        self.assertEqual({s.epoch for s in first + small_gap}, {first[0].epoch})
        self.assertEqual({s.epoch for s in large_gap}, {first[0].epoch + 1})
        self.assertEqual({s.epoch for s in backwards}, {first[0].epoch + 2})
        for part in (first, small_gap, backwards):
            self.assertEqual(part[-1].state_name, "tracking")

    def test_2b_the_poses_of_an_epoch_that_ends_are_written_and_their_number_and_the_reason_are_named(self):
        first = min(s.epoch for s in self.record.status)
        tracked = [s.header.stamp.to_sec() for s in self.record.status
                   if s.epoch == first and s.state_name != "initialising"]
        stamps = stamps_of(os.path.join(rospkg.get_ros_home(), "lifecycle_epoch%d.txt" % first))
        self.assertGreater(len(stamps), 50)
        self.assertEqual(len(stamps), len(tracked))
        self.assertAlmostEqual(stamps[-1], tracked[-1], places=6)
        warnings = [m.msg for m in self.log if m.level == Log.WARN]
        words = ("epoch %d begins, since no events came for" % (first + 1), " %d poses" % len(tracked))
        self.assertTrue(any(all(word in w for word in words) for w in warnings), (words, warnings))

    def test_3_a_silence_is_named_after_the_bag_has_stopped(self):
        def sentence():
            message = self.record.diagnostic("surface: inputs")["message"]
            return "No more events on /event_camera/events (EventArray or EventPacket)" in message and "nobody publishes it" in message
        self.assertTrue(await_true(sentence, 15), self.record.diagnostic("surface: inputs"))

    def test_3b_what_comes_while_paused_is_not_called_missing(self):
        pause = rospy.ServiceProxy("/devo/surface/pause", SetBool)
        self.assertTrue(pause(True).success)
        player = self.start("--loop")
        try:
            def paused():
                return (self.record.diagnostic("surface: time surface")["message"] == "paused" and
                        self.record.diagnostic("surface: inputs")["message"] == "all inputs arrive")
            self.assertTrue(await_true(paused, 15), self.record.diagnostic("surface: inputs"))
            time.sleep(4)  # longer than a silence
            self.assertEqual(self.record.diagnostic("surface: inputs")["message"], "all inputs arrive")
        finally:
            self.stop(player)
            pause(False)

    def test_4_who_comes_late_gets_path_and_maps(self):
        for topic, kind in (("/devo/path", Path), ("/devo/local_map", PointCloud2), ("/devo/global_map", PointCloud2)):
            message = rospy.wait_for_message(topic, kind, 10)
            self.assertEqual(message.header.frame_id, "odom")
            self.assertGreater(len(message.poses) if kind is Path else message.width, 4)

    def test_4b_a_pause_longer_than_the_gap_that_begins_an_epoch_begins_none(self):
        pause = rospy.ServiceProxy("/devo/surface/pause", SetBool)
        player = self.start("--rate", "0.25")
        try:
            self.await_tracking(len(self.record.status))
            self.assertTrue(pause(True).success)
            time.sleep(0.5)
            before = self.record.status[-1]
            time.sleep(2.5)
            self.assertEqual(self.record.status[-1].header.stamp, before.header.stamp)
            self.assertTrue(pause(False).success)
            self.assertTrue(await_true(lambda: self.record.status[-1].header.stamp > before.header.stamp))
            after = self.record.status[-1]
            self.assertGreater((after.header.stamp - before.header.stamp).to_sec(), 0.5)
            self.assertEqual(after.epoch, before.epoch)
            self.assertNotEqual(after.state_name, "initialising")
        finally:
            self.stop(player)

    def test_5_a_manager_that_dies_comes_back_and_tracks_a_bag_that_plays_already(self):
        self.start("--loop")
        self.await_tracking(len(self.record.status))
        dead = pid_of("/devo/manager")
        os.kill(dead, signal.SIGKILL)
        begin = time.time()
        self.assertTrue(await_true(lambda: not os.path.exists("/proc/%d" % dead), 10))
        time.sleep(1)  # what was under way
        self.await_tracking(len(self.record.status), 60)
        print("tracks %.1f s after the manager was killed" % (time.time() - begin))
        self.assertNotEqual(pid_of("/devo/manager"), dead)

    def test_6_one_nodelet_that_dies_comes_back_and_all_three_begin_a_new_epoch(self):
        for player in self.players:
            self.stop(player)
        for node in ("tracking", "mapping"):
            player = self.start("--rate", "0.1")  # so that it lasts until the nodelet is there again
            self.await_tracking(len(self.record.status))
            epoch = self.record.status[-1].epoch
            os.kill(pid_of("/devo/" + node), signal.SIGINT)

            def tracks_anew():
                return any(s.epoch > epoch and s.state_name == "tracking" for s in list(self.record.status)[-100:])
            self.assertTrue(await_true(tracks_anew), node)
            self.assertIsNone(player.poll(), "the bag is over: time that goes back begins an epoch, too")
            self.stop(player)


if __name__ == "__main__":
    rostest.rosrun("devo", "lifecycle", LifecycleTest)
