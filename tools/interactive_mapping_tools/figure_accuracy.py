# SPDX-License-Identifier: BSD-3-Clause
"""The paper's Figs. 3 and 8 from fig8_experiment: one look's tolerance, and the map after a removal against a map of
the last look alone."""

import concurrent.futures
import csv
import itertools
import os
import shutil
import subprocess

import matplotlib.colors
import numpy as np
import yaml

from . import ROOT, render_mesh, workspace
from .cli import Refusal
from .results import markdown, read_json, read_rows
from .style import BLUE, GREEN, GREY, ORANGE, legend_below, plt, save, tidy
from .table_campaign import with_interval

PAPER = {"gpis": (0.005, 0.012), "octomap": (0.033, 0.015)}  # mean and standard deviation [cm]
SYSTEMS = {"gpis": "Dynamic GPIS", "gpis_static": "GPIS, dynamic: false", "octomap": "Dynamic OctoMap, 2 cm"}
SCENES = {"fig8": "one brick, one place", "fig8_several": "three bricks, one place",
          "fig8_survey": "one brick, eight places"}
SEVERAL = (6, 3, 4)  # of fig8.yaml, from the top: one after another, a scan after each
SEEDS = {"exact": range(1, 2), "full": range(1, 21)}  # without noise they are all the same
COLUMNS = ("scene", "sensor", "seed", "system", "points", "mean_cm", "sigma_cm", "rms_cm", "median_abs_cm",
           "p95_abs_cm", "faces_sigma_cm", "edges_sigma_cm", "truth_rms_cm",
           "ghost_cm2", "outside_share")
RANGE_CM = 1.0
TARGET = np.array([0.02, -0.02, 0.12])
PANEL = (520, 380)
BRICK = np.array([0.80, 0.66, 0.55])
NOT_COMPARED = (0.72, 0.84, 0.58)  # outside the common region


