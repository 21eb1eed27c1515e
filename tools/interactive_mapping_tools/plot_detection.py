# SPDX-License-Identifier: BSD-3-Clause
"""Table and plot of what evaluate_detection measured; can also put the table into a document.

The document keeps its text; what stands between `<!-- detection: begin -->` and `<!-- detection: end -->` is replaced.
"""

from .results import holds, main_of, markdown, measured, number, read_machine, read_rows
from .style import BLUE, GREY, RED, plt, save, tidy

TILTS = (0, 30, 60)
COLOURS = {0: RED, 30: BLUE, 60: "#6ea6ab"}
LIMITS = {"position_mm": 5.0, "angle_deg": 1.5, "rate": 0.99, "ms": 30.0}


def pick(rows, group, depth=None):
    return [row for row in rows if row["group"] == group and (depth is None or row["depth"] == depth)]


def rate(row):
    return row["detected"] / row["tags"]


def plot(result, out):
    rows = result[0]
    grid = {depth: {(row["distance_m"], row["tilt_deg"]): row for row in pick(rows, "grid", depth)} for depth in (0.0, 1.0)}
    distances = sorted({key[0] for key in grid[1.0]})
    tilts = sorted({key[1] for key in grid[1.0]})
    figure, axes = plt.subplots(1, 3, figsize=(15.0, 4.8), constrained_layout=True)
    for panel, key, label, limit in ((axes[0], "position_median_mm", "position error, median [mm]", LIMITS["position_mm"]),
                                     (axes[1], "angle_median_deg", "rotation error, median [degrees]", LIMITS["angle_deg"])):
        for tilt in TILTS:
            for depth, style in ((0.0, ":"), (1.0, "-")):
                values = [grid[depth][(distance, tilt)][key] for distance in distances]
                panel.plot(distances, values, style, marker="o", markersize=4, color=COLOURS[tilt],
                           label=f"tilt {tilt} degrees, {'with' if depth else 'without'} depth")
        panel.plot([0.5, 1.5], [limit, limit], color=GREY, linewidth=1.2, linestyle="--")
        panel.annotate("wanted to 1.5 m", (0.52, limit), xytext=(0, 3), textcoords="offset points", fontsize=10, color=GREY)
        panel.set_yscale("log")
        tidy(panel, label, "distance [m]")
    axes[0].legend(fontsize=9.5, loc="lower right")
    heat = axes[2]
    shares = [[100.0 * rate(grid[1.0][(distance, tilt)]) for distance in distances] for tilt in tilts]
    heat.imshow(shares, origin="lower", cmap="RdYlGn", vmin=0.0, vmax=100.0, aspect="auto")
    for y, tilt in enumerate(tilts):
        for x, distance in enumerate(distances):
            entry = grid[1.0][(distance, tilt)]
            heat.annotate(f"{100.0 * rate(entry):.0f}\n{entry['side_px']:.0f} px", (x, y), ha="center", va="center", fontsize=8.5,
                          color="white" if rate(entry) > 0.9 or rate(entry) < 0.1 else "black")
    heat.set_xticks(range(len(distances)))
    heat.set_xticklabels([f"{distance:g}" for distance in distances])
    heat.set_yticks(range(len(tilts)))
    heat.set_yticklabels([f"{tilt:g}" for tilt in tilts])
    heat.set_xlabel("distance [m]")
    heat.set_ylabel("tilt [degrees]")
    heat.set_title("tags found [%], median shortest side", loc="left")
    save(figure, out, 100)


def result_cells(row):
    return (f"{100.0 * rate(row):.1f}", f"{row['used']:.0f}", f"{row['ambiguous']:.0f}", number(row["position_median_mm"], ".2f"),
            number(row["position_p95_mm"], ".2f"), number(row["angle_median_deg"], ".2f"), number(row["angle_p95_deg"], ".2f"), f"{row['wrong_normals']:.0f}")


RESULT_HEAD = ("depth", "tags", "found %", "used", "ambiguous", "position median mm", "95 % mm", "rotation median deg", "95 % deg", "wrong normals")


def table_of(rows, group, head, label):
    yield (head, *RESULT_HEAD)
    for row in pick(rows, group):
        yield (label(row), "yes" if row["depth"] else "no", f"{row['tags']:.0f}", *result_cells(row))


