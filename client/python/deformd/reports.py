# SPDX-License-Identifier: Apache-2.0
"""What is said about a design: by the server, or by a compiled deformation."""

import math
import warnings
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _deformd
from .errors import BadDesign, BadDesignWarning, Error, InvalidArgument

_VERDICTS = {"VERDICT_GOOD": "good", "VERDICT_DOUBTFUL": "doubtful", "VERDICT_BAD": "bad"}

# The limits of the verdict of the server: fractions of the largest displacement, and of the diagonal (of that of most points where some have strayed).
_BAD_ERROR = 1e-3
_LEAST_MOTION = 1e-4  # of D: errors of smaller motions are judged as if they were so large
_NEGLIGIBLE_ERROR = 1e-12
_OUT_OF_REACH = 1e12


class Report:
    """The report on one design: verdict, errors, faces, cells.

    Besides the properties below every field of DesignResult (proto/deform/v1/deformation.proto) is an attribute:
    `report.max_displacement`, `report.faces.flipped`, `report.cells.safe_amplitude`. Lengths are in model units. Reports that do not
    apply are None. Immutable.
    """

    __slots__ = ("_record", "_error")

    def __init__(self, record: "Optional[_deformd.Record]", error: Optional[Error] = None) -> None:
        self._record = record
        self._error = error

    @property
    def error(self) -> Optional[Error]:
        """Why there is no deformation, as an exception that was not raised; then there are no other fields. Else None."""
        return self._error

    @property
    def verdict(self) -> str:
        """"good", "doubtful", "bad", or "unknown" where nothing was judged. "bad" where there is an error."""
        if self._record is None:
            return "bad"
        return _VERDICTS.get(self._record.verdict, "unknown")

    @property
    def bad(self) -> bool:
        """The design must not be used: its verdict is bad, or it has an error."""
        return self.verdict == "bad"

    @property
    def reasons(self) -> Tuple[str, ...]:
        """The reasons of a verdict that is not good, or the error: one sentence each, for people; those for the worst verdict first."""
        if self._record is None:
            return (str(self._error),)
        return tuple(self._record.reasons)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if self._record is None:
            raise AttributeError(f"this design has no {name}, it could not be evaluated: {self._error}")
        return getattr(self._record, name)

    def to_dict(self) -> Dict[str, Any]:
        """Everything, as plain Python values."""
        if self._record is not None:
            return {**self._record.to_dict(), "verdict": self.verdict, "error": None}
        error = self._error
        assert error is not None
        return {"verdict": self.verdict, "reasons": list(self.reasons), "error": {"code": error.code, "message": error.message, "field": error.field}}

    def __dir__(self) -> List[str]:
        return sorted({"error", "verdict", "bad", "reasons", "to_dict", *(dir(self._record) if self._record is not None else ())})

    def __repr__(self) -> str:
        reasons = "; ".join(self.reasons)
        return f"<Report: {self.verdict}{': ' if reasons else ''}{reasons}>"

    def __reduce__(self) -> Any:
        return Report, (self._record, self._error)


class CompiledReport:
    """The report on one design of a compiled deformation, which knows the solver's part, and the flipped faces where a FaceCheck looked for
    them: no cells. Lengths are in model units. All but the error is NaN, None or False where there is one. Immutable."""

    __slots__ = ("_numbers", "_diagonal", "_error", "_flipped_faces", "_doubts", "_across")

    def __init__(self, *numbers: float, diagonal: float = 0.0, error: Optional[Error] = None, flipped_faces: Optional[int] = None,
                 doubts: Tuple[str, ...] = (), points_across_symmetry: Optional[int] = None) -> None:
        self._numbers = numbers or (math.nan, math.nan, math.nan, math.nan, False)
        self._diagonal = diagonal
        self._error = error
        self._flipped_faces = flipped_faces
        self._doubts = tuple(doubts)
        self._across = points_across_symmetry

    @property
    def estimated_error(self) -> float:
        """Estimated largest distance of a point from its position in the exact solution of the equations of the method; at least half of
        the true value. That of float32 is not counted."""
        return float(self._numbers[0])

    @property
    def max_displacement(self) -> float:
        """The largest displacement of a point."""
        return float(self._numbers[1])

    @property
    def prescribed_displacement(self) -> float:
        """The largest displacement that a handle prescribes."""
        return float(self._numbers[2])

    @property
    def interpolation_residual(self) -> float:
        """Bound of the error at handle and fixed points."""
        return float(self._numbers[3])

    @property
    def converged(self) -> bool:
        """The solver reached its tolerance."""
        return bool(self._numbers[4])

    @property
    def flipped_faces(self) -> Optional[int]:
        """The number of faces that are folded over, which the server calls doubtful; None where that was not checked."""
        return self._flipped_faces

    @property
    def points_across_symmetry(self) -> Optional[int]:
        """The number of points of a half model that crossed a symmetry plane, which the server calls doubtful: the whole model runs through
        itself. 0 without planes."""
        return self._across

    @property
    def doubts(self) -> Tuple[str, ...]:
        """What handles are mirrored or flattened by their motion, and that points of the model have strayed, which the server calls
        doubtful; one sentence each."""
        return self._doubts

    @property
    def relative_error(self) -> float:
        """estimated_error / max_displacement; 0 if nothing moves."""
        return self.estimated_error / self.max_displacement if self.max_displacement != 0 else 0.0

    @property
    def error(self) -> Optional[Error]:
        """Why there is no deformation, as an exception that was not raised. Else None."""
        return self._error

    @property
    def reasons(self) -> Tuple[str, ...]:
        """Why the design must not be used: the error, or what is wrong with the solution; one sentence each. Empty where it may be."""
        if self._error is not None:
            return (str(self._error),)
        if not math.isfinite(self.max_displacement) or not math.isfinite(self.estimated_error):
            return ("points are not finite",)
        reasons = []
        if not self.converged:
            reasons.append(f"the solver did not reach its tolerance: the estimated error is {self.estimated_error:.3g}")
        motion = max(self.max_displacement, _LEAST_MOTION * self._diagonal)
        if self.estimated_error > max(_BAD_ERROR * motion, _NEGLIGIBLE_ERROR * self._diagonal):
            reasons.append(f"the estimated error is {self.estimated_error:.3g}, {self.relative_error:.3g} of the largest displacement")
        farthest = max(self.max_displacement, self.prescribed_displacement)
        if self._diagonal > 0 and farthest / self._diagonal > _OUT_OF_REACH:
            reasons.append(f"points move by up to {farthest / self._diagonal:.3g} times the diagonal of the model, where the rounding of coordinates "
                           "destroys its shape; are the variables in its units?")
        return tuple(reasons)

    @property
    def bad(self) -> bool:
        """The design must not be used: it has an error, or the server would call its solution bad."""
        return bool(self.reasons)

    def to_dict(self) -> Dict[str, Any]:
        """Everything, as plain Python values."""
        if self._error is not None:
            error = self._error
            return {"reasons": list(self.reasons), "error": {"code": error.code, "message": error.message, "field": error.field}}
        names = ("estimated_error", "max_displacement", "prescribed_displacement", "interpolation_residual", "converged", "relative_error",
                 "flipped_faces", "points_across_symmetry")
        return {**{name: getattr(self, name) for name in names}, "doubts": list(self.doubts), "reasons": list(self.reasons), "error": None}

    def __repr__(self) -> str:
        return f"<CompiledReport: {'; '.join(self.reasons) or f'estimated error {self.estimated_error:.3g}'}>"

    def __reduce__(self) -> Any:
        return _compiled_report, (self._numbers, self._diagonal, self._error, self._flipped_faces, self._doubts, self._across)


