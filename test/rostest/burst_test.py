#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""A second of 30 million events, as a flickering lamp makes them, in the middle of a recording."""

import os
import sys
import time
import unittest
from xmlrpc.client import ServerProxy

import numpy as np
import rosbag
import rosgraph
import rospy
import rostest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from devo_testing import Record  # noqa: E402

EVENTS, DEPTH, INFOS = "/event_camera/events", "/depth/image_raw", ("/event_camera/camera_info", "/depth/camera_info")
WIDTH, HEIGHT, RATE_HZ, PERIOD_NS = 346, 260, 30e6, 10000000
EVENT = np.dtype([("x", "<u2"), ("y", "<u2"), ("secs", "<u4"), ("nsecs", "<u4"), ("polarity", "u1")])


def stamped(message_bytes, header_ns, events, t_ns):
    """The bytes of a message, its header at `header_ns` and its events (a view of them) at `t_ns`."""
    np.frombuffer(message_bytes, "<u4", 2, 4)[:] = divmod(header_ns, 10**9)
    events["secs"], events["nsecs"] = t_ns // 10**9, t_ns % 10**9
    return message_bytes


def events_of(message_bytes):
    return np.frombuffer(message_bytes, EVENT, -1, 16 + int.from_bytes(message_bytes[12:16], "little") + 12)


def noise(template, t_ns):
    """An EventArray of one period of uniformly distributed events from `t_ns` on."""
    count = int(RATE_HZ * PERIOD_NS * 1e-9)
    head = 16 + int.from_bytes(template[12:16], "little") + 8
    message = bytearray(template[:head]) + count.to_bytes(4, "little") + bytearray(count * EVENT.itemsize)
    events = events_of(message)
    random = np.random.RandomState(t_ns % 2**32)
    events["x"], events["y"] = random.randint(WIDTH, size=count), random.randint(HEIGHT, size=count)
    events["polarity"] = random.randint(2, size=count)
    return stamped(message, t_ns, events, t_ns + np.sort(random.randint(PERIOD_NS, size=count)))


def resident_mb(pid):
    with open("/proc/%d/statm" % pid) as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


class BurstTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("burst_test")
        cls.record = Record()
        cls.schedule(rospy.get_param("~bag"))
        master = rosgraph.Master("/burst_test")
        cls.pid = ServerProxy(master.lookupNode("/devo/manager")).getPid("/burst_test")[2]
        deadline = time.time() + 20
        while cls.publishers[EVENTS].get_num_connections() == 0 and time.time() < deadline:
            time.sleep(0.1)
        time.sleep(1)
        cls.play()

    @classmethod
    def schedule(cls, path):
        """Messages in order of time: the recording with the burst's second inserted after its first."""
        cls.publishers, cls.messages = {}, []
        with rosbag.Bag(path) as bag:
            for topic, (datatype, data, md5, _, kind), t in bag.read_messages([EVENTS, DEPTH, *INFOS], raw=True):
                raw = type("Raw", (rospy.AnyMsg,), {"_type": datatype, "_md5sum": md5, "_full_text": kind._full_text})
                if topic not in cls.publishers:
                    cls.publishers[topic] = rospy.Publisher(topic, raw, queue_size=200, latch=topic in INFOS)
                cls.messages.append((t.to_nsec(), topic, bytearray(data)))
        template = next(data for _, topic, data in cls.messages if topic == EVENTS)
        cls.burst_ns = (cls.messages[0][0] // 10**9 + 1) * 10**9
        for i, (t_ns, topic, data) in enumerate(cls.messages):
            if t_ns < cls.burst_ns:
                continue
            moved = events_of(data) if topic == EVENTS else np.zeros(0, EVENT)
            moved["secs"] += 1
            np.frombuffer(data, "<u4", 1, 4)[0] += 1
            cls.messages[i] = (t_ns + 10**9, topic, data)
        cls.messages += [(t_ns + PERIOD_NS, EVENTS, noise(template, t_ns))
                         for t_ns in range(cls.burst_ns, cls.burst_ns + 10**9, PERIOD_NS)]
        cls.messages.sort(key=lambda message: message[0])

    @classmethod
    def play(cls):
        begin, first_ns = time.time(), cls.messages[0][0]
        cls.before_mb = cls.most_mb = None
        for t_ns, topic, data in cls.messages:
            time.sleep(max(0, begin + 1e-9 * (t_ns - first_ns) - time.time()))
            message = cls.publishers[topic].data_class()
            message._buff = bytes(data)
            cls.publishers[topic].publish(message)
            if t_ns >= cls.burst_ns and topic == EVENTS:
                cls.before_mb = cls.before_mb or resident_mb(cls.pid)
                cls.most_mb = max(cls.most_mb or 0, resident_mb(cls.pid))
        cls.end_ns = cls.messages[-1][0]
        deadline = time.time() + 20
        while cls.last_pose_ns() < cls.end_ns - 10**8 and time.time() < deadline:
            time.sleep(0.1)
        time.sleep(2.5)  # diagnostics of the state after the last message
        cls.after_mb = resident_mb(cls.pid)

    @classmethod
    def stamps(cls):
        return [pose.header.stamp.to_nsec() for pose in cls.record.odometry_of_epoch(0)]

    @classmethod
    def last_pose_ns(cls):
        return max(cls.stamps(), default=0)

    def test_poses_go_on_through_the_burst_and_after_it(self):
        stamps = self.stamps()
        within = sum(self.burst_ns < t <= self.burst_ns + 10**9 for t in stamps)
        print("%d poses before the burst, %d within, %d after" %
              (sum(t <= self.burst_ns for t in stamps), within, sum(t > self.burst_ns + 10**9 for t in stamps)))
        self.assertGreater(within, 10)
        self.assertGreater(self.last_pose_ns(), self.end_ns - 10**8)

    def test_every_surface_is_rendered_or_counted_as_skipped_and_every_rendered_one_tracked_or_counted_as_dropped(self):
        surface, tracking = self.record.diagnostic("time surface"), self.record.diagnostic("tracking")
        rendered, skipped = int(surface["surfaces"]), int(surface["surfaces skipped"])
        answered = int(tracking["poses"]) + int(tracking["surfaces before the first map"])
        ticks = (self.end_ns - self.messages[0][0]) // PERIOD_NS
        print("%d ticks: %d rendered, %d skipped; %d answered, %s dropped; %s events dropped" %
              (ticks, rendered, skipped, answered, tracking["surfaces dropped"], surface["events dropped"]))
        self.assertEqual(surface["epoch"], "0")
        self.assertAlmostEqual(rendered + skipped, ticks, delta=3)
        self.assertAlmostEqual(answered + int(tracking["surfaces dropped"]), rendered, delta=1)

    def test_memory_stays_within_what_the_queues_may_hold(self):
        print("%.0f MB before the burst, at most %.0f MB, %.0f MB after" %
              (self.before_mb, self.most_mb, self.after_mb))
        # While it lasts: what the transport has not handed over yet, 390 MB at most, and 2 million queued events.
        self.assertLess(self.most_mb - self.before_mb, 390 + 2 * 16 + 50)
        self.assertLess(self.after_mb - self.before_mb, 100)


if __name__ == "__main__":
    rostest.rosrun("devo", "burst_test", BurstTest)
