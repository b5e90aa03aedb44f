# SPDX-License-Identifier: GPL-3.0-or-later
"""Optimizers of SciPy itself on deformed points."""

import numpy as np
import pytest
from scipy.optimize import check_grad, differential_evolution, minimize, minimize_scalar

import deformd
from deformd.adapters import ScipyObjective, Unusable
from deformd.adapters.libensemble import sim_function

GOAL = np.array([0.02, -0.07])


@pytest.fixture
def distance(system):
    """How far a design is from that of GOAL: the optimum is known."""
    goal = system(GOAL)
    return ScipyObjective(system, lambda points, report: 0.5 * np.sum((points - goal) ** 2), lambda points, report: points - goal)


def test_the_gradient_is_that_of_the_objective(distance):
    x = np.array([0.01, 0.02])
    assert np.linalg.norm(distance.gradient(x)) > 1
    assert check_grad(distance, distance.gradient, x, epsilon=1e-6) < 1e-4 * np.linalg.norm(distance.gradient(x))


def test_minimize_with_gradients(distance):
    found = minimize(distance, [0, 0], jac=distance.gradient, bounds=distance.bounds, options={"ftol": 1e-15, "gtol": 1e-10})
    np.testing.assert_allclose(found.x, GOAL, atol=1e-6)
    assert distance.evaluated <= found.nfev, "value and gradient of one design are one request"
    by_differences = ScipyObjective(distance.system, distance.objective)
    minimize(by_differences, [0, 0], bounds=by_differences.bounds)
    assert distance.evaluated < by_differences.evaluated
    with pytest.raises(deformd.InvalidArgument, match="gradient"):
        by_differences.gradient(np.zeros(2))


def test_the_unit_cube(system):
    goal = system(GOAL)
    f = ScipyObjective(system, lambda points, report: 0.5 * np.sum((points - goal) ** 2), lambda points, report: points - goal, unit_cube=True)
    plain = ScipyObjective(system, f.objective, lambda points, report: points - goal)
    low, high = system.bounds.T
    assert f.bounds == [(0, 1), (0, 1)]
    np.testing.assert_array_equal(f.variables([0, 0]), low)
    np.testing.assert_array_equal(f.variables([1, 1]), high)
    u = f.parts(np.array([0.01, 0.02]))
    assert f(u) == pytest.approx(plain(f.variables(u)), rel=1e-12)
    np.testing.assert_allclose(f.gradient(u), plain.gradient(f.variables(u)) * (high - low), rtol=1e-12)
    np.testing.assert_allclose(f(np.array([u, u]).T), [f(u)] * 2)
    found = minimize(f, f.parts([0, 0]), jac=f.gradient, bounds=f.bounds, options={"ftol": 1e-15, "gtol": 1e-10})
    np.testing.assert_allclose(f.variables(found.x), GOAL, atol=1e-6)


@pytest.mark.parametrize("method", ["L-BFGS-B", "SLSQP", "TNC"])
def test_line_searches_come_back_from_designs_that_must_not_be_used(squeezed, method):
    """A block of half its length: the first step is as far as the bounds allow, where its cells are inverted."""
    f = ScipyObjective(squeezed, lambda points, report: 1e3 * (points[:, 0].max() - 2) ** 2,
                       lambda points, report: 2e3 * (points[:, 0].max() - 2) * np.outer(points[:, 0] == points[:, 0].max(), [1, 0, 0]) / right, unit_cube=True)
    right = np.sum(squeezed([0])[:, 0] == 4)
    found = minimize(f, f.parts([0]), jac=f.gradient, bounds=f.bounds, method=method)
    assert f.unusable > 0 or method == "TNC"
    assert f.variables(found.x)[0] == pytest.approx(2, abs=1e-3)


def test_an_array_that_the_optimizer_reuses(distance):
    x = np.array([0.01, 0.02])
    first = distance(x)
    x[:] = GOAL
    assert distance(x) < 1e-20 < first


def test_differential_evolution_in_batches(distance):
    arguments = dict(bounds=distance.bounds, seed=1, maxiter=15, popsize=6, updating="deferred", polish=False)
    batches = differential_evolution(distance, vectorized=True, **arguments)
    singles = differential_evolution(distance, **arguments)
    np.testing.assert_allclose(batches.x, singles.x, rtol=0, atol=1e-9)
    np.testing.assert_allclose(batches.x, GOAL, atol=0.01)


