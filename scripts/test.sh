#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# Installs what is missing, builds, and runs every unit test and rostest. The last line of the output is
# `N passed, N failed`; the exit status is not zero when a test failed or did not run.
set -euo pipefail
source_dir=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build_dir=${DEVO_BUILD_DIR:-$source_dir/build}
export DEVO_BUILD_DIR=$build_dir

"$source_dir/scripts/install_dependencies.sh"
"$source_dir/scripts/build.sh"

# Results of an earlier run would be counted again.
rm -rf "$build_dir/test_results"
set +u
# shellcheck disable=SC1091
source "$build_dir/devel/setup.bash"
set -u
export ROS_HOME=$build_dir/ros_home
# No network name of this machine may be needed to reach a master on it.
export ROS_HOSTNAME=localhost
unset ROS_IP

# run_tests is sequential and goes on after a failure; what failed is read from the results.
cmake --build "$build_dir" --target run_tests -- -j1 || true
/usr/bin/python3 "$source_dir/scripts/test_summary.py" "$build_dir/test_results"
