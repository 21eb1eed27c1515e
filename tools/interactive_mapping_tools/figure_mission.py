# SPDX-License-Identifier: BSD-3-Clause
"""The paper's Figs. 1, 4 and 9 from a mission's run folder: one cycle, one choice of a view by factors, and the order
of choices."""

import re

import matplotlib.image
import numpy as np
import yaml
from scipy import spatial

from . import ROOT, mission_run, render_mesh
from .cli import Refusal
from .figure_accuracy import BRICK, write_rows
from .mission_run import FACTORS, duration, number
from .plot_mission import is_candidate, spot_of
from .style import BLUE, GREEN, INK, MUTED, RED, legend_below, plt, save, tidy

REAL, FRONTIER, IMAGINARY, HERE = range(4)  # interactive_mapping_msgs/SegmentScore
VALUES = ("utility", *(f"{factor}_factor" for factor in FACTORS))
CELL_M = 0.025  # of a map seen from above
# Farther than this from the new map's surface, a point of the old one is gone: twice its spacing of points.
GONE_M = 0.04
GROUND_M = 0.04
CANDIDATE, OTHER = "#2e8b3d", "#9a9a9a"  # segments in Fig. 1
NUM_ORDER = 4


def run_of(folder):
    run = mission_run.Run(folder)
    run.selections = [selection for selection in run.selections
                      if selection.get("outcome") == 0 and mission_run.count_of(selection.get("best")) is not None]
    if not (run.maps and run.selections and run.path):
        raise Refusal(f"{folder}: holds no maps, choices and path of a mission")
    return run


def goal_of(run, selection):
    """(x, y, yaw) to which this choice sent the robot; where it stays, its place."""
    for row in run.log:
        if number(row["time_s"]) >= selection["time_s"] - 0.1 and row.get("state") == "select":
            told = re.search(r"view at \((-?[\d.]+), (-?[\d.]+)\) m, (-?[\d.]+) rad", str(row.get("reason", "")))
            return tuple(map(float, told.groups())) if told else base_at(run, selection["time_s"])
    return base_at(run, selection["time_s"])


def base_at(run, time_s):
    before = [row for row in run.path if row["time_s"] <= time_s]
    return mission_run.pose_of((before or run.path)[-1 if before else 0]["base"])


def pick_before(run, time_s):
    """When the last pick before this began."""
    begun = [number(row["time_s"])
             for row in run.log if row.get("decision") == "pick" and number(row["time_s"]) < time_s]
    if not begun:
        raise Refusal(f"{run.folder}: the log has no pick before {time_s} s")
    return begun[-1]


def map_before(run, time_s):
    return [path for map_s, _, path in run.maps if map_s <= time_s][-1:] or [run.maps[0][2]]


def footprint(pose):
    """Corners of the base at a pose, closed."""
    profile = yaml.safe_load((ROOT / "src/mp700_ur5e_description/config/base_profile.yaml").read_text(encoding="utf-8"))
    corners = np.array(profile["body"]["footprint_m"] + profile["body"]["footprint_m"][:1])
    turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
    return corners @ turn.T + pose[:2]


def segments_of(selection):
    """Of the pile's outline; the pose at which the robot stands is none."""
    return [segment for segment in selection["segments"]
            if spot_of(segment) and segment.get("kind") in (REAL, FRONTIER, IMAGINARY)]


def window_of(points, margin_m):
    low, high = np.min(points, axis=0) - margin_m, np.max(points, axis=0) + margin_m
    return low[0], high[0], low[1], high[1]


def draw_above(axes, mesh, window):
    """Heights of the map as grey, white where there is none."""
    x_edges, y_edges = (np.arange(low, high + CELL_M, CELL_M) for low, high in (window[:2], window[2:]))
    heights = np.full((len(y_edges), len(x_edges)), -np.inf)
    column, row = (np.floor((mesh.points[:, axis] - edges[0]) / CELL_M).astype(int)
                   for axis, edges in ((0, x_edges), (1, y_edges)))
    inside = (row >= 0) & (row < len(y_edges)) & (column >= 0) & (column < len(x_edges))
    np.maximum.at(heights, (row[inside], column[inside]), mesh.points[inside, 2])
    axes.imshow(np.where(np.isfinite(heights), heights, np.nan), origin="lower",
                extent=(x_edges[0], x_edges[-1] + CELL_M, y_edges[0], y_edges[-1] + CELL_M), cmap="Greys",
                vmin=-0.3, vmax=1.0, interpolation="nearest")
    axes.set_xlim(window[:2])
    axes.set_ylim(window[2:])
    axes.set_aspect("equal")
    axes.tick_params(labelsize=9)


