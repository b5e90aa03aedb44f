# SPDX-License-Identifier: Apache-2.0
"""Registered geometries."""

import os
from typing import TYPE_CHECKING, Any, Dict, Optional, Tuple, Union

import numpy as np

from . import _deformd
from .errors import FailedPrecondition

if TYPE_CHECKING:
    from .client import Client


class Geometry:
    """A mesh that the server knows. `Client.register` and `Client.geometry` make it. Any thread may use it."""

    def __init__(self, client: "Client", info: "_deformd.Record", mesh: "Optional[_deformd.Mesh]", name: str = "") -> None:
        self._client = client
        self._mesh = mesh
        self._name = name  # that of this client, where another has registered the same content by another name before
        self.info = info
        """Counts, box and groups: GeometryInfo of proto/deform/v1/geometry.proto."""

    @property
    def id(self) -> str:
        """64 hexadecimal digits, the hash of the content: the same mesh has the same id everywhere."""
        return str(self.info.id)

    @property
    def points(self) -> np.ndarray:
        """The points as registered, (n, 3) of float64, model units; cannot be written to. Fetched once where it was not
        registered by this client."""
        if self._mesh is not None:
            return self._mesh.points
        return self._client._native.points(self.id, self._client._limits(None, None))

    @property
    def faces(self) -> "Tuple[np.ndarray, np.ndarray]":
        """(sizes, corners): the number of corners of each face, (f,), and the ids of all corners, one face after the other.
        Only of geometries that were registered by this client."""
        mesh = self._need_mesh("faces")
        return mesh.face_sizes, mesh.face_points

    @property
    def groups(self) -> Dict[str, "Tuple[np.ndarray, np.ndarray]"]:
        """The ids of the points and of the faces of each named group. Only of geometries that were registered by this client."""
        return self._need_mesh("groups").groups

    def write(self, path: Union[str, "os.PathLike[str]"], points: Any, *, overwrite_source: bool = False) -> None:
        """Writes the mesh with other coordinates: `points` (n, 3).

        Of a geometry that was read from a file this is that file with nothing but its coordinates changed (of STL also the
        facet normals), in its format; one from arrays becomes a new .obj or .stl. The file that was read is only replaced with
        `overwrite_source`. Raises InvalidArgument for a wrong number of points, and coordinates that are not finite.
        """
        mesh = self._need_mesh("file to write")
        replaced = mesh.replaced_by(path)
        if replaced is not None and not overwrite_source:
            raise FailedPrecondition(f"{os.fspath(path)}: would replace the mesh that was read, {replaced}; name another file, or "
                                     "give overwrite_source=True")
        mesh.write(path, np.asarray(points, dtype=np.float64))

    def delete(self, *, systems: bool = False) -> None:
        """Deletes it on the server. Raises FailedPrecondition while setups use it, unless these may go as well (`systems`)."""
        self._client._native.delete_geometry(self.id, systems, self._client._limits(None, None))

    def _need_mesh(self, what: str) -> "_deformd.Mesh":
        if self._mesh is None:
            raise FailedPrecondition(f"geometry {self.id[:8]}: no {what}, it was not registered by this client; register its mesh "
                                     "again, which sends nothing that the server has")
        return self._mesh

    def __repr__(self) -> str:
        return f"<Geometry {self.id[:8]}: {self.info.points} points>"
