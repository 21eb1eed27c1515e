#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Maps a folder of depth images with poses (TUM RGB-D or 7-Scenes) and draws a slice of the field with its uncertainty.

    map_a_folder.py FOLDER --out slice.png [--config map.yaml] [--axis z --at 0.3] [--mesh mesh.ply]
"""

import argparse
import sys

import numpy as np
from matplotlib import pyplot

import gpis_mapping

CELLS = 400       # along the slice's longer side
BAND_M = 0.25     # distances farther from the surface have one colour
SURFACE_M = 0.02  # no farther from a point of the map is the line of the surface drawn
GREY = "0.85"     # where the map has no answer


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder")
    parser.add_argument("--out", default="slice.png", help="picture to write (default: slice.png)")
    parser.add_argument("--config", help="settings of the map (YAML); default: built-in values")
    parser.add_argument("--stride", type=int, default=1, help="take every N-th image (default: 1)")
    parser.add_argument("--axis", choices="xyz", default="z", help="the slice is at right angles to it (default: z)")
    parser.add_argument("--at", type=float, help="where along the axis [m]; default: the middle of the surface")
    parser.add_argument("--mesh", help="also write the surface to this PLY file")
    options = parser.parse_args()
    if options.stride < 1:
        parser.error(f"--stride is {options.stride}, must be at least 1")
    return options


def map_folder(folder, config=None, stride=1):
    sequence = gpis_mapping.DepthSequence(folder)
    for note in sequence.notes:
        print(f"note: {note}", file=sys.stderr)
    world = gpis_mapping.Map(config)
    milliseconds = []
    for index in range(0, len(sequence), stride):
        try:
            frame = sequence.frame(index)
        except gpis_mapping.DepthSequenceError as error:
            print(f"left out: {error}", file=sys.stderr)
            continue
        statistics = world.integrate(frame.depth, sequence.intrinsics, frame.pose, frame.stamp_s)
        milliseconds.append(statistics.total_ms)
    if not world.num_points:
        raise ValueError(f"{folder}: no surface was mapped from {len(milliseconds)} images")
    print(f"{len(milliseconds)} images, {np.median(milliseconds):.0f} ms each, {world.num_points} points, "
          f"{world.memory_bytes / 1e6:.0f} MB")
    return world


def slice_plane(mesh, axis, at):
    """The plane's extent (low, high) along all three axes: the surface's, but for stray points, and some margin."""
    low, high = np.percentile(mesh.vertices, [1.0, 99.0], axis=0)
    middle = at if at is not None else 0.5 * (low[axis] + high[axis])
    low, high = low - 0.15, high + 0.15
    low[axis] = high[axis] = middle
    return low, high


def draw(world, mesh, axis, at=None):
    """A figure: signed distance and standard deviation of the field in a plane at right angles to `axis` (0 x, 1 y, 2 z).

    `at`: where along the axis [m], map frame; None: the middle of the surface.
    """
    low, high = slice_plane(mesh, axis, at)
    across, up = [i for i in range(3) if i != axis]
    step = max(high[across] - low[across], high[up] - low[up]) / CELLS
    grid_across, grid_up = np.meshgrid(np.arange(low[across], high[across], step), np.arange(low[up], high[up], step))
    points = np.full((grid_across.size, 3), low[axis])
    points[:, across], points[:, up] = grid_across.ravel(), grid_up.ravel()
    answers = world.query(points)
    distance = answers.distance.reshape(grid_across.shape)
    std_mm = 1e3 * np.sqrt(answers.variance).reshape(grid_across.shape)
    std_mm[np.isnan(distance)] = np.nan
    # The sign also changes where front and back of an object meet in space that was never seen: no surface there.
    surface = np.where(answers.euclidean_distance.reshape(grid_across.shape) < 2.0 * step + SURFACE_M, distance, np.nan)

    extent = (low[across] - 0.5 * step, grid_across.max() + 0.5 * step, low[up] - 0.5 * step, grid_up.max() + 0.5 * step)
    is_wide = high[across] - low[across] > 1.3 * (high[up] - low[up])
    rows, columns = (2, 1) if is_wide else (1, 2)
    share = (high[up] - low[up]) / (high[across] - low[across])
    width = 11.0 if is_wide else 7.0  # of a plot with its labels and its scale of colours, which take 2
    figure, axes = pyplot.subplots(rows, columns, figsize=(columns * width, rows * ((width - 2.0) * share + 0.5) + 0.6),
                                   sharex=True, sharey=True, constrained_layout=True)
    for plot, values, title, style in (
            (axes[0], distance, "Signed distance [m]", {"cmap": "RdBu", "vmin": -BAND_M, "vmax": BAND_M}),
            (axes[1], std_mm, "Standard deviation of the field [mm]", {"cmap": "viridis", "vmin": 0.0})):
        plot.set_facecolor(GREY)
        image = plot.imshow(values, origin="lower", extent=extent, **style)
        plot.contour(grid_across, grid_up, surface, [0.0], colors="black" if plot is axes[0] else "white", linewidths=0.8)
        plot.set(aspect="equal", title=title, xlabel=f"{'xyz'[across]} [m]", ylabel=f"{'xyz'[up]} [m]")
        plot.label_outer()
        figure.colorbar(image, ax=plot, extend="both" if plot is axes[0] else "neither")
    figure.suptitle(f"{world.num_images} images, slice at {'xyz'[axis]} = {low[axis]:.2f} m. Lines: the surface. Grey: no answer.")
    return figure


def main():
    options = arguments()
    pyplot.switch_backend("Agg")
    try:
        world = map_folder(options.folder, options.config, options.stride)
        mesh = world.mesh()
        if options.mesh:
            mesh.save_ply(options.mesh)
        draw(world, mesh, "xyz".index(options.axis), options.at).savefig(options.out, dpi=110, bbox_inches="tight")
    except (ValueError, OSError) as error:
        sys.exit(f"map_a_folder: {error}")
    print(options.out)


if __name__ == "__main__":
    main()
