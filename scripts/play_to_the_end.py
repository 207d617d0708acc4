#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""rosbag play that ends when the odometry has answered what was played, not before: replay.launch ends everything with it.

rosrun devo play_to_the_end.py --odometry /devo/status -- <arguments of rosbag play>"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time

import rosbag
import rospy
import std_msgs.msg

# Wall time. Without an answer for so long, none is to come.
QUIET_S = 1
LONGEST_S = 60
POLL_S = 0.02

# Messages that follow the last one: that all before it are published, and one at which the player pauses.
END_TOPIC = "/play_to_the_end/end"
PAUSE_TOPIC = "/play_to_the_end/pause"


class LastHeard:
    """When a message last came, wall time; 0 before the first."""

    def __init__(self, topic):
        self.time = 0
        self.subscriber = rospy.Subscriber(topic, rospy.AnyMsg, self.on_message, queue_size=1)

    def on_message(self, _):
        self.time = time.time()


def wait_until_quiet(answers):
    begin = time.time()
    while not rospy.is_shutdown():
        now = time.time()
        if now > max(answers.time, begin) + QUIET_S or now > begin + LONGEST_S:
            return
        time.sleep(POLL_S)


def write_end(bags, path):
    """A bag that follows the others; false where the player will say what is wrong with them."""
    try:
        ends = []
        for bag in bags:
            with rosbag.Bag(bag, skip_index=True) as opened:
                ends.append(opened.get_end_time())
    except (rosbag.ROSBagException, OSError):
        return False
    if not ends:
        return False
    # Latched: this node may be late to subscribe.
    header = {"topic": END_TOPIC, "latching": "1", "callerid": rospy.get_name(), "type": std_msgs.msg.Bool._type,
              "md5sum": std_msgs.msg.Bool._md5sum, "message_definition": std_msgs.msg.Bool._full_text}
    after = rospy.Time.from_sec(max(ends) + 1e-3)
    with rosbag.Bag(path, "w") as bag:
        bag.write(END_TOPIC, std_msgs.msg.Bool(), after, connection_header=header)
        bag.write(PAUSE_TOPIC, std_msgs.msg.Bool(), after + rospy.Duration(1e-3))
    return True


def play(arguments, answers):
    """rosbag play's exit status. One that ends by itself takes along what it has not sent yet: it is kept until the
    odometry has answered."""
    with tempfile.TemporaryDirectory(prefix="devo_play_") as folder:
        command = ["rosrun", "rosbag", "play"] + arguments
        end = os.path.join(folder, "end.bag")
        if "--loop" not in arguments and write_end([word for word in arguments if word.endswith(".bag")], end):
            command += [end, "--pause-topics", PAUSE_TOPIC]
        published = LastHeard(END_TOPIC)
        player = subprocess.Popen(command + ["__name:=play"])
        while player.poll() is None and not published.time and not rospy.is_shutdown():
            time.sleep(POLL_S)
        if player.poll() is None or player.returncode == 0:
            wait_until_quiet(answers)
        if player.poll() is not None:
            return player.returncode
        player.send_signal(signal.SIGINT)
        player.wait()
        return 0


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
    arguments = options.play + [bag for bag in bags if os.path.exists(bag)]
    return play(arguments, LastHeard(options.odometry))


if __name__ == "__main__":
    sys.exit(main())
