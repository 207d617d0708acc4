#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Simulates recordings that no parameter was chosen by: scene, speed, light, cameras, rests and errors are drawn anew for
each seed. Names say what was drawn; the same seed draws the same.

    scripts/simulate_at_random.py DIR --count 28 --seed 20261125    (15 min on two cores; what is there is kept)
    scripts/simulate_at_random.py DIR2 --count 28 --seed 20261126 --first-seed 401
    scripts/evaluate_recordings.py --data DIR --recordings DIR/random.txt --depth-rate all 5 1

The last takes the table of recordings that the first writes.
"""
import random

import simulated_set

RAMP_S = .4  # in which devo_simulate brakes and speeds up: before it stops it must be at speed


def draw_recordings(count, seed, first_seed):
    """Pairs of a name and the arguments of devo_simulate."""
    draw = random.Random(seed)
    recordings = []
    for own_seed in range(first_seed, first_seed + count):
        scene = draw.choices(['cali', 'table', 'sofa', simulated_set.EXAMPLE, 'hall'], [3, 4, 4, 3, 1])[0]
        speed = draw.choice(['slow', 'mid', 'fast'])
        light = draw.choices(['bright', 'darkish', 'dim', 'dark', 'hdr'], [3, 2, 2, 2, 2])[0]
        sensor = draw.choices(['gen3', 'davis346', 'davis240', 'gen4'], [5, 5, 3, .6])[0]
        rest = draw.choice([0, .3, .3, 1.])
        tags, arguments = [], ['--rest', str(rest)]
        if draw.random() < .35:
            begin, duration = round(draw.uniform(1.2, 2.2), 1), round(draw.uniform(.5, 1.5), 1)
            begin = max(begin, round(rest + 2 * RAMP_S, 1))
            tags.append('stop')
            arguments += ['--stop', str(begin), str(duration)]
        depth = draw.choices(['kinect', 'registered', 'exact'], [6, 1, 1])[0]
        arguments += ['--depth', depth]
        if depth == 'kinect' and draw.random() < .3:
            tags.append('mp')
            arguments += ['--multipath', '0.2']
        if draw.random() < .3:
            tags.append('off')
            arguments += ['--depth-offset', str(draw.choice([.004, -.006, .01]))]
        if depth != 'kinect':
            tags.append(depth)
        if rest == 0:
            tags.append('rest0')
        duration = draw.choice([4, 5, 6])
        scene_name = 'example' if scene == simulated_set.EXAMPLE else scene
        name = '_'.join([f'f{own_seed}', scene_name, speed, light, sensor] + tags)
        recordings.append((name, ['--scene', scene, '--speed', speed, '--light', light, '--sensor', sensor, '--seed',
                                  str(own_seed), '--duration', str(duration)] + arguments))
    return recordings


def main():
    parser = simulated_set.parser(__doc__)
    parser.add_argument('--count', type=int, default=28)
    parser.add_argument('--seed', type=int, default=20261125)
    parser.add_argument('--first-seed', type=int, default=301, help="the recordings' own: those of the other sets are smaller")
    args = parser.parse_args()
    simulated_set.simulate(args, draw_recordings(args.count, args.seed, args.first_seed), 'random.txt')


if __name__ == '__main__':
    main()
