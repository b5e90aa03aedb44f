# SPDX-License-Identifier: Apache-2.0
"""Systems as functions of optimizers: objectives of SciPy, problems of pymoo. Neither library needs to be installed to import this.
Modules of this folder bear the names of the libraries that they are for, which they need: cma, openmdao, torch, jax, libensemble."""

from typing import Any, Callable, List, Optional, Tuple

import numpy as np

from ..errors import Error, InvalidArgument
from ..penalty import Penalty
from ..quality import NAMES, QualityConstraints
from ..reports import Report
from ..system import System

Objective = Callable[[np.ndarray, Report], float]
Gradient = Callable[[np.ndarray, Report], np.ndarray]
_LAST = 1e30


class Unusable(Error):
    """More than half of the designs so far could not be used, so that an optimizer would optimize their penalty."""

    code = "unusable"


class ScipyObjective:
    """An objective of the deformed points for scipy.optimize.

        f = ScipyObjective(system, objective, gradient, unit_cube=True)
        found = minimize(f, f.parts(x0), jac=f.gradient, bounds=f.bounds)
        best = f.variables(found.x)
        differential_evolution(f, f.bounds, vectorized=True, updating="deferred")

    objective(points (n, 3), report): the value of one design, to be minimized.
    gradient(points, report): its gradient with respect to the points, (n, 3); turned into that with respect to the variables by `System.vjp`.
    penalty: the value of a design that must not be used: its verdict is bad, it cannot be evaluated, or the objective has no finite value
      for it, as after a simulation that diverged. Finite, so that no optimizer meets a NaN; `gradient` is zero there. None: 1e30, which
      ranks last; with a gradient, for single designs, the least value so far and a slope away from its design, of which `gradient` is the
      gradient, so that line searches come back to where designs can be used.
      Once more than half of at least 20 designs were so, Unusable is raised.
    unit_cube: x are parts of the bounds, from 0 to 1, not variables, for methods to which lengths and angles of any units are alike.
      `variables` and `parts` turn one into the other, `gradient` is with respect to the parts. All variables need finite bounds.
    options: those of `System.deform`.

    Called with x (k,), or of one variable with its value alone, it gives a number; with X (k, m), as SciPy's vectorized=True has it, (m,).
    The last single design is kept, so value and gradient of one x are one request.
    """

    def __init__(self, system: System, objective: Objective, gradient: Optional[Gradient] = None, *, penalty: Optional[float] = None,
                 unit_cube: bool = False, **options: Any) -> None:
        low, high = system.bounds.T
        if unit_cube and not np.isfinite(system.bounds).all():
            raise InvalidArgument("unit_cube: needs finite bounds of all variables")
        self._low = low if unit_cube else np.zeros(len(low))
        self._span = np.where(high > low, high - low, 1.0) if unit_cube else np.ones(len(low))
        self._unit_cube = unit_cube
        self.system = system
        self.objective = objective
        self.penalty = penalty
        self._sloped = Penalty(system.bounds[:, 1] - system.bounds[:, 0])
        self.evaluated = 0
        """Designs so far."""
        self.unusable = 0
        """Those of them that got the penalty."""
        self._gradient = gradient
        self._options = options
        self._last: Optional[Tuple[np.ndarray, np.ndarray, Report]] = None
        self._no_value: Optional[np.ndarray] = None  # the last single design, where the objective had no finite value
        self._known: Optional[Tuple[np.ndarray, float]] = None  # the last one that had a value

    @property
    def bounds(self) -> List[Tuple[float, float]]:
        """The bounds of x, as SciPy takes them."""
        return [(0.0, float(upper > lower)) if self._unit_cube else (lower, upper) for lower, upper in self.system.bounds]

    def variables(self, x: np.ndarray) -> np.ndarray:
        """The design variables, (k,), of x."""
        parts = np.asarray(x, dtype=np.float64)
        found = self._low + parts * self._span
        if self._unit_cube:  # rounding leads nowhere beyond the bounds
            found = np.where((parts >= 0) & (parts <= 1), np.clip(found, *self.system.bounds.T), found)
        return np.asarray(found)

    def parts(self, variables: np.ndarray) -> np.ndarray:
        """The x, (k,), of design variables."""
        return np.asarray((np.asarray(variables, dtype=np.float64) - self._low) / self._span)

    def __call__(self, x: np.ndarray) -> Any:
        last = _LAST if self.penalty is None else self.penalty
        if np.ndim(x) <= 1:
            design, points, report = self._at(x)
            if report.bad or self._knows_no_value(design):
                return self._penalized(design)[0]
            value = self._value(points, report)
            if value is None:
                self._no_value = design
                self._count_missing(1)
                return self._penalized(design)[0]
            self._sloped.usable(design, value)
            self._known = (design, value)
            return value
        population = self.system.deform(np.ascontiguousarray(self.variables(np.asarray(x).T)), **self._options)
        self._count(population.reports)
        values = [last if report.bad else self._value(points, report) for points, report in zip(population.points, population.reports)]
        self._count_missing(sum(value is None for value in values))
        return np.array([last if value is None else value for value in values])

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """With respect to x, (k,)."""
        if self._gradient is None:
            raise InvalidArgument("gradient: the objective was made without one")
        design, points, report = self._at(x)
        if report.bad or self._knows_no_value(design):
            return self._penalized(design)[1] * self._span
        gradient = self.system.vjp(design, self._gradient(points, report))
        if self._known is not None and np.array_equal(self._known[0], design):
            self._sloped.usable(design, self._known[1], gradient)
        return gradient * self._span

    def constraint(self, constraints: QualityConstraints) -> Any:
        """Limits of quality as a scipy.optimize.NonlinearConstraint on x, of one value per limit: what is beyond the limit in parts of it, at most 0.

            minimize(f, x0, jac=f.gradient, bounds=f.bounds, method="SLSQP", constraints=[f.constraint(limits)])
            differential_evolution(f, f.bounds, vectorized=True, updating="deferred", constraints=(f.constraint(limits),))

        Gradients are differences of two designs per variable, which are deformed and measured but for which the objective is not called, and 0 of
        counts: only methods without gradients hold those. A design that must not be used is beyond all limits by 1e10. Value, objective and
        constraint of one x are one request.
        """
        from scipy.optimize import NonlinearConstraint

        smooth = [not NAMES[name] for name, _, _ in constraints.limits]
        held = QualityConstraints(constraints.quality, {})
        held.limits = tuple(each for each, has_slope in zip(constraints.limits, smooth) if has_slope)
        held.names = list(dict.fromkeys(name for name, _, _ in held.limits))

        def beyond(points: np.ndarray, report: Report) -> np.ndarray:
            if report.bad:
                return np.full(len(constraints.limits), 1e10)
            return beyond_limits(constraints, points, report)

        def value(x: np.ndarray) -> np.ndarray:
            if np.ndim(x) <= 1:
                return beyond(*self._at(x)[1:])
            population = self.system.deform(np.ascontiguousarray(self.variables(np.asarray(x).T)), **self._options)
            return np.array([beyond(*each) for each in zip(population.points, population.reports)]).T

        def jacobian(x: np.ndarray) -> np.ndarray:
            slopes = np.zeros((len(constraints.limits), np.size(x)))
            if any(smooth):
                slopes[np.flatnonzero(smooth)] = held.gradients(self.system, np.atleast_1d(self.variables(x))) * self._span
            return slopes

        return NonlinearConstraint(value, -np.inf, 0.0, jac=jacobian)

    def _knows_no_value(self, design: np.ndarray) -> bool:
        return self._no_value is not None and np.array_equal(self._no_value, design)

    def _penalized(self, design: np.ndarray) -> Tuple[float, np.ndarray]:
        """Value and gradient of a design that must not be used."""
        sloped = self._sloped.at(design) if self.penalty is None and self._gradient is not None else None
        return sloped or (_LAST if self.penalty is None else self.penalty, np.zeros(len(design)))

    def _at(self, x: np.ndarray) -> Tuple[np.ndarray, np.ndarray, Report]:
        """The design of one x, without a request if it is that of the last call: its variables, points and report."""
        design = np.atleast_1d(self.variables(x))
        if self._last is None or not np.array_equal(self._last[0], design):
            deformation = self.system.deform(design, **self._options)
            self._count([deformation.report])
            self._last = (design, deformation.points, deformation.report)
        return self._last

    def _value(self, points: np.ndarray, report: Report) -> Optional[float]:
        """None where the objective has no finite value."""
        value = float(self.objective(points, report))
        return value if np.isfinite(value) else None

    def _count(self, reports: List[Report]) -> None:
        self.evaluated += len(reports)
        self.unusable += sum(report.bad for report in reports)
        last = next((report for report in reports if report.bad), None)
        self._check_share("; ".join(last.reasons) if last else "")

    def _count_missing(self, count: int) -> None:
        self.unusable += count
        if count:
            self._check_share("the objective has no finite value")

    def _check_share(self, last: str) -> None:
        if self.evaluated >= 20 and 2 * self.unusable > self.evaluated:
            raise Unusable(f"{self.unusable} of {self.evaluated} designs cannot be used" + (f", the last one: {last}" if last else ""))


