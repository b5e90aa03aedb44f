# SPDX-License-Identifier: Apache-2.0
"""Numbers of the shape of a mesh with their gradients at its points, and the Sobolev filter of node-wise fields.

    volume = deformd.measures.Volume(geometry)       # once
    value, gradient = volume(points)                 # for many designs: a float and (n, 3)
    slope = system.vjp(x, gradient)                  # the gradient at the design variables, (k,)

Meshes are a `Geometry` that this process registered, the path of a mesh file, or what `Client.register` takes as arrays or objects. Points are
(n, 3), model units. Everything runs here, without the server, and gives the GIL back; any thread may use a measure. Results have the same
bits for any number of `threads` (0: all cores). docs/measures.md has the formulas.
"""

import os
from typing import Any, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _deformd
from .compiled import _thread_count
from .errors import InvalidArgument
from .geometry import Geometry
from .meshes import mesh_from

Names = Union[str, Sequence[str]]


class Measured(NamedTuple):
    """A value and its gradient."""

    value: Any
    """A float; of `CentreOfGravity` an array (3,)."""
    gradient: np.ndarray
    """Its derivatives at the points, (n, 3); of `CentreOfGravity` (3, n, 3)."""


class Least(NamedTuple):
    """The true minimum of the samples behind an aggregated value, and where it is."""

    value: float
    """Model units. The aggregated value lies between this minus `tolerance` and this."""
    at: Tuple[float, float, float]
    """The place of the sample."""
    index: int
    """For `Thickness` the id of its face, for `Clearance` that of its point."""
    tolerance: float
    samples: int
    """How many have a value."""
    covering: float
    """For `Clearance`: no place of the faces is farther than this from a sample, so the faces themselves keep at least `value` minus this. 0 of
    `Thickness`."""


class Measure:
    """What all measures have; use one of the classes below."""

    def __init__(self, native: "_deformd.Measure") -> None:
        self._native = native

    def __call__(self, points: Any, *, threads: int = 1) -> Measured:
        """Value and gradient of a design: points (n, 3), model units."""
        values, gradients, _ = self._evaluate(points, True, threads)
        return Measured(values[0], gradients[0])

    def value(self, points: Any, *, threads: int = 1) -> Any:
        """The value alone, which takes less time."""
        return self._evaluate(points, False, threads)[0][0]

    def _evaluate(self, points: Any, gradients: bool, threads: int) -> Tuple[List[float], List[np.ndarray], Any]:
        return self._native.evaluate(np.asarray(points, dtype=np.float64), gradients, _thread_count(threads))


class Volume(Measure):
    """The enclosed volume, model units cubed; of faces whose normals point inwards as well.

    groups: names of groups of faces that enclose it; all faces unless given. of: "faces", or "cells" for the volume of all cells of a volume
    mesh. rims: "refuse" raises InvalidArgument where the faces are not closed, "close" closes each rim with triangles to the mean of its points.
    """

    def __init__(self, mesh: Any, *, groups: Names = (), of: str = "faces", rims: str = "refuse") -> None:
        super().__init__(_deformd.Measure.volume(_mesh(mesh), _names("groups", groups), str(of), str(rims)))


class CentreOfGravity(Measure):
    """The centre of gravity of the enclosed body, of uniform density: value (3,), model units, gradient (3, n, 3). Options are those of `Volume`."""

    def __init__(self, mesh: Any, *, groups: Names = (), of: str = "faces", rims: str = "refuse") -> None:
        super().__init__(_deformd.Measure.centre_of_gravity(_mesh(mesh), _names("groups", groups), str(of), str(rims)))

    def __call__(self, points: Any, *, threads: int = 1) -> Measured:
        values, gradients, _ = self._evaluate(points, True, threads)
        return Measured(np.array(values), np.array(gradients))

    def value(self, points: Any, *, threads: int = 1) -> np.ndarray:
        """The value alone, (3,)."""
        return np.array(self._evaluate(points, False, threads)[0])


