# SPDX-License-Identifier: BSD-3-Clause
"""Says what a mission did: puts the judge's figures into RUN_FOLDER/summary.json, draws RUN_FOLDER/report/*.png, writes
RUN_FOLDER/index.html, one file with all of it in it, and says it in words on the terminal.

Works with what there is: what is missing, as after a crash, is named.
"""

import base64
import datetime
import io
import json
import math
import os
import pathlib

import jinja2
import matplotlib.colors
import numpy as np
import yaml
from PIL import Image

from . import ROOT, mission_run, plot_mission, render_mesh
from .cli import Refusal, one_line_errors, parser_of
from .mission_run import count_of, duration, number

TEMPLATES = jinja2.Environment(loader=jinja2.FileSystemLoader(str(pathlib.Path(__file__).parent / "templates")), autoescape=True, trim_blocks=True,
                               lstrip_blocks=True, undefined=jinja2.StrictUndefined)
CAPTIONS = {
    "path.png": "Where the robot drove and stood, and the pile, from above. An arrow points to where the robot looked.",
    "time.png": "Where the time went.",
    "utilities.png": "Each choice of a standing pose: the candidates, and the factors of the chosen one.",
    "places.png": "The pile's outline from above as up to three choices saw it; the colour is the utility of standing there."}
FILES = {
    "summary.json": "the figures", "mission.jsonl": "each decision with its reason", "selections.jsonl": "each choice of a view with all candidates",
    "path.jsonl": "the driven path", "judge.csv": "what the judge saw, per second", "events.jsonl": "stowed, fallen, dropped, hit",
    "parameters.yaml": "the nodes' parameters", "judge.json": "the judge's totals", "pictures": "of the world; maps as meshes (PLY)", "log": "of the nodes"}
PARAMETER_FILES = {  # {name: section of the parameters} where it is not the package's name alone
    "gpis_mapping": {"gpis_mapping_node": "", "gpis_mapping": "map/"}, "octomap_baseline": {"octomap_baseline_node": "", "octomap_baseline": "map/"},
    "nbv_selection": {"nbv_selection": "", "octomap_strategies": ""}, "simulated_world": {"simulation": ""}}
MAP_VIEW = (-146.0, 31.0)  # azimuth, elevation [deg]: that of the simulator's pictures when the robot starts on the -x side
MAX_STAGES = 4  # pictures before, during, after


def plural(count, one, many):
    return f"no {one}" if count == 0 else f"one {one}" if count == 1 else f"{count} {many}"


def share(value):
    return None if value is None or not math.isfinite(number(value)) else f"{100.0 * value:.1f} %"


def sentences(run, summary):
    """The outcome in words."""
    stowed, picked, total = (count_of(summary.get(key)) for key in ("bricks_stowed", "bricks_picked", "bricks_total"))
    done = stowed if stowed is not None else picked
    words = []
    if done is None:
        words.append("The number of picked bricks is not known.")
    else:
        of_all = f" of {total}" if total is not None else ""
        pickable = count_of(summary.get("bricks_pickable"))
        if pickable is not None and pickable != total:
            of_all += f" ({pickable} can be picked)"
        percent = f" ({100.0 * done / total:.0f} %)" if total else ""
        verb = f"stowed{percent}" if stowed is not None else f"picked{percent}, by the mission's own count,"
        time = f" in {duration(summary['sim_seconds'])} of {run.clock()}" if summary.get("sim_seconds") is not None else ""
        wall = f", {duration(summary['wall_seconds'])} by the wall clock" if summary.get("wall_seconds") is not None else ""
        words.append(f"{done}{of_all} brick{'' if done == 1 and total in (None, 1) else 's'} {f'{verb}{time}{wall}'.rstrip(',')}.")
    if stowed is not None and picked is not None and stowed != picked:
        words.append(f"The mission's own count is {picked}: it differs from the judge's {stowed}.")
    if summary.get("falls") is not None:
        counted = [plural(summary["falls"], "fall", "falls"), plural(summary["collisions"] or 0, "collision", "collisions")]
        if summary.get("load_contacts"):
            counted.append(plural(summary["load_contacts"], "contact of a carried brick", "contacts of carried bricks"))
        if summary.get("drops"):
            counted.append(plural(summary["drops"], "brick dropped", "bricks dropped"))
        text = ", ".join(counted)
        words.append(text[0].upper() + text[1:] + ".")
    coverage, precision = share(summary.get("map_coverage")), share(summary.get("map_precision"))
    if coverage:
        coverable = share(summary.get("map_coverable"))
        words.append(f"The map covered {coverage} of the bricks' surface that could have been seen from the mast." +
                     (f" This camera could have seen {coverable} of all that was ever exposed." if coverable else "") +
                     (f" In the mean {precision} of what it held of the pile was true." if precision else ""))
    if run.is_one_of_several and run.table:
        words.append("It is one of several missions of a run: the counts are its own, the coverage is the run's up to its end.")
    reason = summary.get("end_reason")
    if reason == "crashed":
        has_ended = run.log and run.log[-1].get("decision") == "ended"
        words.append("It ended, but the reason is not known." if has_ended else "The mission did not end by itself: its log breaks off.")
    elif reason not in (None, "none"):
        message = str(summary.get("end_message") or "").split(" (")[0]  # what is in brackets is in the log
        words.append(f"It ended because {mission_run.END_WORDS.get(reason, reason)}" + (f" ({message})." if message else "."))
    return words


