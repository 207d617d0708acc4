#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes a motion that devo_simulate's random ones do not have, for its --trajectory: TUM, of the event camera.

    scripts/make_trajectory.py walk walk.txt     through the hall at 1.2 m/s, bobbing and swaying
    scripts/make_trajectory.py turn turn.txt     a full turn and a fifth, 72 deg/s, on a small circle
"""
import argparse

import numpy as np

DURATION_S, STEP_S = 6, 0.01


def walk(t):
    """Position, and the direction of view."""
    position = [-1.5 + 1.2 * t, 0.03 * np.sin(2 * np.pi * 0.9 * t), 1.5 + 0.03 * np.sin(2 * np.pi * 1.8 * t)]
    return position, [1, 0.08 * np.sin(2 * np.pi * 0.9 * t), -0.1 + 0.03 * np.sin(2 * np.pi * 1.8 * t)]


def turn(t):
    yaw = 2 * np.pi * t / 5
    x, y = np.cos(yaw), np.sin(yaw)
    return [-0.9 + 0.25 * x, 0.25 * y, 1.3], [x, y, -0.25]


def upright(view):
    """Rotation of a camera (z forward, x right, y down) that looks along `view`, upright in a world whose z is up."""
    forward = np.array(view) / np.linalg.norm(view)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward], 1)


def quaternion(rotation):
    """x, y, z, w."""
    # The eigenvector of the largest eigenvalue (Bar-Itzhack, 2000), which no angle upsets.
    (a, b, c), (d, e, f), (g, h, i) = rotation
    k = np.array([[a - e - i, b + d, c + g, h - f],
                  [b + d, e - a - i, f + h, c - g],
                  [c + g, f + h, i - a - e, d - b],
                  [h - f, c - g, d - b, a + e + i]])
    return np.linalg.eigh(k)[1][:, -1]


def write_tum(path, stamps_s, pose_at):
    """`pose_at(t)`: position and rotation."""
    last = np.array([0, 0, 0, 1])
    with open(path, 'w') as file:
        for t in stamps_s:
            position, rotation = pose_at(t)
            q = quaternion(rotation)
            last = q if q @ last >= 0 else -q
            file.write(' '.join([f'{t:.6f}'] + [f'{value:.9f}' for value in [*position, *last]]) + '\n')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('motion', choices=['walk', 'turn'])
    parser.add_argument('out')
    arguments = parser.parse_args()
    motion = {'walk': walk, 'turn': turn}[arguments.motion]

    def pose_at(t):
        position, view = motion(t)
        return position, upright(view)

    write_tum(arguments.out, np.arange(0, DURATION_S + STEP_S / 2, STEP_S), pose_at)


if __name__ == '__main__':
    main()
