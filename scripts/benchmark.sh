#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# Builds and runs the benchmarks and prints them as a table, the machine's memory limits beside them. The raw
# figures go to build/benchmark.json. Arguments are devo_benchmark's, as --benchmark_filter=AlignPoints.
set -euo pipefail
source_dir=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build_dir=${DEVO_BUILD_DIR:-$source_dir/build}
export DEVO_BUILD_DIR=$build_dir

"$source_dir/scripts/install_dependencies.sh"
"$source_dir/scripts/build.sh" -DCATKIN_ENABLE_TESTING=OFF
json=$build_dir/benchmark.json
"$build_dir/devel/lib/devo/devo_benchmark" --benchmark_min_time=0.5 --benchmark_out="$json" \
  --benchmark_out_format=json "$@" > /dev/null
/usr/bin/python3 "$source_dir/scripts/benchmark_table.py" "$json"
