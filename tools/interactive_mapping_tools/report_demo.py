# SPDX-License-Identifier: BSD-3-Clause
"""Says in words what scripts/demo left in its folder."""

import pathlib

import numpy as np

from . import plot_timing
from . import render_mesh
from .cli import one_line_errors, parser_of


def count_of(path, element):
    with open(path, "rb") as stream:
        _, elements = render_mesh.read_header(stream, path)
    return next((count for name, count, _ in elements if name == element), 0)


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--removal-frame", type=int, required=True, help="first frame without the boxes")
    arguments = parser.parse_args()
    folder = arguments.folder
    timing = plot_timing.read_timing(folder / "timing.csv")
    before, after = folder / "mesh_before.ply", folder / "mesh_after.ply"
    vertices = count_of(before, "vertex"), count_of(after, "vertex")
    triangles = count_of(before, "face"), count_of(after, "face")

    total = timing["total_ms"]
    print(f"Frames            {len(total)}, {np.median(total):.0f} ms each in the median, {np.percentile(total, 95):.0f} ms at the 95th percentile")
    print(f"Map               {timing['map_points'][-1]:.0f} points at the end")
    print(f"Mesh before       {vertices[0]} vertices, {triangles[0]} triangles")
    print(f"Mesh after        {vertices[1]} vertices, {triangles[1]} triangles")
    past = np.flatnonzero(timing["frame"] >= arguments.removal_frame)
    if len(past):
        at = past[0]
        print(f"Boxes taken away  {timing['deleted'][at]:.0f} points deleted at frame {timing['frame'][at]:.0f}, "
              f"the first without them; {timing['deleted'][past[1:]].sum():.0f} in all frames after it")
    print()
    print(f"Look at           {folder / 'before_after.png'} and {folder / 'timing.png'}")
    print(f"Also there        {', '.join(path.name for path in sorted(folder.iterdir()) if path.suffix in ('.ply', '.gpis', '.csv', '.json'))}")