def beyond_limits(constraints: Optional[QualityConstraints], points: np.ndarray, report: Report) -> np.ndarray:
    """The violations of a design, finite: 1e10 of what cannot be measured; 0 where its verdict is bad, which is what makes it rank last."""
    if constraints is None or report.bad:
        return np.zeros(0 if constraints is None else len(constraints.limits))
    return np.nan_to_num(constraints.violations(points, report), nan=1e10, posinf=1e10, neginf=-1e10)


def pymoo_problem(system: System, objectives: Callable[[np.ndarray, Report], Any], count: int = 1, *, penalty: float = 1e30,
                  constraints: Optional[QualityConstraints] = None, **options: Any) -> Any:
    """A pymoo Problem whose generations are evaluated in batches.

    objectives(points (n, 3), report): `count` values of one design, to be minimized. Whether a design may be used is an inequality constraint,
    so that pymoo ranks the others behind all that may: 1 where its verdict is bad, it cannot be evaluated, or an objective has no finite value
    (its objectives are the penalty), else -1. constraints: limits of quality, each one inequality constraint more, in parts of the limit; objectives
    are not called for designs outside of them. Needs pymoo.
    """
    try:
        from pymoo.core.problem import Problem
    except ImportError as error:
        raise ImportError("pymoo_problem needs the package pymoo: pip install pymoo", name=error.name) from error

    lower, upper = system.bounds.T
    if not np.isfinite(system.bounds).all():
        raise InvalidArgument("variables: pymoo needs finite bounds of all of them")

    limits = () if constraints is None else constraints.limits

    class DeformProblem(Problem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(n_var=len(lower), n_obj=count, n_ieq_constr=1 + len(limits), xl=lower, xu=upper)

        def _evaluate(self, x: np.ndarray, out: Any, *_: Any, **__: Any) -> None:
            population = system.deform(x, **options)
            beyond = np.array([beyond_limits(constraints, points, report) for points, report in zip(population.points, population.reports)])
            beyond = beyond.reshape(len(x), len(limits))
            skipped = (beyond > 0).any(axis=1)
            values = [np.full(count, penalty) if report.bad or skip else np.reshape(objectives(points, report), count)
                      for points, report, skip in zip(population.points, population.reports, skipped)]
            found = np.array(values, dtype=np.float64).reshape(-1, count)
            finite = np.isfinite(found).all(axis=1)
            out["F"] = np.where(finite[:, None], found, penalty)
            out["G"] = np.column_stack([np.where(population.usable & finite, -1.0, 1.0), beyond])

    return DeformProblem()
