# SPDX-License-Identifier: BSD-3-Clause
"""Plots of a mission's run folder: bricks and coverage over time, how views were chosen, where time went."""

import math
import pathlib
import sys

import numpy as np

from . import mission_run
from .cli import Refusal, one_line_errors, parser_of
from .mission_run import ACTIVITIES, FACTORS, number
from .style import BLUE, GREEN, INK, LIGHT, MUTED, ORANGE, RED, plt, save, tidy

ACTIVITY_COLOURS = ("#1d4f76", "#5c9a5a", "#dccb6e", "#a9c8a4", "#6ea6ab", "#8c6bb1", "#b9474b", "#c8c8c8")
FACTOR_COLOURS = ("#1d4f76", "#6ea6ab", "#5c9a5a", "#dccb6e", "#e0914f")
FACTOR_WORDS = {"manipulability": "what the arm can reach", "pick_order": "height of the pile", "travel": "short way",
                "uncertainty": "uncertain surface", "frontier": "border of the unseen"}


def time_unit(seconds, clock):
    """(divisor, label) that make a nice axis."""
    return (60.0, f"{clock} [min]") if seconds > 180.0 else (1.0, f"{clock} [s]")


def plot_progress(run, summary, out):
    """As the paper's Fig. 7: bricks over time, and how much of the pile the map had; without a judge what the mission counted. False if there
    is nothing to plot."""
    table, start_s = run.table, run.start_s()
    is_judged = bool(table.get("time_s"))
    told = [(number(row["time_s"]), number(row.get("bricks_picked"))) for row in run.log if math.isfinite(number(row.get("bricks_picked")))]
    if not is_judged and not told:
        return False
    told_time, picked = np.reshape(told, (-1, 2)).T
    time = np.array(table["time_s"] if is_judged else told_time) - start_s
    divisor, label = time_unit(time.max(), run.clock())
    total = mission_run.count_of(summary.get("bricks_total"))
    figure, all_axes = plt.subplots(1, 1 + is_judged, figsize=(12.5, 4.6), constrained_layout=True, squeeze=False)
    left, *others = all_axes[0]

    stowed = np.array(table.get("stowed", np.zeros(len(time)))) if is_judged else picked
    left.step(time / divisor, stowed, where="post", color=BLUE, linewidth=2.4, label="stowed (judge)" if is_judged else "picked (mission)")
    if told and picked[-1] != stowed[-1]:
        left.step((told_time - start_s) / divisor, picked, where="post", color=ORANGE, linewidth=1.4, linestyle="--", label="picked (mission)")
    if total:
        left.axhline(total, color=MUTED, linewidth=1.0, linestyle=":")
        left.text(0.0, total, f" all {total}", ha="left", va="bottom", fontsize=11, color=MUTED)
    for kind, marker, colour, words in (("fall", "v", RED, "brick fell"), ("drop", "X", ORANGE, "brick dropped"), ("collision", "*", "#8c1d1d", "collision")):
        times = [number(event.get("time_s")) - start_s for event in run.events if event.get("event") == kind]
        times = [t for t in times if math.isfinite(t)]
        if times:
            left.plot(np.array(times) / divisor, np.interp(times, time, stowed), linestyle="none", marker=marker, markersize=10, color=colour,
                      markeredgecolor="white", label=f"{words} ({len(times)})")
    left.set_ylim(0, 1.12 * max(total or 0, 1, *stowed[np.isfinite(stowed)], *picked))
    left.yaxis.get_major_locator().set_params(integer=True)
    left.set_ylabel("bricks")
    left.set_title("Bricks", loc="left", fontsize=14)

    for right in others:
        plot_map(table, time / divisor, right)
    for axes in (left, *others):
        tidy(axes)
        axes.set_xlim(0, max(time.max() / divisor, 1e-6))
        axes.set_xlabel(label)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="lower right")
    save(figure, out)
    return True


def plot_map(table, time, right):
    for name, colour, words in (("coverage", GREEN, "coverage (mapped / visible surface)"), ("precision", MUTED, "precision (true / mapped surface)")):
        values = 100.0 * np.array(table.get(name, np.full(len(time), np.nan)))
        if np.isfinite(values).any():
            there = np.isfinite(values)
            if name == "precision" and (values > 0.0).any():
                there[np.flatnonzero(values > 0.0)[-1] + 1:] = False  # no brick is left: all that a map holds, a crumb, is false
            last = values[there][-1]
            right.plot(time[there], values[there], color=colour, linewidth=2.4 if name == "coverage" else 1.4, label=f"{words} (at the end {last:.1f} %)")
    right.set_ylim(0, 105)
    right.set_ylabel("share of the surface [%]")
    right.set_title("Map against the truth", loc="left", fontsize=14)


def is_candidate(segment):
    return segment.get("verdict") in (0, "candidate", "CANDIDATE")


