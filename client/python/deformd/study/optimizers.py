# SPDX-License-Identifier: Apache-2.0
"""Optimizers of libraries on the designs of a study."""

from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple

import numpy as np

from ..errors import InvalidArgument
from ..penalty import Penalty
from ..quality import NAMES
from .spec import Spec

if TYPE_CHECKING:
    from .driver import Study

_WITH_GRADIENTS = ("BFGS", "L-BFGS-B", "SLSQP", "TNC", "CG", "trust-constr")
_WITH_CONSTRAINTS = ("SLSQP", "COBYLA")
_NLOPT_ENDS = {1: "success", 2: "the value to stop at is reached", 3: "ftol is reached", 4: "xtol is reached", 5: "the most evaluations", 6: "the longest time"}
FIRST_STEP = 0.25
"""The first step of searches along gradients, in parts of the bounds."""


def gradients_of(spec: Spec) -> List[str]:
    """The values whose gradients the optimizer of a study takes. Raises InvalidArgument for one that has none."""
    if spec.optimizer is None:
        return []
    name, options = spec.optimizer
    method = _method(name, options)
    if not (name == "scipy" and method in _WITH_GRADIENTS or name == "nlopt" and method.startswith("LD_")):
        return []
    names = list(dict.fromkeys([each for each, _ in spec.objectives] + [each for each, _, _ in spec.constraints]))
    for each in names:
        if each in spec.evaluate.get("quality", ()) and NAMES[each]:
            raise InvalidArgument(f"{each}: it is a number of faces, cells or the like, which has no slope, and {method} follows slopes; "
                                  "cma, nsga2, COBYLA of scipy and LN_COBYLA of nlopt take it")
    return names


def skipping(spec: Spec) -> List[Tuple[str, str, float]]:
    """The constraints on quality outside of which a design need not be evaluated: of optimizers that only rank such designs. All of them."""
    if spec.optimizer is None or spec.optimizer[0] not in ("cma", "nsga2"):
        return []
    return [each for each in spec.constraints if each[0] in spec.evaluate.get("quality", ())]


def _method(name: str, options: Dict[str, Any]) -> str:
    return str(options.get("method", {"scipy": "L-BFGS-B", "nlopt": "LD_LBFGS"}.get(name, "")))


def run(study: "Study") -> str:
    """Runs the optimizer until it or the budget ends (BudgetSpent). Returns why it ended, in the words of its library."""
    assert study.spec.optimizer is not None
    name, options = study.spec.optimizer
    if not np.isfinite(study.bounds).all():
        raise InvalidArgument(f"optimizer.{name}: needs finite bounds of all variables")
    return {"cma": _cma, "nsga2": _nsga2, "scipy": _scipy, "nlopt": _nlopt}[name](study, dict(options))


def _start(study: "Study", options: Dict[str, Any]) -> np.ndarray:
    """The values of the key start, by name, in model units; the rest position within the bounds unless given."""
    given = options.pop("start", {})
    if not isinstance(given, dict) or any(name not in study.names for name in given):
        raise InvalidArgument(f"optimizer.start: {given!r}, expected values by name, of {', '.join(study.names)}")
    start = np.array([float(given.get(name, 0)) for name in study.names])
    return np.clip(start, *study.bounds.T)


def _cma(study: "Study", options: Dict[str, Any]) -> str:
    import cma

    from .driver import FAILED, failed

    # In the unit cube, since the lengths of variables differ.
    low, high = study.bounds.T
    span = np.where(high > low, high - low, 1.0)
    start = (_start(study, options) - low) / span
    sigma = float(options.pop("sigma", 0.25))
    given = {"bounds": [0, 1], "seed": study.spec.seed or 2**31, "verbose": -9, "verb_filenameprefix": str(study.spec.folder / "cma-"), **options}
    strategy = cma.CMAEvolutionStrategy(start.tolist(), sigma, given)
    while not strategy.stop():
        asked = strategy.ask()
        records = study.designs([low + np.asarray(u) * (high - low) for u in asked])
        # Designs that failed differ by how far they are from the start, where the mesh is as it was: equal values would end the search as a flat function.
        strategy.tell(asked, [FAILED * (1 + float(np.linalg.norm(np.asarray(u) - start))) if failed(record) else study.value(record)
                              for u, record in zip(asked, records)])
    return "CMA-ES: " + ", ".join(f"{key} {value}" for key, value in strategy.stop().items())


