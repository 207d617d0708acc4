#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Simulates ways to move that the random motion does not have: shaking and bobbing as in a hand or on a rover, looking
about in jerks, turning about the line of sight, straight towards things and past them, around them.

    scripts/simulate_motions.py DIR                  (12 min on two cores; what is there is kept)
    scripts/evaluate_recordings.py --data DIR --recordings DIR/motions.txt --depth-rate all 5 1
"""
import os

import numpy as np

import make_trajectory
import simulated_set

DURATION_S, STEP_S, REST_S, RAMP_S = 4.5, .005, .3, .5
FIRST_SEED = 501

# Where the camera is in each scene, how far it may go to each side, and what it looks at.
PLACES = {'cali': ([-.55, 0, 1.15], [.45, .7, .35], [1.45, 0, 1.05]),
          'table': ([-.6, 0, 1.25], [.25, .6, .2], [.52, 0, .83]),
          'sofa': ([-.95, 0, 1.275], [.45, .8, .325], [1.6, 0, .62]),
          'example': ([-.25, 0, 1.35], [.35, .6, .25], [1.25, 0, .9]),
          'hall': ([.75, 0, 1.6], [2.25, 1.5, .6], [15, 0, 1.7])}

RECORDINGS = '''
shake table bright gen3
shake sofa dim davis346
orbit cali darkish davis240
orbit sofa bright davis346
whip example bright gen3
whip sofa dim davis346
whip table darkish davis240
roll table hdr davis346
roll sofa bright gen3
push table dim davis346
push sofa bright davis346
push cali bright gen3
bob example darkish davis346
bob sofa dark gen3
side sofa bright davis240
side cali dim davis346
hurry table bright gen3
hurry sofa darkish davis346
hurry example dark davis346
bob hall bright davis346
side table dark davis346
'''

# Each gives, at the time s of a motion without its beginning from rest: the position, what is looked at, and a turn of
# the camera beside that (a rotation vector of its own frame).


def shake(s, centre, reach, target, phases):
    """At 4 to 8 Hz by up to a degree and 5 mm, while it wanders."""
    def swing(hz, k):
        return min(1, 2 * s) * (np.sin(2 * np.pi * hz * s + phases[k]) - np.sin(phases[k]))

    position = centre + .5 * reach * [np.sin(.6 * s), np.sin(.9 * s), .5 * np.sin(.7 * s)]
    position += .003 * np.array([swing(6.2, 3), swing(5.1, 4), swing(7.7, 5)])
    return position, target, np.radians(.8) * np.array([swing(5.3, 0), swing(7.1, 1), swing(4.4, 2)])


def orbit(s, centre, _, target, __):
    x, y, height = centre - target
    angle = np.arctan2(y, x) + .45 * np.sin(1.1 * s)
    return target + [np.hypot(x, y) * np.cos(angle), np.hypot(x, y) * np.sin(angle), height], target, np.zeros(3)


def whip(s, centre, _, target, __):
    """25 or 50 degrees to the side in 0.25 s, then 0.35 s of rest."""
    k = int(s / .6)
    x = np.clip((s - .6 * k) / .25, 0, 1)
    sides = [0, 1, 0, -1, 0, 1, -1, 0, 1]
    side = sides[k] + (sides[k + 1] - sides[k]) * x**3 * (10 - 15 * x + 6 * x * x)
    yaw = np.radians(25) * side
    return centre + [0, .05 * np.sin(s), 0], target, np.array([0, yaw, 0])


def roll(s, centre, reach, target, _):
    return centre + [0, .3 * reach[1] * np.sin(.8 * s), 0], target, np.array([0, 0, np.radians(50) * np.sin(2.2 * s)])


def push(s, centre, reach, target, _):
    return centre + [.9 * reach[0] * np.sin(2 * s), 0, 0], target, np.zeros(3)


def bob(s, centre, reach, target, _):
    """As one walks, 1.8 steps a second."""
    position = centre + .5 * reach * [np.sin(.5 * s), np.sin(.4 * s), 0]
    step, sway = np.sin(2 * np.pi * 1.8 * s), np.sin(2 * np.pi * .9 * s)
    return position + [0, .02 * sway, .03 * step], target, np.radians([1.5 * step, sway, 0])


def side(s, centre, reach, target, _):
    """Without a turn."""
    way = np.array([0, .9 * reach[1] * np.sin(1.6 * s), 0])
    return centre + way, target + way, np.zeros(3)


def hurry(s, centre, reach, target, _):
    position = centre + .8 * reach * [np.sin(2.1 * s), np.sin(2.9 * s), .8 * np.sin(3.7 * s)]
    return position, target + .25 * np.array([0, np.sin(4.3 * s), .6 * np.sin(5.1 * s)]), np.zeros(3)


MOTIONS = {motion.__name__: motion for motion in (shake, orbit, whip, roll, push, bob, side, hurry)}


def since_rest(t):
    """The time of the motion, which begins from rest."""
    x = np.clip((t - REST_S) / RAMP_S, 0, 1)
    return RAMP_S * (x**3 - .5 * x**4) + max(0, t - REST_S - RAMP_S)


def exp_so3(turn):
    angle = np.linalg.norm(turn)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = turn / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def write_motion(path, motion, scene, seed):
    centre, reach, target = (np.array(v) for v in PLACES[scene])
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 12)

    def pose_at(t):
        position, looked_at, turn = MOTIONS[motion](since_rest(t), centre, reach, target, phases)
        return position, make_trajectory.upright(looked_at - position) @ exp_so3(turn)

    make_trajectory.write_tum(path, np.arange(0, DURATION_S + 1e-9, STEP_S), pose_at)


def recordings(directory):
    """Pairs of a name and the arguments of devo_simulate; writes their motions."""
    for seed, recording in enumerate(RECORDINGS.split('\n')[1:-1], FIRST_SEED):
        motion, scene, light, sensor = recording.split()
        name = f'm{seed}_{motion}_{scene}_{light}_{sensor}'
        path = os.path.join(directory, name + '_motion.txt')
        write_motion(path, motion, scene, seed)
        model = simulated_set.EXAMPLE if scene == 'example' else scene
        yield name, ['--scene', model, '--light', light, '--sensor', sensor, '--seed', str(seed), '--trajectory', path,
                     '--rest', '0']


def main():
    args = simulated_set.parser(__doc__).parse_args()
    simulated_set.simulate(args, recordings(args.directory), 'motions.txt')


if __name__ == '__main__':
    main()
