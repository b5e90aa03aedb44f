# SPDX-License-Identifier: Apache-2.0
"""Optimizers of libraries on the designs of a study."""

from typing import TYPE_CHECKING, Any, Dict, List, Tuple

import numpy as np

from ..errors import InvalidArgument
from .spec import Spec

if TYPE_CHECKING:
    from .driver import Study

_WITH_GRADIENTS = ("BFGS", "L-BFGS-B", "SLSQP", "TNC", "CG", "trust-constr")
_WITH_CONSTRAINTS = ("SLSQP", "COBYLA")


def gradients_of(spec: Spec) -> List[str]:
    """The values whose gradients the optimizer of a study takes."""
    if spec.optimizer is None:
        return []
    name, options = spec.optimizer
    method = _method(name, options)
    if not (name == "scipy" and method in _WITH_GRADIENTS or name == "nlopt" and method.startswith("LD_")):
        return []
    return list(dict.fromkeys([each for each, _ in spec.objectives] + [each for each, _, _ in spec.constraints]))


def _method(name: str, options: Dict[str, Any]) -> str:
    return str(options.get("method", {"scipy": "L-BFGS-B", "nlopt": "LD_LBFGS"}.get(name, "")))


def run(study: "Study") -> None:
    """Runs the optimizer until it or the budget ends (BudgetSpent)."""
    assert study.spec.optimizer is not None
    name, options = study.spec.optimizer
    if not np.isfinite(study.bounds).all():
        raise InvalidArgument(f"optimizer.{name}: needs finite bounds of all variables")
    {"cma": _cma, "nsga2": _nsga2, "scipy": _scipy, "nlopt": _nlopt}[name](study, dict(options))


def _start(study: "Study", options: Dict[str, Any]) -> np.ndarray:
    """Of the key start, by name, in model units; the rest position within the bounds unless given."""
    given = options.pop("start", {})
    if not isinstance(given, dict) or any(name not in study.names for name in given):
        raise InvalidArgument(f"optimizer.start: {given!r}, expected values by name, of {', '.join(study.names)}")
    start = np.array([float(given.get(name, 0)) for name in study.names])
    return np.clip(start, *study.bounds.T)


def _cma(study: "Study", options: Dict[str, Any]) -> None:
    import cma

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
        strategy.tell(asked, [study.value(record) for record in records])


def _nsga2(study: "Study", options: Dict[str, Any]) -> None:
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


class _Smooth:
    """Objective and constraints of one design with their gradients at the variables, for methods that take one design at a time."""

    def __init__(self, study: "Study") -> None:
        self.study = study

    def objective(self, x: np.ndarray) -> Tuple[float, np.ndarray]:
        from .driver import FAILED, failed

        record = self.study.designs([np.clip(x, *self.study.bounds.T)])[0]
        if failed(record):
            return FAILED, np.zeros(len(x))
        name, sign = self.study.spec.objectives[0]
        return self.study.objective(record), sign * np.array(record["gradients"].get(name, np.zeros(len(x))))

    def constraint(self, number: int, x: np.ndarray) -> Tuple[float, np.ndarray]:
        """Its violation, negative within."""
        from .driver import failed

        record = self.study.designs([np.clip(x, *self.study.bounds.T)])[0]
        if failed(record):
            return 1e10, np.zeros(len(x))
        name, side, limit = self.study.spec.constraints[number]
        slope = np.array(record["gradients"].get(name, np.zeros(len(x)))) / (abs(limit) or 1.0)
        return self.study.violations(record)[number], slope if side == "max" else -slope


def _scipy(study: "Study", options: Dict[str, Any]) -> None:
    from scipy.optimize import minimize

    start, method = _start(study, options), _method("scipy", options)
    options.pop("method", None)
    smooth = _Smooth(study)
    gradients = method in _WITH_GRADIENTS
    constraints = []
    if study.spec.constraints:
        if method not in _WITH_CONSTRAINTS:
            raise InvalidArgument(f"optimizer.scipy.method: {method} takes no constraints; {' and '.join(_WITH_CONSTRAINTS)} do")
        for i in range(len(study.spec.constraints)):
            each = {"type": "ineq", "fun": lambda x, i=i: -smooth.constraint(i, x)[0]}
            if gradients:
                each["jac"] = lambda x, i=i: -smooth.constraint(i, x)[1]
            constraints.append(each)
    bounded = {} if method in ("BFGS", "CG") else {"bounds": list(map(tuple, study.bounds))}
    minimize(smooth.objective if gradients else lambda x: smooth.objective(x)[0], start, jac=True if gradients else None, method=method,
             constraints=constraints, options=options, **bounded)


def _nlopt(study: "Study", options: Dict[str, Any]) -> None:
    import nlopt

    start, method = _start(study, options), _method("nlopt", options)
    options.pop("method", None)
    if not hasattr(nlopt, method):
        raise InvalidArgument(f"optimizer.nlopt.method: NLopt has no {method}")
    optimizer = nlopt.opt(getattr(nlopt, method), len(start))
    smooth = _Smooth(study)
    nlopt.srand(study.spec.seed)

    def into(pair: Tuple[float, np.ndarray], gradient: np.ndarray) -> float:
        if gradient.size:
            gradient[:] = pair[1]
        return pair[0]

    optimizer.set_lower_bounds(study.bounds[:, 0])
    optimizer.set_upper_bounds(study.bounds[:, 1])
    optimizer.set_min_objective(lambda x, gradient: into(smooth.objective(x), gradient))
    for i in range(len(study.spec.constraints)):
        optimizer.add_inequality_constraint(lambda x, gradient, i=i: into(smooth.constraint(i, x), gradient), 1e-8)
    optimizer.set_xtol_rel(float(options.pop("xtol_rel", 1e-6)))
    if options:
        raise InvalidArgument(f"optimizer.nlopt: unknown options {', '.join(options)}; method, start and xtol_rel are known")
    try:
        optimizer.optimize(start)
    except nlopt.RoundoffLimited:
        pass
