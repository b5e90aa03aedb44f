# SPDX-License-Identifier: Apache-2.0
"""Volume, area and projected area of faces, with their gradients at the points."""

from typing import Tuple

import numpy as np

from ..errors import InvalidArgument


def triangles(sizes: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Faces as fans of triangles, (t, 3) of ids of points. sizes (f,): corners of each face; corners: their ids, one face after the other."""
    sizes = np.asarray(sizes, dtype=np.int64)
    if len(sizes) == 0:
        raise InvalidArgument("measures: the mesh has no faces")
    starts = np.cumsum(sizes) - sizes
    fan = np.repeat(starts, sizes - 2)
    within = np.arange(len(fan)) - np.repeat(np.cumsum(sizes - 2) - (sizes - 2), sizes - 2)
    corners = np.asarray(corners, dtype=np.int64)
    return np.stack([corners[fan], corners[fan + within + 1], corners[fan + within + 2]], axis=1)


def measure(kind: str, axis: str, points: np.ndarray, faces: np.ndarray) -> Tuple[float, np.ndarray]:
    """Value and its gradient at the points, (n, 3).

    points (n, 3), model units; faces (t, 3). kind: "volume", that is enclosed, of a closed surface whose normals point outwards (sum of
    a . (b x c) / 6); "area"; "projected_area": half the sum of the areas of all faces in the plane across `axis`, "x", "y" or "z", which of a
    convex body is the area of its shadow, and of others counts what is hidden as well.
    """
    a, b, c = (points[faces[:, i]] for i in range(3))
    if kind == "volume":
        value = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6
        parts = [np.cross(b, c) / 6, np.cross(c, a) / 6, np.cross(a, b) / 6]
    else:
        normals = np.cross(b - a, c - a) / 2
        if kind == "area":
            sizes = np.linalg.norm(normals, axis=1)
            value = float(sizes.sum())
            slope = normals / np.where(sizes > 0, sizes, 1)[:, None]
        elif kind == "projected_area":
            i = "xyz".index(axis)
            value = float(np.abs(normals[:, i]).sum()) / 2
            slope = np.zeros_like(normals)
            slope[:, i] = np.sign(normals[:, i]) / 2
        else:
            raise InvalidArgument(f"measures: {kind!r}, expected volume, area or projected_area")
        # The normal is (b - a) x (c - a) / 2 = (a x b + b x c + c x a) / 2.
        parts = [np.cross(b - c, slope) / 2, np.cross(c - a, slope) / 2, np.cross(a - b, slope) / 2]
    gradient = np.zeros_like(points)
    for i, part in enumerate(parts):
        np.add.at(gradient, faces[:, i], part)
    return value, gradient
