#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""The package installed from this build, used with nothing else in the environment: found, linked with itself, launched."""

import glob
import os
import shutil
import socket
import subprocess
import tempfile
import unittest

import rospy
import rostest


def cached(build, variable):
    with open(os.path.join(build, "CMakeCache.txt")) as cache:
        for line in cache:
            if line.startswith(variable + ":"):
                return line.strip().split("=", 1)[1]
    return ""


def free_port():
    with socket.socket() as s:
        s.bind(("localhost", 0))
        return s.getsockname()[1]


class InstallTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("install_test")
        cls.build, cls.bag, cls.config = (rospy.get_param("~" + key) for key in ("build", "bag", "config"))
        cls.folder = tempfile.mkdtemp(prefix="devo_install_")
        # Below a folder of the test's own, wherever the build is to be installed: setup.bash finds itself.
        cls.prefix = cls.folder + cached(cls.build, "CMAKE_INSTALL_PREFIX")
        subprocess.check_output(["cmake", "--install", cls.build], stderr=subprocess.STDOUT,
                                env=dict(os.environ, DESTDIR=cls.folder))

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder, ignore_errors=True)

    def installed(self, command, timeout=60):
        """Output of a command in the install space, without anything of this environment."""
        port = free_port()
        environment = {"HOME": self.folder, "PATH": "/usr/bin:/bin", "ROS_HOSTNAME": "localhost", "LANG": "C.UTF-8",
                       "ROS_MASTER_URI": "http://localhost:%d" % port, "ROS_HOME": self.folder}
        script = "source %s/setup.bash && %s" % (self.prefix, command.replace("PORT", str(port)))
        result = subprocess.run(["bash", "-c", script], env=environment, stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT, universal_newlines=True, timeout=timeout)
        self.assertEqual(result.returncode, 0, result.stdout)
        return result.stdout

    def test_the_package_is_found_where_it_is_installed(self):
        self.assertEqual(self.installed("rospack find devo").strip(), self.prefix + "/share/devo")
        self.assertIn(self.prefix + "/share/devo/nodelets.xml", self.installed("rospack plugins --attrib=plugin nodelet"))

    def test_programs_and_nodelets_are_linked_with_installed_libraries_only(self):
        for binary in [self.prefix + "/lib/libdevo_nodelets.so"] + glob.glob(self.prefix + "/lib/devo/devo_*"):
            lines = [line for line in self.installed("ldd " + binary).splitlines() if "libdevo_" in line]
            self.assertTrue(lines, binary)
            self.assertTrue(all("=> %s/lib/" % self.prefix in line for line in lines), lines)

    def test_every_launch_file_finds_its_files(self):
        arguments = "config:=%s bag:=/a.bag sequence:=indoor_flying1 dir:=/tmp drivers:=false rviz:=true"
        for path in glob.glob(self.prefix + "/share/devo/launch/*.launch"):
            nodes = self.installed("roslaunch --nodes devo %s %s" % (os.path.basename(path), arguments % self.config))
            self.assertIn("/devo/surface", nodes)
            self.assertIn("/devo/rviz", nodes)

    def test_a_replay_runs_and_its_trajectory_can_be_plotted(self):
        trajectory = os.path.join(self.folder, "trajectory.txt")
        output = self.installed("roslaunch -p PORT devo replay.launch rviz:=false bag:=%s config:=%s trajectory_file:=%s"
                                % (self.bag, self.config, trajectory))
        with open(trajectory) as lines:
            self.assertGreater(sum(1 for _ in lines), 60, output)
        self.installed("rosrun devo plot_trajectory.py %s --out %s/plot.png" % (trajectory, self.folder))
        self.assertGreater(os.path.getsize(self.folder + "/plot.png"), 1000)


if __name__ == "__main__":
    rostest.rosrun("devo", "install", InstallTest)
