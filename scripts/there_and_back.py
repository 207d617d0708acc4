#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes a recording that goes on from its end back to its beginning, and there again: a real one of a second becomes a
real one of any length, whose drift shows, as it sees the same again and again.

    scripts/there_and_back.py seq1.bag seq1_x8.bag --legs 8
    scripts/there_and_back.py seq1.bag seq1_back.bag --legs 1 --begin-with-back
    rosrun devo devo_offline --config rig.yaml --bag seq1_x8.bag --out results

On the way back events come in the other order and with the other polarity. An IMU is left out: its bias would change
its sign at each turn. So are topics whose messages have no header (/tf, texts), which are named: nothing says when they
are due on the way back. /tf_static is written once. The recording's events must be EventArrays.
"""
import sys

import rosbag
import rospy

import new_recording
from raw_message import Message, begins_with_header, name_left_out, new_bag


def load(bag):
    """All messages with a header, and how to write each topic; those of /tf_static apart. Names what has none."""
    messages, static, kinds, without_header = [], [], {}, set()
    for topic, raw, t in bag.read_messages(raw=True):
        datatype, data, md5, position, pytype = raw
        if topic == '/tf_static':
            static.append((topic, raw))
        elif not begins_with_header(pytype):
            without_header.add(topic)
        elif datatype != 'sensor_msgs/Imu':
            messages.append(Message(t.to_nsec(), topic, datatype, data))
            kinds[topic] = (datatype, md5, position, pytype)
    name_left_out(without_header, 'whose messages have no header')
    return messages, static, kinds


def stamp_ns(message):
    """Of what it holds: an array of events is there when its last event is."""
    secs, nsecs = message.events[-1][['secs', 'nsecs']] if len(message.events) else message.header
    return 10**9 * int(secs) + int(nsecs)


def write(messages, static, kinds, legs, target):
    last_ns = {}
    for leg in range(legs.stop):
        messages.sort(key=stamp_ns)
        if leg == legs.start:
            begin_ns = stamp_ns(messages[0])
            for topic, raw in static:
                target.write(topic, raw, time_of(begin_ns), raw=True)
        for message in messages if leg in legs else []:
            t_ns = stamp_ns(message)
            # Where two legs meet, a message and its mirror image have the same time.
            if t_ns <= last_ns.get(message.topic, -1):
                continue
            last_ns[message.topic] = t_ns
            datatype, *rest = kinds[message.topic]
            target.write(message.topic, (datatype, bytes(message.bytes), *rest), time_of(t_ns), raw=True)
        end_ns = stamp_ns(messages[-1])
        messages = [message.mirrored(end_ns) for message in messages]


def time_of(t_ns):
    return rospy.Time(t_ns // 10**9, t_ns % 10**9)


def main():
    parser = new_recording.parser(__doc__)
    parser.add_argument('--legs', type=int, default=2, help='how many times the recording is seen; 2: there and back')
    parser.add_argument('--begin-with-back', action='store_true', help='the first leg is the way back')
    arguments = parser.parse_args()
    if not 1 <= arguments.legs <= 1000:
        sys.exit(f'--legs {arguments.legs}: expected 1 to 1000')
    new_recording.expect_new(arguments.target)
    with rosbag.Bag(arguments.source) as source:
        messages, static, kinds = load(source)
    new_recording.expect_events(any(len(message.events) for message in messages), arguments.source)
    first = 1 if arguments.begin_with_back else 0
    with new_bag(arguments.target) as target:
        write(messages, static, kinds, range(first, first + arguments.legs), target)


if __name__ == '__main__':
    main()
