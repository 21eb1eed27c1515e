# SPDX-License-Identifier: BSD-3-Clause
"""Tables of a campaign's missions.csv: for each scene and cycle the mean of each variant and its difference to the
first variant.

Brackets hold 95 % bootstrap intervals of the mean. A difference is that of missions with the same seed, bold where p of
its exact test is below 0.1. The tables are left beside the CSV, too: tables.csv and tables.md.
"""

import csv
import itertools
import math
import pathlib
import statistics

import numpy as np

from . import mission_run
from .cli import Refusal, one_line_errors, parser_of
from .results import markdown

CELL = ("scene", "cycle", "variant", "seed")
MEASURES = ("bricks_stowed", "bricks_total", "map_coverage", "map_precision", "falls", "drops", "collisions",
            "load_contacts", "sim_seconds", "views", "distance_m", "disturbance_m", "picks_begun", "wall_seconds")
# Of the bricks, from the start of the mission; empty: not reached.
TIMES = {f"seconds_to_{percent}": percent for percent in (50, 80, 100)}
# From mission.jsonl: views from which no brick was picked; stops by the path monitor, an early contact, the controller
# or the base's scanner; choices of a view, and how many of them were to stay.
GRADED = ("fruitless_views", "guard_stops", "choices", "stays")
GUARDS = {"PATH_BLOCKED", "CONTACT_TOO_EARLY", "PROTECTIVE_STOP", "EMERGENCY_STOP", "obstacle", "base stopped"}
ORIGIN = ("date", "commit", "software", "configuration", "host", "machine")
COLUMNS = (*CELL, *MEASURES, *GRADED, *TIMES, "end_reason", *ORIGIN)
CURVE_COLUMNS = (*CELL, "time_s", "bricks", "map")  # of curves.csv: [%], every CURVE_STEP_S to the mission's end
CURVE_STEP_S = 10.0
CONTAINER = 3  # bricks that it holds: pick_mission.yaml's stow
SHOWN = {  # column: title, factor
    "bricks": ("bricks %", 1), "map_coverage": ("map %", 100), "map_precision": ("precision %", 100),
    "falls": ("falls", 1), "drops": ("drops", 1), "collisions": ("collisions", 1),
    "load_contacts": ("load contacts", 1), "disturbance_m": ("disturbance [cm]", 100), "picks_begun": ("attempts", 1),
    "views": ("views", 1), "fruitless_views": ("fruitless views", 1), "guard_stops": ("guard stops", 1),
    "distance_m": ("driven [m]", 1),
    "sim_seconds": ("simulated [s]", 1),
    **{key: (f"{percent} % of the bricks after [s]", 1) for key, percent in TIMES.items()}}
# What the paper reports. Table I: bricks, map %, falls, collision. Table II: bricks %, map % of its scenes 1 to 3.
PAPER_FACTORS = {"complete": (17, 100, 1, "N"), "no_manipulability": (14.5, 100, 2, "N"),
                 "no_pick_order": (13, 100, 6, "N"), "no_travel": (11, 80, 3, "Y"),
                 "no_uncertainty": (15, 100, 1, "N"), "no_frontier": (16, 90, 4, "Y"),
                 "no_failure_penalty": (7, 60, 1, "N")}
PAPER_SYSTEMS = {"complete": (("95 \u00b1 5", "100 \u00b1 10"), ("100 \u00b1 6", "82 \u00b1 8.5"),
                              ("100 \u00b1 3", "61 \u00b1 3.5")),
                 "octomap_gradient_frontier": (("63 \u00b1 17", "100 \u00b1 5"), ("72 \u00b1 8", "85 \u00b1 9"),
                                               ("66 \u00b1 13", "70 \u00b1 16")),
                 "octomap_random": (("45 \u00b1 12", "90 \u00b1 10"), ("61 \u00b1 12", "71 \u00b1 19"),
                                    ("57 \u00b1 6.8", "57 \u00b1 12"))}
OUR_SCENES = {"one_heap": "paper", "tipped_20": "paper", "decoys": "paper_near"}  # for the paper's 1 to 3; their cycles
# Scenes and cycles of Table I; the first is the paper's.
FACTOR_PLACES = (("one_heap", "paper"), ("decoys", "paper_near"), ("one_heap", "shipped"))
# Which sign of a difference is better.
BETTER = {"bricks": 1, "map_coverage": 1, "map_precision": 1, "falls": -1, "drops": -1, "collisions": -1,
          "load_contacts": -1, "disturbance_m": -1, "guard_stops": -1, "seconds_to_50": -1}
