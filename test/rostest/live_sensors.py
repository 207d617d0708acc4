# SPDX-License-Identifier: BSD-3-Clause
"""A simulated recording played as the drivers of a live rig publish it: prophesee_ros_driver or metavision_driver beside
Azure_Kinect_ROS_Driver, with their topics, types, frames, encodings and stamps, in wall time."""

import struct
import time

import genpy
import numpy
import rosbag
import rospy
import yaml
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, Image, Imu
from tf2_msgs.msg import TFMessage

EVENT = numpy.dtype([("x", "<u2"), ("y", "<u2"), ("secs", "<u4"), ("nsecs", "<u4"), ("polarity", "u1")])
PERIOD_NS = 2000000  # of messages: event_delta_t, event_message_time_threshold
# The Kinect's IMU in the frame of its depth camera: x back, y left, z down.
Q_DEPTH_IMU = [-0.5, 0.5, 0.5, 0.5]


def rotation_of(quaternion):
    """Of x y z w."""
    x, y, z, w = quaternion
    cross = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return numpy.eye(3) + 2 * w * cross + 2 * cross @ cross


def raw_type(name, md5):
    """A message type of a package that is not here, published as the bytes that its driver would send."""
    class Raw(rospy.AnyMsg):
        _type, _md5sum, _has_header, _full_text, _slot_types = name, md5, False, "", []

        def serialize(self, buff):
            buff.write(self._buff)
    return Raw


EventArray = raw_type("prophesee_event_msgs/EventArray", "5e8beee5a6c107e504c2e78903c224b8")
EventPacket = raw_type("event_camera_msgs/EventPacket", "8a6101b351a64529ac77bd8b71074e52")


