# SPDX-License-Identifier: BSD-3-Clause
"""Plot and tables of what scripts/bench measured; can also put the tables into a document.

The document keeps its text; what was measured replaces what stands between `<!-- NAME: begin -->` and `<!-- NAME: end -->`: bench is the map,
core its building blocks, world the simulated world.
"""

from .cli import Refusal
from .results import holds, main_of, markdown, read_json, read_machine
from .style import BLUE, GREY, INK, RED, REST, SEQUENCE, plt, save, tidy

STAGES = ("classify", "regress", "fuse", "observe", "insert", "train", "publish")
STAGE_COLOURS = (*SEQUENCE[:3], REST, *SEQUENCE[3:6])
BUSY_LOAD = 0.5
PLACES = {"face": "faces", "convex": "convex edges", "concave": "concave edges"}
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


def draw_stages(bars, maps):
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


def draw_frames(curve, maps, scene):
    curves = (("octomap_2cm", "OctoMap 2 cm", GREY), ("octomap_2cm_region", "OctoMap 2 cm, our region", "#a0a0a0"), ("gpis_1_thread", "gpis_mapping, 1 thread", "#7fa3bd"),
              ("gpis", f"gpis_mapping, {maps['gpis']['threads']} threads", BLUE))
    highest = 0.0
    for key, label, colour in curves:
        if key not in maps:
            continue
        values = maps[key]["total_ms"]["per_frame"]
        highest = max(highest, max(values))
        curve.plot(range(len(values)), values, color=colour, linewidth=2.2 if key in ("gpis", "octomap_2cm") else 1.4, label=label)
    curve.set_ylim(0.0, 1.6 * highest)
    if scene["removal_frame"] > 0:
        curve.axvline(scene["removal_frame"], color=RED, linewidth=1.2, linestyle="--")
        curve.annotate(f"{scene['removed_boxes']} bricks are taken away", (scene["removal_frame"], 1.0), xycoords=("data", "axes fraction"),
                       xytext=(6, -4), textcoords="offset points", fontsize=10.5, color=RED, va="top")
    curve.set_xlim(0, len(maps["gpis"]["total_ms"]["per_frame"]) - 1)
    curve.legend(fontsize=10.5, loc="upper left")
    tidy(curve, "Frame by frame", "frame", "time per frame [ms]")


def draw_places(bars, maps):
    width = 0.36
    for shift, key, label, colour in ((-0.5, "gpis", "gpis_mapping", BLUE), (0.5, "octomap_2cm", "OctoMap 2 cm", GREY)):
        places = maps[key]["before_removal"]["places"]
        at = [index + shift * width for index in range(len(PLACES))]
        rmse, p95 = ([places[place][name] for place in PLACES] for name in ("rmse_mm", "p95_mm"))
        bars.bar(at, rmse, width=width, color=colour, linewidth=0, label=label)
        bars.scatter(at, p95, marker="_", s=500, linewidth=2.0, color=INK)
        for x, error, high in zip(at, rmse, p95):
            bars.annotate(f"{error:.1f} / {high:.1f}", (x, high), ha="center", va="bottom", fontsize=9.5, xytext=(0, 3), textcoords="offset points")
    ours = maps["gpis"]["before_removal"]["places"]
    bars.set_xticks(range(len(PLACES)))
    bars.set_xticklabels([f"{label}\n{100.0 * ours[place]['area_share']:.0f} % of our area" for place, label in PLACES.items()], fontsize=10.5)
    bars.set_ylim(0.0, 1.3 * bars.get_ylim()[1])
    bars.legend(fontsize=10.5, loc="upper left", ncol=2, title="bar: RMSE, line: 95th percentile", title_fontsize=10.5)
    tidy(bars, "Error by place, before the removal", y_label="distance to the true surface [mm]")


def draw_growth(curve, growth):
    sizes = growth["maps"]
    areas = [size["area_m2"] for size in sizes]
    for what, label, colour in (("octomap_processor_ms", "OctoMap 2 cm", GREY), ("processor_ms", "gpis_mapping", BLUE)):
        values = [size[what] for size in sizes]
        curve.plot(areas, values, color=colour, linewidth=2.2, marker="o", label=label)
        curve.annotate(f"x {growth['ratio'][what]:.2f}", (areas[-1], values[-1]), ha="right", va="bottom", fontsize=11, color=colour, xytext=(0, 7), textcoords="offset points")
    curve.set_xscale("log")
    curve.set_xticks(areas)
    curve.set_xticklabels([f"{area:.0f}" for area in areas])
    curve.minorticks_off()
    curve.set_ylim(0.0, 1.35 * max(size["octomap_processor_ms"] for size in sizes))
    curve.legend(fontsize=10.5, loc="upper left", ncol=2)
    tidy(curve, "The same view in maps of several sizes", "mapped floor [m$^2$]", "processor time per update [ms]")