BROKEN = (ValueError, KeyError, TypeError, AttributeError, ArithmeticError, csv.Error)
NUM_RESAMPLES = 10000
MAX_EXACT = 16  # pairs, whose 2^16 flips take 0.4 s
SHOWN_BELOW = 0.1  # a difference with a smaller p is pointed out; five pairs cannot have one below 0.06


def words_of(error):
    """In one line: YAML's errors have several."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def is_of(row, scene, cycle, variant):
    return (row["scene"], row["cycle"], row["variant"]) == (scene, cycle, variant)


def checked(summary):
    """The summary of a mission; raises one of BROKEN if the tables cannot be made of it."""
    numbers = [summary[key] for key in MEASURES if summary[key] is not None]
    is_finite = all(math.isfinite(float(number)) for number in numbers)
    if not is_finite or summary["bricks_stowed"] is None or not summary["bricks_total"] > 0:
        raise ValueError("no judged mission")
    return summary


def curve_of(folder, bricks_total):
    """Seconds from the start of a mission, and of each the share of bricks stowed and of the pile mapped [%]. Raises
    one of BROKEN."""
    folder = pathlib.Path(folder)
    table = mission_run.read_table(folder / "judge.csv", [])
    seconds, stowed, coverage = (np.array(table[name]) for name in ("time_s", "stowed", "coverage"))
    begun_s = next((row["time_s"] for row in mission_run.read_lines(folder / "mission.jsonl", [])
                    if row.get("event") == "start"), seconds[0])
    return seconds - begun_s, 100.0 * stowed / bricks_total, 100.0 * coverage


def graded_of(folder):
    """{one of GRADED: count}"""
    log = mission_run.read_lines(pathlib.Path(folder) / "mission.jsonl", [])
    chosen = [row for row in log if (row.get("state"), row.get("event")) == ("select", "success")]
    fruitful = {row.get("views") for row in log if (row.get("state"), row.get("event")) == ("pick", "SUCCESS")}
    return {"fruitless_views": len({row.get("views") for row in log} - fruitful - {None, 0}),
            "guard_stops": sum(row.get("event") in GUARDS for row in log), "choices": len(chosen),
            "stays": sum(row.get("decision") == "choose" for row in chosen)}


def row_of(mission, summary):
    seconds, bricks, _ = curve_of(mission["folder"], summary["bricks_total"])
    times = {key: next((round(second, 3) for second, share in zip(seconds, bricks) if share >= percent), None)
             for key, percent in TIMES.items()}
    return {**{key: mission[key] for key in CELL}, **{key: summary[key] for key in (*MEASURES, "end_reason")}, **times,
            **graded_of(mission["folder"]), **{key: summary["origin"].get(key) for key in ORIGIN}}


def curve_rows_of(mission, bricks_total):
    seconds, bricks, coverage = curve_of(mission["folder"], bricks_total)
    grid = np.arange(0.0, seconds[-1] + CURVE_STEP_S, CURVE_STEP_S)
    at = np.maximum(np.searchsorted(seconds, grid, side="right") - 1, 0)
    return [dict(zip(CURVE_COLUMNS, (*(mission[key] for key in CELL), time_s, round(bricks[index], 3),
                                     round(coverage[index], 3)))) for time_s, index in zip(grid, at)]


def write_csv(path, columns, rows):
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def read_csv(path):
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            return list(csv.DictReader(stream))
    except BROKEN as error:
        raise Refusal(f"{path}: {words_of(error)}") from error


def cell_of(row):
    return tuple(str(row[key]) for key in CELL)


def read_rows(path):
    rows = read_csv(path)
    try:
        for row in rows:
            row.update({key: float(row[key]) if row[key] != "" else math.nan for key in (*MEASURES, *GRADED, *TIMES)},
                       bricks=100.0 * float(row["bricks_stowed"]) / float(row["bricks_total"]))
        states = sorted({row["software"] for row in rows})
        if len(states) != 1:
            raise ValueError(
                f"missions of {len(states)} states of the software: {', '.join(states) or 'none'}; must be of one")
        cells = [cell_of(row) for row in rows]
        if len(set(cells)) != len(cells):
            raise ValueError(f"{statistics.mode(cells)} is there twice")
    except BROKEN as error:
        raise Refusal(f"{path}: {words_of(error)}") from error
    return rows


def interval(values):
    """95 % bootstrap interval of the mean (percentiles), the same in each call."""
    values = np.asarray(values, dtype=float)
    means = values[np.random.default_rng(1).integers(len(values), size=(NUM_RESAMPLES, len(values)))].mean(axis=1)
    return np.sort(means)[[int(0.025 * NUM_RESAMPLES) - 1, int(0.975 * NUM_RESAMPLES) - 1]]


def p_of_flips(differences):
    """p of each flip of the differences' signs, in the two-sided test; the first is what was found. How likely chance
    gives as large a mean: exact, at least 2 / 2^n, up to MAX_EXACT differences; of more, from as many random
    flips as those have. nan of fewer than two differences."""
    count = len(differences)
    if count < 2:
        return np.array([math.nan])
    if count <= MAX_EXACT:
        signs = np.array(list(itertools.product((1, -1), repeat=count)))
    else:
        signs = np.random.default_rng(1).choice((1, -1), size=(2 ** MAX_EXACT, count))
        signs[0] = 1  # what was found is one of them: never 0
    equal = 1e-12 * np.abs(differences).sum()  # sums of the same numbers in another order
    sums = np.abs(signs @ differences)
    return 1.0 - np.searchsorted(np.sort(sums), sums - equal) / len(sums)


def with_interval(values, form=".1f"):
    """Of those that are numbers."""
    values = [value for value in values if not math.isnan(value)]
    return interval_text(statistics.fmean(values), *interval(values), len(values), form) if values else "-"


def interval_text(mean, low, high, count, form=".1f"):
    mean, low, high = (text if float(text) else format(0.0, form)  # no -0.0
                       for text in (format(value, form) for value in (mean, low, high)))
    return mean + (f" [{low}, {high}]" if count > 1 else "")


def differences(runs, first, key):
    """Of the missions with the same seed in which both have a value."""
    pairs = [runs[seed][key] - first[seed][key] for seed in runs if seed in first]
    return [value for value in pairs if not math.isnan(value)]


def summaries_of(rows):
    """[one per scene, cycle, variant and measure]; the differences are to `complete`, without it to the first. A time is given only if all missions
    reached it: the mean of some of them would be that of the fast ones. `chance`: how likely p is below SHOWN_BELOW if the variant does not differ."""
    found = []
    for scene, cycle in dict.fromkeys((row["scene"], row["cycle"]) for row in rows):
        of_scene = [row for row in rows if (row["scene"], row["cycle"]) == (scene, cycle)]
        variants = {variant: {row["seed"]: row for row in of_scene if row["variant"] == variant}
                    for variant in sorted({row["variant"]: None for row in of_scene}, key=lambda name: name != "complete")}
        first = next(iter(variants.values()))
        for (variant, runs), (key, (_, factor)) in itertools.product(variants.items(), SHOWN.items()):
            values = [factor * row[key] for row in runs.values() if not math.isnan(row[key])]
            is_told = values and (key not in TIMES or len(values) == len(runs))
            pairs = [factor * value for value in differences(runs, first, key)] if runs is not first and is_told else []
            if key in TIMES and any(math.isnan(row[key]) for row in first.values()):
                pairs = []
            entry = {"scene": scene, "cycle": cycle, "variant": variant, "measure": key, "missions": len(runs),
                     "n": len(values)}
            for name, numbers in (("mean", values if is_told else []), ("difference", pairs)):
                low, high = interval(numbers) if numbers else (math.nan, math.nan)
                entry.update({name: statistics.fmean(numbers) if numbers else math.nan, f"{name}_low": low,
                              f"{name}_high": high})
            p = p_of_flips(pairs)
            found.append({**entry, "pairs": len(pairs), "p": p[0], "chance": np.mean(p < SHOWN_BELOW)})
    return found


def value_cell(entry):
    if entry["measure"] in TIMES and entry["n"] < entry["missions"]:
        return f"reached by {entry['n']} of {entry['missions']}"
    if entry["n"] == 0:
        return "-"
    of = f" (of {entry['n']})" if entry["n"] < entry["missions"] else ""
    return interval_text(entry["mean"], entry["mean_low"], entry["mean_high"], entry["n"]) + of


def difference_cell(entry):
    if entry["pairs"] == 0:
        return "-"
    text = interval_text(entry["difference"], entry["difference_low"], entry["difference_high"], entry["pairs"], "+.1f")
    return f"**{text}**" if entry["p"] < SHOWN_BELOW else text


def measures_text(rows):
    """Markdown: of each scene and cycle all measures, then the differences to `complete`, without it to the first; bold where p is
    below SHOWN_BELOW."""
    texts, summaries = [], summaries_of(rows)
    for scene, cycle in dict.fromkeys((entry["scene"], entry["cycle"]) for entry in summaries):
        of_scene = [entry for entry in summaries if (entry["scene"], entry["cycle"]) == (scene, cycle)]
        variants = list(dict.fromkeys(entry["variant"] for entry in of_scene))
        by_cell = {(entry["variant"], entry["measure"]): entry for entry in of_scene}
        ended = {variant: ", ".join(sorted({row["end_reason"] for row in rows if is_of(row, scene, cycle, variant)}))
                 for variant in variants}
        values = [("", "n", *(title for title, _ in SHOWN.values()), "ended by")]
        values += [(variant, by_cell[variant, "bricks"]["missions"],
                    *(value_cell(by_cell[variant, key]) for key in SHOWN), ended[variant]) for variant in variants]
        texts.append(f"**`{scene}`, cycle `{cycle}`**\n\n{markdown(values)}\n")
        if len(variants) > 1:
            changes = [(f"less `{variants[0]}`", "pairs", *(title for title, _ in SHOWN.values()))]
            changes += [(variant, by_cell[variant, "bricks"]["pairs"],
                         *(difference_cell(by_cell[variant, key]) for key in SHOWN)) for variant in variants[1:]]
            texts.append(markdown(changes) + "\n")
    return "\n".join(texts)


def findings_text(rows):
    """Markdown: of each variant the measures in which it is better and worse than `complete`, with p below SHOWN_BELOW,
    and how many of the tests would have such a p by chance."""
    lines = {}
    tests = [entry for entry in summaries_of(rows) if entry["measure"] in BETTER and not math.isnan(entry["p"])]
    shown = [entry for entry in tests if entry["p"] < SHOWN_BELOW]
    for entry in shown:
        found = lines.setdefault((entry["scene"], entry["cycle"], entry["variant"]), {1: [], -1: []})
        sign = int(math.copysign(1, entry["difference"])) * BETTER[entry["measure"]]
        found[sign].append(f"{SHOWN[entry['measure']][0]} {difference_cell(entry)} (p {entry['p']:.2g}, "
                           f"{entry['pairs']} pairs)")
    text = "".join(f"- `{scene}`, cycle `{cycle}`, `{variant}`: " + "; ".join(
        f"{word} in {', '.join(found[sign])}" for sign, word in ((1, "better"), (-1, "worse")) if found[sign]) + ".\n"
                   for (scene, cycle, variant), found in lines.items())
    return (f"{text}\n{len(shown)} of {len(tests)} tests have a p below {SHOWN_BELOW}. If no variant differed from "
            f"`complete`, about {sum(entry['chance'] for entry in tests):.0f} would.\n").lstrip()


def variants_of(rows):
    """[(scene, cycle, variant)], those of a scene and cycle together."""
    places = list(dict.fromkeys((row["scene"], row["cycle"]) for row in rows))
    cells = dict.fromkeys((row["scene"], row["cycle"], row["variant"]) for row in rows)
    return sorted(cells, key=lambda cell: places.index(cell[:2]))


def lasting(rows):
    """Those of the seeds in which `complete` stows a brick."""
    seeds = {(row["scene"], row["cycle"], row["seed"]) for row in rows
             if row["variant"] == "complete" and row["bricks_stowed"] > 0}
    return [row for row in rows if (row["scene"], row["cycle"], row["seed"]) in seeds]


def lasting_text(rows):
    """Markdown: of those seeds, the differences to `complete` in bricks and in the share mapped."""
    table = [("scene", "cycle", "variant", "pairs", "bricks", "p", "map [points]", "p")]
    rows = lasting(rows)
    for scene, cycle, variant in variants_of(rows):
        first, runs = ({row["seed"]: row for row in rows if is_of(row, scene, cycle, of)} for of in ("complete", variant))
        if variant != "complete":
            bricks = differences(runs, first, "bricks_stowed")
            coverage = [100 * value for value in differences(runs, first, "map_coverage")]
            table.append((scene, cycle, variant, len(bricks), *itertools.chain.from_iterable(
                (with_interval(values, "+.1f"), format(p_of_flips(values)[0], ".2g") if len(values) > 1 else "-")
                for values in (bricks, coverage))))
    return markdown(table) + "\n" if len(table) > 1 else ""


def paired(rows, scene, cycle, variants):
    """{variant: its rows}: of the variants that there are, the seeds that all of them have."""
    found = {variant: {row["seed"]: row for row in rows if is_of(row, scene, cycle, variant)} for variant in variants}
    found = {variant: runs for variant, runs in found.items() if runs}
    return {variant: [row for seed, row in runs.items() if all(seed in others for others in found.values())]
            for variant, runs in found.items()}


def factors_text(rows):
    """Markdown: Table I, where it is the paper's beside its numbers; empty without missions that miss a factor."""
    table = [("scene", "cycle", "variant", "n", "bricks", "the paper's", "map %", "the paper's", "falls", "the paper's",
              "missions with a collision", "the paper's")]
    for scene, cycle in FACTOR_PLACES:
        variants = paired(rows, scene, cycle, PAPER_FACTORS)
        for variant, runs in variants.items() if len(variants) > 1 else ():
            paper = PAPER_FACTORS[variant] if (scene, cycle) == FACTOR_PLACES[0] else ("",) * 4
            ours = [with_interval([factor * row[key] for row in runs])
                    for key, factor in (("bricks_stowed", 1), ("map_coverage", 100), ("falls", 1))]
            ours.append(f"{sum(row['collisions'] > 0 for row in runs)} of {len(runs)}")
            table.append((scene, cycle, variant, len(runs), *itertools.chain.from_iterable(zip(ours, paper))))
    return markdown(table) + "\n" if len(table) > 1 else ""


