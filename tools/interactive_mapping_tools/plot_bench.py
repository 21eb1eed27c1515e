# SPDX-License-Identifier: BSD-3-Clause
"""Plot and table of what scripts/bench measured; can also put the table into a document.

The document keeps its text; what stands between `<!-- bench: begin -->` and `<!-- bench: end -->` is replaced, and the
table of the simulated world between `<!-- world: begin -->` and `<!-- world: end -->`.
"""

from .results import main_of, markdown, read_json, read_machine
from .style import BLUE, GREY, RED, REST, SEQUENCE, plt, save, tidy

STAGES = ("classify", "regress", "fuse", "observe", "insert", "train", "publish")
STAGE_COLOURS = (*SEQUENCE[:3], REST, *SEQUENCE[3:6])
BUSY_LOAD = 0.5
WORLD_PARTS = ("physics", "camera", "scanner", "judge")
CORE_LABELS = (
    ("BM_CellGpTrain/100", "train a cell, 100 points"),
    ("BM_CellGpMean/100", "posterior mean at one point, 100 points"),
    ("BM_CellGpVariance/100", "variance at 64 points, 100 points"),
    ("BM_CellGpVarianceGradient/100", "variance with gradient at 64 points, 100 points"),
    ("BM_FrameRegressor", "frame regressor, once per camera"),
    ("BM_DepthClassifier", "classify 640 x 480"),
    ("BM_FrameMapCondition", "condition the frame map on 640 x 480"),
    ("BM_FitLocalPlane", "fit a local plane"),
    ("BM_SnapshotField", "field and gradient, cells blended"),
    ("BM_BlendWeights", "blend weights at a point"),
    ("BM_MeshOfCellBlock", "mesh of a block of 3 x 3 x 3 cells"),
    ("BM_SaveMap", "save a small map, with flush to disk"),
    ("BM_LoadMapFile", "read its file"),
    ("BM_LoadMapAndTrain", "read its file and train it"),
)


def plot(read, out):
    result = read[0]
    maps = result["maps"]
    figure, (bars, curve) = plt.subplots(1, 2, figsize=(13.0, 5.2), constrained_layout=True, gridspec_kw={"width_ratios": [5, 6]})

    shown = [key for key in ("gpis", "gpis_1_thread", "octomap_2cm_region", "octomap_2cm") if key in maps]
    labels = {"gpis": f"gpis_mapping\n{maps['gpis']['threads']} threads", "gpis_1_thread": "gpis_mapping\n1 thread",
              "octomap_2cm": "OctoMap\n2 cm", "octomap_2cm_region": "OctoMap 2 cm\nour region"}
    for place, key in enumerate(shown):
        total = maps[key]["total_ms"]["median"]
        if "stages_ms" in maps[key]:
            base = 0.0
            # Medians of stages do not add up to the median of the sum: scaled so that the bar shows the latter.
            values = [maps[key]["stages_ms"][stage]["median"] for stage in STAGES]
            scale = total / sum(values)
            for stage, colour, value in zip(STAGES, STAGE_COLOURS, values):
                bars.bar(place, scale * value, bottom=base, width=0.62, color=colour, linewidth=0, label=stage if place == 0 else None)
                base += scale * value
        else:
            bars.bar(place, total, width=0.62, color=GREY, linewidth=0)
        bars.annotate(f"{total:.0f}" if total >= 10 else f"{total:.1f}", (place, total), ha="center", va="bottom", fontsize=13, xytext=(0, 2), textcoords="offset points")
    bars.set_xticks(range(len(shown)))
    bars.set_xticklabels([labels[key] for key in shown], fontsize=10.5)
    handles, names = bars.get_legend_handles_labels()
    bars.legend(handles[::-1], names[::-1], fontsize=10.5, loc="upper left")
    tidy(bars, "Time per frame by stage", y_label="median time per frame [ms]")
    bars.set_ylim(0.0, 1.08 * max(maps[key]["total_ms"]["median"] for key in shown))

    curves = (("octomap_2cm", "OctoMap 2 cm", GREY, "-"), ("octomap_2cm_region", "OctoMap 2 cm, our region", "#a0a0a0", "-"),
              ("gpis_1_thread", "gpis_mapping, 1 thread", "#7fa3bd", "-"),
              ("gpis", f"gpis_mapping, {maps['gpis']['threads']} threads", BLUE, "-"))
    highest = 0.0
    for key, label, colour, style in curves:
        if key not in maps:
            continue
        values = maps[key]["total_ms"]["per_frame"]
        highest = max(highest, max(values))
        curve.plot(range(len(values)), values, color=colour, linestyle=style, linewidth=2.2 if key in ("gpis", "octomap_2cm") else 1.4, label=label)
    removal = result["scene"]["removal_frame"]
    curve.set_ylim(0.0, 1.3 * highest)
    if removal > 0:
        curve.axvline(removal, color=RED, linewidth=1.2, linestyle="--")
        curve.annotate(f"{result['scene']['removed_boxes']} bricks are taken away", (removal, 1.0), xycoords=("data", "axes fraction"),
                       xytext=(6, -4), textcoords="offset points", fontsize=10.5, color=RED, va="top")
    curve.set_xlim(0, len(maps["gpis"]["total_ms"]["per_frame"]) - 1)
    curve.legend(fontsize=10.5, loc="upper left")
    tidy(curve, "Frame by frame", "frame", "time per frame [ms]")
    save(figure, out)