class Area(Measure):
    """The area of the faces, or of those of `groups`; of="cells": of the outer faces of all cells. Model units squared."""

    def __init__(self, mesh: Any, *, groups: Names = (), of: str = "faces") -> None:
        super().__init__(_deformd.Measure.area(_mesh(mesh), _names("groups", groups), str(of)))


class ProjectedArea(Measure):
    """Half the sum of the areas of the faces in the plane across `direction`: "x", "y", "z" or a vector (3,) of any length.

    Of a convex body that is the area of its shadow; of others it counts what is hidden as well, and of an open sheet it is half of its shadow.
    Model units squared.
    """

    def __init__(self, mesh: Any, direction: Any, *, groups: Names = (), of: str = "faces") -> None:
        super().__init__(_deformd.Measure.projected_area(_mesh(mesh), _names("groups", groups), str(of), axis_vector("direction", direction)))


class _Aggregated(Measure):
    def least(self, points: Any, *, threads: int = 1) -> Least:
        """The true minimum behind the value, and where it is."""
        return Least(*self._evaluate(points, False, threads)[2])

    def value_and_least(self, points: Any, *, threads: int = 1) -> Tuple[float, Least]:
        """The value alone, and the true minimum."""
        values, _, least = self._evaluate(points, False, threads)
        return values[0], Least(*least)

    def with_least(self, points: Any, *, threads: int = 1) -> Tuple[Measured, Least]:
        """Value, gradient and the true minimum, of one evaluation."""
        values, gradients, least = self._evaluate(points, True, threads)
        return Measured(values[0], gradients[0]), Least(*least)


class Thickness(_Aggregated):
    """The least thickness of a body, model units, as a differentiable minimum over the centroids of its triangles.

    groups, of, rims: the body, as `Volume` has them. at: names of groups of faces where it is measured; all of the body unless given.
    method: "rays", along inward normals to where they leave the body, or "spheres", the diameter of the largest sphere inside that touches the
    face and no opposing one. tolerance: the value is at most this below the true minimum, and never above it; 5 % of the least
    thickness of the mesh as it is, unless given. opposing_degrees: of spheres, how much the normal of the other side may differ from the inward one.
    """

    def __init__(self, mesh: Any, *, groups: Names = (), of: str = "faces", rims: str = "refuse", at: Names = (), method: str = "rays",
                 tolerance: Optional[float] = None, opposing_degrees: float = 60) -> None:
        super().__init__(_deformd.Measure.thickness(_mesh(mesh), _names("groups", groups), str(of), str(rims), _names("at", at), str(method),
                                                    _tolerance(tolerance), float(opposing_degrees)))


class Clearance(_Aggregated):
    """The least signed distance of the points of faces to a keep-out, model units, negative inside, as a differentiable minimum.

    keep_out: a box (min (3,), max (3,)), or a closed mesh: its path, a `Geometry`, (points, faces). It does not move with the design. groups: the
    faces whose points keep out; all faces unless given. tolerance: the value is at most this below the true minimum, and never above it; 1e-3
    of the diagonal of the mesh unless given. Faces may come nearer between their points: `least(points).covering` says by how much at most.
    """

    def __init__(self, mesh: Any, keep_out: Any, *, groups: Names = (), of: str = "faces", tolerance: Optional[float] = None) -> None:
        box = _box(keep_out)
        names, limit = _names("groups", groups), _tolerance(tolerance)
        if box is not None:
            native = _deformd.Measure.clearance_of_box(_mesh(mesh), names, str(of), *box, limit)
        else:
            native = _deformd.Measure.clearance_of_mesh(_mesh(mesh), names, str(of), _mesh(keep_out), limit)
        super().__init__(native)


