# SPDX-License-Identifier: BSD-3-Clause
"""Makes one of the paper's figures, or its tables: NAME.png with NAME.csv beside it in results/figures.

  1       four panels of one cycle           INPUT: a mission's run folder
  3       tolerance of one look, deletions   INPUT: a run of fig8_experiment (default: made)
  4       one choice of a view, by factors   INPUT: a mission's run folder
  5       the arm's sectors                  INPUT: samples of fit_manipulability (default: made)
  6       the scenes                         of the pictures of scripts/pictures
  7       bricks and map over time           INPUT: a campaign's folder (default: results/campaign)
  8       accuracy after a removal           INPUT: results/fig8 of an earlier call (default: made, some minutes)
  9       order of the picks                 INPUT: a mission's run folder
  tables  Tables I and II                    INPUT: a campaign's folder (default: results/campaign)
"""

import itertools
import pathlib
import shutil
import subprocess

import matplotlib.image
import numpy as np
import yaml
from PIL import Image

from . import ROOT, figure_accuracy, figure_mission, table_campaign, workspace
from .cli import Parser, Refusal, UsageError, one_line_errors
from .figure_accuracy import write_rows
from .results import replace_between_marks
from .style import BLUE, GREY, ORANGE, legend_below, plt, save, tidy

DOCS = ROOT / "docs/results"
# Of other pages, too; all others are in docs/results/figures.
PLACES = {"fig5.png": ROOT / "docs/images/manipulability_sectors.png"}
MAX_BYTES = 250_000
SYSTEMS = {"complete": ("ours", BLUE), "octomap_gradient_frontier": ("OctoMap, gradient frontier", ORANGE),
           "octomap_random": ("OctoMap, random", GREY)}
NOTHING = "No counted missions yet.\n"


def sectors(source, out):
    """Fig. 5. What is drawn is what the node uses: the samples have to be of the same robot."""
    urdf = ROOT / "src/mp700_ur5e_description/urdf/mp700_ur5e.urdf"
    shipped = ROOT / "src/motion_planning/config/manipulability_sectors.yaml"
    if source is None:
        workspace.library("install_packages; build_workspace fit_manipulability")
        folder = ROOT / "results/fit_manipulability"
        folder.mkdir(parents=True, exist_ok=True)
        source, fitted = folder / "samples.csv", folder / "sectors.yaml"
        subprocess.run([ROOT / "devel/lib/motion_planning/fit_manipulability", "--urdf", urdf, "--out", fitted,
                        "--samples", source], check=True)
        if yaml.safe_load(fitted.read_text(encoding="utf-8")) != yaml.safe_load(shipped.read_text(encoding="utf-8")):
            raise Refusal(f"{fitted} is not {shipped}: the shipped sectors are of another robot")
    subprocess.run([ROOT / "src/motion_planning/scripts/plot_manipulability", "--samples", source, "--sectors", shipped,
                    "--urdf", urdf, "--out", out / "fig5.png"], check=True)
    found = yaml.safe_load(shipped.read_text(encoding="utf-8"))
    write_rows(out / "fig5.csv", ("faces", *found["top"]), ((kind, *found[kind].values()) for kind in ("top", "side")))