def pick_stages(entries, wanted):
    """Of [(seconds, count, path)] one per stage: the last with no brick picked, those nearest to shares between, the last."""
    if not entries:
        return []
    last = entries[-1]
    most = max(count for _, count, _ in entries)
    before = [entry for entry in entries if entry[1] == 0] or entries[:1]
    chosen = [before[0] if wanted == "world" else before[-1]]
    for share_of_all in [k / (MAX_STAGES - 1) for k in range(1, MAX_STAGES - 1)]:
        entry = min(entries, key=lambda candidate: (abs(candidate[1] - share_of_all * most), -candidate[0]))
        if entry not in chosen and entry != last:
            chosen.append(entry)
    if last not in chosen:
        chosen.append(last)
    return chosen


def pile_frame(mesh):
    """(middle, distance [m]) from which the pile fills a picture."""
    points = mesh.points[np.unique(mesh.triangles)]
    ground = np.percentile(points[:, 2], 5.0)
    high = points[points[:, 2] > ground + 0.1]
    if len(high) < 50:
        high = points
    middle = np.append(np.median(high[:, :2], axis=0), ground + 0.15)
    radius = np.percentile(np.linalg.norm(high[:, :2] - middle[:2], axis=1), 95.0)
    return middle, (radius + 0.45) / np.tan(0.5 * render_mesh.FIELD_OF_VIEW_RAD)


def draw_maps(run, out):
    """([(seconds, count, picture)], range of the colours): the map at the stages, all from one place and in one scale of colours."""
    drawn, reference, colour_range = [], None, None
    for seconds, count, path in pick_stages(run.maps, "map"):
        picture = out / (path.stem + ".png")
        try:
            mesh = render_mesh.read_ply(path)
            if reference is None:
                middle, distance = pile_frame(mesh)
                reference, colour_range = mesh, render_mesh.range_of(mesh, "height")
            render_mesh.render([mesh], [""], picture, reference, [*MAP_VIEW, distance], middle, "height", colour_range, (800, 450), panel_may_shrink=False, has_legend=False)
        except (render_mesh.MeshError, ValueError, LookupError) as error:
            run.notes.append(f"{path.name} cannot be drawn: {error}")
            continue
        drawn.append((seconds, count, picture))
    return drawn, colour_range


def embedded(path, width_px, run, lossless=False):
    """The picture as an address that holds it; None if it is none."""
    try:
        with Image.open(path) as opened:
            image = opened.convert("RGB")
    except (OSError, ValueError) as error:
        run.notes.append(f"{path.name} cannot be shown: {error}")
        return None
    if image.width > width_px:
        image = image.resize((width_px, max(1, round(image.height * width_px / image.width))), Image.LANCZOS)
    stream = io.BytesIO()
    if lossless:
        image.quantize(128).save(stream, "PNG", optimize=True)
    else:
        image.save(stream, "JPEG", quality=84)
    return f"data:image/{'png' if lossless else 'jpeg'};base64,{base64.b64encode(stream.getvalue()).decode()}"


