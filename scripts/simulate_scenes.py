#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Simulates recordings in scenes that are drawn at random: rooms of 3 to 10 m with furniture, boards and things of any
texture, crowded or next to empty, seen from near or far. Speed, light and cameras are drawn, too.

    scripts/simulate_scenes.py DIR --count 24 --seed 1    (15 min on two cores; what is there is kept)
    scripts/simulate_scenes.py DIR --count 24 --seed 1 --people 1    (the same, s701p1_..., with somebody who walks about)
    scripts/evaluate_recordings.py --data DIR --recordings DIR/scenes.txt --depth-rate all 5 1
"""
import math
import os
import random

import yaml

import simulated_set

FIRST_SEED = 701
WALLS = ['plaster', 'plaster', 'plain', 'fabric', 'brick', 'wood', 'tiles', 'books']
FLOORS = ['tiles', 'wood', 'carpet', 'plain', 'brick']
THINGS = ['dead_leaves', 'poster', 'checker', 'wood', 'books', 'fabric', 'metal', 'plain', 'plain', 'carpet']


class SceneDraw:
    """The scene file of devo_simulate, drawn: the camera is near the origin and looks along x."""

    def __init__(self, draw):
        self.draw = draw
        self.materials = []
        self.near = draw.choice([.5, .9, 1.6])  # from the camera to the first things
        self.height = draw.uniform(1., 1.7)
        self.back, self.front = -draw.uniform(1., 2.5), self.near + draw.uniform(.8, 5.)
        self.right, self.left = -draw.uniform(1.2, 4.), draw.uniform(1.2, 4.)
        self.ceiling = draw.uniform(2.4, 3.6)

    def material(self, textures, sizes_m):
        name = f'm{len(self.materials)}'
        self.materials.append({'name': name, 'texture': self.draw.choice(textures), 'seed': self.draw.randint(1, 999),
                               'size_m': round(self.draw.uniform(*sizes_m), 2),
                               'reflectance': round(self.draw.uniform(.5, 1), 2),
                               'infrared': round(self.draw.uniform(.35, .9), 2)})
        return name

    def ahead(self, radius):
        """A place on the floor, in what the camera sees, for a thing of this radius that keeps its distance."""
        x = self.draw.uniform(self.near + radius, max(self.front, self.near + radius))
        reach = .75 * (x + .3)
        return [x, self.draw.uniform(max(self.right, -reach), min(self.left, reach))]

    def table(self):
        """A top with things on it."""
        size = [self.draw.uniform(.5, 1.), self.draw.uniform(.8, 1.6)]
        x, y = self.ahead(.5 * size[0])
        top = self.draw.uniform(.45, .8)
        boxes = [{'position': [x, y, top], 'size': size + [.04], 'material': self.material(['wood', 'plain', 'metal'], (.5, 1.5))}]
        boxes.append({'position': [x, y, 0], 'size': [.1, .1, top], 'material': boxes[0]['material']})
        for _ in range(self.draw.randint(1, 4)):
            at = [x + self.draw.uniform(-.35, .35) * size[0], y + self.draw.uniform(-.4, .4) * size[1], top + .04]
            boxes.append(self.box(.06, .35, at))
        return boxes

    def box(self, smallest, largest, position=None):
        size = [self.draw.uniform(smallest, largest) for _ in range(3)]
        return {'position': position or self.ahead(.5 * math.hypot(*size[:2])) + [0], 'size': size,
                'yaw_deg': self.draw.uniform(-45, 45), 'material': self.material(THINGS, (.3, 1.5))}

    def board(self):
        """A picture on the wall ahead."""
        width, height = self.draw.uniform(.3, 1.8), self.draw.uniform(.3, 1.1)
        y = self.draw.uniform(self.right, max(self.right, self.left - width))
        return {'corner': [self.front - .02, y, self.draw.uniform(.5, 1.4)], 'side_u': [0, width, 0], 'side_v': [0, 0, height],
                'material': self.material(['poster', 'dead_leaves', 'books', 'checker'], (.6, 1.5))}

    def cylinder(self):
        radius = self.draw.uniform(.02, .2)
        return {'position': self.ahead(radius) + [0], 'radius': radius, 'height': self.draw.uniform(.4, 2.2),
                'material': self.material(THINGS, (.3, 1.))}

    def lamp(self):
        return {'position': [self.draw.uniform(self.back, self.front) * .8, self.draw.uniform(self.right, self.left) * .8,
                             self.ceiling - .1], 'intensity_cd': self.draw.uniform(50, 500), 'radius_m': self.draw.uniform(.05, .2)}

    def person(self):
        """Somebody who walks to and fro across the view, as cylinders: legs, trunk and head."""
        draw = self.draw
        x, way = self.near + draw.uniform(.5, 1.5), draw.uniform(1., 2.5)
        y, period_s = draw.uniform(-1., 1.), max(3., 3.14 * way / draw.uniform(.7, 1.5))  # 0.7 to 1.5 m/s in the middle
        by = [draw.uniform(-.3, .3), way if y < 0 else -way, 0]
        trousers, shirt, skin = self.material(['fabric', 'plain'], (.3, 1.)), self.material(THINGS, (.3, 1.)), self.material(['plain'], (1., 1.))
        sway = {'by': by, 'period_s': period_s, 'begins_s': draw.uniform(0, 1)}
        return [{'position': [x, y, bottom], 'radius': radius, 'height': height, 'material': material, 'sway': sway}
                for bottom, radius, height, material in [(0, .13, .85, trousers), (.85, .19, .6, shirt), (1.5, .1, .25, skin)]]

    def file(self, people):
        draw = self.draw
        room = {'min': [self.back, self.right, 0], 'max': [self.front, self.left, self.ceiling],
                'floor': self.material(FLOORS, (1., 3.)), 'ceiling': self.material(['plaster', 'plain'], (2., 4.)),
                'wall': self.material(WALLS, (1., 4.))}
        boxes = [box for _ in range(draw.randint(0, 2)) for box in self.table()]
        boxes += [self.box(.15, 1.2) for _ in range(draw.randint(1, 6))]
        quads = [self.board() for _ in range(draw.randint(0, 3))]
        cylinders = [self.cylinder() for _ in range(draw.randint(0, 3))]
        middle = .5 * (self.near + self.front)
        side = min(.5, .3 * self.left, -.3 * self.right)
        scene = {'name': 'drawn', 'ambient_lux': draw.uniform(20, 150), 'materials': self.materials, 'room': room,
                'quads': quads, 'boxes': boxes, 'cylinders': cylinders, 'lamps': [self.lamp() for _ in range(draw.randint(1, 3))],
                'motion': {'position_min': [max(-.5, self.back + .4), -side, self.height - .25],
                           'position_max': [min(.1, self.near - .6), side, self.height + .25],
                           'target_min': [middle - .2, -.5, .6], 'target_max': [middle + .4, .5, 1.3]}}
        for _ in range(people):  # drawn last: the rest is as without
            scene['cylinders'] += self.person()
        return scene


def recordings(directory, count, seed, people):
    """Pairs of a name and the arguments of devo_simulate; writes their scenes."""
    draw = random.Random(seed)
    first = FIRST_SEED + 100 * (seed - 1)
    with_people = f'p{people}' if people else ''
    for own_seed in range(first, first + count):
        scene = SceneDraw(random.Random(own_seed))
        speed, light = draw.choice(['slow', 'mid', 'fast']), draw.choice(['bright', 'darkish', 'dim', 'dark', 'hdr'])
        sensor = draw.choices(['gen3', 'davis346', 'davis240'], [5, 5, 3])[0]
        name = f's{own_seed}{with_people}_{speed}_{light}_{sensor}'
        path = os.path.join(directory, name + '_scene.yaml')
        with open(path, 'w') as file:
            yaml.safe_dump(scene.file(people), file, default_flow_style=None)
        yield name, ['--scene', path, '--speed', speed, '--light', light, '--sensor', sensor, '--seed', str(own_seed),
                     '--duration', '5', '--rest', str(draw.choice([0, .3, 1.]))]


def main():
    parser = simulated_set.parser(__doc__)
    parser.add_argument('--count', type=int, default=24)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--people', type=int, default=0, help='so many walk about in each room')
    args = parser.parse_args()
    simulated_set.simulate(args, recordings(args.directory, args.count, args.seed, args.people), 'scenes.txt')


if __name__ == '__main__':
    main()
