#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs devo_offline over recordings and prints one markdown table of errors, losses and speed.

    scripts/evaluate_recordings.py --data DIR                                  all of scripts/recordings.txt found in DIR
    scripts/evaluate_recordings.py --data DIR --only desk --depth-rate 30 5 1
    scripts/evaluate_recordings.py --data DIR --variant "plain: --config config/method_paper.yaml" \\
                                              --variant "no filter: --set surface.noise_neighbours=0"
    scripts/evaluate_recordings.py --data DIR --variants scripts/ablation.txt --summary clean noisy dark \\
                                              --with "--set topics.imu="

The table of recordings has one line each: name, configurations (comma-separated, relative to the repository) and bags
(comma-separated, relative to --data). A variant is a name and arguments that are added to devo_offline's; without any,
the defaults are run. Lines of recordings whose bags are missing are skipped and said so. With --summary there is one row
per depth rate and variant: for the recordings whose names contain each word, the geometric mean of the ATE and the worst.
"""
import argparse
import collections
import concurrent.futures
import json
import math
import os
import shlex
import shutil
import subprocess
import sys
import tempfile

REPOSITORY = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def read_table(path):
    recordings = []
    with open(path) as table:
        for line in table:
            words = line.split('#')[0].split()
            if not words:
                continue
            if len(words) != 3:
                sys.exit(f"{path}: '{line.strip()}': expected 'name configurations bags'")
            recordings.append((words[0], words[1].split(','), words[2].split(',')))
    return recordings


def read_variants(path):
    with open(path) as file:
        return [line for line in (line.split('#')[0].strip() for line in file) if line]


def find_program(given, name='devo_offline'):
    candidates = [given] if given else [shutil.which(name), os.path.join(REPOSITORY, 'build/devel/lib/devo', name)]
    for candidate in candidates:
        if candidate and os.access(candidate, os.X_OK):
            return candidate
    sys.exit(f'{given or name} is not found; give the path of {name}')


def select(data, tables, words):
    """Recordings of the tables whose names contain one of the words and whose bags are there."""
    recordings = []
    for recording in [recording for table in tables for recording in read_table(table)]:
        if not any(word in recording[0] for word in words):
            continue
        missing = [bag for bag in recording[2] if not os.path.exists(os.path.join(data, bag))]
        if missing:
            print(f'skipped: {recording[0]} ({", ".join(missing)} is not in {data})', file=sys.stderr)
        else:
            recordings.append(recording)
    return recordings


def run(program, data, out, job):
    (name, configs, bags), rate, (variant, extra) = job
    extra_configs = [extra[i + 1] for i, word in enumerate(extra) if word == '--config']
    rest = [word for i, word in enumerate(extra) if word != '--config' and (i == 0 or extra[i - 1] != '--config')]
    folder = os.path.join(out, '_'.join(part.replace(' ', '-').replace('/', '-') for part in (name, str(rate), variant)))
    command = [program, '--out', folder]
    for config in configs + extra_configs:
        command += ['--config', os.path.join(REPOSITORY, config)]
    for bag in bags:
        command += ['--bag', os.path.join(data, bag)]
    if rate != 'all':
        command += ['--depth-rate', str(rate)]
    report_path = os.path.join(folder, 'report.json')
    if os.path.exists(report_path):
        os.remove(report_path)
    result = subprocess.run(command + rest, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
    report = {}
    if os.path.exists(report_path):
        with open(report_path) as file:
            report = json.load(file)
    lines = [line for line in result.stderr.splitlines() if line.startswith('devo_offline:') and 'warning' not in line]
    return job, result.returncode, report, lines[-1] if lines else ''


def number(value, digits):
    return '-' if value is None else f'{value:.{digits}f}'


def row(job, status, report, message):
    (name, _, _), rate, (variant, _) = job
    head = f'| {name} | {rate} | {variant} | '
    if not report:
        return head + f'failed: {message} |' + ' |' * 11
    e = report.get('evaluation') or {}
    cells = [number(e.get('ate_rmse_m') and 100 * e['ate_rmse_m'], 2), number(e.get('drift_percent'), 2),
             number(e.get('rpe_rotation_rmse_deg'), 2), number(e.get('rpe_translation_rmse_cm'), 2),
             number(e.get('final_rotation_deg'), 2), number(e.get('final_translation_m') and 100 * e['final_translation_m'], 2),
             number(e.get('nees'), 2),
             str(len(report['lost_intervals'])) if report['poses'] else 'no pose', f"{100 * report['coverage']:.1f}",
             str(report['references']), number(report['real_time_factor'], 1),
             number(report['cpu_s'] / max(1e-9, report['end_s'] - report['begin_s']), 2)]
    note = f' (exit status {status}: {message})' if status else ''
    return head + ' | '.join(cells) + ' |' + note


def times(ates, usual):
    """Geometric mean of how many times the errors by recording are the usual ones, over recordings that have both."""
    ratios = [math.log(ates[name] / usual[name]) for name in ates if usual.get(name)]
    return math.exp(sum(ratios) / len(ratios)) if ratios else None


def summary(results, words):
    """Rows by depth rate and variant, in their order; an error is that of the poses that are not called lost."""
    ates, lost = collections.OrderedDict(), collections.Counter()
    for (recording, rate, (variant, _)), _, report, _ in results:
        ate = (report.get('evaluation') or {}).get('ate_rmse_m')
        ates.setdefault((rate, variant), {}).update({recording[0]: ate} if ate else {})
        lost[rate, variant] += not report or not report['poses'] or len(report['lost_intervals']) > 0
    firsts = {}
    for (rate, variant), by_name in ates.items():
        cells = []
        for word in words:
            group = [1000 * ate for name, ate in by_name.items() if word in name]
            mean = math.exp(sum(map(math.log, group)) / len(group)) if group else None
            cells.append(f'{mean:.2f} / {max(group):.2f}' if group else '-')
        cells.append(number(times(by_name, firsts.setdefault(rate, by_name)), 2))
        head = variant if rate == 'all' else f'{variant}, depth at {rate} Hz'
        yield f'| {head} | ' + ' | '.join(cells) + f' | {lost[rate, variant]} |'


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--data', required=True, help='folder of the bags')
    parser.add_argument('--recordings', nargs='+', default=[os.path.join(REPOSITORY, 'scripts/recordings.txt')],
                        help='tables of recordings')
    parser.add_argument('--only', nargs='+', default=[''], help='names that contain one of these')
    parser.add_argument('--depth-rate', nargs='+', default=['all'], help="depth images per second ('all': every one)")
    parser.add_argument('--variant', action='append', default=[], help='"name: arguments of devo_offline", repeatable')
    parser.add_argument('--variants', help='file with a variant per line')
    parser.add_argument('--with', dest='always', default='', help='arguments of devo_offline added to all variants')
    parser.add_argument('--summary', nargs='+', metavar='WORD', help='one row per variant, columns by words in names')
    parser.add_argument('--devo-offline', help='program; else from PATH or build/')
    parser.add_argument('--out', help='folder that keeps the results; else a temporary one')
    parser.add_argument('--jobs', type=int, default=2, help='runs at once; real-time factors are honest with 1')
    arguments = parser.parse_args()
    program = find_program(arguments.devo_offline)
    texts = (read_variants(arguments.variants) if arguments.variants else []) + arguments.variant
    always = shlex.split(arguments.always)
    variants = [(text.split(':', 1)[0].strip(), always + shlex.split(text.split(':', 1)[1] if ':' in text else ''))
                for text in texts] or [('default', always)]
    recordings = select(arguments.data, arguments.recordings, arguments.only)
    out = arguments.out or tempfile.mkdtemp(prefix='devo_evaluation_')
    jobs = [(recording, rate, variant) for recording in recordings for rate in arguments.depth_rate for variant in variants]
    if arguments.summary:
        columns = ['variant'] + [f'{word}: ATE mm, mean / worst' for word in arguments.summary]
        columns += [f'x {variants[0][0]}', 'lost']
    else:
        columns = ['recording', 'depth Hz', 'variant', 'ATE cm', '% of path', 'RPE deg', 'RPE cm', 'final deg', 'final cm',
                   'NEES', 'lost', 'coverage %', 'references', 'x real time', 'CPU s/s']
    print('| ' + ' | '.join(columns) + ' |\n|' + '---|' * len(columns), flush=True)
    results = []
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        for result in pool.map(lambda job: run(program, arguments.data, out, job), jobs):
            if not arguments.summary:
                print(row(*result), flush=True)
            results.append(result)
    for line in summary(results, arguments.summary) if arguments.summary else []:
        print(line)
    failed = sum(status != 0 for _, status, _, _ in results)
    if not arguments.out:
        shutil.rmtree(out)
    if failed:
        sys.exit(f'{failed} of {len(jobs)} runs failed')


if __name__ == '__main__':
    main()