def plot(read, out):
    result = read["map"]
    figure, ((stages, frames), (places, growth)) = plt.subplots(2, 2, figsize=(13.0, 10.4), constrained_layout=True, gridspec_kw={"width_ratios": [5, 6]})
    draw_stages(stages, result["maps"])
    draw_frames(frames, result["maps"], result["scene"])
    draw_places(places, result["maps"])
    draw_growth(growth, result["growth"])
    save(figure, out)


def time_text(ms):
    for factor, unit in ((1e-3, "s"), (1.0, "ms"), (1e3, "us")):
        if ms * factor >= 1.0:
            return f"{ms * factor:.3g} {unit}"
    return f"{ms * 1e6:.3g} ns"


def rate_text(rate):
    return f"{rate / 1e6:.2f} M" if rate >= 1e6 else f"{rate / 1e3:.0f} k"


def bar_rows(result):
    ours, octomap_ms = result["maps"]["gpis"], result["maps"]["octomap_2cm"]["total_ms"]["median"]
    before, after, bands = ours["before_removal"], ours.get("after_removal"), result["queries"]["bands"]
    threads = ours["threads"]
    rows = [("update, median, of OctoMap 2 cm", "<=", 0.08, ours["total_ms"]["median"] / octomap_ms, ".3f"),
            ("update, 95th percentile, of OctoMap's median", "<=", 0.12, ours["total_ms"]["p95"] / octomap_ms, ".3f"),
            ("RMSE before the removal [mm]", "<=", 1.7, before["rmse_mm"], ".2f")]
    if after:
        rows.append(("RMSE after the removal [mm]", "<=", 1.7, after["rmse_mm"], ".2f"))
    rows += [("complete within 1 cm", ">=", 0.988, before["complete_1cm"], ".3f"), ("complete within 2 cm", ">=", 0.998, before["complete_2cm"], ".3f"),
             ("mean error of distances of 0 to 5 cm [mm]", "<=", 1.0, bands["0 to 5 cm"]["mean_abs_error_mm"], ".2f"),
             ("mean error of distances of 5 to 30 cm [mm]", "<=", 1.5, bands["5 to 30 cm"]["mean_abs_error_mm"], ".2f")]
    if after:
        rows.append(("ghosts one frame after", "<=", 0.002, after["ghost_share"], ".4f"))
    rows += [("mesh of what changed, median [ms]", "<=", 40, ours["mesh_incremental_ms"]["median"], ".0f"), ("mesh of the whole map [ms]", "<=", 120, result["mesh"]["full_ms"], ".0f"),
             (f"distance and gradient, {threads} threads [M/s]", ">=", 4.0, bands["0 to 5 cm"][f"distance_per_s_{threads}_threads"] / 1e6, ".2f"),
             (f"with variance, {threads} threads [M/s]", ">=", 1.0, bands["0 to 5 cm"][f"variance_per_s_{threads}_threads"] / 1e6, ".2f"),
             ("memory of the map [MB]", "<=", 16.0, ours["map_mb"], ".1f"),
             ("update in 1000 m2, of that in 10 m2 (processor time)", "<=", 1.1, result["growth"]["ratio"]["processor_ms"], ".2f")]
    yield ("", "bar", "reached", "reached / bar", "kept")
    for what, relation, bar, reached, form in rows:
        yield (what, f"{relation} {bar:g}", format(reached, form), f"{reached / bar:.2f}", holds(reached <= bar if relation == "<=" else reached >= bar))


def place_rows(result):
    yield ("", "nearest to", "RMSE mm", "median mm", "95th percentile mm", "mean, outwards, mm", "share of the area")
    for entry in result["maps"].values():
        for place, label in PLACES.items():
            error = entry["before_removal"]["places"][place]
            yield (entry["title"] if place == "face" else "", label, *(f"{error[name]:.1f}" for name in ("rmse_mm", "median_mm", "p95_mm", "mean_mm")), f"{error['area_share']:.2f}")


def growth_rows(result):
    yield ("mapped floor m2", "points", "map MB", "update ms", "processor ms", "OctoMap 2 cm processor ms")
    for size in result["growth"]["maps"]:
        yield (f"{size['area_m2']:.0f}", size["points"], f"{size['map_mb']:.0f}", *(f"{size[name]:.1f}" for name in ("update_ms", "processor_ms", "octomap_processor_ms")))
    yield ("**1000 over 10**", "", "", *(f"{result['growth']['ratio'][name]:.2f}" for name in ("update_ms", "processor_ms", "octomap_processor_ms")))


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


