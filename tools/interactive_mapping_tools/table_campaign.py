# SPDX-License-Identifier: BSD-3-Clause
"""Tables of a campaign's missions.csv: for each scene and cycle the mean of each variant and its difference to the first variant.

Brackets hold 95 % bootstrap intervals of the mean. A difference is that of missions with the same seed. Where its interval holds 0 it
shows nothing.
"""

import csv
import math
import pathlib
import statistics

import numpy as np

from .cli import Refusal, one_line_errors, parser_of

CELL = ("scene", "cycle", "variant", "seed")
MEASURES = ("bricks_stowed", "bricks_total", "map_coverage", "map_precision", "falls", "drops", "collisions", "load_contacts", "sim_seconds", "views", "distance_m", "disturbance_m",
            "picks_begun", "wall_seconds")
ORIGIN = ("date", "commit", "software", "configuration", "host", "machine")
COLUMNS = (*CELL, *MEASURES, "end_reason", *ORIGIN)
BROKEN = (ValueError, KeyError, TypeError, AttributeError, ArithmeticError)
NUM_RESAMPLES = 10000


def words_of(error):
    """In one line: YAML's errors have several."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def checked(summary):
    """The summary of a mission; raises one of BROKEN if the tables cannot be made of it."""
    numbers = [summary[key] for key in MEASURES if summary[key] is not None]
    if not all(math.isfinite(float(number)) for number in numbers) or summary["bricks_stowed"] is None or not summary["bricks_total"] > 0:
        raise ValueError("no judged mission")
    return summary


def row_of(cell, summary):
    return {**{key: cell[key] for key in CELL}, **{key: summary[key] for key in (*MEASURES, "end_reason")}, **{key: summary["origin"].get(key) for key in ORIGIN}}


def read_rows(path):
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        for row in rows:
            row.update({key: float(row[key]) if row[key] != "" else math.nan for key in MEASURES}, bricks=100.0 * float(row["bricks_stowed"]) / float(row["bricks_total"]))
        states = sorted({row["software"] for row in rows})
        if len(states) != 1:
            raise ValueError(f"missions of {len(states)} states of the software: {', '.join(states) or 'none'}; must be of one")
        cells = [tuple(row[key] for key in CELL) for row in rows]
        if len(set(cells)) != len(cells):
            raise ValueError(f"{statistics.mode(cells)} is there twice")
    except BROKEN as error:
        raise Refusal(f"{path}: {words_of(error)}") from error
    return rows


def interval(values):
    """95 % bootstrap interval of the mean (percentiles), the same in each call."""
    values = np.asarray(values, dtype=float)
    means = values[np.random.default_rng(1).integers(len(values), size=(NUM_RESAMPLES, len(values)))].mean(axis=1)
    return np.percentile(means, (2.5, 97.5), method="inverted_cdf")


def with_interval(values, form=".1f"):
    values = [value for value in values if not math.isnan(value)]
    if not values:
        return "-"
    mean = format(statistics.fmean(values), form)
    return mean if len(values) == 1 else "{} [{}, {}]".format(mean, *(format(end, form) for end in interval(values)))


def print_tables(path):
    rows = read_rows(path)
    for scene, cycle in dict.fromkeys((row["scene"], row["cycle"]) for row in rows):
        of_scene = [row for row in rows if (row["scene"], row["cycle"]) == (scene, cycle)]
        print(f"\n{scene}, cycle {cycle}\n\n| | n | bricks % | difference | map % | precision % | falls | collisions | load contacts | disturbance m | picks begun | views | ended by |\n"
              "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|")
        first = None
        for variant in dict.fromkeys(row["variant"] for row in of_scene):
            runs = {row["seed"]: row for row in of_scene if row["variant"] == variant}
            first = first or runs
            pairs = [] if first is runs else [runs[seed]["bricks"] - first[seed]["bricks"] for seed in runs if seed in first]

            def column(key, scale=1.0, runs=runs):
                return with_interval([scale * row[key] for row in runs.values()])

            print(f"| {variant} | {len(runs)} | {column('bricks')} | {with_interval(pairs, '+.1f')} | {column('map_coverage', 100)} | {column('map_precision', 100)} | "
                  f"{column('falls')} | {column('collisions')} | {column('load_contacts')} | {column('disturbance_m')} | {column('picks_begun')} | {column('views')} | "
                  f"{', '.join(sorted({row['end_reason'] for row in runs.values()}))} |")


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("csv", type=pathlib.Path, help="missions.csv of a campaign's folder")
    print_tables(parser.parse_args().csv)