def time_text(ms):
    for factor, unit in ((1e-3, "s"), (1.0, "ms"), (1e3, "us")):
        if ms * factor >= 1.0:
            return f"{ms * factor:.3g} {unit}"
    return f"{ms * 1e6:.3g} ns"


def rate_text(rate):
    return f"{rate / 1e6:.2f} M" if rate >= 1e6 else f"{rate / 1e3:.0f} k"


def map_rows(result):
    reference = result["maps"]["octomap_2cm"]["total_ms"]["median"]
    processor = result["maps"]["octomap_2cm"]["processor_ms"]["median"]
    yield ("", "median ms", "of OctoMap 2 cm", "p95 ms", "max ms", "first frame ms", "processor ms", "of OctoMap 2 cm", "map MB", "RSS MB")
    for entry in result["maps"].values():
        total = entry["total_ms"]
        yield (entry["title"], f"{total['median']:.1f}", f"{total['median'] / reference:.2f}", f"{total['p95']:.1f}", f"{total['max']:.1f}",
               f"{total['first']:.1f}", f"{entry['processor_ms']['median']:.1f}", f"{entry['processor_ms']['median'] / processor:.2f}", f"{entry['map_mb']:.1f}", f"{entry['rss_growth_mb']:.0f}")


def quality_rows(result):
    yield ("", "surface RMSE mm", "off by > 2 cm", "complete within 1 cm", "2 cm", "after the removal: 2 cm", "ghosts")
    for entry in result["maps"].values():
        before, after = entry["before_removal"], entry.get("after_removal")
        yield (entry["title"], f"{before['rmse_mm']:.1f}", f"{before['share_off_by_2cm']:.3f}", f"{before['complete_1cm']:.3f}", f"{before['complete_2cm']:.3f}",
               f"{after['complete_2cm']:.3f}" if after else "-", f"{after['ghost_share']:.3f}" if after else "-")


def stage_rows(result):
    yield ("stage", "median ms", "p95 ms", "max ms", "first frame ms")
    ours = result["maps"]["gpis"]
    for stage in STAGES:
        values = ours["stages_ms"][stage]
        yield (stage, *(f"{values[name]:.1f}" for name in ("median", "p95", "max", "first")))
    values = ours["mesh_incremental_ms"]
    yield (f"beside it: mesh of changed cells ({ours['mesh_incremental_cells']['median']:.0f})", *(f"{values[name]:.0f}" for name in ("median", "p95", "max", "first")))


def query_rows(result):
    threads = result["maps"]["gpis"]["threads"]
    counts = [1, threads] if threads > 1 else [1]
    yield ("distance of the points", "asked for", *(f"{count} thread{'s' if count > 1 else ''}: points/s" for count in counts), "mean error mm", "answered")
    for name, band in sorted(result["queries"]["bands"].items()):
        for kind, text in (("distance", "distance, gradient"), ("variance", "and variance"), ("variance_gradient", "and its gradient")):
            rates = [rate_text(band[f"{kind}_per_s_{count}_threads"]) for count in counts]
            quality = (f"{band['mean_abs_error_mm']:.1f}", f"{band['answered_share']:.3f}") if kind == "distance" else ("", "")
            yield (name if kind == "distance" else "", text, *rates, *quality)


def core_rows(core):
    times = {entry["name"]: entry["cpu_time"] * {"ns": 1e-6, "us": 1e-3, "ms": 1.0, "s": 1e3}[entry["time_unit"]] for entry in core["benchmarks"]}
    wall = {entry["name"]: entry["real_time"] * {"ns": 1e-6, "us": 1e-3, "ms": 1.0, "s": 1e3}[entry["time_unit"]] for entry in core["benchmarks"]}
    yield ("building block", "processor time", "time")
    for name, label in CORE_LABELS:
        if name in times:
            yield (label, time_text(times[name]), time_text(wall[name]))


