#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs the three nodelets for minutes on a recording that is published again and again in real time, its stamps moved on
from round to round so that data time never goes back, and prints what they cost: CPU, latency, memory and its slope.

    source devel/setup.bash
    scripts/soak.py --bag rec.bag --config config/simulated.yaml rec.yaml --minutes 10

At the seams the camera jumps from the recording's end to its begin: tracking is lost and must find its place again.
With --reset each round begins a new epoch instead, as a run of its own: that is what to read CPU and latency from.
The recording's events must be EventArrays. Starts a master of its own (--port).
"""
import argparse
import os
import subprocess
import sys
import time

import numpy as np
import rosbag
import rosgraph
import rospy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger
from xmlrpc.client import ServerProxy

EVENT = np.dtype([('x', '<u2'), ('y', '<u2'), ('secs', '<u4'), ('nsecs', '<u4'), ('polarity', 'u1')])
SHOWN = [('time surface', ['surfaces', 'surfaces skipped', 'events dropped', 'event rate (Mev/s)', 'rendering p50 (ms)',
                           'rendering p99 (ms)', 'latency event to pose p50 (ms)', 'latency event to pose p99 (ms)',
                           'latency event to pose max (ms)']),
         ('tracking', ['poses', 'surfaces dropped', 'tracking p50 (ms)', 'tracking p99 (ms)', 'tracking max (ms)']),
         ('mapping', ['references', 'points in the global map', 'depth images used', 'depth images dropped',
                      'mapping p50 (ms)', 'mapping p99 (ms)'])]


def topics_of(configs):
    topics = {}
    for path in configs:
        with open(path) as file:
            topics.update((yaml.safe_load(file) or {}).get('topics', {}))
    return {topic for role, topic in topics.items() if topic and role != 'ground_truth'} | {'/tf_static'}


class Message:
    """A message as its bytes, whose stamps can be moved by whole seconds."""

    def __init__(self, t_s, topic, datatype, data):
        self.t_s, self.topic = t_s, topic
        self.bytes = bytearray(data)
        self.stamps = []
        if datatype != 'tf2_msgs/TFMessage':
            self.stamps.append(np.frombuffer(self.bytes, '<u4', 1, 4))  # of the header
        if datatype.endswith('/EventArray'):
            begin = 16 + int.from_bytes(self.bytes[12:16], 'little') + 12
            self.stamps.append(np.frombuffer(self.bytes, EVENT, -1, begin)['secs'])

    def move(self, seconds):
        for stamps in self.stamps:
            stamps += np.uint32(seconds)


def raw_type(datatype, md5, definition):
    return type('Raw', (rospy.AnyMsg,), {'_type': datatype, '_md5sum': md5, '_full_text': definition})


def load(path, topics):
    messages, publishers = [], {}
    with rosbag.Bag(path) as bag:
        for topic, (datatype, data, md5, _, pytype), t in bag.read_messages(topics=topics, raw=True):
            if datatype.endswith('/EventPacket'):
                sys.exit(f"topic '{topic}' has type {datatype}, expected EventArray")
            messages.append(Message(t.to_sec(), topic, datatype, data))
            publishers.setdefault(topic, (raw_type(datatype, md5, pytype._full_text), topic == '/tf_static'))
    if not messages:
        sys.exit(f"'{path}' holds none of the topics {sorted(topics)}")
    return messages, {topic: rospy.Publisher(topic, kind, queue_size=100, latch=latch)
                      for topic, (kind, latch) in publishers.items()}


def wait_for(what, seconds, found):
    end = time.time() + seconds
    while time.time() < end:
        try:
            value = found()
        except (OSError, rosgraph.MasterException):
            value = None
        if value:
            return value
        time.sleep(0.2)
    sys.exit(f'{what}: not there after {seconds} s')


class Watch:
    """CPU time and memory of a process, as /proc tells them."""

    def __init__(self, pid):
        self.pid = pid
        self.samples = []  # time, CPU seconds, resident MB

    def sample(self):
        with open(f'/proc/{self.pid}/stat') as file:
            fields = file.read().rsplit(')', 1)[1].split()
        with open(f'/proc/{self.pid}/statm') as file:
            resident = int(file.read().split()[1])
        self.samples.append((time.time(), (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK'),
                             resident * os.sysconf('SC_PAGE_SIZE') / 2**20))

    def report(self, warm_up_s):
        rows = np.array(self.samples)
        steady = rows[rows[:, 0] >= rows[0, 0] + warm_up_s]
        if len(steady) < 3:
            steady = rows
        span_s = steady[-1, 0] - steady[0, 0]
        slope = np.polyfit(steady[:, 0] - steady[0, 0], steady[:, 2], 1)[0] * 3600
        print(f'| CPU | {100 * (steady[-1, 1] - steady[0, 1]) / span_s:.0f} % of one core |')
        print(f'| resident memory | {steady[0, 2]:.0f} MB after {warm_up_s:.0f} s, {steady[-1, 2]:.0f} MB after '
              f'{rows[-1, 0] - rows[0, 0]:.0f} s, most {rows[:, 2].max():.0f} MB |')
        print(f'| slope of memory after the first {warm_up_s:.0f} s | {slope:+.1f} MB/h |')


def play(messages, publishers, minutes, watch, at_seam):
    first_s = messages[0].t_s
    round_s = int(np.ceil(messages[-1].t_s - first_s))
    begin, sampled, rounds = time.time(), 0, 0
    while True:
        for message in messages:
            if rounds > 0 and message.topic == '/tf_static':
                continue
            due = begin + rounds * round_s + message.t_s - first_s
            time.sleep(max(0, due - time.time()))
            raw = publishers[message.topic].data_class()
            raw._buff = bytes(message.bytes)
            publishers[message.topic].publish(raw)
            message.move(round_s)
            if time.time() - sampled > 1:
                sampled = time.time()
                watch.sample()
            if time.time() - begin > 60 * minutes or rospy.is_shutdown():
                return rounds, round_s
        rounds += 1
        at_seam()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--bag', required=True)
    parser.add_argument('--config', required=True, nargs='+', help='yaml of the rig; later ones override earlier ones')
    parser.add_argument('--minutes', type=float, default=10)
    parser.add_argument('--warm-up', type=float, default=60, help='seconds that CPU and slope leave out')
    parser.add_argument('--reset', action='store_true', help='a new epoch with each round')
    parser.add_argument('--port', type=int, default=11399, help='of the master that is started')
    parser.add_argument('--set', default='', help='key=value overrides, separated by spaces')
    parser.add_argument('--prefix', default='', help="before the manager's command, such as 'nice -n -5'")
    arguments = parser.parse_args()
    os.environ.update(ROS_MASTER_URI=f'http://localhost:{arguments.port}', ROS_HOSTNAME='localhost')
    configs = [os.path.abspath(path) for path in arguments.config]

    processes = [subprocess.Popen(['roscore', '-p', str(arguments.port)], stdout=subprocess.DEVNULL)]
    try:
        wait_for('master', 30, rosgraph.is_master_online)
        package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
        processes.append(subprocess.Popen(
            ['roslaunch', '-p', str(arguments.port), f'{package}/launch/includes/devo.launch.xml',
             'config:=' + ','.join(configs), f'set:={arguments.set}', f'launch_prefix:={arguments.prefix}'],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        rospy.init_node('soak', disable_signals=True)
        master = rosgraph.Master('/soak')
        pid = wait_for('nodelet manager', 60, lambda: ServerProxy(master.lookupNode('/devo/manager')).getPid('/soak')[2])
        diagnostics = {}
        rospy.Subscriber('/diagnostics', DiagnosticArray,
                         lambda array: diagnostics.update({status.name: status for status in array.status}))
        messages, publishers = load(arguments.bag, topics_of(configs))
        events = max(publishers, key=lambda topic: sum(len(m.bytes) for m in messages if m.topic == topic))
        wait_for('subscription of the nodelets', 60, lambda: publishers[events].get_num_connections())
        watch = Watch(pid)
        reset = rospy.ServiceProxy('/devo/surface/reset', Trigger) if arguments.reset else lambda: None
        rounds, round_s = play(messages, publishers, arguments.minutes, watch, reset)
        time.sleep(1.5)  # the last diagnostics
        print(f'| {os.path.basename(arguments.bag)} | {rounds} rounds of {round_s} s |\n|---|---|')
        watch.report(arguments.warm_up)
        for task, keys in SHOWN:
            status = next((s for name, s in diagnostics.items() if name.endswith(': ' + task)), None)
            values = {pair.key: pair.value for pair in status.values} if status else {}
            for key in keys:
                print(f"| {task}: {key} | {values.get(key, '-')} |")
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


if __name__ == '__main__':
    main()