def systems_text(rows):
    """Markdown: Table II beside the paper's; empty without its scenes."""
    table = [("ours", "paper's", "system", "n", "bricks %", "the paper's", "map %", "the paper's",
              *(SHOWN[key][0] for key in TIMES))]
    for index, (scene, cycle) in enumerate(OUR_SCENES.items()):
        systems = paired(rows, scene, cycle, PAPER_SYSTEMS)
        by_cell = {(entry["variant"], entry["measure"]): entry
                   for entry in summaries_of([row for runs in systems.values() for row in runs])}
        for variant, runs in systems.items():
            if runs:
                paper = PAPER_SYSTEMS[variant][index]
                bricks, coverage, *times = (value_cell(by_cell[variant, key])
                                            for key in ("bricks", "map_coverage", *TIMES))
                table.append((scene, f"#{index + 1}", variant, len(runs), bricks, paper[0], coverage, paper[1], *times))
    return markdown(table) + "\n" if len(table) > 1 else ""


def load_times(curve, bricks_total):
    """Seconds between every third brick of a mission, after the first three: from one full container to the next.
    `curve`: the mission's rows of curves.csv."""
    bricks = np.maximum.accumulate([float(row["bricks"]) for row in curve]) * bricks_total / 100.0  # one can fall out
    full = np.arange(CONTAINER, bricks[-1] + 0.5, CONTAINER)
    return np.diff(CURVE_STEP_S * np.searchsorted(bricks, full - 0.5))