def scenes(_, out):
    """Fig. 6."""
    figure, panels = plt.subplots(1, len(table_campaign.OUR_SCENES), figsize=(15.0, 3.4), constrained_layout=True)
    rows = []
    for axes, letter, scene in zip(panels, "abc", table_campaign.OUR_SCENES):
        world = yaml.safe_load((ROOT / f"sim_tests/simulated_world/worlds/{scene}.yaml").read_text(encoding="utf-8"))
        piles = world.get("heaps", []) + world.get("tipped", [])
        rows.append((scene, sum(pile["bricks"] for pile in piles), sum(world.get("decoys", {}).values())))
        view = matplotlib.image.imread(ROOT / f"docs/images/worlds/{scene}.png")
        axes.imshow(view[view.shape[0] // 4:-view.shape[0] // 4, view.shape[1] // 2:-view.shape[1] // 8])  # the pile
        axes.set_title(f"({letter}) {scene}: {rows[-1][1]} bricks" +
                       (f", {rows[-1][2]} of them decoys" if rows[-1][2] else ""), fontsize=13, loc="left")
        axes.set_axis_off()
    save(figure, out / "fig6.png", bbox_inches="tight")
    write_rows(out / "fig6.csv", ("scene", "bricks", "decoys"), rows)


def curves_of(folder):
    """{(scene, cycle): {system: (seconds, {"bricks", "map": missions x seconds [%]})}} of those that count, of the
    seeds in which `complete` stows a brick. A mission that has ended keeps what it had."""
    rows = table_campaign.lasting(table_campaign.read_rows(folder / "missions.csv"))
    runs = {cell: np.array([[float(row[key]) for key in ("time_s", "bricks", "map")] for row in of_cell])
            for cell, of_cell in itertools.groupby(table_campaign.read_csv(folder / "curves.csv"),
                                                   table_campaign.cell_of)}
    found = {}
    for scene, cycle in dict.fromkeys((row["scene"], row["cycle"])
                                      for row in rows if row["variant"] != "complete" and row["variant"] in SYSTEMS):
        read = {system: [runs[table_campaign.cell_of(row)] for row in of_system]
                for system, of_system in table_campaign.paired(rows, scene, cycle, SYSTEMS).items() if of_system}
        if not read:
            raise Refusal(f"{folder / 'missions.csv'}: {scene}: no seed of all systems")
        length = max(len(run) for of_system in read.values() for run in of_system)
        found[scene, cycle] = {}
        for system, of_system in read.items():
            padded = np.array([np.pad(run, ((0, length - len(run)), (0, 0)), "edge") for run in of_system])
            found[scene, cycle][system] = (table_campaign.CURVE_STEP_S * np.arange(length),
                                           {"bricks": padded[..., 1], "map": padded[..., 2]})
    if not found:
        raise Refusal(f"{folder / 'missions.csv'}: no missions of {', '.join(SYSTEMS)}")
    return found


def curves(source, out):
    """Fig. 7."""
    found = curves_of(source or ROOT / "results/campaign")
    figure, panels = plt.subplots(len(found), 2, figsize=(13.0, 3.6 * len(found) + 0.6), constrained_layout=True,
                                  squeeze=False)
    rows = []
    for (bricks_axes, map_axes), ((scene, cycle), systems) in zip(panels, found.items()):
        for axes, name, title in ((bricks_axes, "bricks", "bricks stowed [%]"),
                                  (map_axes, "map", "pile mapped so far [%]")):
            for system, (grid, values) in systems.items():
                label, colour = SYSTEMS[system]
                axes.fill_between(grid, values[name].min(axis=0), values[name].max(axis=0), color=colour, alpha=0.2,
                                  linewidth=0)
                axes.plot(grid, values[name].mean(axis=0), color=colour, linewidth=2.4, label=f"{label}: mean and range")
            axes.set_ylim(0, 105)
            axes.set_xlim(0, grid[-1])
            tidy(axes, f"{scene}: {title}, n = {len(values[name])}",
                 "simulated time [s]" if axes in panels[-1] else None)
        for system, (grid, values) in systems.items():
            ends = [share(values[name], axis=0) for name in ("bricks", "map") for share in (np.min, np.max)]
            rows += zip(itertools.repeat(scene), itertools.repeat(cycle), itertools.repeat(system),
                        itertools.repeat(len(values["bricks"])), grid, values["bricks"].mean(axis=0), *ends[:2],
                        values["map"].mean(axis=0), *ends[2:])
    figure.set_constrained_layout_pads(hspace=0.05)
    legend_below(figure, panels[0, 0], 3)
    save(figure, out / "fig7.png", bbox_inches="tight")
    write_rows(out / "fig7.csv", ("scene", "cycle", "system", "n", "time_s", "bricks_mean", "bricks_min", "bricks_max",
                                  "map_mean", "map_min", "map_max"), rows)


def tables(source, out):
    for name in ("missions.csv", "curves.csv"):
        shutil.copy((source or ROOT / "results/campaign") / name, out / name)
    table_campaign.print_tables(out / "missions.csv")


FIGURES = {"1": figure_mission.cycle, "3": figure_accuracy.blanket, "4": figure_mission.utility, "5": sectors,
           "6": scenes, "7": curves, "8": figure_accuracy.accuracy,
           "9": figure_mission.order, "tables": tables}
NEED_INPUT = ("1", "4", "9")
DETAILS = ("choices", "measures")  # parts of details.md; the others are in index.md
PARTS = {"factors": table_campaign.factors_text, "systems": table_campaign.systems_text,
         "lasting": table_campaign.lasting_text, "findings": table_campaign.findings_text,
         "measures": table_campaign.measures_text}


def page_parts(folder):
    """{(page in docs/results, mark): Markdown} of the folder's missions.csv and fig7.png; without them, the sentence
    that says so."""
    rows = table_campaign.read_rows(folder / "missions.csv") if (folder / "missions.csv").exists() else None
    parts = {mark: (text_of(rows) if rows else "") or NOTHING for mark, text_of in PARTS.items()}
    choices = table_campaign.choices_text(rows, table_campaign.read_csv(folder / "curves.csv")) if rows else NOTHING
    parts.update(choices=choices, curves="![Bricks and map over time, three systems](figures/fig7.png)\n"
                 if (folder / "fig7.png").exists() else NOTHING)
    return {("details.md" if mark in DETAILS else "index.md", mark): text for mark, text in parts.items()}


def update_docs(name, made):
    (DOCS / "figures").mkdir(exist_ok=True)
    for path in made:
        shutil.copy(path, PLACES.get(path.name, DOCS / "figures" / path.name))
    if name == "8":
        replace_between_marks(DOCS / "fig8.md", "table", (ROOT / "results/figures/fig8.md").read_text(encoding="utf-8"))
    if name in ("7", "tables"):
        for (page, mark), text in page_parts(DOCS / "figures").items():
            replace_between_marks(DOCS / page, mark, text)


@one_line_errors
def main():
    parser = Parser(__doc__)
    parser.add_argument("name", metavar="NAME", choices=FIGURES, help="one of the above")
    parser.add_argument("input", metavar="INPUT", type=pathlib.Path, nargs="?")
    parser.add_argument("--update-docs", action="store_true", help="copy figure and numbers into docs/results")
    arguments = parser.parse_args()
    if arguments.input is None and arguments.name in NEED_INPUT:
        raise UsageError(f"figure {arguments.name} needs a mission's run folder")
    out, stem = ROOT / "results/figures", "" if arguments.name == "tables" else f"fig{arguments.name}"
    out.mkdir(parents=True, exist_ok=True)
    try:
        FIGURES[arguments.name](arguments.input, out)
    except (*table_campaign.BROKEN, IndexError) as error:
        raise Refusal(f"{arguments.input or 'results'}: cannot be drawn: {table_campaign.words_of(error)}") from error
    made = sorted(path for suffix in ("png", "csv") for path in out.glob(f"{stem}[._]*{suffix}"))
    if arguments.name == "tables":
        made = [out / "missions.csv", out / "curves.csv", out / "tables.csv"]
    for path in made:
        if path.suffix == ".png" and path.stat().st_size > MAX_BYTES:
            Image.open(path).convert("RGB").quantize(255, dither=0).save(path, optimize=True)
            if path.stat().st_size > MAX_BYTES:
                raise Refusal(f"{path} has {path.stat().st_size} bytes, must be {MAX_BYTES} at most")
    if arguments.update_docs:
        update_docs(arguments.name, made)
    print(*made, sep="\n")
