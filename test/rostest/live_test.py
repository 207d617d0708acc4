#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""live.launch on what the drivers of a live rig publish, in wall time, once per event camera's driver; frames of a robot."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import numpy
import rospy
import rostest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import Image

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from devo_testing import Record, evaluate, write_tum  # noqa: E402
from live_sensors import LiveSensors  # noqa: E402

# The camera looks along x of the base, 0.3 m in front of it and 0.1 m above.
T_BASE_EVENT = [0.3, 0.0, 0.1, -0.5, 0.5, -0.5, 0.5]
INITIAL_POSE = [1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8]
TRIES = 3


def multiply(a, b):
    """Quaternions x y z w."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return numpy.array([aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
                        aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz])


def compose(a, b):
    """Poses x y z qx qy qz qw."""
    q = numpy.array(a[3:])
    turned = multiply(multiply(q, list(b[:3]) + [0]), q * [-1, -1, -1, 1])
    return list(numpy.array(a[:3]) + turned[:3]) + list(multiply(q, b[3:]))


def pose_of(translation, rotation):
    return [translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z, rotation.w]


class LiveTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("live_test")
        cls.bag, cls.config = rospy.get_param("~bag"), rospy.get_param("~config")
        cls.folder = tempfile.mkdtemp(prefix="devo_live_")
        with open(cls.config) as text:
            rig = yaml.safe_load(text)
        # What a user fills in: the calibration of the event camera. The rest comes from the drivers and /tf_static.
        cls.calibration = os.path.join(cls.folder, "event_camera.yaml")
        with open(cls.calibration, "w") as out:
            yaml.safe_dump({"event_camera": rig["event_camera"]}, out)
        # Or also how the Kinect stands to it, which no /tf_static says then.
        cls.extrinsics = os.path.join(cls.folder, "extrinsics.yaml")
        with open(cls.extrinsics, "w") as out:
            yaml.safe_dump({"T_event_depth": rig["T_event_depth"]}, out)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder, ignore_errors=True)

    def run_live(self, driver, arguments, overrides="", extrinsics="", **of_sensors):
        """What the nodelets published, and by how much its stamps are ahead of the recording's."""
        for _ in range(TRIES):
            record, shift_ns = self.try_live(driver, arguments, overrides, extrinsics, **of_sensors)
            # The recording takes a second of wall time. A machine that is held up for as long leaves most of it out.
            if len(record.odometry) > 60:
                break
        print("%s: %d poses, %s" % (driver, len(record.odometry), record.diagnostic("mapping: inputs")["message"]))
        tracking = record.diagnostic(": tracking")
        self.assertGreater(int(tracking["IMU samples accepted"]), 300, tracking)
        self.assertGreater(len(record.odometry), 60)
        return record, shift_ns

    def try_live(self, driver, arguments, overrides, extrinsics, **of_sensors):
        sensors = LiveSensors(self.bag, self.config, driver, **of_sensors)
        sensors.publish_static(T_BASE_EVENT, connect_depth=not extrinsics)
        record = Record()
        record.images = []
        images = rospy.Subscriber("/devo/reprojection/image", Image, record.images.append)
        path = subprocess.check_output(["rospack", "find", "devo"], universal_newlines=True).strip()
        configs = [path + "/config/prophesee_kinect.yaml", self.calibration] + ([extrinsics] if extrinsics else [])
        command = ["roslaunch", "devo", "live.launch", "drivers:=false", "rviz:=false", "respawn:=false",
                   "event_driver:=" + driver, "config:=" + ",".join(configs),
                   "set:=depth_time_offset_s=0 " + overrides] + arguments
        launched = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        try:
            deadline = time.time() + 30
            while not sensors.connected() and time.time() < deadline:
                time.sleep(0.1)
            self.assertTrue(sensors.connected(), "the nodelets do not subscribe to what the drivers publish")
            time.sleep(1)
            shift_ns = sensors.play()
            time.sleep(1)
        finally:
            launched.send_signal(signal.SIGINT)
            launched.wait()
            record.close()
            images.unregister()
        return record, shift_ns

    def error_of(self, name, odometries, shift_ns, T_child_event):
        for odometry in odometries:
            t_ns = odometry.header.stamp.to_nsec() - shift_ns
            odometry.header.stamp = rospy.Time(t_ns // 10**9, t_ns % 10**9)
            pose = odometry.pose.pose
            (pose.position.x, pose.position.y, pose.position.z, pose.orientation.x, pose.orientation.y,
             pose.orientation.z, pose.orientation.w) = compose(pose_of(pose.position, pose.orientation), T_child_event)
        path = write_tum(os.path.join(self.folder, name + ".txt"), odometries)
        error = evaluate(os.path.splitext(self.bag)[0] + "_groundtruth.txt", path)
        print("%s: ATE %.2f mm of %.2f m" % (name, 1e3 * error["ate_rmse_m"], error["path_length_m"]))
        return error["ate_rmse_m"]

    def test_prophesee_ros_driver_and_kinect_give_the_odometry_of_the_base_with_an_inverted_tf(self):
        record, shift_ns = self.run_live("prophesee", ["base_frame:=base_link", "invert_tf:=true", "initial_pose:=%s"
                                                       % " ".join(str(v) for v in INITIAL_POSE)])
        self.assertEqual({o.child_frame_id for o in record.odometry}, {"base_link"})
        self.assertEqual({i.header.frame_id for i in record.images}, {"PropheseeCamera_optical_frame"})
        first = record.odometry[0].pose.pose
        self.assertLess(numpy.abs(numpy.array(pose_of(first.position, first.orientation)) - INITIAL_POSE).max(), 0.05)
        of_odometry = {o.header.stamp: o.pose.pose for o in record.odometry}
        ours = [t for t in record.transforms if t.child_frame_id == "odom"]
        self.assertGreater(len(ours), 0.9 * len(of_odometry))
        for transform in ours[::20]:
            self.assertEqual(transform.header.frame_id, "base_link")
            pose = of_odometry[transform.header.stamp]
            identity = compose(pose_of(pose.position, pose.orientation),
                               pose_of(transform.transform.translation, transform.transform.rotation))
            self.assertLess(numpy.abs(identity[:6]).max(), 1e-9)
        self.assertLess(self.error_of("prophesee", record.odometry, shift_ns, T_BASE_EVENT), 0.006)

    def test_an_imu_whose_samples_come_too_late_is_named_and_the_odometry_goes_on(self):
        # Its frame only the driver's CameraInfo says.
        record, shift_ns = self.run_live("prophesee", [], "frames.event=", imu_latency_ns=100000000)
        self.assertEqual({o.child_frame_id for o in record.odometry}, {"PropheseeCamera_optical_frame"})
        messages = [d["message"] for d in record.diagnostics_named(": tracking")]
        self.assertTrue(any("IMU samples come" in m and "imu_time_offset_s" in m for m in messages), messages)
        self.assertLess(self.error_of("late_imu", record.odometry, shift_ns, [0, 0, 0, 0, 0, 0, 1]), 0.012)

    def test_depth_of_another_clock_is_named_with_how_far_it_is_off(self):
        record, _ = self.try_live("prophesee", [], "depth_time_offset_s=7", "")
        mapping = record.diagnostics_named(": mapping")
        self.assertTrue(any("s ahead of the events" in d["message"] and "depth_time_offset_s" in d["message"] and
                            d["level"] == DiagnosticStatus.WARN for d in mapping), [d["message"] for d in mapping])
        self.assertEqual(len(record.odometry), 0)

    def test_metavision_driver_and_kinect_give_the_odometry_of_the_event_camera_without_tf_if_it_is_not_wanted(self):
        record, shift_ns = self.run_live("metavision", ["publish_tf:=false"],
                                         "topics.events=/event_camera/events frames.event=event_camera", self.extrinsics)
        self.assertEqual({o.child_frame_id for o in record.odometry}, {"event_camera"})
        self.assertEqual(record.transforms, [])
        self.assertLess(self.error_of("metavision", record.odometry, shift_ns, [0, 0, 0, 0, 0, 0, 1]), 0.006)


if __name__ == "__main__":
    rostest.rosrun("devo", "live", LiveTest)
