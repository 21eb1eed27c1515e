# SPDX-License-Identifier: BSD-3-Clause
"""Tables and plots of what evaluate_planning measured; can also put the tables into a document.

The document keeps its text; what stands between `<!-- planning: begin -->` and `<!-- planning: end -->` is replaced.
"""

import csv
import math

from .results import holds, main_of, markdown, measured, number, read_json, read_machine
from .style import BLUE, GREY, RED, plt, save, tidy

CONDITIONS = ("good", "noisy", "few", "few_noisy", "poor_poses")
LABELS = {"good": "seen well", "noisy": "noisy", "few": "few looks", "few_noisy": "few looks, noisy", "poor_poses": "poor camera poses"}
COLOURS = {"good": BLUE, "noisy": "#e0914f", "few": "#6ea6ab", "few_noisy": "#8fbf7f", "poor_poses": RED}
FIXED = ("fixed_5mm", "fixed_10mm", "fixed_15mm", "fixed_20mm", "fixed_30mm")
SIGMA = ("fixed_5mm", "sigma_1", "sigma_2", "sigma_3")  # no sigma and 5 mm is where both begin
LIMITS = {"median_ms": 300.0, "p95_ms": 1500.0}


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
    tidy(axes, y_label, x_label)


def legend_of(axes, conditions):
    lines = [plt.Line2D([], [], color=COLOURS[condition], label=LABELS[condition]) for condition in CONDITIONS if condition in conditions]
    lines.append(plt.Line2D([], [], color=GREY, marker="o", markersize=5, label="fixed margin"))
    lines.append(plt.Line2D([], [], color=GREY, linestyle="--", marker="s", markersize=5, label="k sigma + 5 mm"))
    axes.legend(handles=lines, fontsize=9.5)


def near_blocked(entry):
    return share(entry["blocked"][0] + entry["blocked"][1], entry["clear"][0] + entry["clear"][1])


def plot_margins(read, out):
    result = read[0]
    has_picks = bool(result.get("margins"))
    figure, panels = plt.subplots(1, 2 if has_picks else 1, figsize=(14.0 if has_picks else 9.0, 5.6), constrained_layout=True, squeeze=False)
    left = panels[0][0]
    panel_of(left, result.get("postures", {}), near_blocked, lambda entry: share(entry["missed"], entry["colliding"]),
             "postures 10 to 40 mm from all bricks that are called in the way [%]", "postures in a brick that are called free [%]")
    legend_of(left, result.get("postures", {}))
    if has_picks:
        panel_of(panels[0][1], result["margins"], lambda entry: share(entry["solved"], entry["problems"]),
                 lambda entry: share(entry["colliding"], entry["solved"]), "picks planned [% of problems]", "of these, through a brick [%]")
    save(figure, out, 100)


def plot_times(read, out):
    with (read[2] / "evaluate_planning.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    figure, (left, right) = plt.subplots(1, 2, figsize=(14.0, 4.8), constrained_layout=True)
    for group, label, colour in (("standard", "planPick: four phases, all faces", BLUE), ("plain", "plain RRTConnect: reach one posture", RED)):
        times = sorted(float(row["plan_ms"]) for row in rows if row["group"] == group)
        left.step([max(time, 0.1) for time in times], [share(i + 1, len(times)) for i in range(len(times))], where="post", color=colour, label=label)
    for limit, level in ((LIMITS["median_ms"], 50.0), (LIMITS["p95_ms"], 95.0)):
        left.plot([limit], [level], marker="v", color=GREY)
        left.annotate(f"wanted: {level:g} % within {limit:g} ms", (limit, level), xytext=(6, -10), textcoords="offset points", fontsize=9, color=GREY)
    left.set_xscale("log")
    tidy(left, "answers within that time [%], failures included", "processor time [ms]")
    left.legend(fontsize=9.5, loc="upper left")
    values = [float(row["clearance_mm"]) for row in rows if row["group"] == "standard" and row["status"] == "success"]
    right.hist(values, bins=[2.5 * i for i in range(41)], color="#6ea6ab")
    tidy(right, "planned picks", "smallest true distance to a brick, approach and stow [mm]")
    save(figure, out, 100)


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
    entry = result["standard"]
    yield ("wanted", "measured", "holds")
    yield (f"planPick: median at most {LIMITS['median_ms']:g} ms", f"{entry['plan_ms_median']:.0f} ms", holds(entry["plan_ms_median"] <= LIMITS["median_ms"]))
    yield (f"planPick: 95 % within {LIMITS['p95_ms']:g} ms", f"{entry['plan_ms_p95']:.0f} ms", holds(entry["plan_ms_p95"] <= LIMITS["p95_ms"]))
    yield ("no planned motion through the exact scene, at ten times the planner's resolution", f"{entry['colliding']} of {entry['solved']}", holds(entry["colliding"] == 0))
    yield ("limits, meeting of phases, contact, tilt, place over the container", f"{entry['faulty']} faults in {entry['solved']}", holds(entry["faulty"] == 0))


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


def tables(read):
    result, machine, _ = read
    parts = [
        measured(machine) + " Times are processor times of one thread.",
    ]
    if "standard" in result:
        parts.append("**Wanted and measured**\n\n" + markdown(acceptance_rows(result)))
        parts.append("**The fixed problems**\n\n" + markdown(standard_rows(result)))
        parts.append(markdown(failure_rows(result)))
    if "postures" in result:
        parts.append("**Margins: random postures near the pile**, called free or in the way, against the exact scene\n\n" + markdown(posture_rows(result)))
    if "margins" in result:
        parts.append("**Margins: whole picks**\n\n" + markdown(margin_rows(result)))
    return "\n\n".join(parts) + "\n"


def read(folder):
    return read_json(folder / "evaluate_planning.json"), read_machine(folder / "machine.txt"), folder


def main():
    return main_of(__doc__, {"plot-margins": plot_margins, "plot-times": plot_times}, read, lambda result: {"planning": tables(result)})()