def draw_goal(axes, pose, colour=RED, **style):
    axes.plot(*footprint(pose).T, color=colour, linewidth=1.6, **style)
    axes.annotate("", xy=(pose[0] + 0.45 * np.cos(pose[2]), pose[1] + 0.45 * np.sin(pose[2])), xytext=pose[:2],
                  arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.6})


def utility(source, out):
    """Fig. 4. INPUT: a run folder. The choice is the one at which most of the outline was seen and most was not."""
    run = run_of(source)
    selection = max(run.selections, key=lambda one: min(sum(map(is_candidate, segments_of(one))),
                                                        sum(not is_candidate(segment) for segment in segments_of(one))))
    segments, best = segments_of(selection), selection["segments"][selection["best"]]
    candidates = [segment for segment in segments if is_candidate(segment)]
    others = np.array([spot_of(segment) for segment in segments if not is_candidate(segment)]).reshape(-1, 2)
    mesh = render_mesh.read_ply(map_before(run, selection["time_s"])[0])
    goal, here = goal_of(run, selection), base_at(run, selection["time_s"])
    weights = mission_run.weights_of(run.selections) or {}
    spots = np.array([spot_of(segment) for segment in candidates])
    window = window_of(np.vstack([spots, others, footprint(goal), footprint(here)]), 0.15)
    figure, panels = plt.subplots(2, 3, figsize=(13.5, 8.6), constrained_layout=True, sharex=True, sharey=True)
    for axes, key, letter in zip(panels.flat, VALUES, "abcdef"):
        values = np.array([number(segment.get(key), 0.0) for segment in candidates])
        draw_above(axes, mesh, window)
        axes.plot(*others.T, linestyle="none", marker="o", markersize=5, markerfacecolor="white",
                  markeredgecolor="#888888", label="cannot stand there, or unseen")
        points = axes.scatter(*spots.T, c=values, cmap="viridis", vmin=0.0, s=50, zorder=3, label="candidate")
        axes.plot(*spots[np.argmax(values)], marker="o", markersize=14, markerfacecolor="none", markeredgecolor=RED,
                  markeredgewidth=2.2, linestyle="none", label="best in this panel", zorder=4)
        axes.plot(*footprint(here).T, color=BLUE, linewidth=1.6, label="robot")
        if key == "utility":
            draw_goal(axes, goal, label="chosen")
        factor = key.replace("_factor", "")
        axes.set_title(f"({letter}) {factor.replace('_', ' ')}" +
                       (f", weight {weights[factor]:.2f}" if factor in weights else ""), fontsize=13, loc="left")
        figure.colorbar(points, ax=axes, shrink=0.85).outline.set_visible(False)
    for axes in panels[1]:
        axes.set_xlabel("x in the map [m]", fontsize=10)
    for axes in panels[:, 0]:
        axes.set_ylabel("y in the map [m]", fontsize=10)
    legend_below(figure, panels[0, 0], 5)
    save(figure, out / "fig4.png", bbox_inches="tight")
    columns = ("kind", "verdict", *VALUES, "information", "failure_penalty", "height", "distance", "manipulability",
               "uncertainty", "frontier")
    write_rows(out / "fig4.csv", ("x_m", "y_m", *columns, "chosen"),
               ([*spot_of(segment), *(segment[name] for name in columns), int(segment is best)]
                for segment in segments))


def gone(before, after):
    """Points of the old map's surface that the new one does not have; not the ground."""
    old = before.points[before.points[:, 2] > GROUND_M]
    return old[spatial.cKDTree(after.points).query(old)[0] > GONE_M]


