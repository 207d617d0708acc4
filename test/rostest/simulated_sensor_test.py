#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""simulation.launch prepares a sequence and streams it in real time, round after round, into the odometry."""

import os
import struct
import sys
import threading
import time
import unittest

import rospy
import rostest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from devo_testing import Record  # noqa: E402

ROUND_S = 2.0
BEGIN_S = 1000.0


class Events:
    """Time and number of events of every message, read from the wire: Python would be too slow for each event."""

    def __init__(self):
        self.lock = threading.Lock()
        self.messages = []  # wall time, stamp, events
        self.subscriber = rospy.Subscriber("/event_camera/events", rospy.AnyMsg, self.on_message, queue_size=None)

    def on_message(self, message):
        _, secs, nsecs, name = struct.unpack_from("<4I", message._buff)
        height, width, count = struct.unpack_from("<3I", message._buff, 16 + name)
        assert (height, width) == (180, 240)
        with self.lock:
            self.messages.append((time.monotonic(), secs + 1e-9 * nsecs, count))

    def copy(self):
        with self.lock:
            return list(self.messages)


class SimulatedSensorTest(unittest.TestCase):
    def test_it_streams_in_real_time_without_loss_or_jump_and_the_odometry_follows(self):
        rospy.init_node("simulated_sensor_test")
        events, record = Events(), Record()
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline:
            time.sleep(0.2)
            messages = events.copy()
            if messages and messages[-1][1] > BEGIN_S + 2.5 * ROUND_S:
                break
        self.assertTrue(messages and messages[-1][1] > BEGIN_S + 2.5 * ROUND_S, "no two rounds within 120 s")

        stamps = [stamp for _, stamp, _ in messages]
        self.assertEqual(stamps, sorted(stamps), "stamps go back at the seam of two rounds")
        passed = messages[-1][0] - messages[0][0]
        self.assertAlmostEqual((stamps[-1] - stamps[0]) / passed, 1, delta=0.05, msg="speed of the sensor's clock")

        def of_round(number):
            begin = BEGIN_S + number * ROUND_S
            return sum(count for _, stamp, count in messages if begin < stamp <= begin + ROUND_S + 1e-7)

        self.assertGreater(of_round(1), 10000)
        sensor = record.diagnostic("simulated sensor")
        self.assertEqual(sensor["message"], "streaming")
        self.assertEqual(sensor["events dropped"], "0")
        later = events.copy()
        while later[-1][1] < BEGIN_S + 3.1 * ROUND_S and time.monotonic() < deadline:
            time.sleep(0.2)
            later = events.copy()
        messages = later
        self.assertEqual(of_round(1), of_round(2), "every round has the same events, all of which arrive")

        with record.lock:
            poses = [message.header.stamp.to_sec() for message in record.odometry]
        self.assertEqual(record.epoch(), 0, "the odometry takes the seam for a jump of time")
        self.assertTrue(poses and poses[-1] > BEGIN_S + 1.5 * ROUND_S, "odometry ends at %s" % poses[-1:])


if __name__ == "__main__":
    rostest.rosrun("devo", "simulated_sensor", SimulatedSensorTest)