def table(result, core, machine):
    scene, ours = result["scene"], result["maps"]["gpis"]
    facts = result["machine"]
    parts = [
        f"Measured {machine.get('date', 'at an unknown date')} on {facts['processor']}, {facts['cores']} cores; {machine.get('compiler', facts['compiler'])}, "
        f"{facts['build_type']}; load {facts['load_at_start']:.2f} at the start; commit {machine.get('commit', 'unknown')}. "
        f"{scene['frames']} frames, {scene['width_px']} x {scene['height_px']}, {scene['boxes']} bricks; medians of {result['repeat']} runs.",
        "The machine was **not at rest**: times on the wall are too long, processor times are the ones to compare." if facts["load_at_start"] >= BUSY_LOAD else "",
        "**Update**, frame 0 apart:\n\n" + markdown(map_rows(result)),
        f"**Quality of these maps** before frame {scene['removal_frame']}, and after it:\n\n" + markdown(quality_rows(result)),
        f"**Where our update spends its time**, {ours['threads']} threads; {ours['points']} points in {ours['cells']} cells, "
        f"{ours['training_points_per_cell']:.0f} training points per cell (at most {ours['largest_cell']:.0f}), "
        f"{ours['cells_retrained']['median']:.0f} cells trained per frame:\n\n" + markdown(stage_rows(result)),
        f"**Mesh** of the whole map from nothing: {result['mesh']['full_ms']:.0f} ms, {result['mesh']['triangles']} triangles.",
        f"**Queries.** The first one after an update builds an index: {result['queries']['first_query_ms']:.1f} ms. "
        f"For context, OctoMap answers {rate_text(result['octomap_lookups_per_s'])} occupancy look-ups per second with one thread.\n\n" + markdown(query_rows(result)),
    ]
    if core is not None:
        parts.append("**Building blocks**, one thread:\n\n" + markdown(core_rows(core)))
    return "\n\n".join(part for part in parts if part) + "\n"


def wall_and_processor(cost):
    """Milliseconds."""
    return f"{1e3 * cost['wall_s']:.0f} ({1e3 * cost['processor_s']:.0f})"


def world_rows(result):
    yield ("ms per simulated second: wall (processors)", "times real time", "all", *WORLD_PARTS)
    for case in result["cases"].values():
        yield (case["title"], f"{case['real_time_factor']:.1f}", wall_and_processor(case["total"]), *(wall_and_processor(case["parts"][part]) for part in WORLD_PARTS))


def world_table(result, machine):
    facts, judge = result["machine"], result["judge_surface"]
    built = [case["construction"] for case in result["cases"].values()]
    bricks = max(case["bricks"] for case in result["cases"].values())
    parts = [
        f"Measured {machine.get('date', 'at an unknown date')} on {facts['processor']}, {facts['cores']} cores; {facts['build_type']}; "
        f"load {facts['load_at_start']:.2f} at the start; commit {machine.get('commit', 'unknown')}. {bricks} bricks, camera at {result['camera_rate_hz']:g} Hz; "
        f"medians of {result['repeat']} runs of {result['simulated_s']:g} simulated seconds.",
        "The machine was **not at rest**: times on the wall are too long, processor times are the ones to compare." if facts["load_at_start"] >= BUSY_LOAD else "",
        markdown(world_rows(result)),
        f"Before the first tick the pile is dropped and textures are drawn: {min(cost['wall_s'] for cost in built):.1f} s ({min(cost['processor_s'] for cost in built):.1f} s of the processors). "
        f"The judge takes {wall_and_processor(judge['first'])} ms for the first surface of {judge['triangles']} triangles, {wall_and_processor(judge['later'])} ms for later ones.",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def read(folder):
    """(map's result, building blocks or None, world's result or None, machine)"""
    others = (folder / name for name in ("bench_core.json", "bench_world.json"))
    return (read_json(folder / "bench_map_vs_octomap.json"), *(read_json(path) if path.is_file() else None for path in others), read_machine(folder / "machine.txt"))


def texts(read):
    result, core, world, machine = read
    return {"bench": table(result, core, machine), **({"world": world_table(world, machine)} if world else {})}


def main():
    return main_of(__doc__, {"plot": plot}, read, texts)()
