# SPDX-License-Identifier: BSD-3-Clause
"""Tables and plots of what evaluate_planning measured; can also put the tables into a document.

The document keeps its text; what stands between `<!-- planning: begin -->` and `<!-- planning: end -->` is replaced.
"""

import argparse
import csv
import math
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from .plot_bench import ResultError, bare, markdown, read_json, read_machine, replace_between_marks

CONDITIONS = ("good", "noisy", "few", "few_noisy", "poor_poses")
LABELS = {"good": "seen well", "noisy": "noisy", "few": "few looks", "few_noisy": "few looks, noisy", "poor_poses": "poor camera poses"}
COLOURS = {"good": "#1d4f76", "noisy": "#e0914f", "few": "#6ea6ab", "few_noisy": "#8fbf7f", "poor_poses": "#b9474b"}
FIXED = ("fixed_5mm", "fixed_10mm", "fixed_15mm", "fixed_20mm", "fixed_30mm")
SIGMA = ("fixed_5mm", "sigma_1", "sigma_2", "sigma_3")  # no sigma and 5 mm is where both begin
LIMITS = {"median_ms": 300.0, "p95_ms": 1500.0}


def read_rows(path):
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))
    except OSError as error:
        raise ResultError(f"{path}: {error.strerror}") from None


def share(part, whole):
    return 100.0 * part / whole if whole else math.nan


def wilson(part, whole):
    """95 % interval of a share [%], after Wilson."""
    if not whole:
        return math.nan, math.nan
    z, p = 1.96, part / whole
    middle = (p + z * z / (2 * whole)) / (1 + z * z / whole)
    half = z / (1 + z * z / whole) * math.sqrt(p * (1 - p) / whole + z * z / (4 * whole * whole))
    return 100.0 * (middle - half), 100.0 * (middle + half)


def short(policy):
    return policy.replace("fixed_", "").replace("sigma_", "") + ("σ" if policy.startswith("sigma") else "")


def panel_of(axes, groups, x_of, y_of, x_label, y_label):
    for condition in CONDITIONS:
        if condition not in groups:
            continue
        policies = groups[condition]["policies"]
        for names, style, marker in ((FIXED, "-", "o"), (SIGMA, "--", "s")):
            names = [name for name in names if name in policies]
            axes.plot([x_of(policies[name]) for name in names], [y_of(policies[name]) for name in names], style, marker=marker,
                      markersize=5, color=COLOURS[condition], linewidth=1.4)
            for name in names[1:]:
                axes.annotate(short(name), (x_of(policies[name]), y_of(policies[name])), xytext=(4, 4), textcoords="offset points", fontsize=8, color=COLOURS[condition])
    axes.set_xlabel(x_label, fontsize=12)
    axes.set_title(y_label, fontsize=13, loc="left")
    bare(axes)


def legend_of(axes, conditions):
    lines = [plt.Line2D([], [], color=COLOURS[condition], label=LABELS[condition]) for condition in CONDITIONS if condition in conditions]
    lines.append(plt.Line2D([], [], color="#5e5e5e", marker="o", markersize=5, label="fixed margin"))
    lines.append(plt.Line2D([], [], color="#5e5e5e", linestyle="--", marker="s", markersize=5, label="k sigma + 5 mm"))
    axes.legend(handles=lines, fontsize=9.5, frameon=False)


def near_blocked(entry):
    return share(entry["blocked"][0] + entry["blocked"][1], entry["clear"][0] + entry["clear"][1])


def plot_margins(result, out):
    has_picks = bool(result.get("margins"))
    figure, panels = plt.subplots(1, 2 if has_picks else 1, figsize=(14.0 if has_picks else 9.0, 5.6), constrained_layout=True, squeeze=False)
    left = panels[0][0]
    panel_of(left, result.get("postures", {}), near_blocked, lambda entry: share(entry["missed"], entry["colliding"]),
             "postures 10 to 40 mm from all bricks that are called in the way [%]", "postures in a brick that are called free [%]")
    legend_of(left, result.get("postures", {}))
    if has_picks:
        panel_of(panels[0][1], result["margins"], lambda entry: share(entry["solved"], entry["problems"]),
                 lambda entry: share(entry["colliding"], entry["solved"]), "picks planned [% of problems]", "of these, through a brick [%]")
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=100)
    plt.close(figure)