def spot_of(segment):
    """[x, y] of its midpoint [m], or None."""
    midpoint = segment.get("midpoint") if isinstance(segment, dict) else None
    spot = [number(value) for value in midpoint[:2]] if isinstance(midpoint, list) else []
    return spot if len(spot) == 2 and np.all(np.isfinite(spot)) else None


def plot_utilities(run, out):
    """What each choice of a view was made from. False if there was none."""
    if not run.selections:
        return False
    start_s = run.start_s()
    count = len(run.selections)
    weights, deciding = mission_run.weights_of(run.selections), mission_run.deciding_factors(run.selections)
    figure, (upper, lower) = plt.subplots(2, 1, figsize=(12.5, 7.4), sharex=True, constrained_layout=True)
    chosen, refused, none = [], [], []
    parts = {name: np.zeros(count) for name in FACTORS}
    for index, selection in enumerate(run.selections):
        segments = [segment for segment in selection["segments"] if isinstance(segment, dict)]
        utilities = np.array([number(segment.get("utility")) for segment in segments if is_candidate(segment)])
        utilities = utilities[np.isfinite(utilities)]
        if len(utilities):
            # The same spread for each run of the plot: only what lies on top of each other is drawn apart.
            spread = 0.16 * np.sin(2.4 * np.arange(len(utilities)))
            upper.plot(index + 1 + spread, utilities, linestyle="none", marker="o", markersize=3.2, color="#8fb3c9", alpha=0.55, markeredgewidth=0)
            upper.plot([index + 0.72, index + 1.28], [np.median(utilities)] * 2, color=MUTED, linewidth=1.2)
        best = mission_run.count_of(selection.get("best"))
        if best is not None and best < len(segments):
            segment = segments[best]
            # The best of them is told also where it was not worth going to.
            (chosen if selection.get("outcome", 0) == 0 else refused).append((index + 1, number(segment.get("utility"))))
            for name in FACTORS:
                parts[name][index] = number(segment.get(name + "_factor"), 0.0) * (weights[name] if weights else 1.0)
        else:
            none.append(index + 1)
    if chosen:
        upper.plot(*np.transpose(chosen), linestyle="none", marker="D", markersize=7, color=RED, markeredgecolor="white", label="chosen")
    if refused:
        upper.plot(*np.transpose(refused), linestyle="none", marker="D", markersize=7, markerfacecolor="white", markeredgecolor=RED, label="best, but too low: not gone to",
                   clip_on=False, zorder=4)
    upper.plot([], [], linestyle="none", marker="o", markersize=5, color="#8fb3c9", label="candidates")
    upper.plot([], [], color=MUTED, linewidth=1.2, label="their median")
    if none:
        upper.plot(none, np.zeros(len(none)), linestyle="none", marker="x", markersize=8, color=INK, label="nothing to choose", clip_on=False)
    upper.set_ylabel("utility")
    upper.set_title("Utility of the standing poses", loc="left", fontsize=14)

    base = np.zeros(count)
    for name, colour in zip(FACTORS, FACTOR_COLOURS):
        label = FACTOR_WORDS[name] + (f" (weight {weights[name]:.2g}, decides {deciding.get(name, 0.0):.0%})" if weights else "")
        lower.bar(np.arange(count) + 1, parts[name], width=0.66, bottom=base, color=colour, label=label, linewidth=0)
        base = base + parts[name]
    if weights and chosen + refused:
        lower.plot(*np.transpose(sorted(chosen + refused)), linestyle="none", marker="D", markersize=6, color=RED, markeredgecolor="white",
                   label="utility: less the failures nearby")
    lower.set_ylabel("information" if weights else "factors, without weights")
    lower.set_title("Factors of the best one", loc="left", fontsize=14)
    # Each choice with its time; of many, a few.
    step = max(1, int(np.ceil(count / 16)))
    ticks = np.arange(1, count + 1, step)
    times = [mission_run.duration(number(run.selections[tick - 1].get("time_s")) - start_s).split()[0] for tick in ticks]
    lower.set_xticks(ticks)
    lower.set_xticklabels([f"{tick}\n{time}" for tick, time in zip(ticks, times)])
    lower.set_xlabel(f"choice, and its {run.clock()} [min:s]")
    lower.set_xlim(0.3, count + 0.7)
    for axes in (upper, lower):
        tidy(axes)
        axes.set_ylim(bottom=0)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    save(figure, out)
    return True