class SobolevFilter:
    """Smooths node-wise fields on a surface: (M + length^2 K) g = M f, with the areas M of the points and the cotangent Laplacian -K.

    points: (n, 3), the shape on which it is done; those of the mesh unless given. length: model units; a point is spread over a distance of about that.
    groups, of: the surface. tolerance: of the residual of the solver, relative to the right side; iterations: most of them per component.

    Fields are (n,) or (n, components), such as (n, 3); calls give a `Filtered`. Points that are not of the surface keep their values, or get 0 from
    `gradient`.
    """

    def __init__(self, mesh: Any, length: float, points: Any = None, *, groups: Names = (), of: str = "faces", tolerance: float = 1e-10,
                 iterations: int = 10000) -> None:
        native = _mesh(mesh)
        shape = native.points if points is None else np.asarray(points, dtype=np.float64)
        self._native = _deformd.SobolevFilter(native, shape, float(length), _names("groups", groups), str(of), float(tolerance), int(iterations))

    @property
    def areas(self) -> np.ndarray:
        """M, the areas of the points, (n,), model units squared; 0 off the surface. Points with the same coordinates are one, and have the sum."""
        return self._native.areas

    def __call__(self, f: Any, *, threads: int = 1) -> "Filtered":
        """A smooth field of the same unit: f is a density, a value per area at each point, such as a surface sensitivity."""
        return self._apply(f, "density", threads)

    def gradient(self, s: Any, *, threads: int = 1) -> "Filtered":
        """The H1 gradient, per area, of an objective whose derivatives at the points are s, as measures and adjoint solvers on nodes give them.
        Symmetric."""
        return self._apply(s, "derivative", threads)

    def transposed(self, w: Any, *, threads: int = 1) -> "Filtered":
        """The transpose of calling the filter, for chain rules: sum(w * filter(f)) = sum(filter.transposed(w) * f)."""
        return self._apply(w, "transposed", threads)

    def _apply(self, field: Any, form: str, threads: int) -> "Filtered":
        return Filtered(*self._native.apply(np.asarray(field, dtype=np.float64), form, _thread_count(threads)))


class Filtered(NamedTuple):
    """A filtered field and how well its equations were solved."""

    field: np.ndarray
    """The filtered field, of the shape of the given one."""
    residual: float
    """|b - A g| / |b|, measured; the largest of all components."""
    iterations: int
    """The sum over all components."""
    converged: bool


def axis_vector(what: str, direction: Any) -> List[float]:
    """The unit vector of "x", "y" or "z", or three numbers as they are. Raises InvalidArgument naming `what`."""
    if isinstance(direction, str):
        if direction not in ("x", "y", "z"):
            raise InvalidArgument(f"{what}: {direction!r}, expected one of x, y, z, or a vector of three numbers")
        return [float(direction == axis) for axis in "xyz"]
    return _vector(what, direction)


def _vector(what: str, value: Any) -> List[float]:
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,):
        raise InvalidArgument(f"{what}: {value!r}, expected three numbers")
    return [float(each) for each in vector]


def _box(keep_out: Any) -> Optional[Tuple[List[float], List[float]]]:
    """A box is a pair of vectors; a pair of an (n, 3) array and faces is a mesh."""
    if not isinstance(keep_out, (tuple, list)) or len(keep_out) != 2 or np.ndim(keep_out[0]) != 1:
        return None
    return _vector("keep_out.min", keep_out[0]), _vector("keep_out.max", keep_out[1])


def _names(what: str, names: Names) -> List[str]:
    found = [names] if isinstance(names, str) else list(names)
    if not all(isinstance(name, str) for name in found):
        raise InvalidArgument(f"{what}: {names!r}, expected the name of a group of faces, or a list of names")
    return found


def _tolerance(tolerance: Optional[float]) -> float:
    if tolerance is None:
        return 0.0
    if not tolerance > 0:
        raise InvalidArgument(f"tolerance: {tolerance!r}, expected a length over 0")
    return float(tolerance)


def _mesh(source: Any) -> "_deformd.Mesh":
    if isinstance(source, _deformd.Mesh):
        return source
    if isinstance(source, Geometry):
        return source._need_mesh("faces")
    if isinstance(source, (str, os.PathLike)):
        from .client import _isolated_reader

        return _deformd.Mesh.read(os.fspath(source), _isolated_reader(), _deformd.Limits())
    return mesh_from(source)


__all__ = ["Area", "CentreOfGravity", "Clearance", "Filtered", "Least", "Measure", "Measured", "ProjectedArea", "SobolevFilter", "Thickness", "Volume"]
