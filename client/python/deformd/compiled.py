# SPDX-License-Identifier: Apache-2.0
"""Compiled deformations: designs become points without a server."""

import os
from typing import TYPE_CHECKING, Any, List, Optional, Tuple, Union

import numpy as np

from . import _deformd
from .designs import DesignSpace, Variable
from .errors import Error, InvalidArgument
from .faces import FaceCheck
from .reports import CompiledReport, Deformation, Population, check_bad, raise_or_warn

if TYPE_CHECKING:
    from typing import Literal

    from .designs import Design, Designs

    Bad = Literal["raise", "warn", "keep"]

_MOST_THREADS = 1024
_SHARED = 15
"""Designs that `report` evaluates at once: they share a pass over the basis, and their points are in memory."""
_MAGIC = b"\x89DEFORM\n"


class CompiledDeformation(DesignSpace):
    """What a system computes without its solver: rest points, basis and design variables. `System.local` and `deformd.load` make it.

    Takes designs as a `System` does, and gives the points that the server computes from its basis, without a server: the same bits where
    the server's processor fuses products with sums (any with AVX2) and the setup has no basis_tolerance, else within 1e-14 of the
    diagonal. Immutable; any thread may use it, and calls give the GIL back. It can be pickled, and survives os.fork().

    Below k is the number of design variables, n the number of points, m a number of designs. dtype is np.float64 or np.float32,
    which is the former rounded once. threads: that a call takes, at most 1024; 0: all cores. Results have the same bits for any number.
    """

    def __init__(self, native: "_deformd.Compiled") -> None:
        super().__init__(Variable(*variable) for variable in native.variables)
        self._native = native

    @property
    def system_id(self) -> str:
        """The id of the system that was compiled, 64 hexadecimal digits."""
        return self._native.system_id

    @property
    def geometry_id(self) -> str:
        """The id of its geometry, 64 hexadecimal digits."""
        return self._native.geometry_id

    @property
    def mesh(self) -> str:
        """The name of its geometry, mostly that of a mesh file; may be empty."""
        return self._native.mesh

    @property
    def method(self) -> str:
        """As in a setup: "rbf"."""
        return self._native.method

    @property
    def notes(self) -> Tuple[str, ...]:
        """The notes on the system, one sentence each, for people."""
        return tuple(self._native.notes)

    @property
    def diagonal(self) -> float:
        """The diagonal of the bounding box of the mesh, model units."""
        return self._native.diagonal

    @property
    def rest(self) -> np.ndarray:
        """The points as registered, (n, 3) of float64, model units; cannot be written to."""
        return self._native.rest

    # ---- points ----

    def __call__(
        self,
        x: "Union[Design, Designs]",
        *,
        out: Optional[np.ndarray] = None,
        dtype: Any = None,
        threads: int = 1,
        bad: "Bad" = "raise",
    ) -> np.ndarray:
        """Points of a design, (n, 3), or of many, (m, n, 3); registered order, model units, C order.

        Many designs share passes over the basis. out: an array of that shape in C order, which is filled and returned; dtype is its type,
        else np.float64 unless given. bad: what happens where a design cannot be evaluated or its error is too large, as calling a `System`
        has it: a single design raises its own error, many a BadDesign, which carries all points and reports. With "keep" no reports are
        made, which takes about half of the time.
        """
        check_bad(bad)
        if bad == "keep":
            designs, single = self._designs(x)
            points = self._target(designs, single, out, dtype)
            try:
                self._native.evaluate(designs, points, _thread_count(threads))
            except InvalidArgument:  # of one of them
                return self.deform(designs[0] if single else designs, out=points, threads=threads).points
            return points
        deformation = self.deform(x, out=out, dtype=dtype, threads=threads)
        raise_or_warn(deformation, bad)
        return deformation.points

    def deform(
        self,
        x: "Union[Design, Designs]",
        *,
        out: Optional[np.ndarray] = None,
        dtype: Any = None,
        threads: int = 1,
        faces: Optional[FaceCheck] = None,
    ) -> Union[Deformation, Population]:
        """Points and report of a design, or points and reports of many; never raises for a single bad design.

        A design that cannot be evaluated has NaN for points and `report.error`, an InvalidArgument that names variable and bounds. The
        reports are `CompiledReport`s. faces: looks for flipped faces, `report.flipped_faces`; a `CellCheck` looks at cells. Raises
        InvalidArgument where its mesh has another number of points.
        """
        designs, single = self._designs(x)
        self._check_faces(faces)
        points = self._target(designs, single, out, dtype)
        reports = self._deform(designs, points, threads, faces)
        return Deformation(points, reports[0]) if single else Population(points, reports)

    def report(
        self, x: "Union[Design, Designs]", *, threads: int = 1, faces: Optional[FaceCheck] = None
    ) -> "Union[CompiledReport, List[CompiledReport]]":
        """What is known of a design, or of many: estimated error, largest displacement, their ratio, and the number of flipped faces
        where `faces` looks for them. The points of a few designs are in memory, however many there are; `deform` gives them."""
        designs, single = self._designs(x)
        self._check_faces(faces)
        points = np.empty((min(len(designs), _SHARED), len(self.rest), 3))
        reports: List[CompiledReport] = []
        for first in range(0, len(designs), _SHARED):
            some = designs[first:first + _SHARED]
            reports += self._deform(some, points[:len(some)], threads, faces)
        return reports[0] if single else reports

    def _deform(self, designs: np.ndarray, points: np.ndarray, threads: int, faces: Optional[FaceCheck]) -> List[CompiledReport]:
        found = self._native.deform(designs, points, _thread_count(threads))
        counts = [None] * len(found) if faces is None else faces.flipped(points.reshape(-1, len(self.rest), 3), threads=threads)
        return [self._report(one, count) for one, count in zip(found, counts)]

    def _check_faces(self, faces: Optional[FaceCheck]) -> None:
        if faces is not None and faces.points != len(self.rest):
            raise InvalidArgument(f"faces: a mesh of {faces.points} points, the deformation has {len(self.rest)}")

    # ---- derivatives ----

    def jvp(self, x: "Optional[Design]", v: "Design", *, out: Optional[np.ndarray] = None, dtype: Any = None, threads: int = 1) -> np.ndarray:
        """The derivative of the points with respect to the variables, at x, times the direction v (k,): (n, 3), model units per
        unit of v. x None: at rest. out, dtype: as for points."""
        vectors = _target((len(self.rest), 3), out, dtype)
        self._native.jacobian_vector(self._design(x), self._design(v), vectors, _thread_count(threads))
        return vectors

    def vjp(self, x: "Optional[Design]", w: Any, *, threads: int = 1) -> np.ndarray:
        """The gradient (k,) of sum(w * points) with respect to the variables, at x, in float64; w (n, 3) is the gradient of an objective
        with respect to the points. x None: at rest."""
        cotangent = np.asarray(w)
        cotangent = np.ascontiguousarray(cotangent, dtype=np.float32 if cotangent.dtype == np.float32 else np.float64)
        if cotangent.shape != self.rest.shape:
            raise InvalidArgument(f"cotangent: an array of shape {cotangent.shape}, expected {self.rest.shape}")
        return self._native.vector_jacobian(self._design(x), cotangent, _thread_count(threads))

    def jacobian(self, x: "Optional[Design]" = None, *, threads: int = 1) -> np.ndarray:
        """The derivative of the points with respect to the variables, at x: (n, 3, k), by k calls of `jvp`."""
        columns = np.empty((len(self.rest), 3, len(self.variables)))
        vectors = np.empty((len(self.rest), 3))
        for i, direction in enumerate(np.eye(len(self.variables))):
            columns[:, :, i] = self.jvp(x, direction, out=vectors, threads=threads)
        return columns

    # ---- the file ----

    def save(self, path: "Union[str, os.PathLike[str]]") -> None:
        """Writes the file that `deform apply` and `deformd.load` read (docs/compiled.md). It replaces one of this name when it is complete;
        until then it grows beside it, under the name with .part. Raises InvalidArgument where the name is that of another file."""
        target = os.fspath(path)
        if os.path.isfile(target) and not _is_compiled(target):
            raise InvalidArgument(f"path: {target} exists and is no compiled deformation; it is not replaced, name another file")
        part = target + ".part"
        try:
            with open(part, "wb") as file:
                self._native.write(file.write)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, target)
        except BaseException:
            if os.path.exists(part):
                os.remove(part)
            raise

    def _target(self, designs: np.ndarray, single: bool, out: Optional[np.ndarray], dtype: Any) -> np.ndarray:
        return _target((len(self.rest), 3) if single else (len(designs), len(self.rest), 3), out, dtype)

    def _report(self, found: Any, flipped: Optional[int]) -> CompiledReport:
        if isinstance(found, Error):
            return CompiledReport(error=found)
        *numbers, across, doubts = found
        return CompiledReport(*numbers, diagonal=self._native.judged_by, flipped_faces=flipped, doubts=doubts, points_across_symmetry=across)

    def __repr__(self) -> str:
        return f"<CompiledDeformation of {self.system_id[:8]}: {len(self.rest)} points, variables {', '.join(self.names)}>"

    def __reduce__(self) -> Any:
        return _restore, (self._native.to_bytes(),)