def animation(run, out):
    """The pictures of the world as a GIF, written to `out`; its address on the page, None if there are too few."""
    frames = []
    for _, _, path in run.world_pictures[:60]:
        try:
            with Image.open(path) as opened:
                frames.append(opened.convert("RGB").resize((480, round(480 * opened.height / opened.width)), Image.LANCZOS).quantize(96))
        except (OSError, ValueError):  # named where it is shown by itself
            continue
    if len(frames) < MAX_STAGES:
        return None
    out.parent.mkdir(exist_ok=True)
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=[500] * (len(frames) - 1) + [2500], loop=0, optimize=True)
    return f"data:image/gif;base64,{base64.b64encode(out.read_bytes()).decode()}"


def figure(path, caption, run, width_px, lossless=False):
    """{"address", "caption"}, or None."""
    address = embedded(path, width_px, run, lossless)
    return address and {"address": address, "caption": caption}


def brick_rows(run):
    """[(cells, is it an exception)]: a row per brick that mission or judge know of, the exceptions first."""
    start_s, plans_failed = run.start_s(), run.plans_failed()
    happened = {}
    for event in run.events:
        brick, kind = count_of(event.get("brick")), event.get("event")
        if brick is not None and kind in ("stow", "fall", "drop"):
            happened.setdefault(brick, {}).setdefault(kind, []).append(number(event.get("time_s")) - start_s)
    ledger = {count_of(brick["id"]): brick for brick in run.bricks}
    rows = []
    for brick in sorted((set(happened) | set(ledger)) - {None}):
        told, seen = ledger.get(brick, {}), happened.get(brick, {})
        stowed = f"stowed at {duration(seen['stow'][0])}" if "stow" in seen else "picked, by the mission alone" if told.get("is_picked") else "left"
        beside = [f"{words} at {', '.join(duration(t) for t in seen[kind])}" for kind, words in (("fall", "fell"), ("drop", "dropped")) if kind in seen]
        failed = (told.get("picks_failed", ""), plans_failed.get(brick, 0) if run.log else told.get("plans_failed", ""))
        is_exception = stowed == "left" or bool(beside) or any(failed)
        rows.append(((brick, stowed, "; ".join(beside), told.get("picks_begun", ""), *failed, told.get("last_failure", "")), is_exception))
    return sorted(rows, key=lambda row: not row[1])


def colour_scale(colour_range):
    """One for all pictures of the map, or None."""
    if colour_range is None:
        return None
    _, label, colormap = render_mesh.COLOURINGS["height"]
    low, high = (f"{value:.2f}" for value in colour_range)
    return {"label": label, "stops": [matplotlib.colors.to_hex(colormap(share)) for share in np.linspace(0.0, 1.0, 9)], "low": low, "high": high}


def failure_rows(run):
    """what, times, last at, why, then; the last two of the last time, and of each time."""
    start_s = run.start_s()
    for kind, times, last_s, why, then in run.exceptions():
        did = ", ".join(words if times == count else f"{words} ({count})" for words, count in sorted(then.items(), key=lambda entry: -entry[1]))
        yield kind, times, duration(last_s - start_s) if math.isfinite(last_s) else "", why, did


def decisions_of(run):
    """(the log's rows as [(id, at, decision, reason)], [{"id", "x", "width", "colour", "words"}]: what followed each, in thousandths of the mission's time)."""
    rows = [(f"d{index}", number(row["time_s"]), str(row.get("decision", "?")), str(row.get("reason", ""))) for index, row in enumerate(run.log)]
    begun_s = run.mission_begun_s()
    lasted_s = max((time_s for _, time_s, _, _ in rows), default=begun_s) - begun_s
    activity_of = {state: index for index, (_, states) in enumerate(mission_run.ACTIVITIES) for state in states}
    strip = []
    for (name, from_s, decision, reason), (_, to_s, _, _), after in zip(rows, rows[1:], run.log[1:]):
        index = activity_of.get(str(after.get("state")))
        if index is not None and begun_s <= from_s < to_s:
            strip.append({"id": name, "x": round(1000.0 * (from_s - begun_s) / lasted_s, 2), "width": round(1000.0 * (to_s - from_s) / lasted_s, 2),
                          "colour": plot_mission.ACTIVITY_COLOURS[index], "words": f"{duration(from_s - run.start_s())}, {decision}: {reason}"})
    return [(name, duration(time_s - run.start_s()), decision, reason) for name, time_s, decision, reason in rows], strip


