# SPDX-License-Identifier: BSD-3-Clause
"""The figure of scripts/fig8: each map before and after the removal, the signed distance on it, and its histogram."""

import json
import pathlib

import matplotlib.colors
import numpy as np

from . import render_mesh
from .cli import Refusal, one_line_errors, parser_of
from .style import plt, save

SYSTEMS = (("gpis", "Dynamic GPIS"), ("gpis_static", "GPIS, dynamic: false"), ("octomap", "Dynamic OctoMap, 2 cm"))
RANGE_CM = 1.0
VIEW = (-25.0, 32.0, None)
TARGET = np.array([0.02, -0.02, 0.12])
PANEL = (520, 380)
BRICK = np.array([0.80, 0.66, 0.55])


def crop(mesh, half_m):
    """The part of the mesh round the bricks: the floor beyond tells nothing."""
    inside = np.all(np.abs(mesh.points[:, :2] - TARGET[:2]) < half_m, axis=1)
    mesh.triangles = mesh.triangles[np.all(inside[mesh.triangles], axis=1)]
    return mesh


def picture_of(mesh, camera, value, colour):
    size_m = 0.9
    return render_mesh.shrink(render_mesh.shade(camera, mesh, {"value": value, "map": colour}, size_m), 2)


def draw_histogram(axes, folder, system, statistics):
    rows = np.genfromtxt(folder / f"{system}_histogram.csv", delimiter=",", skip_header=1)
    rows = rows[np.isfinite(rows[:, 0]) & np.isfinite(rows[:, 1])]
    middle = 50.0 * (rows[:, 0] + rows[:, 1])
    share = rows[:, 2] / max(1.0, statistics["count"])
    # Bins of the file are fine; here 0.05 cm each.
    edges = np.arange(-2.0, 2.0 + 1e-9, 0.05)
    heights, _ = np.histogram(middle, edges, weights=share)
    axes.bar(edges[:-1], heights, width=0.05, align="edge", color="#4c7a9b")
    axes.set_yscale("log")
    axes.set_ylim(1e-5, 1.0)
    axes.set_xlim(-2.0, 2.0)
    beyond = 1.0 - heights.sum()
    axes.set_title(f"mean {100 * statistics['mean_m']:.3f} cm, \u03c3 {100 * statistics['std_dev_m']:.3f} cm", fontsize=13)
    axes.text(0.98, 0.95, f"{100 * beyond:.1f} % beyond 2 cm", transform=axes.transAxes, ha="right", va="top", fontsize=10)
    axes.set_xlabel("signed distance to the map of the last scan [cm]", fontsize=10)
    axes.set_ylabel("share of the cloud", fontsize=10)
    axes.grid(True, which="major", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def draw(folder, out):
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    colormap = matplotlib.colormaps["coolwarm"] if hasattr(matplotlib, "colormaps") else plt.get_cmap("coolwarm")
    scale = matplotlib.colors.Normalize(-RANGE_CM, RANGE_CM, clip=True)
    figure, axes = plt.subplots(len(SYSTEMS), 3, figsize=(15.5, 11.5), gridspec_kw={"width_ratios": [1, 1, 0.8]})
    camera = None
    for row, (system, title) in enumerate(SYSTEMS):
        before = crop(render_mesh.read_ply(folder / f"{system}_before.ply"), 0.42)
        after = crop(render_mesh.read_ply(folder / f"{system}_after.ply"), 0.42)
        if camera is None:
            camera = render_mesh.fit_camera(before.points[np.unique(before.triangles)], *VIEW, TARGET, (2 * PANEL[0], 2 * PANEL[1]))
        axes[row, 0].imshow(picture_of(before, camera, lambda mesh: mesh.points[:, 2], lambda z: np.broadcast_to(BRICK, (len(z), 3))))
        axes[row, 1].imshow(picture_of(after, camera, lambda mesh: np.nan_to_num(100.0 * mesh.distance), lambda d: colormap(scale(d))[:, :3]))
        axes[row, 0].set_title(f"{title}: first scan", fontsize=13)
        axes[row, 1].set_title("a brick taken away, one more scan", fontsize=13)
        for column in (0, 1):
            axes[row, column].set_axis_off()
        draw_histogram(axes[row, 2], folder, system, summary["systems"][system]["against_last_scan"])
    figure.subplots_adjust(left=0.01, right=0.985, top=0.955, bottom=0.085, wspace=0.08, hspace=0.30)
    bar = figure.add_axes([0.37, 0.045, 0.24, 0.014])
    figure.colorbar(matplotlib.cm.ScalarMappable(scale, colormap), cax=bar, orientation="horizontal", extend="both")
    bar.set_xlabel("signed distance [cm]", fontsize=11)
    save(figure, out, 80)


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=pathlib.Path, help="of one run of fig8_experiment")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    arguments = parser.parse_args()
    try:
        draw(arguments.folder, arguments.out)
    except (OSError, ValueError, KeyError, TypeError, IndexError, Refusal) as error:
        raise Refusal(f"{arguments.folder}: cannot be drawn, {type(error).__name__}: {error}") from error
