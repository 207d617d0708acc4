#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""rviz, under a virtual display, shows a replay: the pixels of trajectory and cloud are on the screen."""

import os
import shutil
import subprocess
import tempfile
import time
import unittest

import matplotlib.image
import numpy
import rospy
import rostest

# As config/devo.rviz colours them, in RGB.
TRAJECTORY, LOCAL_MAP = (60, 220, 120), (255, 170, 40)
DISPLAY = ["xvfb-run", "-a", "-s", "-screen 0 1500x900x24"]
# Played slowly, as rendering in software leaves little of two cores for tracking, and once: what it leaves on the screen
# stays there until rviz has drawn it. Where other programs leave nothing at all, it is tried again.
LAUNCH = """
cd %s
for attempt in 1 2 3; do
  [ -e enough ] && break
  roslaunch devo replay.launch bag:=%s config:=%s rate:=0.5 exit_at_end:=false delay:=8 save_at_shutdown:=false & launch=$!
  for i in $(seq 1 45); do
    sleep 1; import -window root PNG24:new.png && mv new.png screen.png; [ -e enough ] && break
  done
  kill -INT $launch; wait $launch
done
"""


def count_pixels(path, colour):
    """Pixels of the colour, to within the anti-aliasing of thin lines, right of the panels."""
    picture = 255 * matplotlib.image.imread(path)[:, 420:, :3]
    return int(numpy.all(numpy.abs(picture - numpy.array(colour)) < 25, axis=2).sum())


@unittest.skipUnless(all(shutil.which(tool) for tool in ("xvfb-run", "import", "rviz")),
                     "xvfb-run, imagemagick or rviz is not installed")
class RvizTest(unittest.TestCase):
    def test_a_replay_shows_trajectory_and_cloud(self):
        rospy.init_node("rviz_test")
        folder = tempfile.mkdtemp(prefix="devo_rviz_")
        screen = os.path.join(folder, "screen.png")
        script = LAUNCH % (folder, rospy.get_param("~bag"), rospy.get_param("~config"))
        environment = dict(os.environ, LIBGL_ALWAYS_SOFTWARE="1", QT_X11_NO_MITSHM="1")
        running = subprocess.Popen(DISPLAY + ["bash", "-c", script], env=environment)
        best = (0, 0)
        while running.poll() is None:
            time.sleep(1)
            if not os.path.exists(screen):
                continue
            seen = (count_pixels(screen, TRAJECTORY), count_pixels(screen, LOCAL_MAP))
            best = max(best, seen, key=lambda n: min(n))
            if min(best) > 50:
                open(os.path.join(folder, "enough"), "w").close()
                break
        running.wait()
        print("%d pixels of the trajectory and %d of the cloud in %s" % (best[0], best[1], screen))
        self.assertGreater(best[0], 50)
        self.assertGreater(best[1], 50)
        shutil.rmtree(folder)  # where it fails, what was on the screen is kept


if __name__ == "__main__":
    rostest.rosrun("devo", "rviz", RvizTest)