def origin_of(run):
    """Where the figures are from, in words."""
    origin = run.origin
    date = origin.get("date", "").replace("T", " ").replace("Z", " UTC")
    if not date and run.log and not run.is_simulated:
        date = datetime.datetime.fromtimestamp(number(run.log[0]["time_s"]), datetime.timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
    known = [date, f"on {origin['host']}" if "host" in origin else "", f"commit {origin['commit']}" if "commit" in origin else ""]
    return ", ".join(filter(None, known))


def flat(parameters, above=""):
    """{"section/name": value} of nested sections."""
    values = {}
    for name, value in parameters.items():
        values.update(flat(value, f"{above}{name}/") if isinstance(value, dict) else {above + str(name): value})
    return values


def shipped_parameters(package):
    """Of the node of the package's name; none for a package that is not ours."""
    values = {}
    for name, section in PARAMETER_FILES.get(package, {package: ""}).items():
        for path in ROOT.glob(f"*/{package}/config/{name}.yaml"):
            values.update(flat(yaml.safe_load(path.read_text(encoding="utf-8")), section))
    return values


def parameter_rows(run):
    """[(node, parameter, value, shipped value)] where they differ, by the shipped files of the node's package."""
    try:
        nodes = yaml.safe_load((run.folder / "parameters.yaml").read_text(encoding="utf-8"))
        packages = {"brick_detection": "surface_picking"} if "surfaces" in nodes.get("bringup", {}).get("detector", "") else {}
        rows = []
        for node, given in sorted(nodes.items()):
            default = shipped_parameters(packages.get(node, node))
            rows += [(node, name, value, default[name]) for name, value in sorted(flat(given).items()) if name in default and value != default[name]]
        return rows
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError, yaml.YAMLError, AttributeError, TypeError) as error:
        run.notes.append(f"parameters.yaml cannot be read: {' '.join(str(error).split())}")
        return []


def run_before(folder):
    """The folder beside it whose page is the newest of those older than its mission; None if there is none."""
    own_s = (folder / "mission.jsonl").stat().st_mtime if (folder / "mission.jsonl").exists() else math.inf
    pages = [(page.stat().st_mtime, page) for page in folder.resolve().parent.glob("*/index.html") if page.parent != folder.resolve()]
    return max((entry for entry in pages if entry[0] < own_s), default=(None, None))[1]


def stages_of(run, worlds, maps):
    """[figure or None], a row per stage, the world on the left, the map as it was then on the right; of one kind alone two beside each other."""
    kinds = [(entries, what, verb) for entries, what, verb in ((worlds, "The world", "stowed"), (maps, "The map", "picked")) if entries]
    figures = []
    for index in range(max((len(entries) for entries, _, _ in kinds), default=0)):
        for entries, what, verb in kinds:
            drawn = None
            if index < len(entries):
                seconds, count, path = entries[index]
                # Beside the world the map needs no count of its own: it is a little older or newer.
                number_of = f", {count} {verb}" if entries is kinds[0][0] else ""
                drawn = figure(path, f"{what} at {duration(seconds - run.start_s())}{number_of}", run, 720)
            if drawn or len(kinds) > 1:
                figures.append(drawn)
    return figures


