#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# Builds everything, tests included (not with -DCATKIN_ENABLE_TESTING=OFF), in build/ (DEVO_BUILD_DIR overrides).
#   build.sh [--only TARGET] [-DNAME=value...]     what follows is cmake's
# Afterwards `source devel/setup.bash` makes the package known to roslaunch and rosrun.
set -euo pipefail
source_dir=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build_dir=${DEVO_BUILD_DIR:-$source_dir/build}

only=
if [ "${1:-}" = --only ]; then
  only=$2
  shift 2
fi

# Debian's own ROS lives under /usr and needs no setup; that of packages.ros.org does.
if [ -f /opt/ros/noetic/setup.bash ]; then
  set +u
  # shellcheck disable=SC1091
  source /opt/ros/noetic/setup.bash
  set -u
fi

arguments=(-DCMAKE_BUILD_TYPE=Release -DCATKIN_ENABLE_TESTING=ON)
# ROS's Python is the system's; another python3 may come first on PATH.
arguments+=(-DPYTHON_EXECUTABLE=/usr/bin/python3)
if [ ! -f "$build_dir/CMakeCache.txt" ] && command -v ninja > /dev/null; then arguments+=(-G Ninja); fi
if command -v ccache > /dev/null; then arguments+=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache); fi

# A compiler process of this package takes up to 1.5 GB.
jobs=$(awk -v cores="$(nproc)" '/^MemTotal/ {j = int($2 / 1500000); print (j < 1) ? 1 : (j < cores ? j : cores)}' /proc/meminfo)

log=$build_dir/configure.log
mkdir -p "$build_dir"
# rosrun does not look below a package's own build/, so what it runs is put beside it.
if [ "$build_dir" = "$source_dir/build" ]; then
  arguments+=(-DCATKIN_DEVEL_PREFIX="$source_dir/devel")
  [ -L "$build_dir/devel" ] || rm -rf "$build_dir/devel"
  ln -sfn ../devel "$build_dir/devel"
fi
if ! cmake -S "$source_dir" -B "$build_dir" "${arguments[@]}" "$@" > "$log" 2>&1; then
  cat "$log" >&2
  echo "build.sh: cmake could not configure (full output above, and in $log)" >&2
  exit 1
fi
echo "building in $build_dir, $jobs at a time"
if [ -n "$only" ]; then
  cmake --build "$build_dir" -j "$jobs" --target "$only"
  exit
fi
cmake --build "$build_dir" -j "$jobs"
# Tests are not part of `all` with catkin.
if grep -q '^CATKIN_ENABLE_TESTING:.*=ON' "$build_dir/CMakeCache.txt"; then
  cmake --build "$build_dir" -j "$jobs" --target tests
fi
