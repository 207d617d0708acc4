#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# Installs what DEVO needs to build, test and run, from apt only. Skips at once when all of it is there.
#   install_dependencies.sh [--lint]     --lint: also what scripts/lint.sh needs
set -euo pipefail

# The same on Debian and Ubuntu: compiler, libraries, plots, and a display for the test that opens rviz.
common=(
  build-essential ca-certificates cmake
  libbenchmark-dev libboost-program-options-dev libceres-dev libeigen3-dev libgmock-dev libgtest-dev
  liblz4-dev libopencv-contrib-dev libopencv-dev libyaml-cpp-dev nlohmann-json3-dev
  python3-matplotlib python3-numpy python3-yaml
  imagemagick libgl1-mesa-dri xauth xvfb)
lint=(clang-format clang-tidy shellcheck)

# Debian 12 and 11 carry ROS 1 (Noetic level) in their own archives, under /usr.
debian=(
  catkin
  libactionlib-msgs-dev libclass-loader-dev libcv-bridge-dev libdiagnostic-msgs-dev libdiagnostic-updater-dev
  libdynamic-reconfigure-config-init-mutex-dev libgeometry-msgs-dev libimage-transport-dev libnav-msgs-dev
  libnodelet-dev libnodelet-topic-tools-dev libnodeletlib-dev libnodeletlib-tools librosbag-dev
  librosbag-storage-dev libroscpp-dev librostest-dev libsensor-msgs-dev libstd-msgs-dev libstd-srvs-dev
  libtf2-dev libtf2-msgs-dev libtf2-ros-dev libtopic-tools-dev libvisualization-msgs-dev pluginlib-dev
  python3-diagnostic-msgs python3-dynamic-reconfigure python3-geometry-msgs python3-nav-msgs python3-rosbag
  python3-roslaunch python3-rosnode python3-rosparam python3-rospy python3-rosservice python3-rostest
  python3-rostopic python3-sensor-msgs python3-std-msgs python3-std-srvs python3-tf2-msgs python3-tf2-ros
  ros-diagnostic-msgs ros-environment ros-geometry-msgs ros-message-generation ros-message-runtime ros-nav-msgs
  ros-rosgraph-msgs ros-sensor-msgs ros-std-msgs ros-std-srvs ros-tf2-msgs rosbash rosout rospack-tools rviz tf2-tools)
debian_lint=(catkin-lint)

# Ubuntu 20.04 has it under /opt/ros/noetic, from the archive of ROS, which has to be known to apt.
ubuntu=(
  ros-noetic-catkin ros-noetic-cv-bridge ros-noetic-diagnostic-msgs ros-noetic-diagnostic-updater
  ros-noetic-dynamic-reconfigure ros-noetic-geometry-msgs ros-noetic-image-transport
  ros-noetic-message-generation ros-noetic-message-runtime ros-noetic-nav-msgs ros-noetic-nodelet
  ros-noetic-nodelet-topic-tools ros-noetic-pluginlib ros-noetic-rosbag ros-noetic-rosbag-storage
  ros-noetic-rosbash ros-noetic-roscpp ros-noetic-roslaunch ros-noetic-rosnode ros-noetic-rosparam
  ros-noetic-rospack ros-noetic-rospy ros-noetic-rosservice ros-noetic-rostest ros-noetic-rostopic
  ros-noetic-rviz ros-noetic-sensor-msgs ros-noetic-std-msgs ros-noetic-std-srvs ros-noetic-tf2
  ros-noetic-tf2-msgs ros-noetic-tf2-ros ros-noetic-topic-tools ros-noetic-visualization-msgs)
ubuntu_lint=(python3-catkin-lint)

die() {
  echo "install_dependencies.sh: $*" >&2
  exit 1
}

as_root() {
  if [ "$(id -u)" -eq 0 ]; then
    "$@"
  elif command -v sudo > /dev/null; then
    sudo "$@"
  else
    die "packages are missing: run as root, or install sudo (missing: ${missing[*]})"
  fi
}

find_missing() {
  missing=()
  local package
  for package in "$@"; do
    # Written by dpkg for every installed package; a virtual package shows up through its provider.
    dpkg-query --show --showformat='${db:Status-Status}\n' "$package" 2> /dev/null | grep -qx installed \
      || missing+=("$package")
  done
}

if ! command -v apt-get > /dev/null || ! command -v dpkg-query > /dev/null; then
  die "no apt-get here; only Debian 12, Debian 11 and Ubuntu 20.04 (or their derivatives) are supported"
fi

packages=("${common[@]}")
if [ -d /opt/ros/noetic ] || grep -qiE '^(ID|ID_LIKE)=.*ubuntu' /etc/os-release; then
  packages+=("${ubuntu[@]}")
  lint+=("${ubuntu_lint[@]}")
else
  packages+=("${debian[@]}")
  lint+=("${debian_lint[@]}")
fi
[ "${1:-}" != --lint ] || packages+=("${lint[@]}")

find_missing "${packages[@]}"
if [ "${#missing[@]}" -eq 0 ]; then
  echo "dependencies: all ${#packages[@]} packages are installed"
  exit 0
fi

echo "dependencies: installing ${#missing[@]} of ${#packages[@]} packages (some minutes on a fresh machine): ${missing[*]}"
as_root apt-get update -qq || echo "install_dependencies.sh: apt-get update failed; trying with the lists at hand" >&2
for package in "${missing[@]}"; do
  # Named here, because apt stops at the first unknown name and says nothing of the others.
  [ -n "$(apt-cache --names-only search "^${package}\$")" ] || unknown+=("$package")
done
[ -z "${unknown[*]:-}" ] || die "apt does not know: ${unknown[*]}
expected Debian 12 or 11 (ROS 1 in its own archive) or Ubuntu 20.04 with the archive of ROS noetic added to apt"
log=$(mktemp)
if ! as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" \
  < /dev/null > "$log" 2>&1; then
  cat "$log" >&2
  die "apt-get could not install: ${missing[*]}"
fi
rm -f "$log"
