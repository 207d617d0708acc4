# SPDX-License-Identifier: BSD-3-Clause
"""What the rostests share: the package's programs, trajectories, and a record of what the nodelets publish."""

import json
import os
import subprocess
import threading

import roslib.packages
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from devo.msg import Status


def program(name):
    found = roslib.packages.find_node("devo", name)
    assert found, "%s is not built" % name
    return found[0]


def documented_options():
    """Key to (min, max, default, meaning) of every numeric option, as devo_offline documents them."""
    table = subprocess.check_output([program("devo_offline"), "--print-parameters"], universal_newlines=True)
    options = {}
    for line in table.splitlines():
        cells = [cell.strip().strip("`") for cell in line.strip("|").split("|")]
        if len(cells) == 4 and " to " in cells[2]:
            low, high = cells[2].split(" to ")
            options[cells[0]] = (float(low), float(high), float(cells[1]), cells[3])
    return options


def run_offline(config, bag, out, overrides=()):
    """Trajectory file of the offline runner on the same bag."""
    command = [program("devo_offline"), "--config", config, "--bag", bag, "--out", out]
    for override in overrides:
        command += ["--set", override]
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
    assert result.returncode == 0, result.stdout
    return os.path.join(out, "trajectory.txt")


def evaluate(groundtruth, trajectory):
    """The figures of devo_evaluate."""
    output = subprocess.check_output([program("devo_evaluate"), "--json", "-", groundtruth, trajectory])
    return json.loads(output)


def stamps_of(trajectory):
    """Of a TUM file, s."""
    with open(trajectory) as lines:
        return [float(line.split()[0]) for line in lines if not line.startswith("#")]


def write_tum(path, odometries):
    with open(path, "w") as out:
        for odometry in odometries:
            p, q = odometry.pose.pose.position, odometry.pose.pose.orientation
            stamp = odometry.header.stamp
            out.write("%d.%09d %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n" %
                      (stamp.secs, stamp.nsecs, p.x, p.y, p.z, q.x, q.y, q.z, q.w))
    return path


class Record:
    """Everything that the nodelets in namespace /devo say from now on."""

    def __init__(self):
        self.lock = threading.Lock()
        self.odometry, self.status, self.transforms, self.diagnostics = [], [], [], {}
        self.subscribers = [
            rospy.Subscriber("/devo/odometry", Odometry, self._append, self.odometry, queue_size=None),
            rospy.Subscriber("/devo/status", Status, self._append, self.status, queue_size=None),
            rospy.Subscriber("/tf", TFMessage, self._on_tf, queue_size=None),
            rospy.Subscriber("/diagnostics", DiagnosticArray, self._on_diagnostics, queue_size=None),
        ]

    def close(self):
        """No more of what they say is kept."""
        for subscriber in self.subscribers:
            subscriber.unregister()

    def _append(self, message, to):
        with self.lock:
            to.append(message)

    def _on_tf(self, message):
        with self.lock:
            self.transforms += message.transforms

    def _on_diagnostics(self, message):
        with self.lock:
            for status in message.status:
                self.diagnostics.setdefault(status.name, []).append(status)

    def epoch(self):
        with self.lock:
            return self.status[-1].epoch if self.status else -1

    def odometry_of_epoch(self, epoch):
        """Odometry messages in order; time goes back once per epoch."""
        runs = [[]]
        with self.lock:
            for message in self.odometry:
                if runs[-1] and message.header.stamp < runs[-1][-1].header.stamp:
                    runs.append([])
                runs[-1].append(message)
        return runs[epoch] if epoch < len(runs) else []

    def diagnostics_named(self, end_of_name):
        """Key to value of each status whose name ends so, and its level and message; oldest first."""
        with self.lock:
            for name, statuses in self.diagnostics.items():
                if name.endswith(end_of_name):
                    return [dict({pair.key: pair.value for pair in status.values}, level=status.level,
                                 message=status.message) for status in statuses]
        raise AssertionError("no diagnostics of '%s'; there are %s" % (end_of_name, sorted(self.diagnostics)))

    def diagnostic(self, end_of_name):
        """The latest of them."""
        return self.diagnostics_named(end_of_name)[-1]