class Stage:
    """Where all panels of Fig. 1 look from."""

    def __init__(self, points, azimuth_deg):
        self.camera = render_mesh.fit_camera(points, azimuth_deg, 38.0, None, None, (1280, 900), 1.02)

    def line(self, axes, points, **style):
        axes.plot(*(0.5 * self.camera.project(np.asarray(points, dtype=float))[0].T), **style)

    def draw(self, axes, mesh, title, robot, selection=None, goal=None):
        def colour(z):
            return np.where((z > GROUND_M)[:, None], BRICK, [0.80, 0.82, 0.85])

        axes.imshow(render_mesh.shrink(render_mesh.shade(self.camera, mesh,
                                                         {"value": render_mesh.height_of, "map": colour}, 2.0), 2))
        axes.set_xlim(0, 0.5 * self.camera.width)
        axes.set_ylim(0.5 * self.camera.height, 0)
        axes.set_axis_off()
        axes.set_title(title, fontsize=13, loc="left")
        self.box(axes, robot)
        for segment in segments_of(selection) if selection else ():
            is_best = segment is selection["segments"][selection["best"]]
            foot = np.array([*spot_of(segment), 0.0])
            shade = RED if is_best else CANDIDATE if is_candidate(segment) else OTHER
            height_m = number(segment.get("utility"), 0.0) if is_candidate(segment) else 0.03
            self.line(axes, [foot, foot + [0.0, 0.0, height_m]], color=shade, linewidth=5, solid_capstyle="butt")
        if goal:
            ahead = np.array([np.cos(goal[2]), np.sin(goal[2])])
            tip, tail = (np.append(np.array(goal[:2]) + length * ahead, 0.02) for length in (0.42, -0.15))
            (x1, y1), (x0, y0) = 0.5 * self.camera.project(np.array([tip, tail]))[0]
            axes.annotate("", xy=(x1, y1), xytext=(x0, y0),
                          arrowprops={"arrowstyle": "-|>", "color": RED, "linewidth": 2.4})
            self.line(axes, [[*corner, 0.01] for corner in footprint(goal)], color=RED, linewidth=1.6)

    def box(self, axes, pose, height_m=0.3):
        """The base as a box with a mark at its front."""
        corners = footprint(pose)
        hull = 0.5 * self.camera.project(np.vstack([np.insert(corners, 2, level, axis=1)
                                                    for level in (0.0, height_m)]))[0]
        axes.fill(*hull[spatial.ConvexHull(hull).vertices].T, color="#8b9198", edgecolor=INK, linewidth=1.2)
        self.line(axes, [[*corner, height_m] for corner in corners], color=INK, linewidth=1.2)
        self.line(axes, [[*corners[0], height_m], [*corners[-2], height_m]], color=BLUE, linewidth=3.5)


def cut_out(mesh, window):
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    inside = (x > window[0]) & (x < window[1]) & (y > window[2]) & (y < window[3])
    mesh.triangles = mesh.triangles[np.all(inside[mesh.triangles], axis=1)]
    return mesh


def cycle(source, out):
    """Fig. 1. INPUT: a run folder. The cycle is that of the first pick: of the others a run keeps no map between the
    drive and the pick."""
    run = run_of(source)
    counts = [count for _, count, _ in run.maps]
    if 1 not in counts or counts[0] != 0:
        raise Refusal(f"{source}: no maps before and after the first pick")
    standing, after = run.maps[counts.index(1) - 1], run.maps[counts.index(1)]
    begun_s = pick_before(run, after[0])
    following = [selection for selection in run.selections if selection["time_s"] > after[0]][:1]
    chosen = [selection for selection in run.selections if selection["time_s"] < begun_s][-1:]
    if not chosen or not following:
        raise Refusal(f"{source}: no choice before or after the first pick")
    goals = [goal_of(run, selection) for selection in (*chosen, *following)]
    places = [base_at(run, time_s) for time_s in (chosen[0]["time_s"], begun_s, following[0]["time_s"])]
    spots = np.array([spot_of(segment) for selection in (*chosen, *following) for segment in segments_of(selection)])
    shown = np.vstack([spots, *map(footprint, (*goals, *places))])
    window = window_of(shown, 0.2)
    before, now = (cut_out(render_mesh.read_ply(path), window) for _, _, path in (standing, after))
    away = places[0][:2] - spots.mean(axis=0)
    stage = Stage(np.vstack([np.insert(shown, 2, height_m, axis=1) for height_m in (0.0, 0.45)]),
                  np.degrees(np.arctan2(away[1], away[0])) - 55.0)
    figure, panels = plt.subplots(2, 2, figsize=(12.8, 9.4), constrained_layout=True)
    start_s = run.mission_begun_s()
    stage.draw(panels[0, 0], before,
               f"(a) {duration(chosen[0]['time_s'] - start_s)}: the best view, drawn on the map of (b)", places[0],
               chosen[0], goals[0])
    stage.draw(panels[0, 1], before, f"(b) {duration(begun_s - start_s)}: the robot there, after the next image",
               places[1])
    stage.draw(panels[1, 0], now, f"(c) {duration(after[0] - start_s)}: a brick is taken; green: surface that is gone",
               places[1])
    stage.line(panels[1, 0], gone(before, now), color="#0b6b1d", linestyle="none", marker="o", markersize=2.2,
               markeredgewidth=0)
    stage.draw(panels[1, 1], now, f"(d) {duration(following[0]['time_s'] - start_s)}: the next best view", places[2],
               following[0], goals[1])
    named = ((RED, "best segment"), (CANDIDATE, "others (height: utility)"),
             (OTHER, "unseen, or the robot cannot stand there"), (BLUE, "front of the robot"))
    figure.legend(handles=[plt.Line2D([], [], color=colour, linewidth=4, label=label) for colour, label in named],
                  loc="upper center", bbox_to_anchor=(0.5, 0.0), ncol=4, frameon=False)
    save(figure, out / "fig1.png", 90, bbox_inches="tight")
    write_rows(out / "fig1.csv", ("panel", "x_m", "y_m", "verdict", "utility", "chosen"),
               ([panel, *spot_of(segment), segment["verdict"], segment["utility"],
                 int(segment is selection["segments"][selection["best"]])]
                for panel, selection in (("a", chosen[0]), ("d", following[0])) for segment in segments_of(selection)))


