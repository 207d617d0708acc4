# SPDX-License-Identifier: BSD-3-Clause
"""Messages of a recording as their bytes, for scripts that play or write it otherwise than it was."""
import contextlib
import os
import re
import sys

import numpy as np
import rosbag

EVENT = np.dtype([('x', '<u2'), ('y', '<u2'), ('secs', '<u4'), ('nsecs', '<u4'), ('polarity', 'u1')])


def begins_with_header(pytype):
    """Whether messages of a type do, which rosbag makes from the recording's own definition."""
    return pytype._slot_types[:1] == ['std_msgs/Header']


def holds_stamps(pytype):
    """Whether messages of a type do, in whatever they consist of."""
    return re.search(r'^\s*time\b', pytype._full_text, re.MULTILINE) is not None


def name_left_out(topics, why):
    if topics:
        print(f"left out: {', '.join(sorted(topics))}, {why}", file=sys.stderr)


@contextlib.contextmanager
def new_bag(target):
    """The bag to write, which has its name only once it is whole."""
    part = target + '.part'
    try:
        with rosbag.Bag(part, 'w', compression='lz4') as bag:
            yield bag
        os.rename(part, target)
    finally:
        if os.path.exists(part):
            os.remove(part)


class Message:
    """A message as its bytes, whose stamps can be moved; its type begins with a header, or its topic is /tf_static."""

    def __init__(self, t_ns, topic, datatype, data):
        self.t_ns, self.topic, self.datatype = t_ns, topic, datatype
        self.bytes = bytearray(data)
        self.header = np.frombuffer(self.bytes, '<u4', 2, 4)
        self.events = np.zeros(0, EVENT)
        if datatype.endswith('/EventArray'):
            begin = 16 + int.from_bytes(self.bytes[12:16], 'little') + 12
            self.events = np.frombuffer(self.bytes, EVENT, -1, begin)

    def move(self, seconds):
        if self.topic != '/tf_static':
            self.header[0] += seconds
            self.events['secs'] += np.uint32(seconds)

    def mirrored(self, turn_ns):
        """The message on the way back from a turn at the time `turn_ns`."""
        back = Message(2 * turn_ns - self.t_ns, self.topic, self.datatype, self.bytes)
        header_ns = 2 * turn_ns - (10**9 * int(self.header[0]) + int(self.header[1]))
        back.header[:] = header_ns // 10**9, header_ns % 10**9
        events = self.events[::-1]
        t_ns = 2 * turn_ns - (10**9 * events['secs'].astype('i8') + events['nsecs'])
        back.events['x'], back.events['y'], back.events['polarity'] = events['x'], events['y'], 1 - events['polarity']
        back.events['secs'], back.events['nsecs'] = t_ns // 10**9, t_ns % 10**9
        return back
