#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Prints the JSON of devo_benchmark as a markdown table with the limits of the machine's memory beside it:
insertion and decoding against random writes per second, surfaces against copying an image of 4 bytes per pixel."""
import json
import re
import sys

TO_MS = {"ns": 1e-6, "us": 1e-3, "ms": 1.0, "s": 1e3}
FIXED = {"name", "family_index", "per_family_instance_index", "run_name", "run_type", "repetitions",
         "repetition_index", "threads", "iterations", "real_time", "cpu_time", "time_unit", "items_per_second",
         "bytes_per_second", "error_occurred", "error_message", "label"}


def limit_of(name, run, copy_bytes_s, writes_s):
    if "items_per_second" in run and name != "MemoryRandomWrite" and writes_s:
        return f"{writes_s / 1e6:.0f} Mev/s ({100 * run['items_per_second'] / writes_s:.0f} %)"
    size = re.search(r"width:(\d+)/height:(\d+)", name)
    if name.startswith(("RenderSurface", "NearestEdgeField")) and size and copy_bytes_s:
        return f"{1e3 * 8 * int(size.group(1)) * int(size.group(2)) / copy_bytes_s:.2f} ms"
    return ""


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        report = json.load(file)
    runs = {run["name"]: run for run in report["benchmarks"] if run.get("run_type") != "aggregate"}
    copy_bytes_s = runs.get("MemoryCopy", {}).get("bytes_per_second")
    writes_s = runs.get("MemoryRandomWrite", {}).get("items_per_second")
    context = report["context"]
    print(f"{context['num_cpus']} cores at {context['mhz_per_cpu']} MHz, load {context.get('load_avg', ['?'])[0]:.1f}, "
          f"{context['date']}\n")
    print("| benchmark | time | rate | memory's limit | |\n|---|---|---|---|---|")
    for name, run in runs.items():
        if run.get("error_occurred"):
            print(f"| {name} | {run['error_message']} | | | |")
            continue
        # Manual time is the pipeline's CPU time.
        time_ms = run["real_time" if "manual_time" in name else "cpu_time"] * TO_MS[run["time_unit"]]
        rate = ""
        if "items_per_second" in run:
            rate = f"{run['items_per_second'] / 1e6:.1f} M/s"
        elif "bytes_per_second" in run:
            rate = f"{run['bytes_per_second'] / 1e9:.1f} GB/s"
        counters = ", ".join(f"{key} {value:.4g}" for key, value in run.items() if key not in FIXED)
        print(f"| {name} | {time_ms:.3f} ms | {rate} | {limit_of(name, run, copy_bytes_s, writes_s)} | {counters} |")


if __name__ == "__main__":
    main()
