# SPDX-License-Identifier: BSD-3-Clause
"""A map of the surfaces that depth images show: signed distance with gradient and uncertainty, and a mesh.

    map = gpis_mapping.Map({"sensor": {"max_range_m": 3.0}})
    map.integrate(depth, (fx, fy, cx, cy), T_map_camera)
    answers = map.query(points)      # answers.distance, .gradient, .variance, .state
    mesh = map.mesh()                # mesh.vertices, .faces, .variance

SI units; what is taken away leaves the map with the first image that sees past it.
"""

from ._core import (DepthFrame, DepthSequence, DepthSequenceError, Map, MapFileError, Mesh, QueryResult, SpaceState,
                    UpdateStatistics)

__all__ = ["DepthFrame", "DepthSequence", "DepthSequenceError", "Map", "MapFileError", "Mesh", "QueryResult", "SpaceState",
           "UpdateStatistics"]
