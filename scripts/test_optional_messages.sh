#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# With the message packages of event cameras' drivers in the workspace, a driver's nodelet shares its messages with the
# odometry: makes stand-ins of the three packages (names and fields as published, hence the same md5), builds against
# them in a build folder of its own, and runs the test that compares the objects. Some minutes; not part of test.sh.
set -euo pipefail
source_dir=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build_dir=${DEVO_BUILD_DIR:-$source_dir/build}_optional_messages
standins=$build_dir/standins
prefix=$build_dir/prefix
mkdir -p "$standins"

make_package() { # NAME; messages are in its msg/ already
  cat > "$standins/$1/package.xml" << XML
<package format="2">
  <name>$1</name>
  <version>0.0.0</version>
  <description>Stand-in for tests.</description>
  <maintainer email="nobody@example.org">nobody</maintainer>
  <license>none</license>
  <buildtool_depend>catkin</buildtool_depend>
  <depend>std_msgs</depend>
  <build_depend>message_generation</build_depend>
  <exec_depend>message_runtime</exec_depend>
</package>
XML
  cat > "$standins/$1/CMakeLists.txt" << CMAKE
cmake_minimum_required(VERSION 3.16)
project($1)
find_package(catkin REQUIRED COMPONENTS message_generation std_msgs)
add_message_files(DIRECTORY msg)
generate_messages(DEPENDENCIES std_msgs)
catkin_package(CATKIN_DEPENDS message_runtime std_msgs)
CMAKE
  if ! {
    cmake -S "$standins/$1" -B "$standins/$1/build" -DCMAKE_INSTALL_PREFIX="$prefix" \
      -DPYTHON_EXECUTABLE=/usr/bin/python3 \
      && cmake --build "$standins/$1/build" --target install
  } > "$standins/$1.log" 2>&1; then
    cat "$standins/$1.log" >&2
    exit 1
  fi
}

# The fields are those of this package's messages; only the name of the element differs.
for package in dvs_msgs prophesee_event_msgs; do
  mkdir -p "$standins/$package/msg"
  cp "$source_dir/msg/RawEvent.msg" "$standins/$package/msg/Event.msg"
  sed 's/RawEvent/Event/' "$source_dir/msg/EventArray.msg" > "$standins/$package/msg/EventArray.msg"
  make_package "$package"
done
mkdir -p "$standins/event_camera_msgs/msg"
cp "$source_dir/msg/EventPacket.msg" "$standins/event_camera_msgs/msg/"
make_package event_camera_msgs

export CMAKE_PREFIX_PATH=$prefix${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}
DEVO_BUILD_DIR=$build_dir "$source_dir/scripts/build.sh" --only zero_copy_test
set +u
# shellcheck disable=SC1091
source "$build_dir/devel/setup.bash"
set -u
export ROS_HOSTNAME=localhost ROS_HOME=$build_dir/ros_home
rostest devo zero_copy.test
/usr/bin/python3 "$source_dir/scripts/test_summary.py" "$ROS_HOME/test_results"
