#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws how cost grows with resolution, event rate and points, from the JSON of scripts/benchmark.sh.

    scripts/plot_performance.py build/benchmark.json docs/images/performance.png
"""
import json
import re
import sys

import matplotlib

matplotlib.use("Agg")  # no display needed
import matplotlib.pyplot as plt  # noqa: E402

TO_MS = {"ns": 1e-6, "us": 1e-3, "ms": 1.0, "s": 1e3}
STAGES = [("RenderSurface/motion_compensated", "surface"), ("NearestEdgeField", "of which the field"),
          ("RenderSurface/exponential", "exponential surface"), ("WarpDepth", "depth warp"),
          ("MakeLocalMap", "depth to map")]


def read(path):
    """(family, {argument: value}, milliseconds) of every benchmark that ran."""
    with open(path, encoding="utf-8") as file:
        report = json.load(file)
    runs = []
    for run in report["benchmarks"]:
        if run.get("error_occurred") or run.get("run_type") == "aggregate":
            continue
        arguments = {key: int(value) for key, value in re.findall(r"/(\w+):(\d+)", run["name"])}
        family = re.split(r"/\w+:", run["name"])[0]
        time = run["real_time" if "manual_time" in run["name"] else "cpu_time"] * TO_MS[run["time_unit"]]
        runs.append((family, arguments, time))
    return runs


def curve(axes, points, label):
    if points:
        axes.plot(*zip(*sorted(points)), marker="o", label=label)


def finish(axes, title, x, y):
    axes.set(title=title, xlabel=x, ylabel=y)
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.grid(True, which="both", alpha=0.25)
    if axes.lines:
        axes.legend(fontsize=7, loc="best")


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    runs = read(sys.argv[1])
    figure, (resolution, rate, points) = plt.subplots(1, 3, figsize=(12, 3.8))
    for family, label in STAGES:
        curve(resolution, [(a["width"] * a["height"] / 1e6, t) for f, a, t in runs if f == family and "width" in a], label)
    finish(resolution, "stages", "megapixels (events grow with them)", "ms")
    whole = [(a, t) for f, a, t in runs if f == "OdometryPerSecond" and a.get("threads", 1) == 1]
    for width, height in sorted({(a["width"], a["height"]) for a, _ in whole}):
        curve(rate, [(a["Mev_s"], t) for a, t in whole if (a["width"], a["height"]) == (width, height)],
              f"{width}x{height}")
    finish(rate, "whole odometry", "million events per second", "CPU ms per second of data")
    curve(points, [(a["points"], t) for f, a, t in runs if f == "AlignPoints"], "alignment")
    finish(points, "alignment to convergence", "points asked for", "ms")
    figure.tight_layout()
    figure.savefig(sys.argv[2], dpi=80)


if __name__ == "__main__":
    main()
