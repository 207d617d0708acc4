#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# From a fresh machine to a trajectory: installs what is missing, builds, makes a sample recording with the package's
# simulator (a desk, DAVIS346 events, Azure Kinect depth beside it), replays it through the three nodelets in one
# manager, and compares the result with the ground truth. With a display, rviz shows it: demo.sh --rviz
set -euo pipefail
source_dir=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build_dir=${DEVO_BUILD_DIR:-$source_dir/build}
export DEVO_BUILD_DIR=$build_dir
out=$build_dir/demo
rviz=false
[ "${1:-}" != --rviz ] || rviz=true

"$source_dir/scripts/install_dependencies.sh"
"$source_dir/scripts/build.sh" -DCATKIN_ENABLE_TESTING=OFF
set +u
# shellcheck disable=SC1091
source "$build_dir/devel/setup.bash"
set -u
mkdir -p "$out"
rm -f "$out"/trajectory.txt "$out"/map.pcd "$out"/trajectory.png

sample=$out/sample
if [ ! -f "$sample.bag" ] || [ "$build_dir/devel/lib/devo/devo_simulate" -nt "$sample.bag" ]; then
  echo "simulating a sample recording"
  rosrun devo devo_simulate --out "$sample" --scene table --speed slow --sensor davis346 --depth kinect \
    --duration 8 --rest 0.3 --no-frames
fi

# A master of its own, so that one that already runs stays untouched.
port=$(/usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("localhost", 0)); print(s.getsockname()[1])')
export ROS_HOME=$out/ros_home ROS_MASTER_URI=http://localhost:$port ROS_HOSTNAME=localhost
echo "replaying it through the three nodelets (log: $out/replay.log)"
fail() {
  tail -n 30 "$out/replay.log" >&2
  echo "demo.sh: $*; the end of the log is above, all of it in $out/replay.log" >&2
  exit 1
}
roscore -p "$port" > "$out/roscore.log" 2>&1 < /dev/null &
processes=($!)
trap 'kill -INT "${processes[@]}" 2> /dev/null || true; wait 2> /dev/null || true' EXIT
wait_for() { # COMMAND...: until it succeeds
  for ((second = 0; second < 120; ++second)); do
    if "$@" > /dev/null 2>&1; then return; fi
    sleep 1
  done
  fail "gave up waiting: $*"
}
wait_for rosparam set /use_sim_time true
roslaunch --wait "$source_dir/launch/includes/devo.launch.xml" config:="$sample.yaml" \
  trajectory_file:="$out/trajectory.txt" map_file:="$out/map.pcd" > "$out/replay.log" 2>&1 < /dev/null &
processes+=($!)
if "$rviz"; then
  roslaunch --wait "$source_dir/launch/includes/rviz.launch.xml" ns:=devo > "$out/rviz.log" 2>&1 < /dev/null &
  processes+=($!)
fi
# Playing before everybody listens would lose the beginning.
for service in /devo/surface/reset /devo/mapping/save_map /devo/tracking/save_trajectory; do
  wait_for rosservice info "$service"
done
rosbag play --clock --hz 1000 --quiet --delay 1 "$sample.bag" >> "$out/replay.log" 2>&1 < /dev/null \
  || fail "the player failed"
rosservice call /devo/tracking/save_trajectory > "$out/services.log" 2>&1 || fail "save_trajectory failed"
rosservice call /devo/mapping/save_map >> "$out/services.log" 2>&1 || fail "save_map failed"
for file in trajectory.txt map.pcd; do
  [ -s "$out/$file" ] || fail "no $file was written ($(cat "$out/services.log"))"
done

"$source_dir/scripts/plot_trajectory.py" "$out/trajectory.txt" --groundtruth "${sample}_groundtruth.txt" \
  --map "$out/map.pcd" --out "$out/trajectory.png"
echo
rosrun devo devo_evaluate "${sample}_groundtruth.txt" "$out/trajectory.txt"
echo "trajectory           $out/trajectory.txt"
echo "map                  $out/map.pcd"
echo "plot                 $out/trajectory.png"
