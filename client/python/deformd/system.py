# SPDX-License-Identifier: Apache-2.0
"""Prepared systems: where designs become points."""

import json
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from . import _deformd, forks
from .compiled import CompiledDeformation
from .designs import DesignSpace, Variable
from .errors import InvalidArgument
from .reports import Deformation, Evaluation, Population, Report, check_bad, raise_or_warn

if TYPE_CHECKING:
    from typing import Literal

    from .client import Client
    from .designs import Design, Designs
    from .geometry import Geometry

    Bad = Literal["raise", "warn", "keep"]

_BATCH_BYTES = 64 << 20  # of the points of one request
_REQUESTS = 2  # at a time: one is computed while the other travels
_WRITTEN_TOLERANCE = 1e-9  # of D, as the command line has it


class System(DesignSpace):
    """A geometry with a setup, prepared on the server. `Client.prepare` and `Client.system` make it. Any thread may use it.

    Below k is the number of design variables, n the number of points, m a number of designs. A design x is an array of k values
    in the order of `names`, or a mapping of names to values in which the others are 0, the rest position. Values outside of the
    bounds are errors of their designs.

    Calling it gives points: `s(x)` -> (n, 3), `s(X)` -> (m, n, 3). `deform` gives reports as well, and `stream` gives designs as
    they get done.
    """

    def __init__(self, client: "Client", info: "_deformd.Record", geometry: "Optional[Geometry]" = None) -> None:
        self._client = client
        self._geometry = geometry
        self.info = info
        """What was prepared, from what and how: SystemInfo of proto/deform/v1/deformation.proto."""
        infinity = float("inf")
        super().__init__(
            Variable(v.name, v.handle, -infinity if v.lower is None else v.lower, infinity if v.upper is None else v.upper)
            for v in info.setup.variables)

    @property
    def id(self) -> str:
        """64 hexadecimal digits, the hash of geometry and setup."""
        return str(self.info.id)

    @property
    def geometry(self) -> "Geometry":
        """What is deformed."""
        if self._geometry is None:
            self._geometry = self._client.geometry(self.info.geometry_id)
        return self._geometry

    # ---- points ----

    def __call__(self, x: "Union[Design, Designs]", *, out: Optional[np.ndarray] = None, bad: "Bad" = "raise", **options: Any) -> np.ndarray:
        """Points of a design, (n, 3), or of many, (m, n, 3); registered order, model units, float64 in C order.

        out: an array of that shape, float64 in C order, which is filled and returned.
        bad: what happens where a verdict is bad or a design cannot be evaluated. "raise": BadDesign, which carries all points and
          reports, once everything is done; a single design that cannot be evaluated raises its own error. "warn": a
          BadDesignWarning. "keep": nothing. Designs that cannot be evaluated are NaN. An optimizer that wants to rank such
          designs last takes `deform` instead, which gives the reports.
        options: those of `deform`.
        """
        check_bad(bad)
        deformation = self.deform(x, out=out, **options)
        if bad != "keep":
            raise_or_warn(deformation, bad)
        return deformation.points

    def deform(
        self,
        x: "Union[Design, Designs]",
        *,
        out: Optional[np.ndarray] = None,
        motions: Optional[Union[Mapping[str, Any], Sequence[Mapping[str, Any]]]] = None,
        timeout: Optional[float] = None,
        cancel: "Optional[_deformd.Cancel]" = None,
        **options: Any,
    ) -> Union[Deformation, Population]:
        """Points and report of a design, or points and reports of many; never raises for a single bad design.

        Of one design a Deformation: points (n, 3) and its report. Of X (m, k), or a list of m designs, a Population: points
        (m, n, 3) and m reports. A design that cannot be evaluated has NaN for points and `report.error`. Many designs go in
        requests of up to 64 MiB of points, two at a time.

        motions: per handle name an affine map x' = A x + b as a 3 x 4 array [A b], or a displacement (p, 3) for every point of the
          handle, in the order of ascending ids, model units; a list of such mappings for many designs. For handles that no
          variable moves.
        timeout: seconds for the whole call, on this side and on the server. cancel: a `deformd.Cancel` that another thread may use.

        Options, as the fields of DeformRequest have them:
        encoding: "RAW_F64", "RAW_F32", "DRACO" or "DELTA_ZSTD"; that of the client unless given.
        tolerance: largest error of a coordinate with the last two, model units; 1e-9 of the diagonal unless given.
        check: "CELL_CHECK_OFF", "SAFE_AMPLITUDE" (default) or "CELL_QUALITY", what the report says about faces and cells.
        intersections: True looks for faces that run into each other, `report.faces.intersecting`; else that is None.
        path: "PATH_AUTOMATIC", "PATH_BASIS" or "PATH_DIRECT".
        splitting: a mode, "SPLIT_UNIFORM" or "SPLIT_ADAPTIVE", or a mapping such as {"mode": "SPLIT_ADAPTIVE", "share": 0.5}.
        solver_tolerance: of iterative solvers, a fraction of the diagonal.
        warm_start: of setups with constraints: each design starts from the one before; the requests then go one after the other.
        batch: designs of one request.
        """
        designs, single = self._designs(x)
        run, target = self._begin(designs, single, out, motions, timeout, cancel, options)
        reports: List[Optional[Report]] = [None] * len(designs)
        points: Optional[np.ndarray] = None
        try:
            run.wait()
            while True:
                item = run.next()
                if item is None:
                    break
                i, points, record, error = item
                reports[i] = Report(record, error)
                if error is not None and target is not None:
                    target[i] = np.nan
        finally:
            run.end()
        done = [report for report in reports if report is not None]
        if not single:
            assert target is not None
            return Population(target, done)
        if target is not None:
            points = out
        if points is None:
            points = np.full((self._point_count, 3), np.nan)
        return Deformation(points, done[0])

    def stream(
        self,
        designs: "Designs",
        *,
        motions: Optional[Sequence[Mapping[str, Any]]] = None,
        timeout: Optional[float] = None,
        cancel: "Optional[_deformd.Cancel]" = None,
        **options: Any,
    ) -> Iterator[Tuple[int, Optional[np.ndarray], Report]]:
        """Designs as they get done, in any order: (number, points (n, 3), report) of each.

        A design that cannot be evaluated has None for points and `report.error`. At most a few requests of designs are held at a time,
        however many there are; leaving the loop cancels the rest. Options are those of `deform`.
        """
        rows, single = self._designs(designs)
        if single:
            raise InvalidArgument("designs: one design, expected an array (m, k) or a list of designs; `deform` takes one")
        run, _ = self._begin(rows, True, None, motions, timeout, cancel, options)
        return self._results(run)

    @staticmethod
    def _results(run: "_deformd.Run") -> Iterator[Tuple[int, Optional[np.ndarray], Report]]:
        try:
            while True:
                item = run.next()
                if item is None:
                    return
                i, points, record, error = item
                yield i, points, Report(record, error)
        finally:
            run.end()

    # ---- other points ----

    def evaluate(
        self,
        points: Any,
        x: "Optional[Design]" = None,
        *,
        motions: Optional[Mapping[str, Any]] = None,
        encoding: Optional[str] = None,
        tolerance: Optional[float] = None,
        solver_tolerance: float = 0,
        timeout: Optional[float] = None,
        cancel: "Optional[_deformd.Cancel]" = None,
    ) -> Evaluation:
        """Where a design moves points that need not belong to the geometry: points (n, 3), model units, a second mesh or probes.

        The Evaluation has the moved points (n, 3), float64, and a report. At the coordinates of a point of the geometry they are those
        of `deform` with path "PATH_DIRECT". Points outside of a lattice stay, `report.still` counts them. Raises FailedPrecondition,
        with the reason, for methods that are defined at the points of their geometry only (shell), and InvalidArgument naming
        points[i] outside of a cage with GREEN coordinates.

        x, motions, encoding, tolerance, timeout and cancel are those of `deform`; x None: at rest but for the motions.
        solver_tolerance: of iterative solvers, a fraction of the diagonal; 0: that of the setup.
        """
        chosen = encoding or self._client.encoding
        if tolerance is None and chosen in ("DRACO", "DELTA_ZSTD"):
            tolerance = _WRITTEN_TOLERANCE * self.info.diagonal
        handles = [(str(handle), np.asarray(values, dtype=np.float64)) for handle, values in (motions or {}).items()]
        moved, report = self._client._native.evaluate(
            self.id, self._design(x), handles, np.asarray(points, dtype=np.float64), chosen, float(tolerance or 0), float(solver_tolerance),
            self._client._limits(timeout, cancel))
        return Evaluation(moved, report)

    # ---- derivatives ----

    def jvp(self, x: "Optional[Design]", v: "Design", *, timeout: Optional[float] = None, cancel: "Optional[_deformd.Cancel]" = None) -> np.ndarray:
        """The derivative of the points with respect to the variables, at x, times the direction v (k,): (n, 3), model units per
        unit of v. x None: at rest."""
        return self._client._native.jacobian_vector(self.id, self._design(x), self._design(v), self._client._limits(timeout, cancel))

    def vjp(self, x: "Optional[Design]", w: Any, *, timeout: Optional[float] = None, cancel: "Optional[_deformd.Cancel]" = None) -> np.ndarray:
        """The gradient (k,) of sum(w * points) with respect to the variables, at x; w (n, 3) is the gradient of an objective with
        respect to the points. Of many, W (m, n, 3), the gradients (m, k), with one solution of the adjoint equations for all of
        them; m is at most 1000. x None: at rest."""
        cotangent = np.asarray(w, dtype=np.float64)
        points = self._point_count
        if cotangent.ndim not in (2, 3) or cotangent.shape[-2:] != (points, 3):
            raise InvalidArgument(f"cotangent: an array of shape {cotangent.shape}, expected {(points, 3)}, or (m, {points}, 3) of many")
        native = self._client._native
        call = native.vector_jacobians if cotangent.ndim == 3 else native.vector_jacobian
        return call(self.id, self._design(x), cotangent, self._client._limits(timeout, cancel))

    def jacobian(self, x: "Optional[Design]" = None, *, timeout: Optional[float] = None, cancel: "Optional[_deformd.Cancel]" = None) -> np.ndarray:
        """The derivative of the points with respect to the variables, at x: (n, 3, k), by k calls of `jvp`."""
        columns = np.empty((self._point_count, 3, len(self.variables)))
        for i, direction in enumerate(np.eye(len(self.variables))):
            columns[:, :, i] = self.jvp(x, direction, timeout=timeout, cancel=cancel)
        return columns

    # ---- the rest ----

    def local(self, *, timeout: Optional[float] = None, cancel: "Optional[_deformd.Cancel]" = None) -> CompiledDeformation:
        """The compiled deformation of this system, which turns designs into points and derivatives without the server. Raises
        FailedPrecondition, with the reason, where a system has none: with constraints, without a basis or without design variables."""
        name = "" if self._geometry is None else self._geometry._name
        return CompiledDeformation(_deformd.compile(self._client._native, self.id, name, self._client._limits(timeout, cancel)))

    def release(self, *, forget: bool = False) -> None:
        """Gives the memory of the system on the server back; it is restored or prepared again when it is used. forget: deletes the
        stored setup as well, so that the id is unknown afterwards."""
        self._client._native.release(self.id, forget, self._client._limits(None, None))

    @property
    def _point_count(self) -> int:
        return int(self.info.points)

    def _begin(self, rows: np.ndarray, single: bool, out: Optional[np.ndarray], motions: Any, timeout: Optional[float],
               cancel: "Optional[_deformd.Cancel]", options: Dict[str, Any]) -> "Tuple[_deformd.Run, Optional[np.ndarray]]":
        batch = options.pop("batch", None)
        warm = bool(options.get("warm_start", False))
        if batch is None:
            batch = max(1, _BATCH_BYTES // (24 * max(1, self._point_count)))
            if len(rows) > 1:
                batch = min(batch, self._client._max_designs)
        target = None
        if out is not None:
            shape = (self._point_count, 3) if single else (len(rows), self._point_count, 3)
            if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype != np.float64 or not out.flags.c_contiguous:
                raise InvalidArgument(f"out: expected an array of shape {shape}, float64 in C order")
            target = out[None] if single else out
        elif not single:
            target = np.empty((len(rows), self._point_count, 3))
        handles = [] if motions is None else [motions] if isinstance(motions, Mapping) else list(motions)
        pairs = [[(str(handle), np.asarray(values, dtype=np.float64)) for handle, values in one.items()] for one in handles]
        run = _deformd.deform(self._client._native, json.dumps(self._request(options)), rows, pairs, (int(batch), 1 if warm else _REQUESTS),
                              target, self._client._limits(timeout, cancel))
        return run, target

    def _request(self, options: Dict[str, Any]) -> Dict[str, Any]:
        """The fields of DeformRequest, but for the designs."""
        request: Dict[str, Any] = {"system_id": self.id}
        given = {name: value for name, value in options.items() if value is not None}
        encoding = given.pop("encoding", None) or self._client.encoding
        tolerance = given.pop("tolerance", None)
        if tolerance is None and encoding in ("DRACO", "DELTA_ZSTD"):
            tolerance = _WRITTEN_TOLERANCE * self.info.diagonal
        request["output"] = {"encoding": encoding, "tolerance": float(tolerance or 0)}
        splitting = given.pop("splitting", None)
        if splitting is not None:
            request["splitting"] = {"mode": splitting} if isinstance(splitting, str) else dict(splitting)
        for name in ("check", "intersections", "path", "solver_tolerance", "warm_start"):
            if name in given:
                request[name] = given.pop(name)
        if given:
            raise TypeError(f"unknown options: {', '.join(sorted(given))}")
        return request

    def __repr__(self) -> str:
        return f"<System {self.id[:8]}: {self._point_count} points, variables {', '.join(self.names)}>"

    def __reduce__(self) -> Any:
        return _restore, (self._client, self.id)


def _restore(client: "Client", id: str) -> "Union[System, forks.Unconnected]":
    return forks.Unconnected() if forks.unconnectable() else client.system(id)