def plot_times(rows, result, out):
    figure, (left, right) = plt.subplots(1, 2, figsize=(14.0, 4.8), constrained_layout=True)
    for group, label, colour in (("standard", "planPick: four phases, all faces", "#1d4f76"), ("plain", "plain RRTConnect: reach one posture", "#b9474b")):
        times = sorted(float(row["plan_ms"]) for row in rows if row["group"] == group)
        left.step([max(time, 0.1) for time in times], [share(i + 1, len(times)) for i in range(len(times))], where="post", color=colour, label=label)
    for limit, level in ((LIMITS["median_ms"], 50.0), (LIMITS["p95_ms"], 95.0)):
        left.plot([limit], [level], marker="v", color="#5e5e5e")
        left.annotate(f"wanted: {level:g} % within {limit:g} ms", (limit, level), xytext=(6, -10), textcoords="offset points", fontsize=9, color="#5e5e5e")
    left.set_xscale("log")
    left.set_xlabel("processor time [ms]", fontsize=12)
    left.set_title("answers within that time [%], failures included", fontsize=13, loc="left")
    left.legend(fontsize=9.5, frameon=False, loc="upper left")
    bare(left)
    values = [float(row["clearance_mm"]) for row in rows if row["group"] == "standard" and row["status"] == "success"]
    right.hist(values, bins=[2.5 * i for i in range(41)], color="#6ea6ab")
    right.set_xlabel("smallest true distance to a brick, approach and stow [mm]", fontsize=12)
    right.set_title("planned picks", fontsize=13, loc="left")
    bare(right)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=100)
    plt.close(figure)


def number(value, form):
    return "-" if value is None or math.isnan(value) else format(value, form)


def standard_rows(result):
    yield ("", "problems", "touchable", "planned", "of touchable %", "through a brick", "other faults", "median ms", "95 % ms", "longest ms", "clearance mm: least", "median", "way rad", "motion s")
    for key, label in (("standard", "planPick"), ("plain", "plain RRTConnect (reach only)")):
        entry = result.get(key)
        if not entry:
            continue
        yield (label, entry["problems"], entry["touchable"], entry["solved"], number(share(entry["solved_touchable"], entry["touchable"]), ".1f"), entry["colliding"], entry["faulty"],
               number(entry["plan_ms_median"], ".0f"), number(entry["plan_ms_p95"], ".0f"), number(entry["plan_ms_max"], ".0f"), number(entry["clearance_mm_min"], ".1f"),
               number(entry["clearance_mm_median"], ".1f"), number(entry["path_rad_median"], ".1f"), number(entry["duration_s_median"], ".1f"))


def acceptance_rows(result):
    def verdict(good):
        return "yes" if good else "**no**"

    entry = result["standard"]
    yield ("wanted", "measured", "holds")
    yield (f"planPick: median at most {LIMITS['median_ms']:g} ms", f"{entry['plan_ms_median']:.0f} ms", verdict(entry["plan_ms_median"] <= LIMITS["median_ms"]))
    yield (f"planPick: 95 % within {LIMITS['p95_ms']:g} ms", f"{entry['plan_ms_p95']:.0f} ms", verdict(entry["plan_ms_p95"] <= LIMITS["p95_ms"]))
    yield ("no planned motion through the exact scene, at ten times the planner's resolution", f"{entry['colliding']} of {entry['solved']}", verdict(entry["colliding"] == 0))
    yield ("limits, meeting of phases, contact, tilt, place over the chute", f"{entry['faulty']} faults in {entry['solved']}", verdict(entry["faulty"] == 0))


def failure_rows(result):
    reasons = sorted({reason for key in ("standard", "plain") for reason in result.get(key, {}).get("failures", {})})
    yield ("no plan because", "planPick", "plain RRTConnect")
    for reason in reasons:
        yield (reason.replace("_", " "), result["standard"]["failures"].get(reason, 0), result.get("plain", {}).get("failures", {}).get(reason, 0))


def policy_name(entry):
    if entry["is_fixed"]:
        return f"fixed {entry['margin_mm']:g} mm"
    return f"{entry['sigmas']:g} sigma + {entry['margin_mm']:g} mm"


