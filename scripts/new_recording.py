# SPDX-License-Identifier: BSD-3-Clause
"""Command line of the scripts that write a recording anew."""
import argparse
import os
import sys


def parser(description):
    result = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument('source', help='bag')
    result.add_argument('target', help='bag that is written')
    return result


def expect_new(target):
    if os.path.exists(target):
        sys.exit(f"'{target}' exists; expected the name of a new bag")


def expect_events(found, source):
    if not found:
        sys.exit(f"'{source}' holds no EventArray")