def _nsga2(study: "Study", options: Dict[str, Any]) -> str:
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize

    from .driver import FAILED, failed

    generations = options.pop("generations", 10**9)
    low, high = study.bounds.T
    count = len(study.spec.objectives)

    class StudyProblem(Problem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(n_var=len(low), n_obj=count, n_ieq_constr=1 + len(study.spec.constraints), xl=low, xu=high)

        def _evaluate(self, x: np.ndarray, out: Any, *_: Any, **__: Any) -> None:
            records = study.designs(x)
            out["F"] = np.array([[FAILED if failed(each) else study.objective(each, i) for i in range(count)] for each in records])
            out["G"] = np.array([[1e10 if failed(each) else -1.0, *([0.0] * len(study.spec.constraints) if failed(each) else study.violations(each))]
                                 for each in records])

    minimize(StudyProblem(), NSGA2(**options), ("n_gen", generations), seed=study.spec.seed)
    return f"NSGA-II: {generations} generations"


class _Smooth:
    """Objective and constraints of one design with their gradients, for methods that take one design at a time. Places are in the unit cube of the
    bounds, since the lengths of variables differ. The objective is 0 at the start, where its gradient has the length FIRST_STEP: that is how far
    methods without a better idea go at first, in parts of the cube. Without gradients it is in parts of what it is at the start."""

    def __init__(self, study: "Study", start: np.ndarray, gradients: bool) -> None:
        from .driver import failed

        self.study = study
        low, high = study.bounds.T
        self._low, self._span = low, high - low
        self._rest = start
        self.start = (start - low) / np.where(self._span > 0, self._span, 1.0)
        self._penalty = Penalty(np.ones(len(start)))
        self._usable: Optional[Tuple[np.ndarray, Dict[str, Any]]] = None  # the last design that could be used
        self._zero, self._unit = 0.0, 1.0
        first = self._record(self.start)
        if failed(first) and not gradients:
            return
        if failed(first):
            raise InvalidArgument(f"optimizer.start: design 0 is {first['verdict']} ({'; '.join(first['reasons'])[:200]}); a search along gradients "
                                  "needs a start that can be used")
        self._zero = study.objective(first)
        slope = float(np.linalg.norm(self._slope(first, study.spec.objectives[0][0]))) if gradients else 0.0
        self._unit = slope / FIRST_STEP if slope > 1e-12 * abs(self._zero) else abs(self._zero) or 1.0
        self.objective(self.start)

    def objective(self, u: np.ndarray) -> Tuple[float, np.ndarray]:
        from .driver import FAILED, failed

        record = self._record(u)
        if failed(record):
            return self._penalty.at(u) or (FAILED, np.zeros(len(u)))
        name, sign = self.study.spec.objectives[0]
        value, gradient = (self.study.objective(record) - self._zero) / self._unit, sign * self._slope(record, name) / self._unit
        self._penalty.usable(u, value, gradient)
        self._usable = (np.array(u), record)
        return value, gradient

    def constraint(self, number: int, u: np.ndarray) -> Tuple[float, np.ndarray]:
        """Its violation, negative within. Where a design failed, what the last one that did not lets expect."""
        from .driver import failed

        record = self._record(u)
        if failed(record) and self._usable is None:
            return 1e10, np.zeros(len(u))
        place, known = self._usable if failed(record) and self._usable is not None else (u, record)
        name, side, limit = self.study.spec.constraints[number]
        slope = self._slope(known, name) / (abs(limit) or 1.0) * (1 if side == "max" else -1)
        return self.study.violations(known)[number] + float(slope @ (u - place)), slope

    def _record(self, u: np.ndarray) -> Dict[str, Any]:
        u = np.clip(u, 0, 1)
        # The start itself, without the rounding of the way there and back.
        return self.study.designs([np.where(u == self.start, self._rest, np.clip(self._low + u * self._span, *self.study.bounds.T))])[0]

    def _slope(self, record: Dict[str, Any], name: str) -> np.ndarray:
        return np.array(record.get("gradients", {}).get(name, np.zeros(len(self._low)))) * self._span


def _scipy(study: "Study", options: Dict[str, Any]) -> str:
    from scipy.optimize import minimize

    start, method = _start(study, options), _method("scipy", options)
    options.pop("method", None)
    gradients = method in _WITH_GRADIENTS
    if study.spec.constraints and method not in _WITH_CONSTRAINTS:
        raise InvalidArgument(f"optimizer.scipy.method: {method} takes no constraints; {' and '.join(_WITH_CONSTRAINTS)} do")
    smooth = _Smooth(study, start, gradients)
    constraints = []
    for i in range(len(study.spec.constraints)):
        each = {"type": "ineq", "fun": lambda u, i=i: -smooth.constraint(i, u)[0]}
        if gradients:
            each["jac"] = lambda u, i=i: -smooth.constraint(i, u)[1]
        constraints.append(each)
    if method == "SLSQP":
        options.setdefault("ftol", 1e-9)  # it is also what constraints are met to
    bounded = {} if method in ("BFGS", "CG") else {"bounds": [(0.0, 1.0)] * len(start)}
    found = minimize(smooth.objective if gradients else lambda u: smooth.objective(u)[0], smooth.start, jac=True if gradients else None, method=method,
                     constraints=constraints, options=options, **bounded)
    return f"{method} of SciPy: {found.message}"


def _nlopt(study: "Study", options: Dict[str, Any]) -> str:
    import nlopt

    start, method = _start(study, options), _method("nlopt", options)
    options.pop("method", None)
    if not hasattr(nlopt, method):
        raise InvalidArgument(f"optimizer.nlopt.method: NLopt has no {method}")
    tolerance = float(options.pop("xtol_rel", 1e-6))
    if options:
        raise InvalidArgument(f"optimizer.nlopt: unknown options {', '.join(options)}; method, start and xtol_rel are known")
    optimizer = nlopt.opt(getattr(nlopt, method), len(start))
    smooth = _Smooth(study, start, method.startswith("LD_"))
    nlopt.srand(study.spec.seed)

    def into(pair: Tuple[float, np.ndarray], gradient: np.ndarray) -> float:
        if gradient.size:
            gradient[:] = pair[1]
        return pair[0]

    optimizer.set_lower_bounds(np.zeros(len(start)))
    optimizer.set_upper_bounds(np.ones(len(start)))
    optimizer.set_min_objective(lambda u, gradient: into(smooth.objective(u), gradient))
    for i in range(len(study.spec.constraints)):
        optimizer.add_inequality_constraint(lambda u, gradient, i=i: into(smooth.constraint(i, u), gradient), 1e-8)
    optimizer.set_xtol_rel(tolerance)
    try:
        optimizer.optimize(smooth.start)
    except nlopt.RoundoffLimited:
        return f"{method} of NLopt: limited by rounding"
    return f"{method} of NLopt: {_NLOPT_ENDS.get(optimizer.last_optimize_result(), optimizer.last_optimize_result())}"
