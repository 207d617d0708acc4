#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs OpenCV's RGB-D odometries and devo_offline on the same recordings and prints one markdown table of both.

    scripts/compare_peers.py --data DIR                                 the noisy ones of scripts/recordings.txt
    scripts/compare_peers.py --data DIR --only desk_slow_clean --depth-rate 30 5

Each error is that of the peer's poses, and behind the stroke that of devo_offline at the same times, so that a few poses
are compared with as few. CPU is seconds per second of data: of devo_offline the whole program's, reading included, of a
peer its odometry's alone, to which the milliseconds per image belong. Where no recording has such a name and its bags in
DIR, the exit status is 2.
"""
import argparse
import json
import os
import subprocess
import sys

import evaluate_recordings

PEERS = ['icp', 'rgbd_icp', 'photometric']


def centimetres(evaluation):
    return f"{100 * evaluation['ate_rmse_m']:.2f}" if evaluation else '-'


def compare(programs, data, out, recording, rate):
    """A row of the table, or what failed."""
    name, configs, bags = recording
    _, status, ours, message = evaluate_recordings.run(programs['devo_offline'], data, out, (recording, rate, ('devo', [])))
    if status or not ours:
        return f'{name} at {rate} Hz: {message}'
    folder = os.path.join(out, f'{name}_{rate}_peers')
    os.makedirs(folder, exist_ok=True)
    command = [programs['devo_rgbd_baseline'], '--out', folder, '--depth-rate', str(rate)]
    command += ['--compare', os.path.join(out, f'{name}_{rate}_devo', 'trajectory.txt')]
    for config in configs:
        command += ['--config', os.path.join(evaluate_recordings.REPOSITORY, config)]
    for bag in bags:
        command += ['--bag', os.path.join(data, bag)]
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
    if result.returncode:
        return f'{name} at {rate} Hz: {result.stderr.strip()}'
    with open(os.path.join(folder, 'peers.json')) as file:
        peers = json.load(file)
    duration_s = ours['end_s'] - ours['begin_s']
    cells = [name, str(rate)]
    for peer in PEERS:
        found = peers.get(peer)
        cells.append(f"{centimetres(found['evaluation'])} / {centimetres(found['compared'])}" if found else '-')
    for peer in PEERS:
        found = peers.get(peer)
        cells.append(f"{found['cpu_s'] / duration_s:.2f} ({found['cpu_ms_per_image']:.0f} ms)" if found else '-')
    cells.append(f"{ours['cpu_s'] / duration_s:.2f}")
    print('| ' + ' | '.join(cells) + ' |', flush=True)
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--data', required=True, help='folder of the bags')
    parser.add_argument('--recordings', default=os.path.join(evaluate_recordings.REPOSITORY, 'scripts/recordings.txt'),
                        help='table of recordings')
    parser.add_argument('--only', nargs='+', default=['noisy'], help='names that contain one of these')
    parser.add_argument('--depth-rate', nargs='+', type=float, default=[30, 5, 1], help='depth images per second')
    parser.add_argument('--programs', help='folder of devo_offline and devo_rgbd_baseline; else from PATH or build/')
    parser.add_argument('--out', help='folder that keeps the trajectories; else a temporary one')
    arguments = parser.parse_args()
    programs = {name: evaluate_recordings.find_program(arguments.programs and os.path.join(arguments.programs, name), name)
                for name in ('devo_offline', 'devo_rgbd_baseline')}
    recordings = evaluate_recordings.select(arguments.data, [arguments.recordings], arguments.only)
    columns = ['recording', 'depth Hz'] + [f'{peer} / devo: ATE cm' for peer in PEERS]
    columns += [f'{peer}: CPU s/s' for peer in PEERS] + ['devo: CPU s/s']
    print('| ' + ' | '.join(columns) + ' |\n|' + '---|' * len(columns), flush=True)
    with evaluate_recordings.results_folder(arguments.out) as out:
        failures = [compare(programs, arguments.data, out, recording, f'{rate:g}')
                    for recording in recordings for rate in arguments.depth_rate]
    failures = [failure for failure in failures if failure]
    if failures:
        sys.exit('\n'.join(failures))


if __name__ == '__main__':
    main()
