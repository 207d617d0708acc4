# SPDX-License-Identifier: BSD-3-Clause
"""Messages of a recording as their bytes, for scripts that play or write it otherwise than it was."""
import numpy as np

EVENT = np.dtype([('x', '<u2'), ('y', '<u2'), ('secs', '<u4'), ('nsecs', '<u4'), ('polarity', 'u1')])


class Message:
    """A message as its bytes, whose stamps can be moved."""

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
