# SPDX-License-Identifier: Apache-2.0
"""What the server says about a design."""

from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from . import _deformd
from .errors import Error

_VERDICTS = {"VERDICT_GOOD": "good", "VERDICT_DOUBTFUL": "doubtful", "VERDICT_BAD": "bad"}


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
        """Of a verdict that is not good, or the error: one sentence each, for people; those for the worst verdict first."""
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
        told = "; ".join(self.reasons)
        return f"<Report: {self.verdict}{': ' if told else ''}{told}>"

    def __reduce__(self) -> Any:
        return Report, (self._record, self._error)


class Deformation(NamedTuple):
    """One design: `points` (n, 3) in registered order, model units, NaN where there is an error; and its `report`."""

    points: np.ndarray
    report: Report


class Population(NamedTuple):
    """Many designs: `points` (m, n, 3), NaN for designs with an error; and one report per design."""

    points: np.ndarray
    reports: List[Report]

    @property
    def usable(self) -> np.ndarray:
        """Which designs may be used: (m,) of bool, False where the verdict is bad."""
        return np.array([not report.bad for report in self.reports], dtype=bool)