def write_page(run, summary, plots, maps, colour_range, out):
    stowed, total = count_of(summary.get("bricks_stowed")), count_of(summary.get("bricks_total"))
    done = stowed if stowed is not None else count_of(summary.get("bricks_picked"))

    def told(key):
        return "?" if summary.get(key) is None else summary[key]

    known = [("scene", "scene"), ("seed", "seed"), ("strategy", "strategy"), ("removed factor", "removed_factor")]
    captions = {"progress.png": "Bricks over time." if not run.table else "Left: bricks over time. Right: how much of the bricks' surface that ever was "
                "exposed is in the map, and how much of what the map holds of the pile is true.", **CAPTIONS}
    thumbs = run.world_pictures[:60] if len(run.world_pictures) > MAX_STAGES else []
    bricks = brick_rows(run)
    moving = animation(run, run.folder / "report" / "mission.gif")
    decisions, strip = decisions_of(run)
    before = run_before(run.folder)
    page = {
        "parameters": parameter_rows(run), "before": before and {"name": before.parent.name, "address": f"../{before.parent.name}/index.html"},
        "name": run.folder.resolve().name, "sentences": sentences(run, summary), "origin": origin_of(run), "command": run.origin.get("command"),
        "about": ", ".join(f"{words} {summary[key]}" for words, key in known if summary.get(key) not in (None, "", "none")),
        "cards": [("?" if done is None else done if total is None else f"{done} of {total}", "bricks stowed" if stowed is not None else "bricks picked",
                   done is None or (total is not None and done < 0.95 * total)),
                  (share(summary.get("map_coverage")) or "?", "of the surface mapped", False), (told("falls"), "bricks fell", bool(summary.get("falls"))),
                  (told("collisions"), "collisions", bool(summary.get("collisions"))), (duration(summary.get("sim_seconds")), f"of {run.clock()}", False),
                  (told("views"), "views", False)],
        "stages": stages_of(run, pick_stages(run.world_pictures, "world"), maps),
        "moving": moving and {"address": moving, "caption": f"The mission in {len(run.world_pictures[:60])} pictures"},
        "scale": colour_scale(colour_range if maps else None), "num_pictures": len(run.world_pictures),
        "thumbs": list(filter(None, (figure(path, f"{duration(seconds - run.start_s())}, {count} stowed", run, 400) for seconds, count, path in thumbs))),
        "plots": list(filter(None, (figure(path, captions[path.name], run, 1400, lossless=True) for path in plots))),
        "exceptions": [cells for cells, is_exception in bricks if is_exception], "others": [cells for cells, is_exception in bricks if not is_exception],
        "failures": list(failure_rows(run)), "decisions": decisions, "strip": strip, "files": {name: words for name, words in FILES.items() if (run.folder / name).exists()}}
    out.write_text(TEMPLATES.get_template("mission.html").render(page, notes=run.notes) + "\n", encoding="utf-8")


def write_atomically(path, text):
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_text(text, encoding="utf-8")
    os.replace(unfinished, path)


def json_safe(value):
    """NaN and infinity are no JSON."""
    if isinstance(value, dict):
        return {key: json_safe(entry) for key, entry in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def what_is_known(run, unreadable):
    """A note of the mission's own summary where it is not whole; it comes first."""
    reason = run.summary.get("end_reason")
    if unreadable.exists():
        return [f"the mission's summary cannot be read, {unreadable.name} is it: its counts are from mission.jsonl"]
    if not run.summary:
        return ["summary.json is missing: the mission did not end by itself; its counts are from mission.jsonl"]
    return {"none": ["the mission's end: its summary is of its last step"],
            "crashed": ["the mission did not write a summary: its counts are from mission.jsonl"]}.get(reason if isinstance(reason, str) else "", [])


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=pathlib.Path, metavar="RUN_FOLDER", help="relative to the current folder")
    parser.add_argument("--summary-only", action="store_true", help="no plots and no page")
    arguments = parser.parse_args()
    folder = arguments.folder
    if not folder.is_dir():
        raise Refusal(f"{folder}: no such folder")
    run = mission_run.Run(folder)
    if not (run.log or run.table or run.judge or run.summary):
        raise Refusal(f"{folder}: no mission left anything there that can be read")
    path, unreadable = folder / "summary.json", folder / "summary.json.unreadable"
    if not run.summary and path.exists():
        os.replace(path, unreadable)
    run.notes[:0] = what_is_known(run, unreadable)
    summary = mission_run.merged_summary(run)
    write_atomically(path, json.dumps(json_safe(summary), indent=2) + "\n")
    if not arguments.summary_only:
        out = folder / "report"
        write_page(run, summary, plot_mission.draw(run, summary, out), *draw_maps(run, out), folder / "index.html")
    print("\n".join(sentences(run, summary)))
    failures = run.exceptions()
    if failures:
        total = plural(sum(times for _, times, *_ in failures), "failure", "failures")
        print(f"{total[0].upper()}{total[1:]} on the way: "
              + ", ".join(f"{times} x {kind}" for kind, times, *_ in failures[:4]) + (", ..." if len(failures) > 4 else "") + ".")
    for note in run.notes:
        print(f"Missing: {note}.")
    if not arguments.summary_only:
        print(f"\nLook at {folder / 'index.html'}")