def plot_time(run, out):
    """What the mission did when, and how long in all. False without a log."""
    periods = run.periods()
    if not periods:
        return False
    start_s = run.start_s()
    end_s = max(to_s for _, to_s, _ in periods)
    divisor, label = time_unit(end_s - start_s, run.clock())
    totals = np.zeros(len(ACTIVITIES))
    for from_s, to_s, index in periods:
        totals[index] += to_s - from_s
    shown = [index for index in np.argsort(-totals, kind="stable") if totals[index] > 0.0]
    figure, (strip, bars) = plt.subplots(2, 1, figsize=(12.5, 1.9 + 0.42 * len(shown)), constrained_layout=True,
                                         gridspec_kw={"height_ratios": [1.0, 0.42 * len(shown) + 0.2]})
    for from_s, to_s, index in periods:
        strip.axvspan((from_s - start_s) / divisor, (to_s - start_s) / divisor, color=ACTIVITY_COLOURS[index], linewidth=0)
    stows = [number(event.get("time_s")) for event in run.events if event.get("event") == "stow"]
    stows = [(time_s - start_s) / divisor for time_s in stows if start_s <= time_s <= end_s]
    if stows:
        triangles, = strip.plot(stows, np.full(len(stows), 1.12), linestyle="none", marker="v", markersize=6, color=INK, clip_on=False)
        triangles.set_in_layout(False)
    strip.set_ylim(0, 1)
    strip.set_xlim(0, (end_s - start_s) / divisor)
    strip.set_yticks([])
    strip.set_xlabel(label + (" (triangles: a brick is stowed)" if stows else ""))
    strip.set_title("What it did when", loc="left", fontsize=14, pad=14)
    strip.tick_params(color="#999999", labelcolor="#333333")
    for side in strip.spines.values():
        side.set_visible(False)

    rows = np.arange(len(shown))[::-1]
    bars.barh(rows, totals[shown] / divisor, color=[ACTIVITY_COLOURS[index] for index in shown], height=0.72)
    for row, index in zip(rows, shown):
        bars.text(totals[index] / divisor, row, f"  {mission_run.duration(totals[index])}, {100 * totals[index] / totals.sum():.0f} %", va="center", fontsize=11, color=INK)
    bars.set_yticks(rows)
    bars.set_yticklabels([ACTIVITIES[index][0] for index in shown])
    bars.tick_params(length=0, labelcolor="#333333")
    bars.set_xticks([])
    bars.set_xlim(0, 1.18 * totals.max() / divisor)
    for side in bars.spines.values():
        side.set_visible(False)
    save(figure, out)
    return True


