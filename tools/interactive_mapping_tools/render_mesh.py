# SPDX-License-Identifier: BSD-3-Clause
"""Renders triangle meshes (PLY) to a PNG without a display or a graphics driver.

Several meshes are drawn side by side from one view point with one colour scale, so that they can be compared.
Back faces, where the surface is seen from inside, are grey.
"""

import copy
import pathlib

import matplotlib.colors
import numpy as np
from PIL import Image, ImageDraw
from scipy import ndimage

from .cli import Refusal, one_line_errors, parser_of
from .style import plt, save

PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}
FIELD_OF_VIEW_RAD = np.deg2rad(28.0)


class MeshError(Refusal):
    """The file is not a mesh this program can draw; the text says why."""


class Mesh:
    """points, normals: Nx3 [m, unit], map frame; variance: N [m^2] or None; triangles: Mx3 indices;
    distance: N, signed, to another surface [m], or None."""

    def __init__(self, points, normals, variance, triangles, distance=None):
        self.points = points
        self.normals = normals
        self.variance = variance
        self.triangles = triangles
        self.distance = distance


def read_header(stream, path):
    """Returns (format, elements); an element is [name, count, [(property, type, type of list length or None)]]."""
    if stream.readline().strip() != b"ply":
        raise MeshError(f"{path}: not a PLY file")
    file_format, elements = None, []
    for _ in range(1000):
        words = stream.readline().decode("ascii", "replace").split()
        if not words:
            raise MeshError(f"{path}: the header ends too early")
        if words[0] == "end_header":
            return file_format, elements
        try:
            if words[0] == "format":
                file_format = words[1]
            elif words[0] == "element":
                elements.append([words[1], int(words[2]), []])
            elif words[0] == "property" and words[1] == "list":
                elements[-1][2].append((words[4], PLY_TYPES[words[3]], PLY_TYPES[words[2]]))
            elif words[0] == "property":
                elements[-1][2].append((words[2], PLY_TYPES[words[1]], None))
        except (IndexError, KeyError, ValueError):
            raise MeshError(f"{path}: cannot understand the header line `{' '.join(words)}`") from None
    raise MeshError(f"{path}: the header has no end")


def read_ply(path):
    """Reads a triangle mesh; missing normals are computed, a missing variance is None."""
    with open(path, "rb") as stream:
        file_format, elements = read_header(stream, path)
        if file_format != "binary_little_endian":
            raise MeshError(f"{path}: format {file_format}, must be binary_little_endian")
        tables = {}
        for name, count, properties in elements:
            dtype = []
            for key, kind, length_kind in properties:
                if length_kind is None:
                    dtype.append((key, "<" + kind))
                else:  # only triangles: then a row has a fixed size
                    dtype += [(key + "_count", "<" + length_kind), (key, "<" + kind, (3,))]
            dtype = np.dtype(dtype)
            # Asked before memory is: a broken header may tell any number.
            num_there = (path.stat().st_size - stream.tell()) // max(1, dtype.itemsize)
            if not 0 <= count <= num_there:
                raise MeshError(f"{path}: element {name}: the file ends after {num_there} of {count}")
            tables[name] = np.frombuffer(stream.read(dtype.itemsize * count), dtype)

    vertices, faces = tables.get("vertex"), tables.get("face")
    if vertices is None or not {"x", "y", "z"} <= set(vertices.dtype.names):
        raise MeshError(f"{path}: no vertices with x, y, z")
    list_name = next((key for key in ("vertex_indices", "vertex_index") if faces is not None and key in faces.dtype.names), None)
    if list_name is None:
        raise MeshError(f"{path}: no faces; this is a point cloud, not a mesh")
    if len(faces) and np.any(faces[list_name + "_count"] != 3):
        raise MeshError(f"{path}: only triangles are supported")
    points = np.stack([vertices[key] for key in "xyz"], axis=1).astype(np.float64)
    triangles = faces[list_name].astype(np.int64)
    if len(triangles) == 0:
        raise MeshError(f"{path}: the mesh is empty")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise MeshError(f"{path}: a face names a vertex that does not exist")
    triangles = triangles[np.isfinite(points[triangles]).all(axis=(1, 2))]
    if {"nx", "ny", "nz"} <= set(vertices.dtype.names):
        normals = np.stack([vertices["n" + key] for key in "xyz"], axis=1).astype(np.float64)
    else:
        normals = np.zeros_like(points)
        corners = points[triangles]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        for corner in range(3):
            np.add.at(normals, triangles[:, corner], area)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 1e-12, normals / np.maximum(length, 1e-12), [0.0, 0.0, 1.0])
    variance = vertices["variance"].astype(np.float64) if "variance" in vertices.dtype.names else None
    distance = vertices["distance"].astype(np.float64) if "distance" in vertices.dtype.names else None
    return Mesh(points, normals, variance, triangles, distance)


