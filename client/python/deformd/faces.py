# SPDX-License-Identifier: Apache-2.0
"""Flipped faces and inverted cells of designs that were deformed without a server."""

import os
from typing import Any, List, Optional

import numpy as np

from . import _deformd
from .errors import InvalidArgument
from .geometry import Geometry
from .meshes import mesh_from


class FaceCheck:
    """Finds the faces of a mesh that a design folded over: those whose normals turned by more than 90 degrees relative to their neighbourhood, as
    the server counts them (`report.faces.flipped`).

    mesh: a path, a Geometry that this client registered, or what `Client.register` takes; its points are those at rest. Raises
    InvalidArgument where it has no faces. Immutable; any thread may use it, and calls give the GIL back.
    """

    def __init__(self, mesh: Any) -> None:
        self._native = _deformd.FaceCheck(_mesh(mesh))

    @property
    def points(self) -> int:
        """The number of points of the mesh."""
        return self._native.points

    @property
    def faces(self) -> int:
        """The number of faces of the mesh."""
        return self._native.faces

    def flipped(self, points: Any, *, threads: int = 1) -> "List[Optional[int]]":
        """The number of flipped faces of each design; None where points are not finite. points: (n, 3), or (m, n, 3) of float64 or float32."""
        from .compiled import _thread_count

        array = np.asarray(points)
        array = np.ascontiguousarray(array, dtype=np.float32 if array.dtype == np.float32 else np.float64)
        if array.shape[-2:] != (self.points, 3) or array.ndim not in (2, 3):
            raise InvalidArgument(f"points: an array of shape {array.shape}, expected ({self.points}, 3) or (m, {self.points}, 3)")
        return self._native.flipped(array, _thread_count(threads))

    def __repr__(self) -> str:
        return f"<FaceCheck: {self.points} points, {self.faces} faces>"


class CellCheck:
    """Finds the cells of a volume mesh, or of a mesh of triangles and quads in a plane z = constant, that a design turned inside out, as the server counts
    them (`report.cells.inverted`). Those that are inverted at rest are left out. There is no safe amplitude: only the design itself is looked at.

    mesh: a path, a Geometry that this client registered, or what `Client.register` takes; its points are those at rest. Raises
    InvalidArgument where it has no cells. Immutable; any thread may use it, and calls give the GIL back.
    """

    def __init__(self, mesh: Any) -> None:
        self._native = _deformd.CellCheck(_mesh(mesh))

    @property
    def points(self) -> int:
        """The number of points of the mesh."""
        return self._native.points

    @property
    def cells(self) -> int:
        """The number of cells of the mesh."""
        return self._native.cells

    def inverted(self, points: Any, *, threads: int = 1) -> int:
        """The number of inverted cells of a design: points (n, 3). Raises InvalidArgument for points that are not finite, and of a mesh in a plane
        for points that left it."""
        from .compiled import _thread_count

        return self._native.inverted(np.asarray(points, dtype=np.float64), _thread_count(threads))

    def __repr__(self) -> str:
        return f"<CellCheck: {self.points} points, {self.cells} cells>"


def _mesh(mesh: Any) -> "_deformd.Mesh":
    from .client import _isolated_reader

    if isinstance(mesh, Geometry):
        return mesh._need_mesh("faces")
    if isinstance(mesh, _deformd.Mesh):
        return mesh
    if isinstance(mesh, (str, os.PathLike)):
        return _deformd.Mesh.read(os.fspath(mesh), _isolated_reader(), _deformd.Limits())
    return mesh_from(mesh)
