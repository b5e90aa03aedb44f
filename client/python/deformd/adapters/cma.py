# SPDX-License-Identifier: Apache-2.0
"""pycma on deformed points."""

from typing import Any, List, Optional, Sequence

import numpy as np

from ..system import System
from . import Objective, ScipyObjective


class CmaObjective(ScipyObjective):
    """An objective of the deformed points for ask and tell.

        f = CmaObjective(system, objective)
        strategy = cma.CMAEvolutionStrategy(x0, sigma0, {"bounds": f.cma_bounds})
        while not strategy.stop():
            designs = strategy.ask()
            strategy.tell(designs, f(designs))

    Called with a list of m designs, as `ask` gives them, it evaluates them in one batch and gives a list of m numbers; with one design, a
    number, as cma.fmin2 takes it. Values are handed on as the objective gave them. Penalty, Unusable and options are those of ScipyObjective.
    """

    def __init__(self, system: System, objective: Objective, *, penalty: float = 1e30, **options: Any) -> None:
        super().__init__(system, objective, penalty=penalty, **options)

    @property
    def cma_bounds(self) -> List[List[Optional[float]]]:
        """Lower and upper bounds, as pycma takes them; None where there is none."""
        return [[float(value) if np.isfinite(value) else None for value in side] for side in self.system.bounds.T]

    def __call__(self, x: Sequence[Any]) -> Any:
        if np.ndim(x[0]) == 0:
            return super().__call__(np.asarray(x, dtype=np.float64))
        return super().__call__(np.asarray(x, dtype=np.float64).T).tolist()
