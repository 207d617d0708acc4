#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""A wrong parameter stops its nodelet with the key named, and leaves the manager alive. A missing input is named."""

import os
import shutil
import subprocess
import tempfile
import time
import unittest

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

from devo.msg import TrackedPose

KINDS = ("TimeSurface", "Mapping", "Tracking")


class BadParametersTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("bad_parameters_test")
        cls.config = rospy.get_param("~config")
        cls.folder = tempfile.mkdtemp(prefix="devo_bad_parameters_")
        cls.log, cls.diagnostics, cls.loaders = [], {}, []
        cls.subscribers = [rospy.Subscriber("/rosout", Log, cls.log.append),
                           rospy.Subscriber("/diagnostics", DiagnosticArray, cls.on_diagnostics)]
        time.sleep(1)

    @classmethod
    def tearDownClass(cls):
        for loader in cls.loaders:
            loader.terminate()
        for loader in cls.loaders:
            loader.wait()
        shutil.rmtree(cls.folder, ignore_errors=True)

    @classmethod
    def on_diagnostics(cls, message):
        for status in message.status:
            cls.diagnostics[status.name] = status

    def load(self, kind, name, **parameters):
        for key, value in parameters.items():
            rospy.set_param("/%s/%s" % (name, key), value)
        self.loaders.append(subprocess.Popen(["rosrun", "nodelet", "nodelet", "load", "devo/" + kind, "/manager",
                                              "__name:=" + name, "--no-bond"]))

    def yaml(self, name, text):
        path = os.path.join(self.folder, name)
        with open(path, "w") as out:
            out.write(text)
        return path

    def await_true(self, condition, timeout=10):
        deadline = time.time() + timeout
        while not condition() and time.time() < deadline:
            time.sleep(0.05)
        return condition()

    def expect_fatal(self, name, words):
        def found():
            return any(m.level >= Log.FATAL and name in m.msg and all(w in m.msg for w in words) for m in list(self.log))
        fatal = [m.msg for m in self.log if m.level >= Log.FATAL]
        self.assertTrue(self.await_true(found), "no FATAL of %s with %s; there are %s" % (name, words, fatal))

    def test_a_missing_config_is_named_by_every_nodelet(self):
        for kind in KINDS:
            self.load(kind, "no_config_" + kind)
        for kind in KINDS:
            self.expect_fatal("no_config_" + kind, ["config", "missing"])

    def test_an_unknown_key_of_the_yaml_is_named(self):
        self.load("TimeSurface", "unknown_key", config=self.yaml("unknown.yaml", "surfaces: {rate_hz: 100}\n"))
        self.expect_fatal("unknown_key", ["surfaces"])

    def test_a_value_out_of_range_is_named_with_its_range(self):
        self.load("Mapping", "out_of_range", config=self.config, set="surface.rate_hz=100000")
        self.expect_fatal("out_of_range", ["surface.rate_hz", "1000"])

    def test_a_file_that_is_not_there_is_named(self):
        self.load("Tracking", "no_file", config="/nowhere/rig.yaml")
        self.expect_fatal("no_file", ["/nowhere/rig.yaml"])

    def test_a_misspelt_private_parameter_is_named(self):
        self.load("Tracking", "misspelt", config=self.config, publsh_tf=False)
        self.expect_fatal("misspelt", ["publsh_tf", "publish_tf"])

    def test_a_parameter_of_the_wrong_type_is_named(self):
        self.load("Tracking", "wrong_type", config=self.config, publish_tf="perhaps")
        self.expect_fatal("wrong_type", ["publish_tf", "true or false"])

    def test_an_initial_pose_that_is_none_is_named(self):
        self.load("Tracking", "no_pose", config=self.config, initial_pose="0 0 0 1 1 1 1")
        self.expect_fatal("no_pose", ["initial_pose"])

    def test_the_manager_lives_and_a_good_nodelet_names_its_missing_input(self):
        self.load("TimeSurface", "bad_before_good", config="/nowhere/rig.yaml")
        self.expect_fatal("bad_before_good", ["/nowhere/rig.yaml"])
        self.load("TimeSurface", "good", config=self.config)

        def sentence():
            status = self.diagnostics.get("good: inputs")
            return status is not None and "No events on /events (EventArray or EventPacket)" in status.message
        self.assertTrue(self.await_true(sentence), sorted(self.diagnostics))
        self.assertTrue(self.await_true(lambda: any("good: No events on /events" in m.msg for m in list(self.log))))

    def test_a_simulated_sensor_that_cannot_run_says_why_and_where_its_lidar_is(self):
        children = set()
        subscriber = rospy.Subscriber("/tf_static", TFMessage, lambda m: children.update(
            t.child_frame_id for t in m.transforms))
        self.load("SimulatedSensor", "no_memory", memory_limit_mb=1, duration=1.0, sensor="davis240", lidar=True,
                  loop=False, clock=False)

        def failed():
            status = self.diagnostics.get("no_memory: simulated sensor")
            return status is not None and status.level == DiagnosticStatus.ERROR and "memory_limit_mb" in status.message
        self.assertTrue(self.await_true(failed, 30), self.diagnostics.get("no_memory: simulated sensor"))
        subscriber.unregister()
        self.assertEqual(children, {"depth_camera_optical", "velodyne"})

    def test_a_topic_for_two_roles_is_named(self):
        self.load("Mapping", "one_topic", config=self.config, set="topics.depth=/events")
        self.expect_fatal("one_topic", ["topics.events", "topics.depth", "/events"])

    def test_ground_truth_of_a_type_that_is_none_ends_no_manager(self):
        # The CameraInfo beside the events, which the nodelet itself subscribes.
        config = self.yaml("truth.yaml", "topics: {events: /dvs/events, ground_truth: /dvs/camera_info}\n")
        self.load("Tracking", "odd_truth", config=config)
        self.assertTrue(self.await_true(lambda: "odd_truth: inputs" in self.diagnostics), sorted(self.diagnostics))
        publisher = rospy.Publisher("/dvs/camera_info", CameraInfo, queue_size=1)

        def is_named():
            publisher.publish(CameraInfo())
            return any("/dvs/camera_info" in m.msg and "sensor_msgs/CameraInfo" in m.msg and
                       "expected PoseStamped" in m.msg for m in list(self.log))
        try:
            self.assertTrue(self.await_true(is_named), "no word about the type")
            del self.diagnostics["odd_truth: inputs"]
            self.assertTrue(self.await_true(lambda: "odd_truth: inputs" in self.diagnostics), "the manager has died")
        finally:
            publisher.unregister()

    def test_missing_calibration_is_named(self):
        config = self.yaml("no_camera.yaml", "topics: {events: /events, depth: /depth/image_raw}\n"
                                             "frames: {event: event_optical, depth: depth_optical}\n")
        self.load("Mapping", "no_camera", config=config)

        def sentences():
            status = self.diagnostics.get("no_camera: inputs")
            return status is not None and all(word in status.message for word in (
                "event_camera is not in the configuration", "depth_camera is not in the configuration",
                "/depth/camera_info", "T_event_depth", "'event_optical' with 'depth_optical'"))
        self.assertTrue(self.await_true(sentences),
                        self.diagnostics["no_camera: inputs"].message if "no_camera: inputs" in self.diagnostics else "-")

    def test_tracking_and_surface_wait_for_the_frame_in_which_mapping_looks_for_the_depth_camera(self):
        config = self.yaml("no_frame.yaml", """
topics: {events: /framed/events, depth: /framed_depth/image_raw}
event_camera: {width: 32, height: 24, fx: 30, fy: 30, cx: 15, cy: 11, distortion_model: none, distortion_coefficients: []}
""")
        names = {kind: "no_frame_" + kind for kind in ("TimeSurface", "Tracking")}
        for kind, name in names.items():
            self.load(kind, name, config=config)

        def waits(name):
            status = self.diagnostics.get(name + ": inputs")
            return status is not None and "No frame of the event camera" in status.message and \
                "/framed/camera_info" in status.message
        for name in names.values():
            self.assertTrue(self.await_true(lambda: waits(name)), self.diagnostics.get(name + ": inputs"))
        publisher = rospy.Publisher("/framed/camera_info", CameraInfo, queue_size=1, latch=True)
        info = CameraInfo()
        info.header.frame_id = "lens"
        publisher.publish(info)
        for name in names.values():
            self.assertTrue(self.await_true(lambda: not waits(name)), self.diagnostics.get(name + ": inputs"))
        publisher.unregister()

    def test_poses_that_a_mapping_without_calibration_cannot_take_are_counted(self):
        # A camera that nobody calibrates: the 33rd pose on is one too many.
        config = self.yaml("never_calibrated.yaml", "topics: {events: /never/events, depth: /never/image_raw}\n")
        self.load("Mapping", "never_calibrated", config=config)
        publisher = rospy.Publisher("/tracked_pose", TrackedPose, queue_size=100)
        pose = TrackedPose()
        pose.T_world_event.orientation.w = pose.T_world_event_edges.orientation.w = 1

        def counted():
            status = self.diagnostics.get("never_calibrated: mapping")
            values = {pair.key: pair.value for pair in status.values} if status else {}
            if publisher.get_num_connections() > 0 and values.get("poses dropped") == "0":
                for _ in range(40):
                    publisher.publish(pose)
            return int(values.get("poses dropped", 0)) >= 8
        try:
            self.assertTrue(self.await_true(counted), "no pose dropped: %s" % self.diagnostics.get("never_calibrated: mapping"))
        finally:
            publisher.unregister()


if __name__ == "__main__":
    rostest.rosrun("devo", "bad_parameters", BadParametersTest)