def conditions(facts, machine, what):
    """How a part was measured, and a warning where other programs ran."""
    text = (f"Measured {machine.get('date', 'at an unknown date')} on {facts['processor']}, {facts['cores']} cores; {machine.get('compiler', facts.get('compiler', 'unknown compiler'))}, "
            f"{facts['build_type']}; load {facts['load_at_start']:.2f} at the start; commit {machine.get('commit', 'unknown')}. {what}")
    busy = "\n\nThe machine was **not at rest**: times on the wall are too long, processor times are the ones to compare."
    return text + (busy if facts["load_at_start"] >= BUSY_LOAD else "")


def map_table(result, machine):
    scene, ours = result["scene"], result["maps"]["gpis"]
    parts = [
        conditions(result["machine"], machine, f"{scene['frames']} frames, {scene['width_px']} x {scene['height_px']}, {scene['boxes']} bricks; medians of {result['repeat']} run{'s' if result['repeat'] > 1 else ''}."),
        "**Bars** that were set, and what was reached; times and rates count only on a machine at rest:\n\n" + markdown(bar_rows(result)),
        "**Update**, frame 0 apart:\n\n" + markdown(map_rows(result)),
        f"**Quality of these maps** before frame {scene['removal_frame']}, and after it:\n\n" + markdown(quality_rows(result)),
        f"**Error by place**, before frame {scene['removal_frame']}:\n\n" + markdown(place_rows(result)),
        f"**Where our update spends its time**, {ours['threads']} threads. {ours['points']} points in {ours['cells']} cells, "
        f"{ours['training_points_per_cell']:.0f} training points per cell (at most {ours['largest_cell']:.0f}). "
        f"{ours['cells_retrained']['median']:.0f} cells trained per frame:\n\n" + markdown(stage_rows(result)),
        f"**Mesh** of the whole map from nothing: {result['mesh']['full_ms']:.0f} ms, {result['mesh']['triangles']} triangles.",
        f"**Queries.** The first one far from the surface after an update builds an index: {result['queries']['first_query_ms']:.1f} ms. "
        f"For context, OctoMap answers {rate_text(result['octomap_lookups_per_s'])} occupancy look-ups per second with one thread.\n\n" + markdown(query_rows(result)),
        "**Cost against the map's size**: the same view 20 times in floors with bricks, medians:\n\n" + markdown(growth_rows(result)),
    ]
    return "\n\n".join(parts) + "\n"


def core_table(core, machine):
    """Google Benchmark's context says less than the other programs."""
    facts = {"processor": machine.get("processor", "an unknown machine").split(",")[0], "cores": core["context"]["num_cpus"], "build_type": machine.get("build", "unknown build"),
             "load_at_start": core["context"]["load_avg"][0]}
    return conditions(facts, machine, "One thread.") + "\n\n" + markdown(core_rows(core)) + "\n"


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
        conditions(facts, machine, f"{bricks} bricks, camera at {result['camera_rate_hz']:g} Hz; medians of {result['repeat']} runs of {result['simulated_s']:g} simulated seconds."),
        markdown(world_rows(result)),
        f"Before the first tick the pile is dropped and textures are drawn: {min(cost['wall_s'] for cost in built):.1f} s ({min(cost['processor_s'] for cost in built):.1f} s of the processors). "
        f"The judge takes {wall_and_processor(judge['first'])} ms for the first surface of {judge['triangles']} triangles, {wall_and_processor(judge['later'])} ms for later ones.",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def read_map(path):
    result = read_json(path)
    result = result if isinstance(result, dict) else {}
    missing = [key for key in ("machine", "scene", "maps", "mesh", "queries", "growth") if key not in result]
    missing += [f"maps/{name}/before_removal/places" for name, entry in result.get("maps", {}).items() if "places" not in entry.get("before_removal", {})]
    if missing:
        raise Refusal(f"{path}: has no {', '.join(missing)}: it comes from another version of bench_map_vs_octomap, run scripts/bench map again")
    return result


def read(folder):
    """{part: what was measured}, and "machine"."""
    files = {"map": ("bench_map_vs_octomap.json", read_map), "core": ("bench_core.json", read_json), "world": ("bench_world.json", read_json)}
    parts = {part: read_one(folder / name) for part, (name, read_one) in files.items() if (folder / name).is_file()}
    if not parts:
        raise Refusal(f"{folder}: holds none of {', '.join(name for name, _ in files.values())}")
    return {**parts, "machine": read_machine(folder / "machine.txt")}


def texts(read):
    tables = {"bench": ("map", map_table), "core": ("core", core_table), "world": ("world", world_table)}
    return {mark: table(read[part], read["machine"]) for mark, (part, table) in tables.items() if part in read}


def main():
    return main_of(__doc__, {"plot": plot}, read, texts)()
