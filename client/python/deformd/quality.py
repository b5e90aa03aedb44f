# SPDX-License-Identifier: Apache-2.0
"""The quality of deformed meshes, by the names of `deform quality` and of --fail-on.

    quality = deformd.Quality(system.geometry)                  # once
    quality(points)                                             # everything, {"scaled_jacobian": 0.83, ...}
    quality.values(points, ["scaled_jacobian", "aspect_ratio"])

Which names there are depends on the mesh: `quality.names`. docs/command-line.md (deform quality) says what they mean.
"""

import math
import os
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _deformd
from .errors import FailedPrecondition, InvalidArgument, NumericalFailure
from .faces import _mesh
from .reports import CompiledReport, Report
from .system import System

STEP = 1e-4
"""The step of differences, in parts of the bounds: rounding of the points is far below, and the curvature of a measure above it."""
_BATCH = 2**26
"""Bytes of points that differences have in memory at a time."""


class Row(NamedTuple):
    """A row of the table of `deform quality`."""

    name: str
    label: str
    """For people."""
    value: float
    id: Optional[int]
    """The id of the point, face, cell or element with this value; None of sums, averages and counts."""
    in_table: bool
    """Whether `deform quality` prints it; the others are in its JSON only."""


class Quality:
    """Measures designs of a mesh, as `deform quality` measures files: of OpenFOAM and polyhedral cells what checkMesh measures, of elements scaled
    Jacobians, aspect ratios and volumes, of surfaces quality and angles of faces and curvature; of all the flipped faces and the largest displacement.

    mesh: a path, a Geometry that this client registered, or what `Client.register` takes; its points are those at rest.
    walls: names of groups of boundary faces of a volume mesh, whose first layer of cells is measured as well (`wall_height`, `wall_angle`).

    Raises InvalidArgument for a mesh without faces and cells, and for walls that are none. Lengths are in model units, angles in degrees. Computed
    here, without the server. Immutable; any thread may use it, and calls give the GIL back. Results have the same bits for any number of threads.
    One of a path can be pickled, which reads the file again where it arrives.
    """

    def __init__(self, mesh: Any, *, walls: Union[str, Sequence[str]] = ()) -> None:
        self._walls = [walls] if isinstance(walls, str) else list(walls)
        self._path = os.path.abspath(os.fspath(mesh)) if isinstance(mesh, (str, os.PathLike)) else None
        self._native = _deformd.QualityCheck(_mesh(mesh), self._walls)

    @property
    def names(self) -> Tuple[str, ...]:
        """The names of the measures of this mesh."""
        return tuple(name for name, _ in self._native.names)

    def check(self, name: str) -> None:
        """Raises InvalidArgument where this mesh has no such measure, with those that are near."""
        self._native.check(name)

    def __call__(self, points: Any, *, threads: int = 1) -> Dict[str, float]:
        """All measures of a design by name. points: (n, 3), model units. What is infinite or no number is so: the aspect ratio of an inverted
        element, for instance."""
        return {row.name: row.value for row in self.rows(points, threads=threads)}

    def rows(self, points: Any, *, threads: int = 1) -> List[Row]:
        """The same with labels and places, as tables show them."""
        from .compiled import _thread_count

        return [Row(*row) for row in self._native.rows(np.asarray(points, dtype=np.float64), _thread_count(threads))]

    def values(self, points: Any, names: Sequence[str], report: Any = None, *, threads: int = 1) -> Dict[str, float]:
        """Some measures of a design by name, in the order of `names`.

        report: that on the design; then names may also be those of --fail-on of commands that deform: safe_amplitude, least_determinant,
          max_displacement, relative_error, .... What it has is not measured once more.
        Raises InvalidArgument for names that there are not, with suggestions.
        """
        from .compiled import _thread_count

        found = {name: report_measure(name, report) for name in names}
        wanted = [name for name, value in found.items() if value is None]
        if wanted:
            found.update(zip(wanted, self._native.values(np.asarray(points, dtype=np.float64), wanted, _thread_count(threads))))
        return {name: float(value) for name, value in found.items() if value is not None}

    def __reduce__(self) -> Any:
        if self._path is None:
            raise FailedPrecondition("a Quality of arrays or a geometry cannot be pickled; make it of the path of a mesh file")
        return _quality_of, (self._path, self._walls)

    def __repr__(self) -> str:
        return f"<Quality: {self._native.points} points, {len(self.names)} measures>"


def _quality_of(path: str, walls: List[str]) -> Quality:
    return Quality(path, walls=walls)


class QualityConstraints:
    """Limits of measures, for adapters: `QualityConstraints(quality, {"scaled_jacobian": {"min": 0.1}, "non_orthogonality": {"max": 70}})`.

    quality: a Quality. limits: name -> {"min": number}, {"max": number} or both; names are those of `Quality.values` with a report.
    Raises InvalidArgument for what is wrong in them, with suggestions for names.
    """

    def __init__(self, quality: Quality, limits: Mapping[str, Mapping[str, float]]) -> None:
        self.quality = quality
        self.limits = checked_limits("constraints", limits)
        """(name, "min" or "max", limit) each."""
        self.names = list(dict.fromkeys(name for name, _, _ in self.limits))
        for name in self.names:
            if name not in REPORT_MEASURES:
                quality.check(name)

    def violations(self, points: Any, report: Any = None, *, threads: int = 1) -> np.ndarray:
        """How much each value is beyond its limit, in parts of the limit (as it is where that is 0); negative within. In the order of `limits`."""
        values = self.quality.values(points, self.names, report, threads=threads)
        return np.array([violation(values[name], side, limit) for name, side, limit in self.limits])

    def gradients(self, system: Any, x: Any) -> np.ndarray:
        """The derivatives of the violations by the variables, (limits, k), by differences. Raises InvalidArgument for limits of counts."""
        slopes = differences(system, x, self.quality, self.names)
        return np.array([(1 if side == "max" else -1) * slopes[name] / (abs(limit) or 1.0) for name, side, limit in self.limits])


