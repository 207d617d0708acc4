#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Simulates tours of a minute: somebody walks round and round a furnished room, camera in hand, and comes by every place
again. Room, furniture, pace, gaze, light and camera are drawn.

    scripts/simulate_tours.py DIR --count 6 --seed 1    (40 min on two cores; what is there is kept)
    scripts/evaluate_recordings.py --data DIR --recordings DIR/tours.txt --depth-rate all 5 1
"""
import math
import os
import random

import numpy as np
import yaml

import simulated_set
from make_trajectory import upright, write_tum
from simulate_scenes import THINGS, SceneDraw

FIRST_SEED = 2001
STEP_S = .02


class TourDraw(SceneDraw):
    """A room about the origin, its furniture along the walls, so that an ellipse round the middle is free."""

    def __init__(self, draw):
        super().__init__(draw)
        self.front, self.left = draw.uniform(2.5, 4.5), draw.uniform(2.2, 3.8)
        self.back, self.right = -self.front, -self.left
        self.half_axes_m = [self.front - draw.uniform(1.3, 1.8), self.left - draw.uniform(1.2, 1.5)]

    def ahead(self, radius):
        """A place at one of the walls for a thing of this radius."""
        along = self.draw.uniform(-.9, .9)
        x, y = self.draw.choice([(self.front - radius, along * self.left), (radius - self.front, along * self.left),
                                 (along * self.front, self.left - radius), (along * self.front, radius - self.left)])
        return [x, y]

    def board(self):
        width, height = self.draw.uniform(.3, 1.8), self.draw.uniform(.3, 1.1)
        along, bottom = self.draw.uniform(-1, 1), self.draw.uniform(.7, 1.4)
        material = self.material(['poster', 'dead_leaves', 'books', 'checker'], (.6, 1.5))
        side = self.draw.choice([-1, 1])
        if self.draw.random() < .5:
            corner, side_u = [side * (self.front - .02), along * (self.left - width), bottom], [0, width, 0]
        else:
            corner, side_u = [along * (self.front - width), side * (self.left - .02), bottom], [width, 0, 0]
        return {'corner': corner, 'side_u': side_u, 'side_v': [0, 0, height], 'material': material}

    def file(self):
        """Things of 15 to 50 cm in radius stand at the walls: the way keeps 70 cm from these."""
        draw = self.draw
        scene = super().file(people=0)
        scene['boxes'] = [box for _ in range(draw.randint(1, 3)) for box in self.table()]
        scene['boxes'] += [self.box(.15, .7) for _ in range(draw.randint(4, 10))]
        scene['quads'] = [self.board() for _ in range(draw.randint(2, 7))]
        scene['cylinders'] = [self.cylinder() for _ in range(draw.randint(1, 5))]
        return scene


class Walk:
    """Round the ellipse at a walking pace, bobbing with the steps, the gaze wandering about the way ahead."""

    def __init__(self, draw, half_axes_m):
        self.half_axes_m = half_axes_m
        self.pace_mps, self.height_m = draw.uniform(.4, 1.), draw.uniform(1.2, 1.6)
        self.sense, self.outward = draw.choice([-1, 1]), draw.uniform(0, .9)
        self.waves = [[(draw.uniform(*amplitude), 2 * math.pi * draw.uniform(*hertz), draw.uniform(0, 6.28))
                       for amplitude, hertz in spread] for spread in
                      [[((.005, .02), (.7, 1.))], [((.005, .02), (1.4, 2.))],  # sideways and up, m
                       [((.1, .4), (.08, .25)), ((.01, .04), (.7, 1.5))],  # to the side, rad
                       [((.05, .2), (.08, .25)), ((.01, .03), (1., 2.))]]]  # downwards, rad

    def wave(self, which, t):
        return sum(amplitude * (math.sin(omega * t + phase) - math.sin(phase)) for amplitude, omega, phase in self.waves[which])

    def pose_at(self, t):
        a, b = self.half_axes_m
        # A second to start; the pace is that of the mean radius, so it varies about the ellipse.
        way = self.pace_mps * (t - 1. + math.exp(-t)) / math.sqrt((a * a + b * b) / 2)
        angle = self.sense * way
        tangent = math.atan2(self.sense * b * math.cos(angle), -self.sense * a * math.sin(angle))
        yaw = tangent - self.sense * self.outward + self.wave(2, t)
        sideways = self.wave(0, t)
        position = [a * math.cos(angle) - math.sin(tangent) * sideways, b * math.sin(angle) + math.cos(tangent) * sideways,
                    self.height_m + self.wave(1, t)]
        return position, upright([math.cos(yaw), math.sin(yaw), -.25 - self.wave(3, t)])


def recordings(directory, count, seed, duration_s):
    """Pairs of a name and the arguments of devo_simulate; writes their scenes and ways."""
    draw = random.Random(seed)
    first = FIRST_SEED + 100 * (seed - 1)
    for own_seed in range(first, first + count):
        room = TourDraw(random.Random(own_seed))
        light = draw.choice(['bright', 'darkish', 'dim', 'dark', 'hdr'])
        sensor = draw.choices(['davis346', 'davis240', 'gen3'], [4, 2, 1])[0]
        name = f't{own_seed}_{light}_{sensor}'
        scene, way = (os.path.join(directory, f'{name}_{what}') for what in ('scene.yaml', 'way.txt'))
        with open(scene, 'w') as file:
            yaml.safe_dump(room.file(), file, default_flow_style=None)
        walk = Walk(random.Random(own_seed), room.half_axes_m)
        write_tum(way, np.arange(0, duration_s + STEP_S / 2, STEP_S), walk.pose_at)
        yield name, ['--scene', scene, '--trajectory', way, '--light', light, '--sensor', sensor, '--seed', str(own_seed)]


def main():
    parser = simulated_set.parser(__doc__)
    parser.add_argument('--count', type=int, default=6)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--duration', type=float, default=60)
    args = parser.parse_args()
    os.makedirs(args.directory, exist_ok=True)
    simulated_set.simulate(args, recordings(args.directory, args.count, args.seed, args.duration), 'tours.txt')


if __name__ == '__main__':
    main()
