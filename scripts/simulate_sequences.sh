#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
#   scripts/simulate_sequences.sh DIR
#
# Simulates the sequences of docs/results.md into DIR (about 10 GB, an hour on two cores; what is there is kept) and
# writes DIR/simulated.txt, the table of recordings for scripts/evaluate_recordings.py.
set -euo pipefail
[ $# -eq 1 ] || { echo "usage: $0 DIR" >&2; exit 2; }
source_dir=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
simulate=${DEVO_SIMULATE:-$source_dir/devel/lib/devo/devo_simulate}
[ -x "$simulate" ] || { echo "$simulate: not there, expected the built simulator (scripts/build.sh)" >&2; exit 2; }
mkdir -p "$1"
cd "$1"
: > simulated.txt

sequence() {  # name, arguments of devo_simulate
  local name=sim_$1
  shift
  [ -e "$name.bag" ] || "$simulate" --out "$name" --quiet "$@"
  echo "$name $PWD/$name.yaml $name.bag" >> simulated.txt
}

for scene in cali table sofa; do
  sequence "${scene}_slow_bright" --scene $scene --speed slow --seed 2 --duration 5
  sequence "${scene}_mid_bright" --scene $scene --speed mid --seed 1 --duration 5
  sequence "${scene}_fast_bright" --scene $scene --speed fast --seed 3 --duration 5
done
for light in darkish dim dark hdr; do
  sequence "table_mid_$light" --scene table --speed mid --seed 1 --light $light --duration 5
done
sequence sofa_mid_dark --scene sofa --speed mid --seed 1 --light dark --duration 5
sequence sofa_fast_darkish --scene sofa --speed fast --seed 7 --light darkish --duration 5 --no-frames
sequence cali_fast_dark --scene cali --speed fast --seed 8 --light dark --duration 5 --no-frames
sequence cali_slow_dim --scene cali --speed slow --seed 9 --light dim --duration 5 --no-frames
sequence table_stop_bright --scene table --speed mid --seed 5 --stop 2 2 --duration 6
sequence table_mid_davis346 --scene table --speed mid --seed 1 --sensor davis346 --duration 5
sequence table_slow_davis346 --scene table --speed slow --seed 1 --sensor davis346 --no-frames --duration 5
sequence table_slow_davis240 --scene table --speed slow --seed 3 --sensor davis240 --depth-rate 15 --no-frames --duration 4
sequence sofa_mid_davis240 --scene sofa --speed mid --seed 5 --sensor davis240 --no-frames --duration 4
# Hardly an edge and hardly an event; abrupt stops.
sequence sofa_slow_davis346 --scene sofa --speed slow --seed 26 --sensor davis346 --no-frames --duration 5
sequence sofa_slow_davis240 --scene sofa --speed slow --seed 33 --sensor davis240 --no-frames --duration 4
sequence table_faststop_davis346 --scene table --speed fast --seed 34 --stop 2 1 --stop 5 1 --sensor davis346 --no-frames --duration 8
for motion in walk turn; do
  [ -e "$motion.txt" ] || "$source_dir/scripts/make_trajectory.py" "$motion" "$motion.txt"
done
sequence hall_walk_davis346 --scene hall --trajectory walk.txt --sensor davis346 --no-frames
sequence table_turn_davis346 --scene table --trajectory turn.txt --sensor davis346 --no-frames