_QUALITY_NAMES = dict(_deformd.quality_names())
REPORT_MEASURES = dict(_deformd.design_measures())
"""What reports on designs have for gates and constraints: name -> whether it counts."""
NAMES = {**_QUALITY_NAMES, **REPORT_MEASURES}
"""All measures that some mesh or report has: name -> whether it counts something, so that it has no slope."""


def report_measure(name: str, report: Any) -> Optional[float]:
    """A measure that --fail-on takes from the report on a design; None where the report does not have it."""
    if report is None or name not in REPORT_MEASURES or report.error is not None:
        return None
    if isinstance(report, Report):
        record = report._record
        return None if record is None else _deformd.design_measure(name, record)
    value = getattr(report, name, None) if isinstance(report, CompiledReport) else None
    return None if value is None else float(value)


def check_name(what: str, name: Any) -> str:
    """Refuses names that no mesh has. Raises InvalidArgument, with suggestions."""
    if name not in NAMES:
        near = _deformd.nearest_names(str(name), list(NAMES))
        raise InvalidArgument(f"{what}: there is no measure {name!r}; {f'did you mean {near}?' if near else 'there are ' + ', '.join(NAMES)}")
    return str(name)


def checked_limits(what: str, value: Any) -> Tuple[Tuple[str, str, float], ...]:
    """{"a": {"min": 1, "max": 2}} as (name, "min" or "max", limit) each. Raises InvalidArgument, which names the key."""
    if not isinstance(value, Mapping):
        raise InvalidArgument(f"{what}: expected names with min, max or both")
    found = []
    for name, limits in value.items():
        if not isinstance(limits, Mapping) or not limits:
            raise InvalidArgument(f"{what}.{name}: expected min, max or both")
        for side, limit in limits.items():
            if side not in ("min", "max"):
                raise InvalidArgument(f"{what}.{name}: {side!r}, expected one of min, max")
            if isinstance(limit, bool) or not isinstance(limit, (int, float)):
                raise InvalidArgument(f"{what}.{name}.{side}: {limit!r}, expected a number")
            found.append((str(name), str(side), float(limit)))
    return tuple(found)


def violation(value: float, side: str, limit: float) -> float:
    """How much a value is beyond its limit, in parts of the limit (as it is where that is 0); negative within."""
    return (value - limit if side == "max" else limit - value) / (abs(limit) or 1.0)


def differences(system: Any, x: Any, quality: Quality, names: Sequence[str], *, step: float = STEP) -> Dict[str, np.ndarray]:
    """Derivatives of measures with respect to the variables, (k,) by name: central differences, one-sided at bounds, of two designs per variable,
    which are deformed and measured but not evaluated further.

    system: a System or CompiledDeformation. x: (k,). step: in parts of the bounds. Measures are extremes over the mesh, so they have kinks where
    another face or cell becomes the worst; there the slope is one in between. Raises InvalidArgument for counts, which have none;
    NumericalFailure where a design beside x cannot be evaluated.
    """
    for name in names:
        if NAMES.get(name, False):
            raise InvalidArgument(f"{name}: it is a number of faces, cells or the like, which has no slope")
    at = np.asarray(x, dtype=np.float64)
    low, high = system.bounds.T
    width = np.where(np.isfinite(high - low), high - low, np.maximum(1.0, np.abs(at)))
    before, after = np.maximum(low, at - step * width), np.minimum(high, at + step * width)
    free = np.flatnonzero(after > before)
    slopes = {name: np.zeros(len(at)) for name in names}
    options = {"encoding": "RAW_F64"} if isinstance(system, System) else {}  # without the tolerance of others
    count = max(1, _BATCH // (48 * quality._native.points))
    for first in range(0, len(free), count):
        some = free[first:first + count]
        designs = np.repeat(at[None], 2 * len(some), axis=0)
        designs[range(0, len(designs), 2), some], designs[range(1, len(designs), 2), some] = before[some], after[some]
        population = system.deform(designs, **options)
        lost = next((report for report in population.reports if report.error is not None), None)
        if lost is not None:
            raise NumericalFailure(f"{names[0]}: no differences, since a design beside this one cannot be evaluated: {lost.error}")
        values = [quality.values(points, names, report) for points, report in zip(population.points, population.reports)]
        for i, variable in enumerate(some):
            for name in names:
                rise = values[2 * i + 1][name] - values[2 * i][name]
                if not math.isfinite(rise):
                    raise NumericalFailure(f"{name}: no differences, since it is not finite beside this design")
                slopes[name][variable] = rise / (after[variable] - before[variable])
    return slopes
