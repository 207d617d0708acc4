# SPDX-License-Identifier: BSD-3-Clause
"""What scripts that simulate a set of recordings have in common."""
import argparse
import os
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
EXAMPLE = os.path.join(ROOT, 'config/sim/example_scene.yaml')


def parser(description):
    arguments = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument('directory', type=os.path.abspath)
    arguments.add_argument('--devo-simulate', default=os.path.join(ROOT, 'devel/lib/devo/devo_simulate'))
    return arguments


def simulate(args, recordings, table):
    """`recordings`: pairs of a name and the arguments of devo_simulate. What is there is kept; the table, of the form that
    evaluate_recordings.py takes, grows with each."""
    if not os.access(args.devo_simulate, os.X_OK):
        sys.exit(f'{args.devo_simulate}: not there, expected the built simulator (scripts/build.sh)')
    os.makedirs(args.directory, exist_ok=True)
    rows = []
    for name, arguments in recordings:
        path = os.path.join(args.directory, name)
        if not os.path.exists(path + '.bag'):
            subprocess.run([args.devo_simulate, '--out', path, '--quiet', '--no-frames'] + arguments, check=True)
        rows.append(f'{name} {path}.yaml {name}.bag\n')
        with open(os.path.join(args.directory, table), 'w') as file:
            file.writelines(rows)