def order(source, out):
    """Fig. 9. INPUT: a run folder, best of scene two_rows. The first picks: the world after each, and above the map
    where the robot stood and what then left."""
    run = run_of(source)
    maps = {count: path for _, count, path in run.maps}  # the last with so many bricks taken
    pictures = [(time_s, count, path) for time_s, count, path in run.world_pictures
                if count > 0 and {count - 1, count} <= set(maps)][:NUM_ORDER]
    if not pictures:
        raise Refusal(f"{source}: no picture and maps of a pick")
    spots = np.array([spot_of(segment) for selection in run.selections for segment in segments_of(selection)])
    window = window_of(spots, 1.1)  # room for the base beside the outline
    figure, panels = plt.subplots(2, len(pictures), figsize=(4.1 * len(pictures), 6.4), constrained_layout=True,
                                  squeeze=False)
    rows, start_s = [], run.mission_begun_s()
    for index, (time_s, count, path) in enumerate(pictures):
        world, above = panels[:, index]
        world.imshow(matplotlib.image.imread(path))
        world.set_axis_off()
        world.set_title(f"{duration(time_s - start_s)}: brick {count} is taken", fontsize=12, loc="left")
        begun_s = pick_before(run, time_s)
        selection = [one for one in run.selections if one["time_s"] < begun_s][-1]
        before, after = (render_mesh.read_ply(maps[number_taken]) for number_taken in (count - 1, count))
        lost, pose = gone(before, after), base_at(run, begun_s)
        draw_above(above, before, window)
        above.plot(*lost[:, :2].T, linestyle="none", marker=".", markersize=2, color=GREEN)
        above.plot([], [], linestyle="none", marker="s", markersize=8, color=GREEN, label="surface that is gone")
        above.plot(*np.transpose([spot_of(segment) for segment in segments_of(selection)]), linestyle="none",
                   marker="o", markersize=3.5, color=MUTED, label="segment of the outline")
        draw_goal(above, pose, label="robot")
        tidy(above, x_label="x in the map [m]", y_label="y [m]" if index == 0 else None)
        above.yaxis.grid(False)
        rows.append((count, time_s - start_s, *pose, *(np.median(lost, axis=0) if len(lost) else [np.nan] * 3),
                     number(selection["segments"][selection["best"]].get("utility"))))
    legend_below(figure, panels[1, 0], 3)
    save(figure, out / "fig9.png", 90, bbox_inches="tight")
    write_rows(out / "fig9.csv", ("brick", "time_s", "base_x_m", "base_y_m", "base_yaw_rad", "gone_x_m", "gone_y_m",
                                  "gone_z_m", "utility"), rows)