def test_designs_that_must_not_be_used_rank_last(squeezed):
    far = ScipyObjective(squeezed, lambda points, report: -np.ptp(points[:, 0]), penalty=1e6)
    values = far(np.array([[1, 6, 20]], dtype=float))
    assert values[0] < 1e6 and list(values[1:]) == [1e6, 1e6]
    assert far(np.array([6.0])) == 1e6 and (far.evaluated, far.unusable) == (4, 3)
    steep = ScipyObjective(squeezed, lambda points, report: 5.0, lambda points, report: np.ones_like(points))
    assert steep(np.array([6.0])) == 1e30 and steep.gradient(np.array([6.0])) == 0, "none could be used so far"
    assert steep(np.array([1.0])) == 5 and steep.gradient(np.array([1.0])) != 0
    slope = abs(steep.gradient(np.array([1.0]))[0])
    assert steep(np.array([6.0])) == pytest.approx(5 + 5 * slope) and steep.gradient(np.array([6.0])) == pytest.approx(slope)


@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
def test_designs_without_a_value_rank_last(system, missing):
    """A simulation that diverged: SciPy would take -inf for the best, and NaN ends minimize."""
    calls = []

    def objective(points, report):
        calls.append(report)
        return missing if points[:, 2].max() > highest else points[:, 2].max()

    highest = system([0.02, 0])[:, 2].max()
    f = ScipyObjective(system, objective, lambda points, report: np.full_like(points, missing if points[:, 2].max() > highest else 1), penalty=1e6)
    assert f(np.array([0.03, 0.0])) == 1e6 and (f.evaluated, f.unusable) == (1, 1)
    assert f(np.array([0.03, 0.0])) == 1e6 and (f.evaluated, f.unusable, len(calls)) == (1, 1, 1), "the same design counts once"
    np.testing.assert_array_equal(f.gradient(np.array([0.03, 0.0])), [0, 0])
    assert f(np.array([0.01, 0.0])) < 1 and np.any(f.gradient(np.array([0.01, 0.0])) != 0)
    values = f(np.array([[0.03, 0.01], [0, 0]]))
    assert values[0] == 1e6 and values[1] < 1 and (f.evaluated, f.unusable) == (4, 2)
    with pytest.raises(Unusable, match="^12 of 22 designs cannot be used, the last one: the objective has no finite value"):
        f(np.array([np.r_[np.full(10, 0.03), np.full(8, 0.01)], np.zeros(18)]))


def test_the_simulator_of_libensemble(system, squeezed):
    """The function itself, which does not need the library."""
    x = np.zeros(3, dtype=[("x", float, (2,))])
    x["x"][1:] = [[0.03, 0], [0.01, 0.05]]
    heights = system(x["x"])[:, :, 2].mean(axis=1)
    specs = {"out": [("f", float), ("usable", bool)], "user": {"system": system, "objective": lambda points, report: points[:, 2].mean()}}
    out, _ = sim_function(x, None, specs)
    np.testing.assert_array_equal(out["f"], heights)
    assert out["usable"].all()
    two = {"out": [("f", float, (2,)), ("usable", bool)],
           "user": {"system": system, "objective": lambda points, report: [1, np.nan if points[:, 2].mean() == heights[1] else 2], "penalty": 7}}
    out, _ = sim_function(x, None, two)
    np.testing.assert_array_equal(out["f"], [[1, 2], [7, 7], [1, 2]])
    assert out["usable"].tolist() == [True, False, True]
    pushed = np.zeros(2, dtype=[("x", float, (1,))])
    pushed["x"][1] = 6
    out, _ = sim_function(pushed, None, {**specs, "user": {**specs["user"], "system": squeezed}})
    assert out["f"][1] == 1e30 and out["usable"].tolist() == [True, False]


def test_one_variable(squeezed):
    """As minimize_scalar has it: a number for x."""
    f = ScipyObjective(squeezed, lambda points, report: (points[:, 0].max() - goal) ** 2, lambda points, report: np.ones_like(points))
    goal = squeezed([0.5])[:, 0].max()
    assert f(0.3) == f(np.array([0.3])) and f.gradient(0.3) == f.gradient(np.array([0.3]))
    assert minimize_scalar(f, bounds=(0, 1), method="bounded").x == pytest.approx(0.5, abs=1e-4)


def test_more_than_half_unusable_stops_loudly(squeezed):
    f = ScipyObjective(squeezed, lambda points, report: 0.0)
    f(np.linspace(0, 1, 10)[None])
    f(np.full((1, 10), 6.0))
    with pytest.raises(Unusable, match="^11 of 21 designs cannot be used, the last one: "):
        f(np.array([6.0]))
