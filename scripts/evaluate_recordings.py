#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs devo_offline over recordings and prints one markdown table of errors, losses and speed.

    scripts/evaluate_recordings.py --data DIR                                  all of scripts/recordings.txt found in DIR
    scripts/evaluate_recordings.py --data DIR --only desk --depth-rate 30 5 1
    scripts/evaluate_recordings.py --data DIR --variant "plain: --config config/method_paper.yaml" \\
                                              --variant "no filter: --set surface.noise_neighbours=0"
    scripts/evaluate_recordings.py --data DIR --variants scripts/ablation.txt --summary clean noisy dark \\
                                              --with "--set topics.imu="
    scripts/evaluate_recordings.py --data DIR --wide --depth-rate all 5 1 --variant "with IMU:" \\
                                              --variant "no IMU: --set topics.imu="

The table of recordings has one line each: name, configurations (comma-separated, relative to the repository) and bags
(comma-separated, relative to --data). A variant is a name and arguments that are added to devo_offline's; without any,
the defaults are run. Lines of recordings whose bags are missing are skipped and said so; where none is left, the
exit status is 2. With --summary there is one row per depth rate and variant: for the recordings whose names contain each
word, the geometric mean of the ATE and the worst. With --wide there is one row per recording, with the ATE of each variant
and depth rate, and more of the first of these.
"""
import argparse
import collections
import concurrent.futures
import contextlib
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
    """Recordings of the tables whose names contain one of the words and whose bags are there, at least one."""
    recordings = []
    for recording in [recording for table in tables for recording in read_table(table)]:
        if not any(word in recording[0] for word in words):
            continue
        missing = [bag for bag in recording[2] if not os.path.exists(os.path.join(data, bag))]
        if missing:
            print(f'skipped: {recording[0]} ({", ".join(missing)} is not in {data})', file=sys.stderr)
        else:
            recordings.append(recording)
    if not recordings:
        asked = ' whose name contains ' + ' or '.join(f"'{word}'" for word in words) if any(words) else ''
        print(f'no recording: expected one of {", ".join(tables)}{asked}, its bags in {data}', file=sys.stderr)
        sys.exit(2)
    return recordings


@contextlib.contextmanager
def results_folder(given):
    """The folder that is given, or a temporary one, which goes away however the script ends."""
    if given:
        yield given
        return
    with tempfile.TemporaryDirectory(prefix='devo_evaluation_') as folder:
        yield folder


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


def mean(values):
    """Geometric, of positive ones."""
    return math.exp(sum(map(math.log, values)) / len(values))


def cpu_share(report):
    """Seconds of CPU per second of data."""
    return report['cpu_s'] / max(1e-9, report['end_s'] - report['begin_s'])


def markdown(cells):
    return '| ' + ' | '.join(cells) + ' |'


def title(variant, rate, words=''):
    """Of a row or a column."""
    return variant if rate == 'all' else f'{variant}, {words}{rate} Hz'


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
             number(cpu_share(report), 2)]
    note = f' (exit status {status}: {message})' if status else ''
    return head + ' | '.join(cells) + ' |' + note


def times(ates, usual):
    """Geometric mean of how many times the errors by recording are the usual ones, over recordings that have both."""
    ratios = [ates[name] / usual[name] for name in ates if usual.get(name)]
    return mean(ratios) if ratios else None


def header(columns):
    return markdown(columns) + '\n|' + '---|' * len(columns)


def full(results):
    """A row per run, as it comes."""
    yield header(['recording', 'depth Hz', 'variant', 'ATE cm', '% of path', 'RPE deg', 'RPE cm', 'final deg', 'final cm',
                  'NEES', 'lost', 'coverage %', 'references', 'x real time', 'CPU s/s'])
    for result in results:
        yield row(*result)


def summary(results, words):
    """Rows by depth rate and variant, in their order; an error is that of the poses that are not called lost."""
    ates, lost = collections.OrderedDict(), collections.Counter()
    for (recording, rate, (variant, _)), _, report, _ in results:
        ate = (report.get('evaluation') or {}).get('ate_rmse_m')
        ates.setdefault((rate, variant), {}).update({recording[0]: ate} if ate else {})
        lost[rate, variant] += not report or not report['poses'] or len(report['lost_intervals']) > 0
    first_variant = next(iter(ates))[1] if ates else ''
    yield header(['variant'] + [f'{word}: ATE mm, mean / worst' for word in words] + [f'x {first_variant}', 'lost'])
    firsts = {}
    for (rate, variant), by_name in ates.items():
        cells = [title(variant, rate, 'depth at ')]
        for word in words:
            group = [1000 * ate for name, ate in by_name.items() if word in name]
            cells.append(f'{mean(group):.2f} / {max(group):.2f}' if group else '-')
        cells.append(number(times(by_name, firsts.setdefault(rate, by_name)), 2))
        yield markdown(cells + [str(lost[rate, variant])])


def wide_cell(report, with_share):
    """ATE in cm, by itself or with its share of the path, and what was lost."""
    e = report.get('evaluation') or {}
    if not e.get('ate_rmse_m'):
        return '- (lost)' if report else '- (failed)'
    times_lost = len(report['lost_intervals'])
    lost = ['', ' (lost)'][times_lost] if times_lost < 2 else f' (lost {times_lost} times)'
    share = f" ({e['drift_percent']:.2f} %)" if with_share and e.get('drift_percent') is not None else ''
    return f"{100 * e['ate_rmse_m']:.2f}{share}{lost}"


def wide(results):
    """Rows by recording, with a cell for each variant and depth rate, and below them the geometric means of the columns."""
    rows, ates = collections.OrderedDict(), collections.OrderedDict()
    for (recording, rate, (variant, _)), _, report, _ in results:
        rows.setdefault(recording[0], {})[variant, rate] = report
        ate = (report.get('evaluation') or {}).get('ate_rmse_m')
        ates.setdefault((variant, rate), []).extend([ate] if ate else [])
    columns = list(ates)
    yield header(['recording'] + [title(*column) for column in columns] + ['RPE deg / cm', 'NEES', 'CPU s/s'])
    for name, reports in rows.items():
        first = reports[columns[0]]
        e = first.get('evaluation') or {}
        rpe = f"{number(e.get('rpe_rotation_rmse_deg'), 2)} / {number(e.get('rpe_translation_rmse_cm'), 2)}"
        cpu = cpu_share(first) if first else None
        yield markdown([name] + [wide_cell(reports[column], column == columns[0]) for column in columns]
                       + [rpe, number(e.get('nees'), 2), number(cpu, 2)])
    means = [100 * mean(column) if column else None for column in ates.values()]
    yield markdown(['geometric mean'] + [number(value, 3) for value in means] + ['-'] * 3)


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--data', required=True, help='folder of the bags')
    parser.add_argument('--recordings', nargs='+', default=[os.path.join(REPOSITORY, 'scripts/recordings.txt')],
                        help='tables of recordings')
    parser.add_argument('--only', nargs='+', default=[''], help='names that contain one of these')
    parser.add_argument('--depth-rate', nargs='+', default=['all'], help="depth images per second ('all': every one)")
    parser.add_argument('--variant', action='append', default=[], help='"name: arguments of devo_offline", repeatable')
    parser.add_argument('--variants', help='file with a variant per line')
    parser.add_argument('--with', dest='always', default='', help='arguments of devo_offline added to all variants')
    table = parser.add_mutually_exclusive_group()
    table.add_argument('--summary', nargs='+', metavar='WORD', help='one row per variant, columns by words in names')
    table.add_argument('--wide', action='store_true', help='one row per recording, a column per variant and depth rate')
    parser.add_argument('--devo-offline', help='program; else from PATH or build/')
    parser.add_argument('--out', help='folder that keeps the results; else a temporary one')
    parser.add_argument('--jobs', type=int, default=2, help='runs at once; real-time factors are honest with 1')
    return parser.parse_args()


def main():
    arguments = parse_arguments()
    program = find_program(arguments.devo_offline)
    texts = (read_variants(arguments.variants) if arguments.variants else []) + arguments.variant
    always = shlex.split(arguments.always)
    variants = [(text.split(':', 1)[0].strip(), always + shlex.split(text.split(':', 1)[1] if ':' in text else ''))
                for text in texts] or [('default', always)]
    cases = [(rate, variant) for rate in arguments.depth_rate for variant in variants]
    if arguments.wide:  # the rates of a variant side by side
        cases = [(rate, variant) for variant in variants for rate in arguments.depth_rate]
    recordings = select(arguments.data, arguments.recordings, arguments.only)
    jobs = [(recording, *case) for recording in recordings for case in cases]
    failed = 0

    def counted(results):
        nonlocal failed
        for result in results:
            failed += result[1] != 0
            yield result

    with results_folder(arguments.out) as out, concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        results = counted(pool.map(lambda job: run(program, arguments.data, out, job), jobs))
        table = summary(results, arguments.summary) if arguments.summary else wide(results) if arguments.wide else full(results)
        for line in table:
            print(line, flush=True)
    if failed:
        sys.exit(f'{failed} of {len(jobs)} runs failed')


if __name__ == '__main__':
    main()
