# SPDX-License-Identifier: Apache-2.0
"""pycma on deformed points."""

from typing import Any, List, Optional, Sequence

import numpy as np

from ..quality import QualityConstraints
from ..reports import Report
from ..system import System
from . import Objective, ScipyObjective, beyond_limits

OUTSIDE = 1e20
"""The least value of a design outside of its limits of quality."""


class CmaObjective(ScipyObjective):
    """An objective of the deformed points for ask and tell.

        f = CmaObjective(system, objective)
        strategy = cma.CMAEvolutionStrategy(x0, sigma0, {"bounds": f.cma_bounds})
        while not strategy.stop():
            designs = strategy.ask()
            strategy.tell(designs, f(designs))

    Called with a list of m designs, as `ask` gives them, it evaluates them in one batch and gives a list of m numbers; with one design, a
    number, as cma.fmin2 takes it. Values are handed on as the objective gave them. Penalty, Unusable and options are those of ScipyObjective.

    constraints: limits of quality. A design outside of them has the value 1e20 (1 + the sum of what is beyond them in parts of the limits), so that it
    ranks behind all that are within and before those that must not be used; the objective is not called for it.
    """

    def __init__(self, system: System, objective: Objective, *, penalty: float = 1e30, constraints: Optional[QualityConstraints] = None,
                 **options: Any) -> None:
        def within(points: np.ndarray, report: Report) -> float:
            beyond = float(np.maximum(beyond_limits(constraints, points, report), 0.0).sum())
            return OUTSIDE * (1.0 + min(beyond, 1e9)) if beyond > 0 else objective(points, report)

        super().__init__(system, objective if constraints is None else within, penalty=penalty, **options)

    @property
    def cma_bounds(self) -> List[List[Optional[float]]]:
        """Lower and upper bounds, as pycma takes them; None where there is none."""
        return [[float(value) if np.isfinite(value) else None for value in side] for side in self.system.bounds.T]

    def __call__(self, x: Sequence[Any]) -> Any:
        if np.ndim(x[0]) == 0:
            return super().__call__(np.asarray(x, dtype=np.float64))
        return super().__call__(np.asarray(x, dtype=np.float64).T).tolist()