def run_experiment(scene, sensor, seed, out):
    """One run of fig8_experiment into the folder. Raises Refusal with its last line."""
    command = [ROOT / "devel/lib/experiments/fig8_experiment", scene, "--out", out, "--sensor", sensor, "--seed",
               str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise Refusal(f"{out.name}: {(done.stderr.splitlines() or ['no message'])[-1]}")
    return out


def run_all(out):
    """Every scene, sensor and seed, as many at a time as there are cores. Only the first seed keeps its meshes."""
    workspace.library("install_packages; build_workspace fig8_experiment")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    folder = ROOT / "sim_tests/synthetic_depth/scenes"
    scene = yaml.safe_load((folder / "fig8.yaml").read_text(encoding="utf-8"))
    scene["changes"] = [{"frame": frame, "remove": [brick]} for frame, brick in enumerate(SEVERAL, 1)]
    scene["trajectory"]["frames"] = 1 + len(SEVERAL)
    (out / "fig8_several.yaml").write_text(yaml.safe_dump(scene), encoding="utf-8")

    def run(name, sensor, seed):
        path = (out if name == "fig8_several" else folder) / f"{name}.yaml"
        done = run_experiment(path, sensor, seed, out / f"{name}-{sensor}-{seed}")
        for mesh in done.glob("*.ply") if seed > 1 else ():
            mesh.unlink()

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        jobs = [pool.submit(run, name, sensor, seed)
                for name, (sensor, seeds) in itertools.product(SCENES, SEEDS.items()) for seed in seeds]
        try:
            for count, job in enumerate(concurrent.futures.as_completed(jobs), 1):
                job.result()
                print(f"{count} of {len(jobs)} runs", flush=True)
        except BaseException:
            for job in jobs:
                job.cancel()
            raise


def read_runs(folder):
    """[a row of COLUMNS per run and system]. Raises Refusal."""
    rows = []
    for path in sorted(folder.glob("*/summary.json")):
        summary = read_json(path)
        try:
            for system, entry in summary["systems"].items():
                against, zones = entry["against_last_scan"], entry["zones_against_last_scan"]
                values = [against[name] for name in ("mean_m", "std_dev_m", "rms_m", "median_abs_m", "p95_abs_m")]
                values += [zones["faces"]["std_dev_m"], zones["edges"]["std_dev_m"], entry["against_truth"]["rms_m"]]
                rows.append(dict(zip(COLUMNS, (
                    path.parent.name.split("-")[0], summary["sensor"], summary["seed"], system, against["count"],
                    *(100.0 * value for value in values), 1e4 * entry["ghost_area_m2"], entry["outside_share"]))))
        except (KeyError, TypeError, AttributeError) as error:
            raise Refusal(f"{path}: no summary of fig8_experiment, {type(error).__name__}: {error}") from error
    if not rows:
        raise Refusal(f"{folder}: no folders with a summary.json of fig8_experiment")
    return rows


def table_of(rows):
    """Markdown; one line for each scene, sensor and system."""
    table = [("removed, seen from", "sensor", "system", "n", "mean [cm]", "sigma [cm]", "sigma on faces [cm]",
              "truth rms [cm]", "ghost [cm2]", "outside", "paper: mean, sigma [cm]")]
    for scene, sensor, system in itertools.product(SCENES, SEEDS, SYSTEMS):
        runs = [row for row in rows if (row["scene"], row["sensor"], row["system"]) == (scene, sensor, system)]
        if runs:
            paper = "{:.3f}, {:.3f}".format(*PAPER[system]) if system in PAPER else "-"
            forms = {"mean_cm": ".3f", "sigma_cm": ".3f", "faces_sigma_cm": ".3f", "truth_rms_cm": ".3f",
                     "ghost_cm2": ".0f", "outside_share": ".3f"}
            table.append((SCENES[scene], sensor, SYSTEMS[system], len(runs),
                          *(with_interval([run[key] for run in runs], form) for key, form in forms.items()), paper))
    return markdown(table) + "\n"


def draw_distribution(rows, out):
    """Mean and sigma of each seed, sensor full, beside the paper's numbers."""
    figure, axes = plt.subplots(1, 2, figsize=(12.5, 4.2), sharey=True, constrained_layout=True)
    lines = list(itertools.product(SCENES, ("gpis", "octomap")))
    for place, (scene, system) in enumerate(lines):
        runs = [row for row in rows if (row["scene"], row["sensor"], row["system"]) == (scene, "full", system)]
        colour = BLUE if system == "gpis" else GREY
        for panel, key in zip(axes, ("mean_cm", "sigma_cm")):
            values = [row[key] for row in runs]
            panel.plot(values, place + 0.16 * np.sin(2.4 * np.arange(len(values))), linestyle="none", marker="o",
                       markersize=4, color=colour, alpha=0.5, markeredgewidth=0)
            panel.plot([np.mean(values)] * 2, [place - 0.32, place + 0.32], color=colour, linewidth=2.4)
    for index, (panel, title) in enumerate(zip(axes, ("Mean of the signed distance [cm]",
                                                      "Sigma of the signed distance [cm]"))):
        for system, colour in (("gpis", BLUE), ("octomap", GREY)):
            panel.axvline(PAPER[system][index], color=colour, linestyle=":", linewidth=1.6,
                          label=f"the paper's {SYSTEMS[system].replace(', 2 cm', '')}, a real scene")
        tidy(panel, title)
        panel.yaxis.grid(False)
        panel.xaxis.grid(True)
    axes[1].set_xscale("log")
    ticks_cm = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
    axes[1].set_xticks(ticks_cm)
    axes[1].set_xticklabels(ticks_cm)
    axes[0].set_yticks(range(len(lines)))
    axes[0].set_yticklabels([f"{SYSTEMS[system].replace(', 2 cm', '')}\n{SCENES[scene]}" for scene, system in lines])
    axes[0].invert_yaxis()
    legend_below(figure, axes[0], 2)
    save(figure, out, bbox_inches="tight")


def crop(mesh, half_m):
    """The part of the mesh round the bricks: the floor beyond tells nothing."""
    inside = np.all(np.abs(mesh.points[:, :2] - TARGET[:2]) < half_m, axis=1)
    mesh.triangles = mesh.triangles[np.all(inside[mesh.triangles], axis=1)]
    return mesh


def picture_of(mesh, camera, value, colour):
    return render_mesh.shrink(render_mesh.shade(camera, mesh, {"value": value, "map": colour}, 0.9), 2)


def brick_coloured(mesh, camera):
    return picture_of(mesh, camera, lambda mesh: mesh.points[:, 2], lambda z: np.broadcast_to(BRICK, (len(z), 3)))


def draw_maps(folder, out):
    """Each map before and after the removal, and the signed distance on it."""
    systems = read_json(folder / "summary.json")["systems"]
    colormap, scale = plt.get_cmap("coolwarm"), matplotlib.colors.Normalize(-RANGE_CM, RANGE_CM, clip=True)
    figure, axes = plt.subplots(2, len(SYSTEMS), figsize=(13.2, 7.0), constrained_layout=True)
    camera = None
    for column, (system, title) in enumerate(SYSTEMS.items()):
        before, after = (crop(render_mesh.read_ply(folder / f"{system}_{when}.ply"), 0.42)
                         for when in ("before", "after"))
        camera = camera or render_mesh.fit_camera(before.points[np.unique(before.triangles)], -25.0, 32.0, None, TARGET,
                                                  (2 * PANEL[0], 2 * PANEL[1]))
        axes[0, column].imshow(brick_coloured(before, camera))
        axes[1, column].imshow(picture_of(after, camera, lambda mesh: 100.0 * mesh.distance,
                                          lambda d: np.where(np.isnan(d)[:, None], NOT_COMPARED,
                                                             colormap(scale(d))[:, :3])))
        found = systems[system]["against_last_scan"]
        axes[0, column].set_title(f"{title}: first scan", fontsize=13)
        axes[1, column].set_title(f"brick taken away, second scan\nmean {100 * found['mean_m']:.3f} cm, "
                                  f"sigma {100 * found['std_dev_m']:.3f} cm", fontsize=12)
    for panel in axes.flat:
        panel.set_axis_off()
    figure.colorbar(matplotlib.cm.ScalarMappable(scale, colormap), ax=axes[1], orientation="horizontal", extend="both",
                    shrink=0.3, label="signed distance to the map of the last scan [cm]")
    save(figure, out, 80)


def write_rows(path, columns, rows):
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([format(value, ".6g") if isinstance(value, float) else value for value in row] for row in rows)


def accuracy(source, out):
    """Fig. 8. INPUT: results/fig8 of an earlier call; without it, runs everything."""
    if source is None:
        source = ROOT / "results/fig8"
        run_all(source)
    write_rows(out / "fig8.csv", COLUMNS, (row.values() for row in read_runs(source)))
    rows = read_rows(out / "fig8.csv", COLUMNS[:2] + COLUMNS[3:4])
    (out / "fig8.md").write_text(table_of(rows), encoding="utf-8")
    draw_distribution(rows, out / "fig8.png")
    draw_maps(source / "fig8-full-1", out / "fig8_maps.png")


def blanket(source, out):
    """Fig. 3. INPUT: a run of fig8_experiment (default: results/fig8/fig8-full-1, made if it is not there)."""
    if source is None:
        source = ROOT / "results/fig8/fig8-full-1"
        if not (source / "blanket.csv").exists():
            workspace.library("install_packages; build_workspace fig8_experiment")
            run_experiment(ROOT / "sim_tests/synthetic_depth/scenes/fig8.yaml", "full", 1, source)
    rays = np.genfromtxt(source / "blanket.csv", delimiter=",", names=True)
    removed = np.array([[row["x"], row["y"], row["z"]] for row in read_rows(source / "removed.csv")])
    before = render_mesh.read_ply(source / "gpis_before.ply")
    eye = np.array(read_json(source / "summary.json")["T_map_camera_last"])[:3, 3]
    figure, (view, section) = plt.subplots(1, 2, figsize=(16.0, 4.4), gridspec_kw={"width_ratios": [0.6, 1.0]},
                                           constrained_layout=True)

    after = crop(render_mesh.read_ply(source / "gpis_after.ply"), 0.42)
    camera = render_mesh.fit_camera(crop(before, 0.42).points[np.unique(before.triangles)], -25.0, 32.0, None, TARGET,
                                    (2 * PANEL[0], 2 * PANEL[1]))
    view.imshow(brick_coloured(after, camera))
    pixels, _ = camera.project(removed)
    view.plot(*(0.5 * pixels.T), linestyle="none", marker="o", markersize=3.5, color=GREEN, markeredgewidth=0)
    view.set_axis_off()
    view.set_title("The new map, and the training points that the image deleted", fontsize=13, loc="left")

    # The column of rays that passes most deleted points; all of it lies in one plane through the camera.
    def knots(name, of):
        return np.stack([of[f"{name}_{axis}"] for axis in "xyz"], axis=-1)

    def bearing_of(points):
        return np.arctan2(points[:, 1] - eye[1], points[:, 0] - eye[0])

    columns = [rays[rays["column"] == column] for column in np.unique(rays["column"])]
    middle = np.nanmedian(bearing_of(removed))
    chosen = min(columns, key=lambda of: abs(np.nanmedian(bearing_of(knots("seen", of))) - middle))
    normal = np.linalg.svd(knots("seen", chosen)[np.isfinite(chosen["seen_x"])] - eye, full_matrices=False)[2][2]

    def in_plane(points):
        return np.hypot(points[:, 0] - eye[0], points[:, 1] - eye[1]), points[:, 2]

    def near_plane(points):
        return points[np.abs((points - eye) @ normal) < 0.01]

    section.plot(*in_plane(near_plane(before.points)), linestyle="none", marker=".", markersize=3, color="#b8b8b8",
                 label="vertices of the surface mapped before, within 1 cm of the plane")
    wall = chosen["is_wall"] == 1
    section.plot(*in_plane(knots("seen", chosen[wall])), color="#b58a00", linewidth=4.0, alpha=0.5,
                 label="nothing within range: the wall at infinity, drawn at the range's end")
    for name, colour, words in (("nearer", BLUE, "bound: what is nearer is deleted"),
                                ("seen", "#b58a00", "what the image measures, a function of the ray"),
                                ("farther", "#8c6bb1", "bound: what is farther is hidden, kept")):
        section.plot(*in_plane(knots(name, chosen[~wall])), color=colour, linewidth=1.6, label=words)
    section.plot(*in_plane(near_plane(removed)), linestyle="none", marker="o", markersize=6, color=GREEN,
                 label="deleted training points")
    ray = removed[np.argmin(np.abs((removed - eye) @ normal))]
    section.plot(*np.transpose([(0.0, eye[2]), tuple(float(value[0]) for value in in_plane(ray[None]))]), color=ORANGE,
                 linewidth=1.0, linestyle="--", label="a ray of the camera")
    section.set_aspect("equal")
    section.set_xlim(0.5, 2.5)
    section.set_ylim(-0.05, 0.45)
    tidy(section, "Section through one column of the image", "distance from the camera, along the ground [m]",
         "height [m]")
    section.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncol=2)
    save(figure, out / "fig3.png", bbox_inches="tight")
    write_rows(out / "fig3.csv", rays.dtype.names, chosen.tolist())