def plot_places(run, out):
    """The outline of the pile from above at the first, a middle and the last choice. False if there was none."""
    usable = [selection for selection in run.selections if any(spot_of(s) and is_candidate(s) for s in selection["segments"])]
    if not usable:
        return False
    picks = sorted({0, len(usable) // 2, len(usable) - 1})
    start_s = run.start_s()
    spots = np.array([spot_of(s) for selection in usable for s in selection["segments"] if spot_of(s)])
    low, high = spots.min(axis=0) - 0.2, spots.max(axis=0) + 0.2
    highest = max(number(s.get("utility"), 0.0) for selection in usable for s in selection["segments"] if isinstance(s, dict) and is_candidate(s))
    figure, all_axes = plt.subplots(1, len(picks), figsize=(4.2 * len(picks) + 1.0, 4.4), constrained_layout=True, squeeze=False)
    points = None
    for axes, pick in zip(all_axes[0], picks):
        selection = usable[pick]
        segments = [s for s in selection["segments"] if spot_of(s)]
        others = [spot_of(s) for s in segments if not is_candidate(s)]
        candidates = [s for s in segments if is_candidate(s)]
        if others:
            axes.plot(*np.transpose(others), linestyle="none", marker="o", markersize=5, markerfacecolor="white", markeredgecolor="#aaaaaa", label="cannot stand there, or unseen")
        points = axes.scatter(*np.transpose([spot_of(s) for s in candidates]), c=[number(s.get("utility"), 0.0) for s in candidates],
                              cmap="viridis", vmin=0.0, vmax=max(highest, 1e-6), s=42, zorder=3)
        best = mission_run.count_of(selection.get("best"))
        spot = spot_of(selection["segments"][best]) if best is not None and best < len(selection["segments"]) else None
        if spot:
            axes.plot(*spot, marker="o", markersize=15, markerfacecolor="none", markeredgecolor=RED, markeredgewidth=2.2, linestyle="none", label="chosen", zorder=4)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_aspect("equal")
        axes.set_title(f"Choice {run.selections.index(selection) + 1}, {mission_run.duration(number(selection.get('time_s')) - start_s)}", fontsize=13, loc="left")
        axes.set_xlabel("x in the map [m]", fontsize=11)
        tidy(axes)
        axes.xaxis.grid(True, color=LIGHT)
    all_axes[0][0].set_ylabel("y in the map [m]", fontsize=11)
    handles = {label: handle for axes in all_axes[0] for handle, label in zip(*axes.get_legend_handles_labels())}
    if handles:
        figure.legend(handles.values(), handles.keys(), loc="lower left", ncol=2, bbox_to_anchor=(0.04, -0.06))
    bar = figure.colorbar(points, ax=list(all_axes[0]), shrink=0.8)
    bar.outline.set_visible(False)
    bar.set_label("utility", fontsize=11)
    save(figure, out, bbox_inches="tight")
    return True


def outline_of(selection):
    """(x, y) of the pile's outline from above, broken where it has gaps."""
    spots = np.array([spot_of(s) for s in selection["segments"] if spot_of(s)])
    closed = np.vstack([spots, spots[:1]])
    steps = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    broken = np.flatnonzero(steps > 2.5 * max(np.median(steps), 1e-6))  # several piles, or a side that is not known
    return np.insert(closed, broken + 1, np.nan, axis=0).T


def plot_path(run, out):
    """From above: the driven path, where the robot stood, the pile's outline. False if neither path nor poses are known."""
    driven = np.array([mission_run.pose_of(row["base"])[:2] for row in run.path])
    standing = run.standing_poses()
    if len(driven) < 2 and not standing:
        return False
    figure, axes = plt.subplots(figsize=(12.5, 6.4), constrained_layout=True)
    usable = [selection for selection in run.selections if any(map(spot_of, selection["segments"]))]
    outlines = [(usable[0], "#c9a24a", "pile at the first choice")] if usable else []
    outlines += [(usable[-1], RED, "pile at the last choice")] if len(usable) > 1 else []
    for selection, colour, words in outlines:
        axes.plot(*outline_of(selection), color=colour, linewidth=2.0, label=words)
    if len(driven) > 1:
        axes.plot(*driven.T, color="#7fa8c4", linewidth=1.6, label="driven path")
        axes.plot(*driven[0], marker="o", markersize=8, color="#7fa8c4", linestyle="none", label="start")
    if standing:
        poses = np.array([pose for _, pose in standing])
        if len(driven) < 2:
            axes.plot(*poses[:, :2].T, color="#bbbbbb", linewidth=1.2, linestyle="--", label="order (the path is not known)")
        length_m = 0.3
        axes.quiver(*poses[:, :2].T, length_m * np.cos(poses[:, 2]), length_m * np.sin(poses[:, 2]), angles="xy", scale_units="xy", scale=1.0, color=BLUE,
                    width=0.006, zorder=3)
        axes.plot(*poses[:, :2].T, marker="o", markersize=5, color=BLUE, linestyle="none", label="standing poses, in their order", zorder=3)
        last = {}  # of places that were stood at more than once, one label
        for index, (x_m, y_m, _) in enumerate(poses):
            last.setdefault((round(x_m, 1), round(y_m, 1)), []).append(index + 1)
        for (x_m, y_m), numbers in last.items():
            words = ", ".join(map(str, numbers[:4])) + (", ..." if len(numbers) > 4 else "")
            axes.annotate(words, (x_m, y_m), xytext=(7, 7), textcoords="offset points", fontsize=10, color=INK, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x in the map [m]", fontsize=11)
    axes.set_ylabel("y in the map [m]", fontsize=11)
    axes.set_title("From above", loc="left", fontsize=14)
    tidy(axes)
    axes.xaxis.grid(True, color=LIGHT)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    save(figure, out)
    return True


def draw(run, summary, out):
    """[path] of the plots there is something for. One that cannot be drawn is a note: the rest is of use without it."""
    drawn = []
    for name, plot in (("progress.png", lambda path: plot_progress(run, summary, path)), ("path.png", lambda path: plot_path(run, path)), ("time.png", lambda path: plot_time(run, path)),
                       ("utilities.png", lambda path: plot_utilities(run, path)), ("places.png", lambda path: plot_places(run, path))):
        try:
            with np.errstate(all="ignore"):
                if plot(out / name):
                    drawn.append(out / name)
        except OSError:
            raise  # nor can the page be written then
        except Exception as error:  # pylint: disable=broad-except
            plt.close("all")
            run.notes.append(f"{name} cannot be drawn: {type(error).__name__}: {' '.join(str(error).split())}")
    return drawn


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=pathlib.Path, metavar="RUN_FOLDER")
    parser.add_argument("--out", type=pathlib.Path, metavar="FOLDER", help="default: RUN_FOLDER/report")
    arguments = parser.parse_args()
    if not arguments.folder.is_dir():
        raise Refusal(f"{arguments.folder}: no such folder")
    run = mission_run.Run(arguments.folder)
    summary, num_read = mission_run.merged_summary(run), len(run.notes)
    drawn = draw(run, summary, arguments.out or arguments.folder / "report")
    for note in run.notes[num_read:]:
        print(f"plot_mission: {note}", file=sys.stderr)
    if not drawn:
        raise Refusal(f"{arguments.folder}: no mission left anything to plot there")
    print(*drawn, sep="\n")