def header(t_ns, frame):
    return struct.pack("<IIII", 0, t_ns // 10**9, t_ns % 10**9, len(frame)) + frame.encode()


def event_array(events, t_ns, size):
    """The driver stamps with the last event and names no frame."""
    shifted = events.copy()
    shifted["secs"], shifted["nsecs"] = t_ns // 10**9, t_ns % 10**9
    return header(int(t_ns[-1]), "") + struct.pack("<III", size[1], size[0], len(events)) + shifted.tobytes()


def event_packet(events, t_ns, size, sensor_us, seq):
    """EVT3: time (high and low), row and column for every event."""
    words = numpy.empty((len(events), 4), "<u2")
    words[:, 0] = 0x8000 | (sensor_us >> 12 & 0xFFF)
    words[:, 1] = 0x6000 | (sensor_us & 0xFFF)
    words[:, 2] = events["y"]
    words[:, 3] = 0x2000 | events["polarity"].astype("<u2") << 11 | events["x"]
    data = words.tobytes()
    return (header(int(t_ns[0]), "event_camera") + struct.pack("<IIQQ", size[1], size[0], seq, 0) +
            struct.pack("<I", 4) + b"evt3" + struct.pack("<BI", 0, len(data)) + data)


class LiveSensors:
    def __init__(self, bag, config, driver, imu_latency_ns=8000000):
        self.imu_latency_ns = imu_latency_ns  # samples come in batches
        with open(config) as text:
            self.rig = yaml.safe_load(text)
        self.packets = driver == "metavision"
        self.event_frame = "event_camera" if self.packets else "PropheseeCamera_optical_frame"
        topic = "/event_camera/events" if self.packets else "/prophesee/camera/cd_events_buffer"
        self.events_publisher = rospy.Publisher(topic, EventPacket if self.packets else EventArray, queue_size=500)
        # Of a live camera only the size is known here.
        self.info_publisher = rospy.Publisher(topic.rsplit("/", 1)[0] + "/camera_info", CameraInfo, queue_size=5)
        self.depth_publisher = rospy.Publisher("/depth/image_raw", Image, queue_size=5)
        self.depth_info_publisher = rospy.Publisher("/depth/camera_info", CameraInfo, queue_size=5)
        self.imu_publisher = rospy.Publisher("/imu", Imu, queue_size=100)
        self.static_publisher = rospy.Publisher("/tf_static", TFMessage, queue_size=5, latch=True)
        self.read(bag)

    def read(self, path):
        events, self.depth, self.imu = [], [], []
        with rosbag.Bag(path) as bag:
            for topic, raw, _ in bag.read_messages(topics=["/event_camera/events"], raw=True):
                skip = 16 + struct.unpack_from("<I", raw[1], 12)[0]
                events.append(numpy.frombuffer(raw[1], EVENT, offset=skip + 12))
            for topic, message, _ in bag.read_messages(topics=["/depth/image_raw", "/depth/camera_info"]):
                self.depth.append(message)
            for _, message, _ in bag.read_messages(topics=["/imu"]):
                self.imu.append(self.of_the_kinect(message))
        self.events = numpy.concatenate(events)
        self.t_ns = self.events["secs"].astype(numpy.int64) * 10**9 + self.events["nsecs"]

    def of_the_kinect(self, message):
        """A sample in the event camera's frame as a sensor at its place, but turned as the Kinect's, would have it."""
        turned = (rotation_of(self.rig["T_event_depth"]["quaternion"]) @ rotation_of(Q_DEPTH_IMU)).T
        for vector in (message.angular_velocity, message.linear_acceleration):
            vector.x, vector.y, vector.z = turned @ numpy.array([vector.x, vector.y, vector.z])
        message.header.frame_id = "imu_link"
        return message

    def publish_static(self, T_base_event, connect_depth):
        """base_link -> event camera, the Kinect's own tree and, on request, event camera -> depth camera as the rig has
        it. Poses are x y z qx qy qz qw."""
        rig = self.rig["T_event_depth"]
        p_depth_imu = list(-rotation_of(rig["quaternion"]).T @ numpy.array(rig["translation"]))
        poses = [("base_link", self.event_frame, T_base_event), ("depth_camera_link", "imu_link", p_depth_imu + Q_DEPTH_IMU)]
        if connect_depth:
            poses.append((self.event_frame, "depth_camera_link", rig["translation"] + rig["quaternion"]))
        message = TFMessage()
        for parent, child, pose in poses:
            transform = TransformStamped()
            transform.header.frame_id, transform.child_frame_id = parent, child
            for part, names, values in ((transform.transform.translation, "xyz", pose[:3]),
                                        (transform.transform.rotation, "xyzw", pose[3:])):
                for name, value in zip(names, values):
                    setattr(part, name, value)
            message.transforms.append(transform)
        self.static_publisher.publish(message)

    def connected(self):
        return self.events_publisher.get_num_connections() > 0 and self.depth_publisher.get_num_connections() > 0

    def play(self):
        """Everything once, stamps moved to the present; returns by how many nanoseconds."""
        shift_ns = time.time_ns() + 10**9 - int(self.t_ns[0])
        size = (self.rig["event_camera"]["width"], self.rig["event_camera"]["height"])
        due = []
        cuts = numpy.searchsorted(self.t_ns, numpy.arange(self.t_ns[0], self.t_ns[-1] + PERIOD_NS, PERIOD_NS))
        for seq, (begin, end) in enumerate(zip(cuts, list(cuts[1:]) + [len(self.t_ns)])):
            if begin == end:
                continue
            chunk, t_ns = self.events[begin:end], self.t_ns[begin:end] + shift_ns
            if self.packets:
                data = event_packet(chunk, t_ns, size, (self.t_ns[begin:end] - self.t_ns[0]) // 1000 + 10**6, seq)
                message = EventPacket()
            else:
                data = event_array(chunk, t_ns, size)
                message = EventArray()
            message._buff = data
            due.append((int(t_ns[-1]), self.events_publisher, message))
        for message in self.depth:
            t_ns = message.header.stamp.to_nsec() + shift_ns
            message.header.stamp = genpy.Time(t_ns // 10**9, t_ns % 10**9)
            message.header.frame_id = "depth_camera_link"
            is_image = isinstance(message, Image) or message._type == Image._type
            due.append((t_ns + (20000000 if is_image else 0),  # exposure and transfer
                        self.depth_publisher if is_image else self.depth_info_publisher, message))
        for message in self.imu:
            t_ns = message.header.stamp.to_nsec() + shift_ns
            message.header.stamp = genpy.Time(t_ns // 10**9, t_ns % 10**9)
            due.append((t_ns + self.imu_latency_ns, self.imu_publisher, message))
        info = CameraInfo(width=size[0], height=size[1])
        info.header.frame_id = self.event_frame
        for t_ns in range(due[0][0], due[-1][0], 200000000):
            due.append((t_ns, self.info_publisher, info))
        for t_ns, publisher, message in sorted(due, key=lambda item: item[0]):
            time.sleep(max(0, (t_ns - time.time_ns()) * 1e-9))
            publisher.publish(message)
        return shift_ns