def policies_of(group):
    return [name for name in FIXED + SIGMA[1:] if name in group["policies"]]


def posture_rows(result):
    yield ("seen", "margin", "postures in a brick", "called free", "%", "95 % interval", "deepest mm", "clear 10-20 mm, blocked %", "20-40 mm", "40-60 mm")
    for condition in CONDITIONS:
        group = result.get("postures", {}).get(condition)
        for name in policies_of(group) if group else []:
            entry = group["policies"][name]
            low, high = wilson(entry["missed"], entry["colliding"])
            yield (LABELS[condition], policy_name(entry), entry["colliding"], entry["missed"], number(share(entry["missed"], entry["colliding"]), ".2f"), f"{low:.2f} - {high:.2f}",
                   number(entry["deepest_missed_mm"], ".1f"), *(number(share(b, c), ".1f") for b, c in zip(entry["blocked"], entry["clear"])))


def margin_rows(result):
    yield ("seen", "sigma of the pile's surface mm: median", "95 %", "margin", "problems", "planned", "through a brick", "deepest mm", "clearance mm: least", "5 %", "median", "median ms")
    for condition in CONDITIONS:
        group = result.get("margins", {}).get(condition)
        for name in policies_of(group) if group else []:
            entry = group["policies"][name]
            yield (LABELS[condition], number(group["sigma_mm_median"], ".1f"), number(group["sigma_mm_p95"], ".1f"), policy_name(entry), entry["problems"], entry["solved"], entry["colliding"],
                   number(entry["deepest_mm"], ".1f"), number(entry["clearance_mm_min"], ".1f"), number(entry["clearance_mm_p05"], ".1f"), number(entry["clearance_mm_median"], ".1f"),
                   number(entry["plan_ms_median"], ".0f"))


def cells(rows):
    return [tuple(str(cell) for cell in row) for row in rows]


def tables(result, machine):
    parts = [
        f"Measured {machine.get('date', 'at an unknown date')} on {machine.get('processor', 'an unknown machine')}; {machine.get('compiler', 'unknown compiler')}, "
        f"{machine.get('build', 'unknown build')}; load {machine.get('load', 'unknown')}; commit {machine.get('commit', 'unknown')}. Times are processor times of one thread.",
    ]
    if "standard" in result:
        parts.append("**Wanted and measured**\n\n" + markdown(cells(acceptance_rows(result))))
        parts.append("**The fixed problems**\n\n" + markdown(cells(standard_rows(result))))
        parts.append(markdown(cells(failure_rows(result))))
    if "postures" in result:
        parts.append("**Margins: random postures near the pile**, called free or in the way, against the exact scene\n\n" + markdown(cells(posture_rows(result))))
    if "margins" in result:
        parts.append("**Margins: whole picks**\n\n" + markdown(cells(margin_rows(result))))
    return "\n\n".join(parts) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path, metavar="RESULTS", help="results/bench")
    parser.add_argument("--plot-margins", type=pathlib.Path, metavar="PNG")
    parser.add_argument("--plot-times", type=pathlib.Path, metavar="PNG")
    parser.add_argument("--table", type=pathlib.Path, metavar="MD")
    parser.add_argument("--document", type=pathlib.Path, metavar="MD", help="replace the part between the marks")
    arguments = parser.parse_args()
    try:
        result = read_json(arguments.folder / "evaluate_planning.json")
        text = tables(result, read_machine(arguments.folder))
        if arguments.plot_margins:
            plot_margins(result, arguments.plot_margins)
            print(arguments.plot_margins)
        if arguments.plot_times:
            plot_times(read_rows(arguments.folder / "evaluate_planning.csv"), result, arguments.plot_times)
            print(arguments.plot_times)
        if arguments.table:
            arguments.table.write_text(text, encoding="utf-8")
            print(arguments.table)
        if arguments.document:
            replace_between_marks(arguments.document, "planning", text)
            print(arguments.document)
    except ResultError as error:
        print(f"plot_planning: {error}", file=sys.stderr)
        return 1
    except (KeyError, ValueError) as error:
        print(f"plot_planning: a result is missing or not a number: {error!r}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"plot_planning: {error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    return 0