def load(path: "Union[str, os.PathLike[str]]") -> CompiledDeformation:
    """Reads a compiled deformation, from `deform compile` or `CompiledDeformation.save`. Everything is checked: raises DataLoss for files
    that are none or are damaged, with the place, FailedPrecondition for a layout of another version, NotFound where there is no such
    file."""
    return CompiledDeformation(_deformd.Compiled.load(os.fspath(path)))


def _is_compiled(path: str) -> bool:
    with open(path, "rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


def _restore(content: bytes) -> CompiledDeformation:
    return CompiledDeformation(_deformd.Compiled.parse(content))


def _thread_count(threads: int) -> int:
    if isinstance(threads, bool) or not isinstance(threads, (int, np.integer)) or not 0 <= threads <= _MOST_THREADS:
        raise InvalidArgument(f"threads: {threads!r}, expected 0 (all cores) to {_MOST_THREADS}")
    return int(threads)


def _target(shape: Tuple[int, ...], out: Optional[np.ndarray], dtype: Any) -> np.ndarray:
    """`out`, or a new array, for what a call gives."""
    kind = None if dtype is None else np.dtype(dtype)
    if kind not in (None, np.float64, np.float32):
        raise InvalidArgument(f"dtype: {kind}, expected float64 or float32")
    if out is None:
        return np.empty(shape, dtype=kind or np.float64)
    kinds = (np.float64, np.float32) if kind is None else (kind,)
    if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype not in kinds or not out.flags.c_contiguous or not out.flags.writeable:
        raise InvalidArgument(f"out: expected a writeable array of shape {shape}, {' or '.join(np.dtype(one).name for one in kinds)} in C order")
    return out