def _compiled_report(numbers: Tuple[float, ...], diagonal: float, error: Optional[Error], flipped_faces: Optional[int] = None,
                     doubts: Tuple[str, ...] = (), across: Optional[int] = None) -> CompiledReport:
    return CompiledReport(*numbers, diagonal=diagonal, error=error, flipped_faces=flipped_faces, doubts=doubts, points_across_symmetry=across)


class Deformation(NamedTuple):
    """One design: `points` (n, 3) in registered order, model units, NaN where there is an error; and its `report`."""

    points: np.ndarray
    report: Union[Report, CompiledReport]


class Evaluation(NamedTuple):
    """One design at other points: `points` (n, 3), model units; and its `report`, whose attributes are the fields of EvaluateResult
    (proto/deform/v1/deformation.proto): `max_displacement`, `estimated_error`, which holds where the geometry has points, `still`,
    `reduction_error`, `converged`, `doubts`, `warnings`."""

    points: np.ndarray
    report: "_deformd.Record"


class Population(NamedTuple):
    """Many designs: `points` (m, n, 3), NaN for designs with an error; and one report per design."""

    points: np.ndarray
    reports: Sequence[Union[Report, CompiledReport]]

    @property
    def usable(self) -> np.ndarray:
        """Which designs may be used: (m,) of bool, False where the verdict is bad."""
        return np.array([not report.bad for report in self.reports], dtype=bool)


def _reasons_of_bad(report: Union[Report, CompiledReport]) -> Sequence[str]:
    """Those for which it is bad, without those that would have made it doubtful; all of a server that does not tell them apart."""
    deciding = 0 if isinstance(report, CompiledReport) or report.error is not None else int(getattr(report, "reasons_of_verdict", 0))
    return report.reasons[:deciding] if deciding > 0 else report.reasons


def check_bad(bad: str) -> None:
    """Refuses values of the argument `bad` that there are not."""
    if bad not in ("raise", "warn", "keep"):
        raise InvalidArgument(f'bad: {bad!r}, expected "raise", "warn" or "keep"')


def raise_or_warn(deformation: Union[Deformation, Population], bad: str) -> None:
    """Raises or warns where something is bad."""
    if isinstance(deformation, Deformation):
        report = deformation.report
        if report.error is not None and bad == "raise":
            raise report.error
        wrong = [("design", report)] if report.bad else []
    else:
        wrong = [(f"designs[{i}]", report) for i, report in enumerate(deformation.reports) if report.bad]
    if not wrong:
        return
    first = next((report.error for _, report in wrong if report.error is not None), None)
    texts = [f"{name}: {'; '.join(_reasons_of_bad(report)) or 'the verdict is bad'}" for name, report in wrong[:3]]
    message = (f"{len(wrong)} bad designs: " if len(wrong) > 1 else "") + ". ".join(texts) + (f", and {len(wrong) - 3} more" if len(wrong) > 3 else "")
    if bad == "warn":
        warnings.warn(message, BadDesignWarning, stacklevel=3)
        return
    raise BadDesign(message, deformation, wrong[0][0]) from first
