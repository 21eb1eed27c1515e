# SPDX-License-Identifier: BSD-3-Clause
"""Says what a mission did: puts the judge's figures into RUN_FOLDER/summary.json, draws RUN_FOLDER/report/*.png, writes
RUN_FOLDER/index.html, one file with all of it in it, and says it in words on the terminal.

Works with what there is: what is missing, as after a crash, is named.
"""

import argparse
import base64
import datetime
import html
import io
import json
import math
import os
import pathlib
import sys

import matplotlib.colors
import numpy as np
from PIL import Image

from . import mission_run
from . import plot_mission
from . import render_mesh
from .mission_run import count_of, duration, number

MAP_VIEW = (-146.0, 31.0)  # azimuth, elevation [deg]: that of the simulator's pictures when the robot starts on the -x side
MAX_STAGES = 4  # pictures before, during, after
STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, "DejaVu Sans", sans-serif; color: #222; background: #f4f5f6; margin: 0; }
main { max-width: 1120px; margin: 0 auto; padding: 28px 20px 60px; }
h1 { font-size: 27px; margin: 0 0 4px; }
h2 { font-size: 20px; margin: 40px 0 10px; }
.sub { color: #6b7280; margin: 0 0 18px; }
.sub + .sub { margin-top: -14px; }
.words { font-size: 18px; margin: 0 0 18px; max-width: 60em; }
.cards { display: flex; flex-wrap: wrap; gap: 12px; }
.card { flex: 1 1 130px; background: #fff; border-radius: 8px; padding: 12px 16px; box-shadow: 0 1px 2px #0002; }
.card b { display: block; font-size: 25px; line-height: 1.2; color: #1d4f76; white-space: nowrap; }
.card.bad b { color: #b9474b; }
.card span { color: #6b7280; font-size: 14px; }
.note { background: #fdf3d8; border-left: 4px solid #e0914f; padding: 10px 16px; margin: 18px 0; border-radius: 0 6px 6px 0; }
.note ul { margin: 4px 0; padding-left: 20px; }
.stages { display: grid; gap: 12px; grid-template-columns: 1fr 1fr; align-items: start; }
@media (max-width: 640px) { .stages { grid-template-columns: 1fr; } }
figure { margin: 0; background: #fff; border-radius: 8px; overflow: hidden; box-shadow: 0 1px 2px #0002; }
figure img { display: block; width: 100%; height: auto; }
.stages img { aspect-ratio: 16 / 9; object-fit: cover; }
.scale { display: flex; align-items: center; gap: 8px; margin-top: 10px; font-size: 14px; color: #444; }
.scale i { flex: 0 1 240px; height: 12px; border-radius: 3px; }
details { margin-top: 10px; }
figcaption { padding: 6px 12px 8px; font-size: 14px; color: #444; }
.plot { padding: 14px; margin-bottom: 16px; }
.plot figcaption { padding: 8px 2px 0; }
.thumbs { display: grid; grid-template-columns: repeat(auto-fill, minmax(200px, 1fr)); gap: 10px; margin-top: 10px; }
summary { cursor: pointer; color: #1d4f76; }
.scroll { overflow-x: auto; background: #fff; border-radius: 8px; box-shadow: 0 1px 2px #0002; }
table { border-collapse: collapse; width: 100%; font-size: 14.5px; }
th, td { text-align: left; padding: 6px 12px; border-bottom: 1px solid #eceef0; vertical-align: top; }
th { color: #6b7280; font-weight: 600; }
td.n, th.n { text-align: right; }
code { font-size: 14px; }
"""


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
        words.append("Nothing tells how many bricks were picked.")
    else:
        of_all = f" of {total}" if total is not None else ""
        percent = f" ({100.0 * done / total:.0f} %)" if total else ""
        verb = f"stowed{percent}" if stowed is not None else f"picked{percent}, by the mission's own count,"
        time = f" in {duration(summary['sim_seconds'])} of {run.clock()}" if summary.get("sim_seconds") is not None else ""
        wall = f", {duration(summary['wall_seconds'])} by the wall clock" if summary.get("wall_seconds") is not None else ""
        words.append(f"{done}{of_all} brick{'' if done == 1 and total in (None, 1) else 's'} {f'{verb}{time}{wall}'.rstrip(',')}.")
    if stowed is not None and picked is not None and stowed != picked:
        words.append(f"The mission's own count is {picked}: it differs from the judge's {stowed}.")
    if summary.get("falls") is not None:
        counted = [plural(summary["falls"], "fall", "falls"), plural(summary["collisions"] or 0, "collision", "collisions")]
        if summary.get("drops"):
            counted.append(plural(summary["drops"], "brick dropped", "bricks dropped"))
        text = ", ".join(counted)
        words.append(text[0].upper() + text[1:] + ".")
    coverage, precision = share(summary.get("map_coverage")), share(summary.get("map_precision"))
    if coverage:
        coverable = share(summary.get("map_coverable"))
        words.append(f"The map covered {coverage} of the bricks' surface that ever was exposed" +
                     (f" ({coverable} could have been seen from the mast; what is within 2 cm of the map counts, too)" if coverable else "") +
                     (f"; {precision} of what it holds of the pile is true." if precision else "."))
    if run.is_one_of_several and run.table:
        words.append("It is one of several missions of a run: the counts are its own, the coverage is the run's up to its end.")
    reason = summary.get("end_reason")
    if reason == "crashed":
        has_ended = run.log and run.log[-1].get("decision") == "ended"
        words.append("It ended, but nothing tells why." if has_ended else "The mission did not end by itself: its log breaks off.")
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


def figure(path, caption, run, width_px, lossless=False, kind=""):
    address = embedded(path, width_px, run, lossless)
    if address is None:
        return ""
    return f'<figure class="{kind}"><img src="{address}" alt="{html.escape(caption)}"><figcaption>{html.escape(caption)}</figcaption></figure>'


def table(header, rows, numeric=()):
    def row(cells, tag):
        return "<tr>" + "".join(f'<{tag} class="{"n" if column in numeric else ""}">{html.escape(str(cell))}</{tag}>' for column, cell in enumerate(cells)) + "</tr>"
    return f'<div class="scroll"><table>{row(header, "th")}{"".join(row(cells, "td") for cells in rows)}</table></div>'


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


def brick_tables(rows):
    """The exceptions in sight, the others behind a click."""
    if not rows:
        return "<p>Nothing is known of single bricks.</p>"
    header = ("brick", "what became of it", "on the way", "picks begun", "picks failed", "plans failed", "last failure")
    exceptions, others = ([cells for cells, is_exception in rows if is_exception == wanted] for wanted in (True, False))
    parts = [table(header, exceptions, numeric=(0, 3, 4, 5))] if exceptions else []
    if others:
        words = f"{plural(len(others), 'brick', 'bricks')} without a failure"
        parts.append(f"<details><summary>{words[0].upper()}{words[1:]}</summary>{table(header, others, numeric=(0, 3, 4, 5))}</details>")
    return "".join(parts)


def colour_scale(colour_range):
    """One for all pictures of the map."""
    if colour_range is None:
        return ""
    _, label, colormap = render_mesh.COLOURINGS["height"]
    stops = ", ".join(matplotlib.colors.to_hex(colormap(share)) for share in np.linspace(0.0, 1.0, 9))
    low, high = (f"{value:.2f}" for value in colour_range)
    return f'<div class="scale"><span>{html.escape(label)}: {low}</span><i style="background: linear-gradient(to right, {stops})"></i><span>{high}</span></div>'


def failure_rows(run):
    """what, times, last at, why, then; the last two of the last time, and of each time."""
    start_s = run.start_s()
    for kind, times, last_s, why, then in run.exceptions():
        did = ", ".join(words if times == count else f"{words} ({count})" for words, count in sorted(then.items(), key=lambda entry: -entry[1]))
        yield kind, times, duration(last_s - start_s) if math.isfinite(last_s) else "", why, did


def origin_lines(run):
    """Where the figures are from."""
    origin = run.origin
    date = origin.get("date", "").replace("T", " ").replace("Z", " UTC")
    if not date and run.log and not run.is_simulated:
        date = datetime.datetime.fromtimestamp(number(run.log[0]["time_s"]), datetime.timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
    known = [date, f"on {origin['host']}" if "host" in origin else "", f"commit {origin['commit']}" if "commit" in origin else ""]
    lines = [html.escape(", ".join(filter(None, known))), f"<code>{html.escape(origin['command'])}</code>" if "command" in origin else ""]
    return "".join(f'<p class="sub">{line}</p>' for line in lines if line)


def stage_grid(run, worlds, maps, colour_range, start_s, strategy):
    """A row per stage, the world on the left, the map as it was then on the right; of one kind alone two beside each other."""
    # Coverage and precision are of the map that the strategy sees; the meshes that are kept, of the one that the arm moves by.
    map_name = "The arm's map" if strategy.startswith("octomap") else "The map"
    kinds = [(entries, what, verb) for entries, what, verb in ((worlds, "The world", "stowed"), (maps, map_name, "picked")) if entries]
    if not kinds:
        return "<p>No pictures were taken.</p>"
    cells = []
    for index in range(max(len(entries) for entries, _, _ in kinds)):
        for entries, what, verb in kinds:
            drawn = ""
            if index < len(entries):
                seconds, count, path = entries[index]
                # Beside the world the map needs no count of its own: it is a little older or newer.
                number_of = f", {count} {verb}" if entries is kinds[0][0] else ""
                drawn = figure(path, f"{what} at {duration(seconds - start_s)}{number_of}", run, 720)
            if drawn or len(kinds) > 1:
                cells.append(drawn or "<span></span>")
    return f'<div class="stages">{"".join(cells)}</div>{colour_scale(colour_range if maps else None)}'


def card(value, words, bad=False):
    return f'<div class="card{" bad" if bad else ""}"><b>{html.escape(str(value))}</b><span>{html.escape(words)}</span></div>'


def write_page(run, summary, plots, maps, colour_range, out):
    start_s = run.start_s()
    name = run.folder.resolve().name
    stowed, total = count_of(summary.get("bricks_stowed")), count_of(summary.get("bricks_total"))
    done = stowed if stowed is not None else count_of(summary.get("bricks_picked"))
    known = [("scene", "scene"), ("seed", "seed"), ("strategy", "strategy"), ("removed factor", "removed_factor")]
    about = ", ".join(f"{words} {summary[key]}" for words, key in known if summary.get(key) not in (None, "", "none"))
    cards = [card(f"{'?' if done is None else done}{'' if total is None else f' of {total}'}", "bricks stowed" if stowed is not None else "bricks picked", bad=done is None or (total is not None and done < 0.95 * total)),
             card(share(summary.get("map_coverage")) or "?", "of the surface mapped"),
             card("?" if summary.get("falls") is None else summary["falls"], "bricks fell", bad=bool(summary.get("falls"))),
             card("?" if summary.get("collisions") is None else summary["collisions"], "collisions", bad=bool(summary.get("collisions"))),
             card(duration(summary.get("sim_seconds")), f"of {run.clock()}"),
             card("?" if summary.get("views") is None else summary["views"], "places it stood at")]
    body = [f"<h1>Mission {html.escape(name)}</h1>", f'<p class="sub">{html.escape(about or "nothing is known about what it was to do")}</p>', origin_lines(run),
            f'<p class="words">{html.escape(" ".join(sentences(run, summary)))}</p>', f'<div class="cards">{"".join(cards)}</div>', "<!-- notes -->"]
    body += ["<h2>Before, during, after</h2>", stage_grid(run, pick_stages(run.world_pictures, "world"), maps, colour_range, start_s, str(summary.get("strategy") or ""))]
    if len(run.world_pictures) > MAX_STAGES:
        thumbs = "".join(figure(path, f"{duration(seconds - start_s)}, {count} stowed", run, 400) for seconds, count, path in run.world_pictures[:60])
        body.append(f'<details><summary>All pictures of the world ({len(run.world_pictures)})</summary><div class="thumbs">{thumbs}</div></details>')
    body.append("<h2>How it went</h2>")
    captions = {
        "progress.png": "Bricks over time." if not run.table else "Left: bricks over time. Right: how much of the bricks' surface that ever was exposed is in the map, and how much of what the map holds of the pile is true.",
        "path.png": "Where the robot drove and stood, and the pile, from above. An arrow points to where the robot looked.",
        "time.png": "Where the time went.",
        "utilities.png": "Each choice of a place to stand at: what it was chosen from, and what spoke for the chosen one.",
        "places.png": "The pile's outline from above as three choices saw it; the colour is the utility of standing there."}
    body += [figure(path, captions[path.name], run, 1400, lossless=True, kind="plot") for path in plots] or ["<p>There is nothing to plot.</p>"]
    body += ["<h2>Bricks</h2>", brick_tables(brick_rows(run)), "<h2>What failed, and what was done about it</h2>"]
    failures = list(failure_rows(run))
    body.append(table(("what", "times", "last at", "why", "then"), failures, numeric=(1,)) if failures else "<p>Nothing that is known of.</p>")
    body.append("<h2>Files</h2>")
    files = [(f'<a href="{html.escape(name)}">{html.escape(name)}</a>', words) for name, words in (
        ("summary.json", "the figures"), ("mission.jsonl", "each decision with its reason"), ("selections.jsonl", "each choice of a view with all candidates"), ("path.jsonl", "the driven path"),
        ("judge.csv", "what the judge saw, per second"), ("events.jsonl", "stowed, fallen, dropped, hit"), ("judge.json", "the judge's totals"),
        ("pictures", "of the world; maps as meshes (PLY)"), ("log", "of the nodes")) if (run.folder / name).exists()]
    body.append('<div class="scroll"><table>' + "".join(f"<tr><td>{link}</td><td>{html.escape(words)}</td></tr>" for link, words in files) + "</table></div>")
    notes = ""
    if run.notes:
        notes = '<div class="note"><b>Not everything is there.</b><ul>' + "".join(f"<li>{html.escape(note)}</li>" for note in run.notes) + "</ul></div>"
    page = "\n".join(body).replace("<!-- notes -->", notes)
    out.write_text(f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
                   f"<title>Mission {html.escape(name)}</title><style>{STYLE}</style></head><body><main>\n{page}\n</main></body></html>\n", encoding="utf-8")


def write_atomically(path, text):
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_text(text, encoding="utf-8")
    os.replace(unfinished, path)


def json_safe(value):
    """NaN and infinity are no JSON."""
    if isinstance(value, dict):
        return {key: json_safe(entry) for key, entry in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path, metavar="RUN_FOLDER", help="relative to the current folder")
    parser.add_argument("--summary-only", action="store_true", help="no plots and no page")
    arguments = parser.parse_args()
    folder = arguments.folder
    if not folder.is_dir():
        print(f"report_mission: {folder}: no such folder", file=sys.stderr)
        return 1
    run = mission_run.Run(folder)
    if not (run.log or run.table or run.judge or run.summary):
        print(f"report_mission: {folder}: no mission left anything there that can be read", file=sys.stderr)
        return 1
    path, unreadable = folder / "summary.json", folder / "summary.json.unreadable"
    try:
        if not run.summary and path.exists():
            os.replace(path, unreadable)
    except OSError as error:
        print(f"report_mission: {error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    if unreadable.exists():
        run.notes.insert(0, f"the mission's summary cannot be read, {unreadable.name} is it: its counts are from mission.jsonl")
    elif not run.summary:
        run.notes.insert(0, "summary.json is missing: the mission did not end by itself; its counts are from mission.jsonl")
    elif run.summary.get("end_reason") == "none":
        run.notes.insert(0, "the mission's end: its summary is of its last step")
    elif run.summary.get("end_reason") == "crashed":
        run.notes.insert(0, "the mission did not write a summary: its counts are from mission.jsonl")
    summary = mission_run.merged_summary(run)
    try:
        write_atomically(path, json.dumps(json_safe(summary), indent=2) + "\n")
        if not arguments.summary_only:
            out = folder / "report"
            write_page(run, summary, plot_mission.draw(run, summary, out), *draw_maps(run, out), folder / "index.html")
    except OSError as error:
        print(f"report_mission: {error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    print("\n".join(sentences(run, summary)))
    failures = run.exceptions()
    if failures:
        total = sum(times for _, times, *_ in failures)
        print(f"{plural(total, 'failure', 'failures')[0].upper()}{plural(total, 'failure', 'failures')[1:]} on the way: "
              + ", ".join(f"{times} x {kind}" for kind, times, *_ in failures[:4]) + (", ..." if len(failures) > 4 else "") + ".")
    for note in run.notes:
        print(f"Missing: {note}.")
    if not arguments.summary_only:
        print(f"\nLook at {folder / 'index.html'}")
    return 0
