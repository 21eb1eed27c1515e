# SPDX-License-Identifier: BSD-3-Clause
"""Counts test cases, each once, in catkin's result files and prints `N passed, M failed` as its last line.

gtest-*.xml and rosunit-*.xml hold the cases. rostest-*.xml looks at them from outside (did the node start, did it end
in time): it counts only where that failed. MISSING-*.xml stands for a program that crashed before it could report.
"""

import argparse
import pathlib
import xml.etree.ElementTree as ElementTree


def read_cases(path):
    """Yields (name, outcome) with outcome passed, failed or skipped; an unreadable file is one failure."""
    try:
        tree = ElementTree.parse(path)
    except (ElementTree.ParseError, OSError) as error:
        yield f"{path.name}: {error}", "failed"
        return
    for case in tree.getroot().iter("testcase"):
        name = f"{case.get('classname')}.{case.get('name')}"
        if case.find("failure") is not None or case.find("error") is not None:
            yield name, "failed"
        elif case.find("skipped") is not None or case.get("status") == "notrun":
            yield name, "skipped"
        else:
            yield name, "passed"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=pathlib.Path, help="catkin's test_results folder")
    parser.add_argument("--ctest-exit-code", type=int, default=0, help="a failure here must show in the count")
    parser.add_argument("--also-failed", type=int, default=0, help="failures found elsewhere (repository checks)")
    arguments = parser.parse_args()

    counts = {"passed": 0, "failed": 0, "skipped": 0}
    for path in sorted(arguments.results.rglob("*.xml")):
        is_wrapper = path.name.startswith("rostest-")
        for name, outcome in read_cases(path):
            if is_wrapper and outcome != "failed":
                continue
            counts[outcome] += 1
            if outcome == "failed":
                print(f"FAILED {name} ({path.relative_to(arguments.results)})")

    if arguments.ctest_exit_code != 0 and counts["failed"] == 0:
        counts["failed"] += 1
        print(f"FAILED ctest ended with code {arguments.ctest_exit_code}, but no test case says why; see its output above")
    if arguments.also_failed:
        counts["failed"] += arguments.also_failed
        print(f"FAILED repository checks: {arguments.also_failed} (see above)")
    if counts["passed"] + counts["failed"] == 0:
        print("No test ran: that is not a success.")
    skipped = f", {counts['skipped']} skipped" if counts["skipped"] else ""
    print(f"{counts['passed']} passed, {counts['failed']} failed{skipped}")
    return 0 if counts["failed"] == 0 and counts["passed"] > 0 else 1
