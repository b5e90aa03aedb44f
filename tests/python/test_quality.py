# SPDX-License-Identifier: GPL-3.0-or-later
"""Quality by the names of `deform quality`: what the command says of the files is the other opinion."""

import json
import pickle

import numpy as np
import pytest
from conftest import brick
from scipy.optimize import NonlinearConstraint, differential_evolution, minimize

import deformd
from deformd import CellCheck, Quality, QualityConstraints
from deformd.adapters import ScipyObjective
from deformd.quality import NAMES, differences

X = np.array([0.03, -0.15])


class Stretched:
    """A system that moves points along x by x[0] of their own x and shears them by x[1], without a server: derivatives are known."""

    bounds = np.array([[-0.5, 0.5], [-1.0, 1.0]])
    names = ("stretch", "shear")

    def __init__(self, points):
        self.rest = points
        self.deformed = 0

    def deform(self, x, **_):
        designs = np.atleast_2d(x)
        self.deformed += len(designs)
        assert ((designs >= self.bounds[:, 0]) & (designs <= self.bounds[:, 1])).all(), "a server refuses designs out of their bounds"
        points = np.array([np.stack([(1 + a) * self.rest[:, 0] + b * self.rest[:, 2], self.rest[:, 1], self.rest[:, 2]], axis=1) for a, b in designs])
        good = deformd.Population(points, [Fine()] * len(designs))
        return good if np.ndim(x) == 2 else deformd.Deformation(points[0], good.reports[0])


class Fine:
    """A report."""

    bad, error, reasons = False, None, ()


def block(scale=1.0):
    points, hexahedra = brick()
    return points * scale, hexahedra


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_values_are_those_of_the_command(case, client, tmp_path, scale):
    points, hexahedra = block(scale)
    geometry = client.register((points, {"hexahedron": hexahedra}))
    quality = Quality(geometry)
    moved = points + 0.1 * scale * np.sin(points[:, ::-1] / scale)
    meshio = pytest.importorskip("meshio")
    for name, each in (("rest", points), ("moved", moved)):
        meshio.Mesh(each, {"hexahedron": hexahedra}).write(tmp_path / f"{name}.vtu")
    told = json.loads(case.command("quality", tmp_path / "moved.vtu", "--before", tmp_path / "rest.vtu", "--json"))
    found = quality(moved)
    assert set(found) == set(quality.names) and {"scaled_jacobian", "aspect_ratio", "volume", "flipped_faces", "displacement"} <= set(found)
    assert found == pytest.approx({name: told[name] for name in found}, rel=1e-12)
    some = ["volume", "scaled_jacobian"]
    assert list(quality.values(moved, some)) == some and quality.values(moved, some) == {name: found[name] for name in some}
    assert quality(moved, threads=2) == found


def test_a_surface_and_its_table(case, system):
    quality = Quality(system.geometry)
    points = system(X)
    system.geometry.write(str(case.folder / "moved.obj"), points)
    told = json.loads(case.command("quality", "moved.obj", "--before", "ahmed.obj", "--json"))
    assert quality(points) == pytest.approx({name: told[name] for name in quality.names}, rel=1e-6, abs=1e-9)  # the file has fewer digits
    row = next(row for row in quality.rows(points) if row.name == "face_quality")
    assert row.label == "quality of a face 2r/R, least" and row.in_table and row.id == told["face_quality_at"]


def test_reports_have_what_fail_on_takes(squeezed):
    quality = Quality(squeezed.geometry)
    points, report = squeezed.deform([1.0])
    found = quality.values(points, ["safe_amplitude", "scaled_jacobian", "max_displacement", "inverted_cells"], report)
    assert list(found) == ["safe_amplitude", "scaled_jacobian", "max_displacement", "inverted_cells"]
    assert found["safe_amplitude"] == report.cells.safe_amplitude and found["max_displacement"] == report.max_displacement == 1
    assert found["inverted_cells"] == 0 == quality.values(points, ["inverted_cells"])["inverted_cells"]
    with pytest.raises(deformd.InvalidArgument, match="safe_amplitude"):
        quality.values(points, ["safe_amplitude"])
    compiled = squeezed.local().deform([1.0])
    assert quality.values(compiled.points, ["max_displacement"], compiled.report)["max_displacement"] == pytest.approx(1, rel=1e-12)
    bad = squeezed.deform([6.0])
    assert bad.report.bad and quality.values(bad.points, ["inverted_cells"], bad.report)["inverted_cells"] == bad.report.cells.inverted > 0


def test_inverted_cells_are_those_of_the_server(squeezed, case):
    check = CellCheck(squeezed.geometry)
    assert (check.points, check.cells) == (80, 36)
    for push in (1.0, 3.0, 5.0, 6.0):
        points, report = squeezed.deform([push])
        assert check.inverted(points) == check.inverted(points, threads=2) == report.cells.inverted
    assert squeezed.deform([6.0]).report.cells.inverted > 0
    with pytest.raises(deformd.InvalidArgument, match="no cells"):
        CellCheck(case.mesh)
    with pytest.raises(deformd.InvalidArgument, match="finite"):
        check.inverted(np.full((80, 3), np.nan))