def choices_text(rows, curves):
    """Markdown: what each variant chose, and the bricks of each of its missions. `curves`: rows of curves.csv."""
    runs_of = {cell: list(of_cell) for cell, of_cell in itertools.groupby(curves, cell_of)}
    seeds = sorted({row["seed"] for row in rows}, key=int)
    table = [("scene", "cycle", "variant", "choices to stay", "views", "without a pick", "driven [m]", "3 bricks [s]",
              *(f"bricks, {seed}" for seed in seeds))]
    for scene, cycle, variant in variants_of(rows):
        runs = {row["seed"]: row for row in rows if is_of(row, scene, cycle, variant)}
        stays, choices = (sum(row[key] for row in runs.values()) for key in ("stays", "choices"))
        means = (format(statistics.fmean(row[key] for row in runs.values()), ".1f")
                 for key in ("views", "fruitless_views", "distance_m"))
        loads = np.concatenate([load_times(runs_of[cell_of(row)], row["bricks_total"]) for row in runs.values()])
        table.append((scene, cycle, variant, f"{stays:.0f} of {choices:.0f}", *means,
                      f"{np.median(loads):.0f}" if len(loads) else "-",
                      *(f"{runs[seed]['bricks_stowed']:.0f}" if seed in runs else "" for seed in seeds)))
    return markdown(table) + "\n"


def print_tables(path):
    rows = read_rows(path)
    summaries = summaries_of(rows)
    write_csv(path.with_name("tables.csv"), summaries[0],
              [{key: "" if isinstance(value, float) and math.isnan(value) else value for key, value in entry.items()}
               for entry in summaries])
    text = "\n".join(filter(None, (factors_text(rows), systems_text(rows), measures_text(rows))))
    path.with_name("tables.md").write_text(text, encoding="utf-8")
    print(f"\n{text}", end="")


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("csv", type=pathlib.Path, help="missions.csv of a campaign's folder")
    print_tables(parser.parse_args().csv)
