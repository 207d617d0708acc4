#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes a recording as it would be at another speed: on the same way, a camera sees the same events in less time.

    scripts/change_speed.py room.bag room_x3.bag --speed 3
    rosrun devo devo_offline --config rig.yaml --bag room_x3.bag --out results    # and at that speed?

Images and their calibrations, depth included, keep their rate: of a faster recording some are left out. An IMU's rates
grow with the speed and its accelerations with the square, noise included; gravity does not. This takes the orientation
from the ground truth (--ground-truth), which must be that of the IMU's frame; without it, the IMU is left out.
Messages without a header, such as /tf_static's or texts, stay as they are and keep their place in the recording; those
that hold stamps within, such as /tf's, are left out and their topics named.
The recording's events must be EventArrays.
"""
import sys

import numpy as np
import rosbag
import rospy

import new_recording
from raw_message import Message, begins_with_header, holds_stamps, name_left_out, new_bag


class Imu:
    """Readings at another speed."""

    def __init__(self, bag, topic, ground_truth, speed):
        self.speed, self.index = speed, 0
        samples = [m for _, m, _ in bag.read_messages(topics=[topic])]
        poses = sorted((m for _, m, _ in bag.read_messages(topics=[ground_truth])), key=lambda m: m.header.stamp)
        self.known = len(samples) > 0 and len(poses) > 2
        if not self.known:
            return
        t = np.array([m.header.stamp.to_sec() for m in samples])
        force = np.array([[getattr(m.linear_acceleration, k) for k in 'xyz'] for m in samples])
        t_pose = np.array([m.header.stamp.to_sec() for m in poses])
        q = np.array([[getattr(m.pose.orientation, k) for k in 'xyzw'] for m in poses])
        p = np.array([[getattr(m.pose.position, k) for k in 'xyz'] for m in poses])
        self.R_imu_world = np.array([rotation(*row).T for row in q])[nearest(t, t_pose)]
        # What is left of the mean force is gravity, once the change of velocity is taken out.
        velocity = np.diff(p[[0, 1, -2, -1]], axis=0)[[0, 2]] / np.diff(t_pose[[0, 1, -2, -1]])[[0, 2], None]
        mean = np.einsum('nji,nj->ni', self.R_imu_world, force).mean(axis=0)
        self.gravity_world = (velocity[1] - velocity[0]) / (t_pose[-1] - t_pose[0]) - mean

    def change(self, sample):
        gravity = self.R_imu_world[self.index] @ self.gravity_world
        self.index += 1
        for i, k in enumerate('xyz'):
            acceleration = getattr(sample.linear_acceleration, k) + gravity[i]
            setattr(sample.linear_acceleration, k, self.speed**2 * acceleration - gravity[i])
            setattr(sample.angular_velocity, k, self.speed * getattr(sample.angular_velocity, k))


def nearest(t, sorted_t):
    """Indices of the nearest in `sorted_t`, of two as near that of the earlier one."""
    after = np.searchsorted(sorted_t, t).clip(1, len(sorted_t) - 1)
    return after - (t - sorted_t[after - 1] <= sorted_t[after] - t)


def rotation(x, y, z, w):
    n = np.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / n, y / n, z / n, w / n
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


class Clock:
    """Times at another speed, which begin with the recording."""

    def __init__(self, begin_ns, speed):
        self.begin_ns, self.speed = begin_ns, speed

    def changed(self, secs, nsecs):
        """Both may be arrays."""
        t_ns = 10**9 * np.int64(secs) + nsecs
        t_ns = self.begin_ns + np.round((t_ns - self.begin_ns) / self.speed).astype('i8')
        return t_ns // 10**9, t_ns % 10**9


def periods_s(bag):
    """Of what keeps its rate."""
    span_s = bag.get_end_time() - bag.get_start_time()
    return {topic: span_s / value.message_count for topic, value in bag.get_type_and_topic_info()[1].items()
            if value.msg_type.startswith('sensor_msgs/') and value.msg_type != 'sensor_msgs/Imu'}


def write(source, target, clock, imu_topic, imu):
    """Returns the topics that are left out for what their messages hold."""
    period_s, last_s, left_out = periods_s(source), {}, set()
    for topic, raw, t in source.read_messages(raw=True):
        datatype, data, md5, position, pytype = raw
        t = rospy.Time(*map(int, clock.changed(t.secs, t.nsecs)))
        if not begins_with_header(pytype):
            if topic == '/tf_static' or not holds_stamps(pytype):
                target.write(topic, raw, t, raw=True)
            else:
                left_out.add(topic)
            continue
        # A message may be recorded a little sooner or later than its period says.
        if t.to_sec() - last_s.get(topic, 0) < 0.7 * period_s.get(topic, 0) or (topic == imu_topic and not imu.known):
            continue
        last_s[topic] = t.to_sec()
        message = Message(t.to_nsec(), topic, datatype, data)
        message.header[:] = clock.changed(*message.header)
        events = message.events
        events['secs'], events['nsecs'] = clock.changed(events['secs'], events['nsecs'])
        if topic == imu_topic:
            sample = pytype().deserialize(bytes(message.bytes))
            imu.change(sample)
            target.write(topic, sample, t)
        else:
            target.write(topic, (datatype, bytes(message.bytes), md5, position, pytype), t, raw=True)
    return left_out


def main():
    parser = new_recording.parser(__doc__)
    parser.add_argument('--speed', type=float, required=True, help='3: three times as fast; 0.5: half as fast')
    parser.add_argument('--imu', default='/imu', help='topic')
    parser.add_argument('--ground-truth', default='/ground_truth/pose', help="topic, PoseStamped of the IMU's frame")
    arguments = parser.parse_args()
    if not 0.05 <= arguments.speed <= 20:
        sys.exit(f'--speed {arguments.speed}: expected 0.05 to 20')
    new_recording.expect_new(arguments.target)
    with rosbag.Bag(arguments.source) as source:
        topics = source.get_type_and_topic_info()[1]
        with_events = any(value.msg_type.endswith('/EventArray') for value in topics.values())
        new_recording.expect_events(with_events, arguments.source)
        imu = Imu(source, arguments.imu, arguments.ground_truth, arguments.speed)
        if arguments.imu in topics and not imu.known:
            print(f"no poses on '{arguments.ground_truth}': '{arguments.imu}' is left out", file=sys.stderr)
        begin_ns = int(round(1e9 * source.get_start_time()))
        with new_bag(arguments.target) as target:
            left_out = write(source, target, Clock(begin_ns, arguments.speed), arguments.imu, imu)
    name_left_out(left_out, 'whose messages hold stamps but have no header')


if __name__ == '__main__':
    main()