def acceptance_rows(rows):
    """What was asked for, what was measured, and whether the one meets the other."""
    yield ("wanted", "measured", "holds")
    near = [row for row in pick(rows, "grid") if row["distance_m"] <= 1.5 and row["tilt_deg"] <= 60.0]
    for depth, text in ((1.0, "with depth"), (0.0, "without depth")):
        for key, unit, limit in (("position_median_mm", "mm", LIMITS["position_mm"]), ("angle_median_deg", "degrees", LIMITS["angle_deg"])):
            values = [row[key] for row in near if row["depth"] == depth and row["used"] > 0]
            what = "position" if unit == "mm" else "rotation"
            yield (f"{what}: median at most {limit:g} {unit} in every cell of the grid to 1.5 m and 60 degrees, {text}", f"worst cell {max(values):.2f} {unit}", holds(max(values) <= limit))
    for name in ("shortest side 30 px or more", "edge from the front 30 px or more"):
        row = next(row for row in pick(rows, "summary", 1.0) if row["name"] == name)
        yield (f"99 % found: {name}", f"{row['detected']:.0f} of {row['tags']:.0f}", holds(rate(row) >= LIMITS["rate"]))
    for depth, text in ((1.0, "with depth"), (0.0, "without depth")):
        used = pick(rows, "summary", depth)
        row = next(row for row in used if row["name"] == "everything")
        yield (f"no wrong normal (off by more than 20 degrees) in the whole grid, {text}", f"{row['wrong_normals']:.0f} of {row['used']:.0f}", holds(row["wrong_normals"] == 0))
        bricks = pick(rows, "brick", depth)
        wrong = sum(brick["wrong_normals"] for brick in bricks)
        yield (f"no wrong normal of whole bricks to {max(brick['distance_m'] for brick in bricks):g} m, {text}", f"{wrong:.0f} of {sum(brick['used'] for brick in bricks):.0f}", holds(wrong == 0))
    tagless = pick(rows, "tagless")[0]
    yield (f"no brick in {tagless['name']} without tags", f"{tagless['false_bricks']:.0f} bricks, {tagless['false_tags']:.0f} tags", holds(tagless["false_bricks"] == 0))
    pile = next(row for row in pick(rows, "time") if row["name"].endswith("decimate 1"))
    total = pile["detect_p95_ms"] + pile["pose_p95_ms"]
    yield (f"at most {LIMITS['ms']:g} ms a frame on one core (pile of 12 bricks, 95 %)", f"{total:.1f} ms", holds(total <= LIMITS["ms"]))


def peer_rows(rows):
    """The peer on the same images: ratios below 1 are in favour of this package."""
    yield ("one tag, alone", "tags", "found %: libapriltag", "here, with depth", "position median mm: libapriltag", "here", "ratio", "95 %: libapriltag", "here", "ratio",
           "rotation 95 % deg: libapriltag", "here", "ratio", "wrong normals: libapriltag", "here")
    for peer in pick(rows, "peer summary"):
        ours = next(row for row in pick(rows, "summary", 1.0) if row["name"] == peer["name"])
        def beside(key, form):
            return (number(peer[key], form), number(ours[key], form), number(ours[key] / peer[key], ".2f"))
        yield (peer["name"], f"{peer['tags']:.0f}", f"{100.0 * rate(peer):.1f}", f"{100.0 * rate(ours):.1f}", *beside("position_median_mm", ".2f"),
               *beside("position_p95_mm", ".2f"), *beside("angle_p95_deg", ".2f"), f"{peer['wrong_normals']:.0f} of {peer['used']:.0f}",
               f"{ours['wrong_normals']:.0f} of {ours['used']:.0f}")


def time_rows(rows):
    yield ("processor time, ms", "find tags", "95 %", "poses", "95 %", "tags of 12 px or more found")
    for row in pick(rows, "time"):
        yield (row["name"], *(f"{row[key]:.1f}" for key in ("detect_ms", "detect_p95_ms", "pose_ms", "pose_p95_ms")), f"{row['detected']:.0f} of {row['tags']:.0f}")
    for row in pick(rows, "peer time"):
        yield ("libapriltag alone, " + row["name"], f"{row['detect_ms']:.1f}", f"{row['detect_p95_ms']:.1f}", "in it", "-", f"{row['detected']:.0f} of {row['tags']:.0f}")
    row = pick(rows, "tagless")[0]
    yield (row["name"] + " without tags", f"{row['detect_ms']:.1f}", f"{row['detect_p95_ms']:.1f}", "-", "-", "-")


def table(result):
    rows, machine = result
    parts = [
        measured(machine),
        "**Wanted and measured**\n\n" + markdown(acceptance_rows(rows)),
        "**Summaries of the grid**\n\n" + markdown(table_of(rows, "summary", "one tag, alone", lambda row: row["name"])),
        "**Beside libapriltag alone** (its corners, its `estimate_tag_pose`, no depth, decimate 1), on the same images\n\n" + markdown(peer_rows(rows)),
        "**Whole bricks**, turned anyhow, by distance\n\n" + markdown(table_of(rows, "brick", "distance m", lambda row: f"{row['distance_m']:g}")),
        "**One effect at a time**, one tag at 1 m, tilt 0 to 60 degrees\n\n" + markdown(table_of(rows, "effect", "effect", lambda row: row["name"])),
        "**Time**, one thread, 640 x 480\n\n" + markdown(time_rows(rows)),
        "**The grid**, by distance and tilt\n\n" + markdown(table_of(rows, "grid", "m, degrees", lambda row: f"{row['distance_m']:g}, {row['tilt_deg']:g}")),
    ]
    return "\n\n".join(parts) + "\n"


def read(folder):
    return read_rows(folder / "evaluate_detection.csv", ("group", "name")), read_machine(folder / "machine.txt")


def main():
    return main_of(__doc__, {"plot": plot}, read, lambda result: {"detection": table(result)})()
