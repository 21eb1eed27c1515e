# SPDX-License-Identifier: BSD-3-Clause
"""Plot and page of what scripts/soak measured in its parts loop and fuzz."""

import csv
import os
import pathlib

from .cli import Refusal, one_line_errors, parser_of
from .results import markdown, read_machine, read_rows
from .style import BLUE, GREY, RED, plt, save, tidy

PANELS = (("resident_mb", "heap_used_mb"), ("points",), ("ms_per_frame",))
LABELS = {"resident_mb": "resident [MB]", "heap_used_mb": "heap in use [MB]", "points": "points in the map", "ms_per_frame": "map update [ms]"}
COLOURS = {"resident_mb": BLUE, "heap_used_mb": "#6ea6ab", "points": RED, "ms_per_frame": GREY}


def plot(rows, out):
    figure, axes = plt.subplots(len(PANELS), 1, figsize=(9.0, 7.5), sharex=True, constrained_layout=True)
    frames = [row["frame"] for row in rows]
    for panel, names in zip(axes, PANELS):
        for name in names:
            panel.plot(frames, [row[name] for row in rows], color=COLOURS[name], linewidth=1.2, label=LABELS[name])
        panel.set_ylim(bottom=0)
        panel.axvspan(0, 0.1 * frames[-1], color="#eeeeee", linewidth=0)
        panel.legend(loc="lower right", fontsize=11)
        tidy(panel)
    axes[-1].set_xlabel("frame (grey: warm-up, not judged)")
    save(figure, out, 90)


def origin(machine):
    if not machine:
        return "Machine not recorded."
    return (f"Measured {machine.get('date', '?')} at commit {machine.get('commit', '?')} on {machine.get('processor', '?')}; "
            f"{machine.get('compiler', '?')}; load {machine.get('load', '?')}.")


def loop_part(folder, rows, image):
    text = folder / "loop.txt"
    lines = text.read_text(encoding="utf-8").splitlines() if text.is_file() else []
    verdict = [line for line in lines if "at most" in line or line.startswith("FAILED") or line.endswith("flat")]
    if not verdict:
        verdict = ["The run was interrupted; judge it with soak_map --judge results/soak/loop.csv."]
    last = rows[-1]
    body = "\n".join(verdict)
    return (f"## Endurance: {last['frame']:.0f} frames\n\n`scripts/soak loop`. {origin(read_machine(folder / 'loop-machine.txt'))}\n\n"
            "One map, 160 x 120 px. A camera circles a pile whose bricks leave and return every 250 frames, with fresh noise in every "
            f"image and pose. {last['inserted']:.0f} points were inserted, {last['deleted']:.0f} deleted. Queries, mesh, saving and loading "
            "run beside it. Memory and contents are compared at the same phase of the scene, after 10 % of warm-up. The median of the "
            f"first half is compared with that of the last. The Theil-Sen slope is over the run.\n\n```\n{body}\n```\n\n![Memory, points and time over the run]({image})\n")


def fuzz_part(folder):
    totals = {}
    with (folder / "fuzz.csv").open(encoding="utf-8", newline="") as file:
        for name, seed, _, inputs, accepted, refused, seconds, result in csv.reader(file):
            entry = totals.setdefault(name, {"seeds": set(), "inputs": 0, "accepted": 0, "refused": 0, "seconds": 0.0, "failed": 0})
            entry["seeds"].add(seed)
            for key, value in (("inputs", inputs), ("accepted", accepted), ("refused", refused)):
                entry[key] += int(value)
            entry["seconds"] += float(seconds)
            entry["failed"] += result != "passed"
    if not totals:
        raise Refusal("fuzz.csv: no results")
    names = ("inputs", "accepted", "refused", "seconds", "failed")
    whole = {name: sum(entry[name] for entry in totals.values()) for name in names}
    rows = [("target", "inputs", "accepted", "refused", "seconds", "pieces failed")]
    rows += [(target, *(f"{entry[name]:.0f}" for name in names)) for target, entry in (*sorted(totals.items()), ("**all**", whole))]
    seeds = ", ".join(sorted(set.union(*(entry["seeds"] for entry in totals.values()))))
    return (f"## Fuzzing: {whole['inputs']} inputs\n\n`scripts/soak fuzz`, address and undefined-behaviour sanitizers, seed {seeds}. "
            f"{origin(read_machine(folder / 'fuzz-machine.txt'))}\n\n" + markdown(rows) + "\n")


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=pathlib.Path, metavar="RESULTS", help="results/soak")
    parser.add_argument("--plot", type=pathlib.Path, metavar="PNG", required=True)
    parser.add_argument("--table", type=pathlib.Path, metavar="MD", required=True)
    parser.add_argument("--note", help="what a reader must know about these runs")
    arguments = parser.parse_args()
    loop, fuzz = (arguments.folder / name for name in ("loop.csv", "fuzz.csv"))
    if not loop.is_file() and not fuzz.is_file():
        raise Refusal(f"{arguments.folder}: neither loop.csv nor fuzz.csv")
    parts = ["# Long checks\n\nWritten by `scripts/soak --update-docs`; what the parts are: [testing.md](../testing.md#long-checks).\n"]
    if arguments.note:
        parts.append(arguments.note + "\n")
    try:
        if loop.is_file():
            rows = read_rows(loop)
            plot(rows, arguments.plot)
            parts.append(loop_part(arguments.folder, rows, os.path.relpath(arguments.plot, arguments.table.parent)))
        if fuzz.is_file():
            parts.append(fuzz_part(arguments.folder))
    except (ValueError, KeyError, TypeError) as error:
        raise Refusal(error) from error
    arguments.table.parent.mkdir(parents=True, exist_ok=True)
    arguments.table.write_text("\n".join(parts), encoding="utf-8")
    print(arguments.table)
