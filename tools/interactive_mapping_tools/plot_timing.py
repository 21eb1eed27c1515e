# SPDX-License-Identifier: BSD-3-Clause
"""Plots the timing.csv of map_sequence: milliseconds per frame by stage, and below it the points of the map."""

import csv
import pathlib

import numpy as np

from .cli import Refusal, one_line_errors, parser_of
from .style import INK, RED, REST, SEQUENCE, plt, save, tidy

NEEDED = ("frame", "total_ms", "deleted", "map_points")


def read_timing(path):
    """Returns {column: array}; all columns of the file, as numbers."""
    try:
        with open(path, newline="", encoding="utf-8") as stream:
            rows = list(csv.reader(stream, skipinitialspace=True))
    except UnicodeDecodeError:
        raise Refusal(f"{path}: not a text file") from None
    rows = [row for row in rows if row]
    header = [name.strip() for name in rows[0]] if rows else []
    missing = [name for name in NEEDED if name not in header]
    if missing:
        raise Refusal(f"{path}: not a timing table: column {', '.join(missing)} is missing")
    if len(rows) < 2:
        raise Refusal(f"{path}: no frame in it")
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            raise Refusal(f"{path}:{number}: {len(row)} values, {len(header)} expected")
    try:
        table = np.array(rows[1:], dtype=float)
    except ValueError as error:
        raise Refusal(f"{path}: {error}") from None
    return {name: table[:, column] for column, name in enumerate(header)}


def stages_of(timing):
    """[(name, ms per frame)] in the file's order, with what no stage accounts for as the last."""
    stages = [(name[:-3].replace("_", " "), values) for name, values in timing.items() if name.endswith("_ms") and name != "total_ms"]
    rest = timing["total_ms"] - sum((values for _, values in stages), np.zeros_like(timing["total_ms"]))
    if not stages or np.median(np.maximum(rest, 0.0)) > 0.01 * np.median(timing["total_ms"]):
        stages.append(("other", np.maximum(rest, 0.0)))
    return stages


def plot(timing, out, title):
    frames = timing["frame"]
    step = np.median(np.diff(frames)) if len(frames) > 1 else 1.0
    figure, (upper, lower) = plt.subplots(2, 1, figsize=(11.0, 6.8), sharex=True, constrained_layout=True,
                                           gridspec_kw={"height_ratios": [3, 2]})

    base = np.zeros_like(frames)
    for number, (name, values) in enumerate(stages_of(timing)):
        colour = REST if name == "other" else SEQUENCE[number % len(SEQUENCE)]
        upper.bar(frames, values, width=0.9 * step, bottom=base, color=colour, label=name, linewidth=0)
        base = base + values
    median = float(np.median(timing["total_ms"]))
    upper.axhline(median, color=INK, linewidth=1.2, linestyle="--", label=f"median of the total: {median:.3g} ms")
    # One slow frame must not flatten the others; say so where it is cut.
    highest, usual = float(base.max()), float(np.percentile(base, 95))
    if highest > 4.0 * usual:
        upper.set_ylim(0.0, 2.0 * usual)
        for frame, value in zip(frames[base > 2.0 * usual], base[base > 2.0 * usual]):
            upper.annotate(f"{value:.0f} ms", (frame, 2.0 * usual), ha="center", va="bottom", fontsize=10, annotation_clip=False)
    upper.set_ylabel("time per frame [ms]")
    handles, labels = upper.get_legend_handles_labels()
    upper.legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5))
    upper.set_title(title, fontsize=14, loc="left", pad=16 if highest > 4.0 * usual else 8)

    lower.plot(frames, timing["map_points"], color=INK, linewidth=2.0, label="points in the map")
    lower.set_ylabel("points in the map")
    lower.set_ylim(bottom=0)
    lower.set_xlabel("frame")
    changes = lower.twinx()
    if "inserted" in timing:
        changes.bar(frames - 0.2 * step, timing["inserted"], width=0.4 * step, color="#8fbf7f", label="inserted in this frame")
    changes.bar(frames + 0.2 * step, timing["deleted"], width=0.4 * step, color=RED, label="deleted in this frame")
    # The first frame inserts everything; the scale is for the later ones.
    later = np.concatenate([timing[name][1:] for name in ("inserted", "deleted") if name in timing] or [np.zeros(1)])
    changes.set_ylim(0.0, 2.2 * max(1.0, float(later.max()) if len(later) else 1.0))
    changes.set_ylabel("points per frame")
    lower.set_zorder(changes.get_zorder() + 1)
    lower.patch.set_visible(False)
    first, second = lower.get_legend_handles_labels(), changes.get_legend_handles_labels()
    lower.legend(first[0] + second[0], first[1] + second[1], loc="center left", bbox_to_anchor=(1.13, 0.5))
    changes.spines["right"].set_visible(True)
    upper.set_xlim(frames[0] - step, frames[-1] + step)
    tidy(upper)
    lower.xaxis.get_major_locator().set_params(integer=True)
    save(figure, out)


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("timing", type=pathlib.Path, metavar="TIMING.csv")
    parser.add_argument("--out", required=True, type=pathlib.Path, metavar="PNG")
    parser.add_argument("--title", default="Map update, time by stage")
    arguments = parser.parse_args()
    plot(read_timing(arguments.timing), arguments.out, arguments.title)
    print(arguments.out)