def test_what_is_refused(case, client):
    points, hexahedra = block()
    quality = Quality((points, {"hexahedron": hexahedra}))
    for name, message in (("scaled_jacobain", 'did you mean "scaled_jacobian"'), ("least_scaled_jacobian", '"scaled_jacobian"'), ("wall_height", "with walls"),
                          ("skewness", "other kinds of meshes")):
        with pytest.raises(deformd.InvalidArgument, match=message):
            quality.check(name)
        with pytest.raises(deformd.InvalidArgument, match=message):
            QualityConstraints(quality, {name: {"min": 1}})
    with pytest.raises(deformd.InvalidArgument, match="is a surface"):
        Quality(case.mesh, walls="nose")
    with pytest.raises(deformd.InvalidArgument, match="points"):
        quality(points[:-1])
    for limits, message in (({"volume": {}}, "constraints.volume: expected min, max or both"), ({"volume": {"least": 1}}, "'least', expected one of min, max"),
                            ({"volume": {"min": True}}, "constraints.volume.min: True, expected a number"), ([], "expected names")):
        with pytest.raises(deformd.InvalidArgument, match=message):
            QualityConstraints(quality, limits)
    here = Quality(case.mesh)
    rest = client.register(case.mesh).points
    assert pickle.loads(pickle.dumps(here))(rest) == here(rest)
    with pytest.raises(deformd.FailedPrecondition, match="path"):
        pickle.dumps(quality)


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_differences_are_derivatives(scale):
    points, hexahedra = block(scale)
    quality = Quality((points, {"hexahedron": hexahedra}))
    system = Stretched(points)
    x = np.array([0.2, 0.3])
    names = ["volume", "total_volume", "scaled_jacobian"]
    slopes = differences(system, x, quality, names)
    assert system.deformed == 4
    cell = scale ** 3
    a, b = x
    np.testing.assert_allclose(slopes["volume"], [cell, 0], atol=1e-6 * cell)
    np.testing.assert_allclose(slopes["total_volume"], [36 * cell, 0], atol=36e-6 * cell)
    # edges (1 + a, 0, 0) and (b, 0, 1): determinant over lengths is 1 / sqrt(1 + b^2)
    np.testing.assert_allclose(slopes["scaled_jacobian"], [0, -b * (1 + b * b) ** -1.5], atol=1e-6)
    for bound in ([0.5, 1.0], [-0.5, -1.0]):
        np.testing.assert_allclose(differences(system, bound, quality, ["volume"])["volume"], [cell, 0], atol=1e-6 * cell)
    limits = QualityConstraints(quality, {"volume": {"min": 0.5 * cell, "max": 2 * cell}})
    np.testing.assert_allclose(limits.violations(system.deform(x).points), [(0.5 - 1.2) / 0.5, (1.2 - 2) / 2], rtol=1e-12)
    np.testing.assert_allclose(limits.gradients(system, x), [[-2, 0], [0.5, 0]], atol=1e-5)
    with pytest.raises(deformd.InvalidArgument, match="inverted_cells: it is a number"):
        differences(system, x, quality, ["inverted_cells"])


def test_differences_of_a_system_agree_with_longer_steps(system):
    """Two implementations of the chain: the server with bounds in metres and radians, and plain quotients."""
    quality = Quality(system.geometry)
    names = ["total_area", "average_face_quality"]
    slopes = differences(system, X, quality, names)
    for i in range(2):
        step = np.eye(2)[i] * [1e-3, 1e-3]
        up, down = (quality.values(system(x), names) for x in (X + step, X - step))
        for name in names:
            assert slopes[name][i] == pytest.approx((up[name] - down[name]) / 2e-3, rel=1e-3)


def test_scipy_holds_quality():
    """The farthest shear whose cells have a scaled Jacobian of 0.8 is tan(acos(0.8)) = 0.75."""
    points, hexahedra = block()
    system = Stretched(points)
    limits = QualityConstraints(Quality((points, {"hexahedron": hexahedra})), {"scaled_jacobian": {"min": 0.8}, "inverted_cells": {"max": 0}})

    def lean(points, report):
        return -float(points[:, 0].max())

    f = ScipyObjective(system, lean)
    constraint = f.constraint(limits)
    assert isinstance(constraint, NonlinearConstraint)
    found = minimize(f, [0.1, 0.1], bounds=f.bounds, method="SLSQP", constraints=[constraint], options={"ftol": 1e-12})
    np.testing.assert_allclose(found.x, [0.5, 0.75], atol=1e-4)
    f.system.bounds = np.array([[-0.5, 9], [-9, 9]])  # COBYLA leaves them
    found = minimize(f, [0.1, 0.1], method="COBYLA", constraints=[constraint, {"type": "ineq", "fun": lambda x: 0.5 - np.abs(x[0])}], tol=1e-8)
    f.system.bounds = Stretched.bounds
    np.testing.assert_allclose(found.x, [0.5, 0.75], atol=1e-3)
    found = differential_evolution(f, f.bounds, constraints=(constraint,), vectorized=True, updating="deferred", seed=2, maxiter=60, polish=False)
    np.testing.assert_allclose(found.x, [0.5, 0.75], atol=2e-2)
    inside = constraint.fun(np.array([[0.0, 0.0], [0.0, 1.0]]).T)
    assert inside.shape == (2, 2) and inside[0, 0] < 0 < inside[0, 1]


def test_bad_designs_are_beyond_all_limits(squeezed):
    limits = QualityConstraints(Quality(squeezed.geometry), {"scaled_jacobian": {"min": 0.2}, "aspect_ratio": {"max": 50}})
    constraint = ScipyObjective(squeezed, lambda points, report: 0.0).constraint(limits)
    assert constraint.fun(np.array([6.0])).tolist() == [1e10, 1e10]
    assert (constraint.fun(np.array([0.5])) < 0).all()


def test_every_name_of_reports_and_meshes_is_known(system):
    assert set(Quality(system.geometry).names) <= set(NAMES)
    assert {"safe_amplitude", "non_orthogonality", "scaled_jacobian", "face_quality", "wall_height", "missed"} <= set(NAMES)
    assert NAMES["flipped_faces"] and not NAMES["safe_amplitude"]
