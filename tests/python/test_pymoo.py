# SPDX-License-Identifier: GPL-3.0-or-later
"""pymoo itself on deformed points; run by install.sh, since Debian has no package of it."""

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.algorithms.soo.nonconvex.de import DE
from pymoo.optimize import minimize

from deformd import Quality, QualityConstraints
from deformd.adapters import pymoo_problem


def test_one_objective(system):
    goal = system([0.02, -0.07])
    problem = pymoo_problem(system, lambda points, report: np.sum((points - goal) ** 2))
    found = minimize(problem, DE(pop_size=20), ("n_gen", 25), seed=1)
    np.testing.assert_allclose(found.X, [0.02, -0.07], atol=0.01)


def test_two_objectives(system):
    rest = system.geometry.points
    problem = pymoo_problem(system, lambda points, report: [points[:, 2].mean(), np.abs(points - rest).max()], 2)
    front = minimize(problem, NSGA2(pop_size=20), ("n_gen", 10), seed=1).F
    assert len(front) > 5 and np.all(np.diff(front[front[:, 0].argsort()][:, 1]) <= 0), "less of one is more of the other"


def test_bad_designs_are_infeasible(squeezed):
    """Pushing as far as possible would be best, were the cells not inverted."""
    problem = pymoo_problem(squeezed, lambda points, report: points[:, 0].max())
    found = minimize(problem, DE(pop_size=20), ("n_gen", 20), seed=1)
    assert found.X[0] < 4 and not squeezed.deform(found.X).report.bad
    values = problem.evaluate(np.array([[1.0], [6.0]]), return_as_dictionary=True)
    assert values["G"][:, 0].tolist() == [-1, 1] and values["F"][1, 0] == 1e30


def test_designs_without_a_value_are_infeasible(system):
    rest = system([0, 0])[:, 2].mean()
    problem = pymoo_problem(system, lambda points, report: [1, np.nan if points[:, 2].mean() > rest else 2], 2)
    values = problem.evaluate(np.array([[0.03, 0], [0, 0]]), return_as_dictionary=True)
    assert values["G"][:, 0].tolist() == [1, -1] and values["F"].tolist() == [[1e30, 1e30], [1, 2]]


def test_quality_is_a_constraint(system):
    """Objectives are not asked for outside of the limits."""
    quality = Quality(system.geometry)
    designs = np.array([[0.0, 0.0], [0.04, 0.1], [0.02, 0.19], [-0.05, -0.2]])
    measured = np.array([quality(system(x))["total_area"] for x in designs])
    limit = float(np.median(measured))
    asked = []
    problem = pymoo_problem(system, lambda points, report: asked.append(1) or 5.0, constraints=QualityConstraints(quality, {"total_area": {"max": limit}}))
    values = problem.evaluate(designs, return_as_dictionary=True)
    np.testing.assert_allclose(values["G"][:, 1], (measured - limit) / limit, rtol=1e-9)
    assert len(asked) == np.sum(measured <= limit) == 2
    found = minimize(pymoo_problem(system, lambda points, report: points[:, 2].mean(), constraints=QualityConstraints(quality, {"total_area": {"max": limit}})),
                     DE(pop_size=20), ("n_gen", 10), seed=1)
    assert quality(system(found.X))["total_area"] <= limit
