#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Counts the results of gtest and rostest under a folder, lists what failed, and ends with one line
`N passed, N failed`. Exit status 1 when a test failed or none ran."""
import pathlib
import sys
import xml.etree.ElementTree as ElementTree


def read_cases(path):
    """[(name, state, message)] of one result file."""
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        return [(path.stem, "failed", f"unreadable result {path}: {error}")]
    cases = []
    for case in root.iter("testcase"):
        name = f"{case.get('classname', path.stem)}.{case.get('name')}"
        bad = case.find("failure") if case.find("failure") is not None else case.find("error")
        if bad is not None:
            cases.append((name, "failed", bad.get("message") or bad.text or ""))
        elif case.find("skipped") is not None or case.get("result") == "skipped" or case.get("status") == "notrun":
            cases.append((name, "skipped", ""))
        else:
            cases.append((name, "passed", ""))
    return cases


def collect(folder):
    """A rostest writes one file of its own with one case per test node (rostest-*.xml), beside the node's
    results (rosunit-<node>.xml). The former counts only where the latter does not tell the same."""
    paths = sorted(folder.rglob("*.xml"))
    cases, nodes = [], {}
    for path in paths:
        if path.name.startswith("rostest-"):
            continue
        found = read_cases(path)
        cases += found
        if path.name.startswith("rosunit-"):
            nodes[path.stem[len("rosunit-"):]] = any(state == "failed" for _, state, _ in found)
    for path in paths:
        if not path.name.startswith("rostest-"):
            continue
        for name, state, message in read_cases(path):
            node = name.rsplit(".", 1)[-1]
            node = node[len("test"):] if node.startswith("test") else node
            if node not in nodes or (state == "failed" and not nodes[node]):
                cases.append((f"{path.stem}: {name}", state, message))
    return cases


def main():
    cases = collect(pathlib.Path(sys.argv[1]))
    count = {state: sum(1 for case in cases if case[1] == state) for state in ("passed", "failed", "skipped")}
    for name, state, message in cases:
        if state == "failed":
            print(f"FAILED {name}\n    " + message.strip().replace("\n", "\n    "))
    for name, state, _ in cases:
        if state == "skipped":
            print(f"skipped {name}")
    if not cases:
        print("no test has run")
    line = f"{count['passed']} passed, {count['failed']} failed"
    if count["skipped"]:
        line += f", {count['skipped']} skipped"
    print(line, flush=True)
    return 1 if count["failed"] or not cases else 0


if __name__ == "__main__":
    sys.exit(main())
