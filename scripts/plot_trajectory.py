#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws a trajectory from above, over the map where given, and its coordinates and error over time.

    plot_trajectory.py trajectory.txt --out plot.png [--groundtruth truth.txt] [--map map.pcd]

Trajectories are TUM files (t tx ty tz qx qy qz qw) of the event camera in its world frame, whose first pose looks
along z, x right, y down. Ground truth is moved into that frame by the rigid alignment of the two."""
import argparse
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")  # no display needed
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402


def read_tum(path):
    """Times (n) and positions (n, 3), sorted by time."""
    try:
        rows = np.atleast_2d(np.loadtxt(path, comments="#"))
    except (OSError, ValueError) as error:
        sys.exit(f"plot_trajectory.py: {path}: {error}")
    if rows.shape[1] != 8:
        sys.exit(f"plot_trajectory.py: {path}: expected eight numbers per line (t tx ty tz qx qy qz qw)")
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return rows[:, 0], rows[:, 1:4]


def read_pcd(path):
    """Positions (n, 3) of a PCD file, ascii or binary."""
    raw = pathlib.Path(path).read_bytes()
    header, data, offset = {}, "", 0
    while not data:
        end = raw.index(b"\n", offset)
        words = raw[offset:end].decode("ascii").split()
        offset = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
            data = words[1] if words[0] == "DATA" else ""
    fields, points = header["FIELDS"], int(header["POINTS"][0])
    size, kinds = [int(s) for s in header["SIZE"]], header["TYPE"]
    column = [fields.index(axis) for axis in "xyz"]
    if data == "ascii":
        rows = np.loadtxt(raw[offset:].decode("ascii").splitlines(), ndmin=2)
        return rows[:, column] if points else np.empty((0, 3))
    if data != "binary":
        sys.exit(f"plot_trajectory.py: {path}: DATA {data}, expected ascii or binary")
    codes = {("F", 4): "<f4", ("F", 8): "<f8", ("U", 1): "u1", ("U", 2): "<u2", ("U", 4): "<u4",
             ("I", 1): "i1", ("I", 2): "<i2", ("I", 4): "<i4"}
    layout = np.dtype([(f"{name}{i}", codes[kinds[i], size[i]]) for i, name in enumerate(fields)])
    table = np.frombuffer(raw, layout, points, offset)
    return np.stack([table[layout.names[i]].astype(float) for i in column], axis=1)


def interpolate(t, t_truth, p_truth):
    inside = (t >= t_truth[0]) & (t <= t_truth[-1])
    return inside, np.stack([np.interp(t[inside], t_truth, p_truth[:, i]) for i in range(3)], axis=1)


def align(moving, fixed):
    """R, t of the rigid transformation that brings `moving` closest to `fixed` (Umeyama 1991 without scale)."""
    mean_m, mean_f = moving.mean(0), fixed.mean(0)
    u, _, vt = np.linalg.svd((fixed - mean_f).T @ (moving - mean_m))
    sign = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ sign @ vt
    return rotation, mean_f - rotation @ mean_m


def draw(arguments):
    t, p = read_tum(arguments.trajectory)
    figure, (above, over_time, error_axes) = plt.subplots(
        1, 3, figsize=(15, 4.8), gridspec_kw={"width_ratios": [1.2, 1.2, 1]}, constrained_layout=True)

    if arguments.map:
        points = read_pcd(arguments.map)
        if len(points):
            # The few farthest points would shrink the picture of all others.
            low, high = np.percentile(points, [1, 99], axis=0)
            near = np.all((points >= low) & (points <= high), axis=1)
            above.scatter(points[near, 0], points[near, 2], s=0.3, c="0.6", linewidths=0, label="map")

    if arguments.groundtruth:
        t_truth, p_truth = read_tum(arguments.groundtruth)
        inside, truth = interpolate(t, t_truth, p_truth)
        if inside.sum() < 3:
            sys.exit(f"plot_trajectory.py: {arguments.groundtruth} and {arguments.trajectory} overlap in less than "
                     f"3 poses ({t_truth[0]:.3f}..{t_truth[-1]:.3f} s and {t[0]:.3f}..{t[-1]:.3f} s)")
        rotation, shift = align(truth, p[inside])
        truth = truth @ rotation.T + shift
        above.plot(truth[:, 0], truth[:, 2], "k-", lw=1, label="ground truth")
        for i in range(3):
            over_time.plot(t[inside] - t[0], truth[:, i], "k-", lw=0.8, label="ground truth" if i == 0 else None)
        error_mm = 1e3 * np.linalg.norm(p[inside] - truth, axis=1)
        error_axes.plot(t[inside] - t[0], error_mm, "C3-", lw=1)
        error_axes.set(title=f"position error after alignment, RMSE {np.sqrt(np.mean(error_mm ** 2)):.1f} mm",
                       xlabel="time, s", ylabel="error, mm")
        error_axes.set_ylim(bottom=0)
    else:
        error_axes.set_axis_off()

    above.plot(p[:, 0], p[:, 2], "C0-", lw=1.5, label="DEVO")
    above.plot(p[0, 0], p[0, 2], "C0o", ms=5)
    above.set(title="from above (first view looks up)", xlabel="x (right), m", ylabel="z (forward), m")
    above.set_aspect("equal", adjustable="datalim")
    above.legend(loc="best", fontsize="small")
    for i, axis in enumerate("xyz"):
        over_time.plot(t - t[0], p[:, i], f"C{i}-", lw=1.2, label=axis)
    over_time.set(title="position", xlabel="time, s", ylabel="m")
    over_time.legend(loc="best", fontsize="small")
    figure.savefig(arguments.out, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trajectory", help="TUM file")
    parser.add_argument("--groundtruth", help="TUM file")
    parser.add_argument("--map", help="PCD file in the frame of the trajectory")
    parser.add_argument("--out", required=True, help="picture to write (.png, .pdf, .svg)")
    draw(parser.parse_args())


if __name__ == "__main__":
    main()
