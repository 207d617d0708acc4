#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
#   scripts/unpack_noisier.sh SHARED_DATA DIR
#
# Unpacks the simulated recordings of SHARED_DATA (which holds recording.py and esim/*.rec) with ten kinds of noise into
# DIR (5 GB, 4 min on two cores; what is there is kept) and writes DIR/noisier.txt, the table of recordings for
# scripts/evaluate_recordings.py. k30_n10: 30 % of the events are kept, 10 Hz per pixel are added.
set -euo pipefail
[ $# -eq 2 ] || { echo "usage: $0 SHARED_DATA DIR" >&2; exit 2; }
shared=$1 folder=$2 unpack=$1/recording.py
[ -f "$unpack" ] || { echo "$unpack: not there, expected the script that unpacks recordings" >&2; exit 2; }
mkdir -p "$folder"
: > "$folder/noisier.txt"

unpack_kind() {  # kind, share of events kept, latency (us), noise (Hz per pixel), share of hot pixels, seed
  local name configuration bag
  for name in desk_slow desk_stop room_davis; do
    configuration=config/esim.yaml
    [ $name = room_davis ] && configuration=config/esim_offset_depth.yaml
    bag=${name}_$1.bag
    if [ ! -e "$folder/$bag" ]; then
      /usr/bin/python3 "$unpack" unpack "$shared/esim/$name.rec" "$folder/$bag.part" --noisy-depth --keep "$2" \
        --latency-us "$3" --noise-hz "$4" --hot "$5" --seed "$6"
      mv "$folder/$bag.part" "$folder/$bag"
    fi
    echo "${name}_$1 $configuration $bag" >> "$folder/noisier.txt"
  done
}

unpack_kind k50_n5 .5 1000 5 .002 21
unpack_kind k60_n10 .6 800 10 .001 22
unpack_kind k40_n6 .4 1200 6 .005 23
unpack_kind k100_n10 1 300 10 .001 24
unpack_kind k30_n10 .3 2000 10 .01 7
unpack_kind k100_n30 1 1500 30 .001 12
unpack_kind k30_n3 .3 800 3 .001 31
unpack_kind k20_n0.5 .2 500 .5 .001 32
unpack_kind k20_n5 .2 1000 5 .002 33
unpack_kind k10_n1 .1 500 1 .002 11
