# SPDX-License-Identifier: BSD-3-Clause
"""What a mission of the simulation cost the machine: processor time by process and state of the mission, and by what its clock waited for.

  scripts/plot_speed.py RUN_FOLDER [EARLIER_RUN_FOLDER ...] [--picture PNG]

Reads processor.csv and clock.csv, which scripts/run_mission leaves in the folder, also of a mission that still runs. Tables go to the terminal.
The picture shows one pick cycle, from one pick's end to the next: the wall time that each 0.2 s took, by what was waited for.
"""

import collections
import pathlib
import statistics

import numpy as np

from .cli import Refusal, one_line_errors, parser_of
from .results import markdown, number, read_rows
from .style import INK, SEQUENCE, plt, save, tidy

SHOWN_STATES = 7
MIN_LABEL = 0.04  # share of the cycle that a state takes whose name has room


class Run:
    """Of one folder. costs: {(state, process): processor s}; lengths: {state: simulated s}; ends: [(time, state left)]."""

    def __init__(self, folder):
        self.name = folder.name
        try:
            rows = read_rows(folder / "processor.csv", ("state", "process"))
            self.clock = read_rows(folder / "clock.csv", ("waited_for",))
        except (TypeError, ValueError) as error:
            raise Refusal(f"{folder}: a damaged table: {error}") from None
        self.costs, self.lengths, self.ends = collections.Counter(), collections.Counter(), []
        before, before_s = {}, None
        for row in rows:
            if not self.ends or row["time_s"] != self.ends[-1][0]:
                before_s = self.ends[-1][0] if self.ends else None
                self.ends.append((row["time_s"], row["state"]))
                if before_s is not None:
                    self.lengths[row["state"]] += row["time_s"] - before_s
            process, used_s = row["process"], row["processor_s"]
            if before_s is not None:  # one that is started anew begins at zero
                self.costs[row["state"], process] += used_s - before[process] if used_s >= before.get(process, np.inf) else used_s
            before[process] = used_s
        self.length_s = sum(self.lengths.values())
        if not self.length_s > 0.0:
            raise Refusal(f"{folder}/processor.csv: the mission has to leave two states at least")
        self.processes = sorted({process for _, process in self.costs}, key=lambda process: -self.cost(process))

    def cost(self, process, state=None):
        """Processor seconds per simulated second; of all states, or of one; of all processes if it is None."""
        used = sum(value for (of_state, of_process), value in self.costs.items() if process in (None, of_process) and state in (None, of_state))
        return used / (self.length_s if state is None else self.lengths[state])

    def waits(self):
        """{what: wall seconds per simulated second}, the longest first."""
        used = collections.Counter()
        for row in self.clock:
            if self.ends[0][0] <= row["time_s"] <= self.ends[-1][0]:
                used[row["waited_for"]] += row["wall_s"]
        return {what: wall_s / self.length_s for what, wall_s in used.most_common()}

    def cycle(self):
        """(begin, end) [s] of the pick cycle of median length."""
        picks = [time_s for time_s, state in self.ends if state == "pick"]
        cycles = sorted((end - begin, begin, end) for begin, end in zip(picks, picks[1:]))
        if not cycles:
            raise Refusal(f"{self.name}: two picks are needed for a picture")
        return cycles[(len(cycles) - 1) // 2][1:]


def tables(runs):
    run = runs[0]
    states = [state for state, _ in run.lengths.most_common(SHOWN_STATES)]
    rows = [["processor s per simulated s", *(f"all, {one.name}" for one in runs), *states]]
    for process in [*run.processes, None]:
        rows.append([process or "**together**", *(number(one.cost(process), ".3f") for one in runs), *(number(run.cost(process, state), ".3f") for state in states)])
    rows.append(["share of the time", *("" for _ in runs), *(f"{100.0 * run.lengths[state] / run.length_s:.0f} %" for state in states)])
    waits = [one.waits() for one in runs]
    waited = [["wall s per simulated s, the clock waiting for", *(one.name for one in runs)]]
    waited += [[what, *(number(one.get(what, 0.0), ".3f") for one in waits)] for what in waits[0]]
    waited.append(["**together**", *(number(sum(one.values()), ".3f") for one in waits)])
    return markdown(rows) + "\n\n" + markdown(waited)


def draw(run, out):
    begin_s, end_s = run.cycle()
    rows = [row for row in run.clock if begin_s <= row["time_s"] < end_s]
    times = sorted({row["time_s"] for row in rows})
    if len(times) < 2:
        raise Refusal(f"{run.name}/clock.csv: nothing of the cycle from {begin_s:.1f} s to {end_s:.1f} s")
    width_s = statistics.median(np.diff(times))
    totals = collections.Counter()
    for row in rows:
        totals[row["waited_for"]] += row["wall_s"]
    figure, axes = plt.subplots(figsize=(13.0, 5.5), constrained_layout=True)
    base = dict.fromkeys(times, 0.0)
    for index, (what, total_s) in enumerate(totals.most_common()):
        ours = [row for row in rows if row["waited_for"] == what]
        axes.bar([row["time_s"] for row in ours], [1000.0 * row["wall_s"] for row in ours], width_s, [1000.0 * base[row["time_s"]] for row in ours], align="edge",
                 color=SEQUENCE[index % len(SEQUENCE)], label=f"{what}: {total_s:.2f} s", linewidth=0)
        for row in ours:
            base[row["time_s"]] += row["wall_s"]
    since_s = begin_s
    for time_s, state in run.ends:
        if begin_s < time_s <= end_s:
            axes.axvline(time_s, color=INK, linewidth=0.8)
            if time_s - since_s > MIN_LABEL * (end_s - begin_s):
                axes.text(0.5 * (since_s + time_s), 1.01, state, transform=axes.get_xaxis_transform(), ha="center", fontsize=9)
            since_s = time_s
    axes.set_xlim(begin_s, end_s)
    axes.legend(title="the clock waits for", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    tidy(axes, None, "simulated time [s]", f"wall time of {width_s:.1f} s [ms]")
    save(figure, out)


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("runs", nargs="+", type=pathlib.Path, metavar="RUN_FOLDER")
    parser.add_argument("--picture", type=pathlib.Path, metavar="PNG")
    arguments = parser.parse_args()
    runs = [Run(folder) for folder in arguments.runs]
    print(tables(runs))
    if arguments.picture:
        draw(runs[0], arguments.picture)
