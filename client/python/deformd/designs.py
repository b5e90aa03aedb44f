# SPDX-License-Identifier: Apache-2.0
"""Design variables, and what stands for their values."""

from typing import TYPE_CHECKING, Any, Iterable, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _deformd
from .errors import InvalidArgument

if TYPE_CHECKING:
    Design = Union[float, Sequence[float], np.ndarray, Mapping[str, float]]
    Designs = Union[np.ndarray, Sequence[Union[Sequence[float], np.ndarray, Mapping[str, float]]]]


class Variable(NamedTuple):
    """A design variable of a setup."""

    name: str
    handle: str
    """The name of the handle that it moves."""
    lower: float
    """-inf where there is no bound."""
    upper: float


class DesignSpace:
    """The design variables of a system, in order."""

    variables: Tuple[Variable, ...]

    def __init__(self, variables: Iterable[Variable]) -> None:
        self.variables = tuple(variables)

    @property
    def names(self) -> Tuple[str, ...]:
        """The names of the design variables, in the order of the setup."""
        return tuple(variable.name for variable in self.variables)

    @property
    def bounds(self) -> np.ndarray:
        """Lower and upper bounds of the design variables, (k, 2); infinite where there is none."""
        return np.array([(variable.lower, variable.upper) for variable in self.variables], dtype=np.float64).reshape(-1, 2)

    def _design(self, x: "Optional[Design]") -> np.ndarray:
        if x is None:
            return np.zeros(len(self.variables))
        rows, single = self._designs(x)
        if not single:
            raise InvalidArgument(f"design: shape {rows.shape}, expected ({len(self.variables)},)")
        return rows[0]

    def _designs(self, x: Any) -> Tuple[np.ndarray, bool]:
        """Rows of values (m, k), and whether x was one design."""
        if x is None:
            return np.zeros((1, len(self.variables))), True
        if isinstance(x, Mapping):
            return self._named(x, "design")[None, :], True
        if isinstance(x, (int, float)) or getattr(x, "ndim", None) == 0:  # of one variable its value alone, as minimize_scalar has it
            x = [x]
        if not isinstance(x, np.ndarray) and any(isinstance(row, Mapping) for row in x):
            rows = [self._named(row, f"designs[{i}]") if isinstance(row, Mapping) else np.asarray(row, dtype=np.float64) for i, row in enumerate(x)]
            for i, row in enumerate(rows):
                self._check_width(row.shape, f"designs[{i}].variables")
            return np.array(rows), False
        values = np.asarray(x, dtype=np.float64)
        if values.ndim not in (1, 2):
            raise InvalidArgument(f"designs: an array of shape {values.shape}, expected ({len(self.variables)},) or (m, {len(self.variables)})")
        self._check_width(values.shape[-1:], "designs")
        return (values[None, :], True) if values.ndim == 1 else (values, False)

    def _check_width(self, shape: Tuple[int, ...], what: str) -> None:
        if shape != (len(self.variables),):
            raise InvalidArgument(f"{what}: {shape[0] if shape else 'no'} values, the setup has {len(self.variables)} variables: {', '.join(self.names)}")

    def _named(self, values: Mapping[str, float], what: str) -> np.ndarray:
        row = np.zeros(len(self.variables))
        places = {name: i for i, name in enumerate(self.names)}
        for name, value in values.items():
            if name not in places:
                near = _deformd.nearest_names(str(name), list(self.names))
                raise InvalidArgument(f'{what}: there is no variable "{name}"' + (f"; did you mean {near}?" if near else f", only {', '.join(self.names)}"))
            row[places[name]] = value
        return row
