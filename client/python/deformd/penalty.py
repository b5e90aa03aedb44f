# SPDX-License-Identifier: Apache-2.0
"""What line searches see of designs that must not be used."""

from typing import Optional, Tuple

import numpy as np


class Penalty:
    """A value for designs that must not be used: the least value so far and a slope away from its design, as steep as the objective was there or more.

    A line search that meets it comes back by a constant factor at a time. It would not from a huge constant, whose interpolation ends where the search
    began, as if that were the optimum. Nor is there a jump that an approximation of second derivatives would keep.

    scale: (k,) lengths by which the variables are compared. Not for several threads.
    """

    def __init__(self, scale: np.ndarray) -> None:
        self._scale = np.where(np.isfinite(scale) & (scale > 0), scale, 1.0)
        self._x: Optional[np.ndarray] = None  # the design of the least value
        self._least = np.inf
        self._most = -np.inf
        self._slope = 0.0  # of the objective there, per scale

    def usable(self, x: np.ndarray, value: float, gradient: Optional[np.ndarray] = None) -> None:
        """Takes the value of a design that may be used, and the gradient with respect to the variables, (k,), once it is known."""
        if self._x is None or value < self._least:
            self._x, self._least, self._slope = np.array(x, dtype=np.float64), value, 0.0
        self._most = max(self._most, value)
        if gradient is not None and np.array_equal(x, self._x):
            self._slope = float(np.linalg.norm(gradient * self._scale))

    def at(self, x: np.ndarray) -> Optional[Tuple[float, np.ndarray]]:
        """Value and gradient at a design that must not be used; None before any design could be used."""
        if self._x is None:
            return None
        away = (np.asarray(x, dtype=np.float64) - self._x) / self._scale
        distance = float(np.linalg.norm(away))
        slope = max(self._slope, self._most - self._least) or abs(self._least) or 1.0
        return self._least + slope * distance, slope * away / ((distance or 1.0) * self._scale)
