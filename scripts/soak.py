#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs the three nodelets for minutes on a recording that is played there and back again in real time, and prints what
they cost: CPU, latency (percentiles of 20 s each: their median and the worst), memory and the slope of a line through it
after the first minutes.

    source devel/setup.bash
    scripts/soak.py --bag rec.bag --config config/simulated.yaml rec.yaml --minutes 10

On the way back the order of the events is reversed and their polarity changed, which is what a camera sees that returns
on its way: data time and motion go on without a seam for as long as one likes. The recording's events must be
EventArrays; IMU and ground truth are left out. Starts a master of its own (--port).
"""
import argparse
import math
import os
import subprocess
import sys
import time

import numpy as np
import rosbag
import rosgraph
import rospkg
import rospy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from xmlrpc.client import ServerProxy

from raw_message import Message

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
    return {topic for role, topic in topics.items() if topic and role not in ('ground_truth', 'imu')} | {'/tf_static'}


def raw_type(datatype, md5, definition):
    return type('Raw', (rospy.AnyMsg,), {'_type': datatype, '_md5sum': md5, '_full_text': definition})


def load(path, topics):
    messages, publishers = [], {}
    with rosbag.Bag(path) as bag:
        for topic, (datatype, data, md5, _, pytype), t in bag.read_messages(topics=topics, raw=True):
            if datatype.endswith('/EventPacket'):
                sys.exit(f"topic '{topic}' has type {datatype}, expected EventArray")
            messages.append(Message(t.to_nsec(), topic, datatype, data))
            publishers.setdefault(topic, (raw_type(datatype, md5, pytype._full_text), topic == '/tf_static'))
    if not messages:
        sys.exit(f"'{path}' holds none of the topics {sorted(topics)}")
    turn_ns = messages[-1].t_ns
    messages += [message.mirrored(turn_ns) for message in reversed(messages) if message.topic != '/tf_static']
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

        def slope(part):
            return np.polyfit(part[:, 0] - part[0, 0], part[:, 2], 1)[0] * 3600

        print(f'| CPU | {100 * (steady[-1, 1] - steady[0, 1]) / span_s:.0f} % of one core |')
        print(f'| resident memory | {steady[0, 2]:.0f} MB after {warm_up_s:.0f} s, {steady[-1, 2]:.0f} MB after '
              f'{rows[-1, 0] - rows[0, 0]:.0f} s, most {rows[:, 2].max():.0f} MB |')
        minutes = np.arange(rows[0, 0], rows[-1, 0], 60)
        per_minute = [rows[np.searchsorted(rows[:, 0], t), 2] for t in minutes]
        print(f"| resident MB, minute by minute | {' '.join(f'{mb:.0f}' for mb in per_minute)} |")
        print(f'| slope of memory after the first {rows[-1, 0] - rows[0, 0] - span_s:.0f} s | {slope(steady):+.1f} MB/h, '
              f'of its second half {slope(steady[len(steady) // 2:]):+.1f} MB/h |')


class Health:
    """What the diagnostics said. Their percentiles are of the last WINDOW_S seconds."""

    WINDOW_S = 20

    def __init__(self):
        self.history = {}  # task: [(time, {key: value})]
        rospy.Subscriber('/diagnostics', DiagnosticArray, self.take)

    def take(self, array):
        for status in array.status:
            task = status.name.rsplit(': ', 1)[-1]
            self.history.setdefault(task, []).append((time.time(), {pair.key: pair.value for pair in status.values}))

    def report(self, warm_up_s):
        for task, keys in SHOWN:
            history = self.history.get(task) or [(0, {})]
            windows = history[::-self.WINDOW_S]  # one message per second: apart from each other
            steady = [w for t, w in windows if t >= history[0][0] + warm_up_s] or [windows[0][1]]
            for key in keys:
                text = windows[0][1].get(key, '-')
                if key.endswith(('(ms)', '(Mev/s)')) and text != '-':
                    values = [float(w[key]) for w in steady]
                    text = f'{np.median(values):.2f}, most in {self.WINDOW_S} s {max(values):.2f}'
                print(f'| {task}: {key} | {text} |')


def play(messages, publishers, minutes, watch):
    first_ns = messages[0].t_ns
    round_s = math.ceil(1e-9 * (messages[-1].t_ns - first_ns) + 0.01)  # the camera rests where it began
    begin, sampled, rounds = time.time(), 0, 0
    while True:
        for message in messages:
            if rounds > 0 and message.topic == '/tf_static':
                continue
            due = begin + rounds * round_s + 1e-9 * (message.t_ns - first_ns)
            time.sleep(max(0, due - time.time()))
            raw = publishers[message.topic].data_class()
            raw._buff = bytes(message.bytes)
            publishers[message.topic].publish(raw)
            message.move(round_s)
            if time.time() - sampled > 1:
                sampled = time.time()
                watch.sample()
            if time.time() - begin > 60 * minutes or rospy.is_shutdown():
                return (time.time() - begin) / round_s, round_s
        rounds += 1


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--bag', required=True)
    parser.add_argument('--config', required=True, nargs='+', help='yaml of the rig; later ones override earlier ones')
    parser.add_argument('--minutes', type=float, default=10)
    parser.add_argument('--warm-up', type=float, default=120,
                        help='seconds that CPU, slope and percentiles leave out')
    parser.add_argument('--port', type=int, default=11399, help='of the master that is started')
    parser.add_argument('--set', default='', help='key=value overrides, separated by spaces')
    parser.add_argument('--prefix', default='', help="before the manager's command, such as 'nice -n -5'")
    arguments = parser.parse_args()
    try:
        rospkg.RosPack().get_path('devo')
    except rospkg.ResourceNotFound:
        sys.exit('package devo is not in ROS_PACKAGE_PATH, where nodelets are sought: source devel/setup.bash first')
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
        health = Health()
        messages, publishers = load(arguments.bag, topics_of(configs))
        events = max(publishers, key=lambda topic: sum(len(m.bytes) for m in messages if m.topic == topic))
        wait_for('subscription of the nodelets', 60, lambda: publishers[events].get_num_connections())
        watch = Watch(pid)
        rounds, round_s = play(messages, publishers, arguments.minutes, watch)
        time.sleep(1.5)  # the last diagnostics
        print(f'| {os.path.basename(arguments.bag)} | {rounds:.1f} rounds of {round_s} s there and back |\n|---|---|')
        watch.report(arguments.warm_up)
        health.report(arguments.warm_up)
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


if __name__ == '__main__':
    main()