class Camera:
    """Looks from `distance` [m] at `target` [m]; azimuth, elevation [deg] say from which side (azimuth 0: from +x)."""

    def __init__(self, target, azimuth, elevation, distance, size):
        azimuth, elevation = np.deg2rad(azimuth), np.deg2rad(elevation)
        back = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        self.width, self.height = size
        self.target = np.asarray(target, dtype=float)
        self.position = self.target + distance * back
        self.rows = np.stack([right, np.cross(right, back), -back])  # x right, y down, z forward
        self.focal = 0.5 * self.height / np.tan(0.5 * FIELD_OF_VIEW_RAD)
        self.shift = np.array([0.5 * self.width, 0.5 * self.height])

    def at_half_size(self):
        half = copy.copy(self)
        half.width, half.height = self.width // 2, self.height // 2
        half.focal, half.shift = 0.5 * self.focal, 0.5 * self.shift
        return half

    def project(self, points):
        """Returns pixel positions Nx2 and depths N [m] along the viewing direction."""
        local = (points - self.position) @ self.rows.T
        depth = local[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = self.focal * local[:, :2] / depth[:, None] + self.shift
        return pixels, depth


def fit_camera(points, azimuth, elevation, distance, target, size, margin=1.06):
    """Camera that shows all points (of many: but for the outermost 0.2 %); distance [m] None: as near as that allows.

    target: the point [m] in the middle of the picture, if a distance is given; None: the middle of the points.
    """
    outliers = 0.1 if len(points) > 1000 else 0.0
    low, high = np.percentile(points, [outliers, 100.0 - outliers], axis=0)
    inside = points[np.all((points >= low) & (points <= high), axis=1)]
    if len(inside) > 200_000:
        inside = inside[:: len(inside) // 200_000 + 1]
    target = 0.5 * (low + high) if target is None else np.asarray(target, dtype=float)
    if distance is not None:
        return Camera(target, azimuth, elevation, distance, size)
    distance = 1.2 * np.linalg.norm(high - low) / np.tan(0.5 * FIELD_OF_VIEW_RAD) + 1e-6
    camera = Camera(target, azimuth, elevation, distance, size)
    for _ in range(12):  # aim at the middle of the picture, then approach until it is filled
        pixels, depth = camera.project(inside)
        low_px, high_px = pixels.min(axis=0), pixels.max(axis=0)
        middle = 0.5 * (low_px + high_px) - camera.shift
        target = target + (middle * np.median(depth) / camera.focal) @ camera.rows[:2]
        fill = np.max(margin * (high_px - low_px) / [camera.width, camera.height])
        distance *= max(0.5, min(2.0, 0.3 + 0.7 * fill))
        camera = Camera(target, azimuth, elevation, distance, size)
    return camera


def nearest_triangles(camera, points, triangles):
    """The index of the nearest triangle per pixel (-1: none), height x width. The far ones are painted first: a map's are small beside their distances."""
    pixels, depth = camera.project(points)
    with np.errstate(invalid="ignore"):
        corners, margin_px = pixels[triangles], 1e4
        is_drawn = np.all(depth[triangles] > 1e-3, axis=1) & np.all((corners > -margin_px) & (corners < margin_px), axis=(1, 2))
    far_first = np.flatnonzero(is_drawn)
    far_first = far_first[np.argsort(-depth[triangles[far_first]].mean(axis=1), kind="stable")]
    image = Image.new("I", (camera.width, camera.height), -1)
    draw = ImageDraw.Draw(image)
    for index, triangle in zip(far_first.tolist(), corners[far_first].reshape(-1, 6).tolist()):
        draw.polygon(triangle, fill=index)
    return np.array(image)


def interpolate(camera, mesh, owner, values):
    """Row, column, position [m] and values (N x k, per vertex) of the covered pixels, perspective-correct."""
    row, column = np.nonzero(owner >= 0)
    triangle = mesh.triangles[owner[row, column]]
    ray = np.stack([column + 0.5, row + 0.5], axis=1) - camera.shift
    ray = np.concatenate([ray / camera.focal, np.ones((len(row), 1))], axis=1) @ camera.rows
    a, b, c = (mesh.points[triangle[:, k]] - camera.position for k in range(3))
    weights = np.stack([np.einsum("ij,ij->i", ray, np.cross(second, third)) for second, third in ((b, c), (c, a), (a, b))], axis=1)
    total = weights.sum(axis=1, keepdims=True)
    weights = np.clip(weights / np.where(np.abs(total) > 1e-300, total, 1.0), 0.0, 1.0)
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-9)
    return row, column, np.einsum("ik,ikd->id", weights, mesh.points[triangle]), np.einsum("ik,ikd->id", weights, values[triangle])


def crevice_darkness(camera, position, normal, covered, radius_m):
    """How much of the view above each pixel's surface its neighbours hide (0..1): corners and contacts come out dark.

    position, normal: height x width x 3, the normal towards the camera. Estimated from a fixed spiral of neighbours.
    """
    depth = np.where(covered, (position - camera.position) @ camera.rows[2], np.inf)
    radius_px = radius_m * camera.focal / np.median(depth[covered])
    samples = 20
    hidden = np.zeros(depth.shape)
    height, width = depth.shape
    for k in range(samples):
        length = radius_px * np.sqrt((k + 0.5) / samples)
        dx, dy = int(round(length * np.cos(2.39996 * k))), int(round(length * np.sin(2.39996 * k)))
        if (dx, dy) == (0, 0) or abs(dx) >= width or abs(dy) >= height:
            continue
        here = (slice(max(0, -dy), height - max(0, dy)), slice(max(0, -dx), width - max(0, dx)))
        there = (slice(max(0, dy), height - max(0, -dy)), slice(max(0, dx), width - max(0, -dx)))
        offset = position[there] - position[here]
        squared = np.einsum("ijk,ijk->ij", offset, offset) + 1e-12
        above = np.einsum("ijk,ijk->ij", offset, normal[here]) / np.sqrt(squared)
        near = np.clip(1.0 - squared / (2.0 * radius_m) ** 2, 0.0, 1.0)
        hidden[here] += np.clip(above - 0.12, 0.0, 1.0) * near * covered[there]
    hidden = ndimage.gaussian_filter(hidden, 0.12 * radius_px)
    return np.clip(2.2 * hidden / samples, 0.0, 1.0)


def shade(camera, mesh, colour_of, size_m):
    """Picture height x width x 3 (0..1); colour_of maps vertex values at pixels to RGB."""
    owner = nearest_triangles(camera, mesh.points, mesh.triangles)
    covered = owner >= 0
    picture = np.ones((camera.height, camera.width, 3))
    if not covered.any():
        return picture
    scalar = colour_of["value"](mesh)
    row, column, position, mixed = interpolate(camera, mesh, owner, np.concatenate([mesh.normals, scalar[:, None]], axis=1))
    to_eye = camera.position - position
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    normal = mixed[:, :3] / np.maximum(np.linalg.norm(mixed[:, :3], axis=1, keepdims=True), 1e-9)
    facing = np.einsum("ij,ij->i", normal, to_eye)
    corners = mesh.points[mesh.triangles[owner[row, column]]]
    flat_normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat_normal *= np.where(np.einsum("ij,ij->i", flat_normal, normal) < 0, -1.0, 1.0)[:, None]
    from_inside = np.einsum("ij,ij->i", flat_normal, to_eye) < 0
    normal = np.where((facing < 0)[:, None], -normal, normal)

    # Key light from above the camera's left shoulder, a head light, and a sky that lifts upward faces.
    right, down, forward = camera.rows
    key = -0.55 * right - 0.65 * down - 0.55 * forward
    key /= np.linalg.norm(key)
    light = 0.25 + 0.45 * np.clip(normal @ key, 0.0, 1.0) + 0.26 * np.abs(facing) + 0.20 * (0.5 + 0.5 * normal[:, 2])
    colour = colour_of["map"](mixed[:, 3])
    colour = np.where(from_inside[:, None], [0.62, 0.62, 0.64], colour)
    light = np.where(from_inside, 0.55 + 0.30 * np.abs(facing), light)

    half = (slice(None, None, 2), slice(None, None, 2))
    positions, normals = np.zeros((2, camera.height, camera.width, 3), dtype=np.float32)
    positions[row, column] = position
    normals[row, column] = normal
    coarse = camera.at_half_size()
    darkness = np.zeros((coarse.height, coarse.width))
    for share, strength in ((0.012, 0.35), (0.035, 0.45)):
        darkness += strength * crevice_darkness(coarse, positions[half], normals[half], covered[half], share * size_m)
    light = light * (1.0 - np.clip(darkness, 0.0, 0.8)[row // 2, column // 2])
    # A thin dark line where the surface in front ends before a farther one.
    depth = np.zeros(owner.shape)
    depth[row, column] = (position - camera.position) @ forward
    farther = ndimage.grey_dilation(depth, size=(3, 3))[row, column] - depth[row, column]
    outline = np.clip((farther - 0.012 * size_m) / (0.02 * size_m), 0.0, 1.0)
    light = light * (1.0 - 0.35 * outline)
    picture[row, column] = np.clip(colour * light[:, None], 0.0, 1.0)
    return picture


def shrink(picture, factor):
    height, width, _ = picture.shape
    return picture.reshape(height // factor, factor, width // factor, factor, 3).mean(axis=(1, 3))


def height_of(mesh):
    return mesh.points[:, 2]


def deviation_of(mesh):
    if mesh.variance is None:
        raise MeshError("the mesh carries no `variance` per vertex; use --color height")
    return 1000.0 * np.sqrt(np.maximum(np.nan_to_num(mesh.variance), 0.0))


COLOURINGS = {
    "height": (height_of, "height in the map frame [m]", matplotlib.colors.LinearSegmentedColormap.from_list(
        "height", ["#a9bccb", "#6ea6ab", "#7fb98a", "#dccb6e", "#e0914f", "#b9474b"])),
    "variance": (deviation_of, "standard deviation of the surface [mm]", matplotlib.colors.LinearSegmentedColormap.from_list(
        "deviation", ["#2f6c8f", "#7fb0b5", "#efe3bd", "#e69a5b", "#b3323a"])),
}


def nice_length(size_m):
    """A round length [m] near a fifth of the scene, for the scale bar."""
    wanted = 0.2 * size_m
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * decade for step in (1, 2, 5) if step * decade <= wanted * 1.001))


def range_of(mesh, coloring):
    """(low, high) of the colour scale that suits a mesh, in its colouring's unit."""
    low, high = np.percentile(COLOURINGS[coloring][0](mesh)[np.unique(mesh.triangles)], [0.5, 99.8])
    if coloring == "variance":
        low = 0.0
    return (low - 0.5e-3, high + 0.5e-3) if high - low < 1e-6 else (low, high)


def render(meshes, titles, out, reference, view, target, coloring, colour_range, panel, panel_may_shrink, has_legend=True):
    """Draws the meshes beside each other; without a legend the panels fill the picture."""
    value, label, colormap = COLOURINGS[coloring]
    used = np.unique(reference.triangles)
    points = reference.points[used]
    size_m = float(np.linalg.norm(np.subtract(*np.percentile(points, [99, 1], axis=0))))
    if colour_range is None:
        colour_range = range_of(reference, coloring)
    scale = matplotlib.colors.Normalize(*colour_range, clip=True)
    supersampling = 2
    camera = fit_camera(points, *view, target, (panel[0] * supersampling, panel[1] * supersampling))
    if panel_may_shrink:
        pixels, _ = camera.project(points)
        low_px, high_px = np.percentile(pixels[:, 1], [0.05, 99.95] if len(points) > 1000 else [0.0, 100.0])
        panel = (panel[0], int(np.clip(1.08 * (high_px - low_px) / supersampling, 0.3 * panel[1], panel[1])))
        camera.shift = camera.shift - [0.0, 0.5 * (camera.height - panel[1] * supersampling)]
        camera.height = panel[1] * supersampling
    size_m = min(size_m, 1.2 * camera.project(camera.target[None, :])[1][0] * camera.width / camera.focal)
    colour_of = {"value": value, "map": lambda values: colormap(scale(values))[:, :3]}

    dpi = 100.0
    head, foot, gap = (54 if any(titles) else 16, 84, 18) if has_legend else (0, 0, 0)
    width = gap + len(meshes) * (panel[0] + gap)
    height = head + panel[1] + foot
    figure = plt.figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
    for column, (mesh, title) in enumerate(zip(meshes, titles)):
        picture = shrink(shade(camera, mesh, colour_of, size_m), supersampling)
        left = gap + column * (panel[0] + gap)
        axes = figure.add_axes([left / width, foot / height, panel[0] / width, panel[1] / height])
        axes.imshow(picture, interpolation="nearest")
        axes.set_axis_off()
        if title:
            figure.text((left + 0.5 * panel[0]) / width, 1.0 - 0.52 * head / height, title, ha="center", va="center", fontsize=17, color="#222222")
    if has_legend:
        draw_legend(figure, camera, scale, label, colormap, size_m, supersampling, (width, height, gap))
    save(figure, out, dpi)


def draw_legend(figure, camera, scale, label, colormap, size_m, supersampling, layout):
    """Colour scale and a length, below the panels. layout: width, height and gap of the figure [px]."""
    width, height, gap = layout
    bar = figure.add_axes([gap / width + 0.02, 46 / height, min(0.42, 460 / width), 14 / height])
    colours = figure.colorbar(matplotlib.cm.ScalarMappable(scale, colormap), cax=bar, orientation="horizontal")
    colours.outline.set_linewidth(0.6)
    bar.tick_params(labelsize=11, length=3, color="#555555", labelcolor="#333333")
    bar.set_xlabel(label, fontsize=12, color="#333333", labelpad=2)
    # The length holds at the distance of the middle of the scene.
    middle = camera.project(camera.target[None, :])[1][0]
    length = nice_length(min(size_m, middle * camera.width / camera.focal))
    length_px = length * camera.focal / middle / supersampling
    right = width - gap - 20
    axes = figure.add_axes([(right - length_px) / width, 50 / height, length_px / width, 6 / height], facecolor="#333333")
    axes.set_xticks([]), axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(False)
    unit = f"{length:g} m" if length >= 1.0 else f"{100 * length:g} cm"
    figure.text(min(right - 0.5 * length_px, width - gap - 80) / width, 36 / height, f"{unit} at mid-distance", ha="center", va="center", fontsize=12, color="#333333")


@one_line_errors
def main():
    parser = parser_of(__doc__)
    parser.add_argument("meshes", nargs="+", type=pathlib.Path, metavar="MESH.ply")
    parser.add_argument("--out", required=True, type=pathlib.Path, metavar="PNG")
    parser.add_argument("--title", nargs="+", default=[], help="one per mesh")
    parser.add_argument("--view", nargs="+", type=float, default=[-60.0, 35.0], metavar="NUMBER",
                        help="azimuth [deg, 0 looks from +x], elevation [deg] and optionally distance [m]; default -60 35, distance as fits")
    parser.add_argument("--target", nargs=3, type=float, metavar=("X", "Y", "Z"),
                        help="point in the middle of the picture [m]; needs a distance in --view; default the middle of the mesh")
    parser.add_argument("--color", choices=sorted(COLOURINGS), default="height", help="by height or by the surface's uncertainty")
    parser.add_argument("--range", nargs=2, type=float, metavar=("LOW", "HIGH"), help="of the colour scale [m, or mm for variance]")
    parser.add_argument("--like", type=pathlib.Path, metavar="MESH.ply", help="take framing and colour scale from this mesh (default: the first)")
    parser.add_argument("--size", nargs=2, type=int, default=None, metavar=("WIDTH", "HEIGHT"), help="pixels per mesh; default 1200 wide, 800 if several, as high as needed")
    arguments = parser.parse_args()
    if arguments.title and len(arguments.title) != len(arguments.meshes):
        parser.error(f"{len(arguments.title)} titles for {len(arguments.meshes)} meshes")
    if len(arguments.view) not in (2, 3):
        parser.error("--view takes azimuth, elevation and optionally a distance")
    if arguments.target and len(arguments.view) != 3:
        parser.error("--target needs a distance: --view AZIMUTH ELEVATION DISTANCE")
    if len(arguments.view) == 3 and arguments.view[2] <= 0.0:
        parser.error("--view: the distance must be positive")
    if arguments.size and min(arguments.size) < 64:
        parser.error("--size: at least 64 pixels")
    if arguments.range and arguments.range[0] >= arguments.range[1]:
        parser.error("--range: LOW must be below HIGH")
    view = arguments.view + [None] * (3 - len(arguments.view))
    panel = tuple(arguments.size or ((1200, 900) if len(arguments.meshes) == 1 else (800, 700)))
    meshes = [read_ply(path) for path in arguments.meshes]
    reference = read_ply(arguments.like) if arguments.like else meshes[0]
    titles = arguments.title or [""] * len(meshes)
    render(meshes, titles, arguments.out, reference, view, arguments.target, arguments.color, arguments.range, panel,
           panel_may_shrink=arguments.size is None and view[2] is None)
    print(arguments.out)
