#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""rosbag play that ends when the odometry has answered what was played, not before: replay.launch ends everything with it.

rosrun devo play_to_the_end.py --odometry /devo/status -- <arguments of rosbag play>"""

import argparse
import os
import subprocess
import sys
import time

import rospy

# Wall time. Without an answer for so long, none is to come.
QUIET_S = 1
LONGEST_S = 60


def wait_until_quiet(topic):
    last = time.time()

    def answered(_):
        nonlocal last
        last = time.time()

    subscriber = rospy.Subscriber(topic, rospy.AnyMsg, answered, queue_size=1)
    deadline = last + LONGEST_S
    while not rospy.is_shutdown() and time.time() < min(last + QUIET_S, deadline):
        time.sleep(0.02)
    subscriber.unregister()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--odometry", required=True, help="topic with a message for each time surface")
    parser.add_argument("--if-there", default="", metavar="BAGS", help="played, too, where they are there")
    parser.add_argument("play", nargs="+", help="arguments of rosbag play, after --")
    options = parser.parse_args(rospy.myargv()[1:])
    rospy.init_node("play_to_the_end")
    bags = options.if_there.split()
    for bag in bags:
        if not os.path.exists(bag):
            rospy.logwarn("%s is not there: the run goes on without what it would hold", bag)
    there = [bag for bag in bags if os.path.exists(bag)]
    result = subprocess.call(["rosrun", "rosbag", "play"] + options.play + there + ["__name:=play"])
    if result == 0:
        wait_until_quiet(options.odometry)
    return result


if __name__ == "__main__":
    sys.exit(main())
