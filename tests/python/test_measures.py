# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures and the Sobolev filter, against numpy and SciPy."""

import threading

import numpy as np
import pytest
from conftest import brick
from scipy import sparse
from scipy.sparse.linalg import spsolve

import deformd
from deformd import measures


def fans(sizes, corners):
    """Faces as fans of triangles, (t, 3)."""
    starts = np.cumsum(sizes) - sizes
    return np.array([(corners[a], corners[a + i - 1], corners[a + i]) for a, n in zip(starts, sizes) for i in range(2, n)])


def corners_of(points, faces):
    return points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]


def volume(points, faces):
    a, b, c = corners_of(points, faces)
    return np.linalg.det(np.stack([a, b, c], axis=1)).sum() / 6


def centre_of_gravity(points, faces):
    a, b, c = corners_of(points, faces)
    return (np.linalg.det(np.stack([a, b, c], axis=1))[:, None] * (a + b + c)).sum(axis=0) / 24 / volume(points, faces)


def area(points, faces):
    a, b, c = corners_of(points, faces)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def projected_area(points, faces, direction):
    a, b, c = corners_of(points, faces)
    return np.abs(np.cross(b - a, c - a) @ (direction / np.linalg.norm(direction))).sum() / 4


def ball(level=3, scale=(1.0, 1.0, 1.0)):
    """An octahedron that was split, on an ellipsoid."""
    points = [np.array(p, dtype=float) for p in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))]
    faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    for _ in range(level):
        middles, split = {}, []

        def middle(a, b):
            key = (min(a, b), max(a, b))
            if key not in middles:
                middles[key] = len(points)
                p = points[a] + points[b]
                points.append(p / np.linalg.norm(p))
            return middles[key]

        for a, b, c in faces:
            d, e, f = middle(a, b), middle(b, c), middle(c, a)
            split += [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
        faces = split
    return np.array(points) * scale, np.array(faces)


@pytest.fixture(scope="module")
def body():
    return ball(3, (2.0, 1.0, 0.5))


def slope_of(measure, points, direction, step):
    value = measure.value
    return (8 * (value(points + step / 2 * direction) - value(points - step / 2 * direction)) -
            (value(points + step * direction) - value(points - step * direction))) / (6 * step)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e4])
def test_integrals_are_those_of_numpy(body, unit):
    points, faces = body[0] * unit + 3 * unit, body[1]
    shaken = points + np.random.default_rng(1).normal(0, 0.01 * unit, points.shape)
    assert measures.Volume((points, faces)).value(shaken) == pytest.approx(volume(shaken - 3 * unit, faces), rel=1e-13)
    assert measures.Area((points, faces)).value(shaken) == pytest.approx(area(shaken, faces), rel=1e-13)
    direction = np.array([1, -2, 0.5])
    assert measures.ProjectedArea((points, faces), direction).value(shaken) == pytest.approx(projected_area(shaken, faces, direction), rel=1e-13)
    assert measures.ProjectedArea((points, faces), "y").value(shaken) == measures.ProjectedArea((points, faces), (0, 5, 0)).value(shaken)
    np.testing.assert_allclose(measures.CentreOfGravity((points, faces)).value(shaken), centre_of_gravity(shaken - 3 * unit, faces) + 3 * unit, rtol=1e-12)


def test_gradients_are_those_of_differences(body):
    points, faces = body
    mesh = (points, faces)
    waves = np.sin(points @ np.array([[1.0, 0.3, 2], [0.2, 1, -1], [0.5, 0.5, 1]]) + 0.3)
    shaken = points + 0.02 * waves
    for measure, tolerance in ((measures.Volume(mesh), 1e-9), (measures.Area(mesh), 1e-8), (measures.CentreOfGravity(mesh), 1e-9),
                               (measures.ProjectedArea(mesh, "z"), 1e-8), (measures.Thickness(mesh, tolerance=0.1), 1e-5),
                               (measures.Thickness(mesh, tolerance=0.1, method="spheres"), 1e-5),
                               (measures.Clearance(mesh, ((0.5, 0.2, 0.1), (3, 3, 3)), tolerance=0.1), 1e-5),
                               (measures.Clearance(mesh, (points + (1.7, 0.2, 0.1), faces), tolerance=0.1), 1e-5)):
        value, gradient = measure(shaken)
        assert gradient.shape == np.shape(value) + points.shape
        np.testing.assert_array_equal(value, measure.value(shaken))
        for direction in (waves[:, ::-1], np.random.default_rng(4).normal(size=points.shape)):
            expected = slope_of(measure, shaken, direction, 1e-6)
            scale = np.abs(gradient * direction).sum(axis=(-2, -1))
            assert np.all(np.abs((gradient * direction).sum(axis=(-2, -1)) - expected) <= tolerance * scale), type(measure).__name__


def test_the_gradient_at_the_variables(system):
    x = np.array([0.02, -0.05])
    for measure in (measures.Volume(system.geometry), measures.Thickness(system.geometry, at="roof", tolerance=0.02),
                    measures.Clearance(system.geometry, ((0.5, -1, 0.33), (0.7, 1, 1)), groups=["roof"], tolerance=0.02)):
        value, gradient = measure(system(x))
        step = 1e-5
        expected = [(measure.value(system(x + step * e)) - measure.value(system(x - step * e))) / (2 * step) for e in np.eye(2)]
        np.testing.assert_allclose(system.vjp(x, gradient), expected, rtol=1e-4, atol=1e-6)


def test_smooth_minima_and_what_is_behind_them(body):
    points, faces = body
    thick = measures.Thickness((points, faces), tolerance=0.2)
    (value, gradient), least = thick.with_least(points)
    assert least == thick.least(points) and thick.value_and_least(points) == (value, least)
    assert least.value - 0.2 <= value < least.value and least.tolerance == 0.2 and least.samples == len(faces)
    np.testing.assert_allclose(least.at, points[faces[least.index]].mean(axis=0), atol=1e-14)
    box = measures.Clearance((points, faces), ([0, 0, 1], [1, 1, 2]), tolerance=1e-3)
    least = box.least(points)
    outside = np.linalg.norm(np.maximum(np.maximum([0, 0, 1] - points, points - [1, 1, 2]), 0), axis=1)
    assert least.value == pytest.approx(outside.min(), rel=1e-14) and least.index == outside.argmin() and 0 < least.covering < 0.5


def test_meshes_of_all_kinds(case, system, client, body, tmp_path):
    points, faces = body
    expected = measures.Volume((points, faces)).value(points)
    assert measures.Volume(client.register((points, faces))).value(points) == expected
    assert measures.Volume(system.geometry).value(system.geometry.points) == measures.Volume(case.mesh).value(system.geometry.points)
    nodes, cells = brick()
    assert measures.Volume((nodes, {"hexahedron": cells}), of="cells").value(nodes) == pytest.approx(36)
    with pytest.raises(deformd.FailedPrecondition, match="not registered by this client"):
        measures.Area(client.geometry(client.register((points, faces)).id))


@pytest.mark.parametrize("wrong, message", [
    (lambda mesh: measures.Volume(mesh, groups="no"), 'groups[0]: there is no group "no"'),
    (lambda mesh: measures.Volume(mesh, groups=[3]), "groups: [3], expected the name"),
    (lambda mesh: measures.Volume(mesh, of="points"), 'of: "points", expected "faces" or "cells"'),
    (lambda mesh: measures.Volume(mesh, rims="open"), 'rims: "open", expected "refuse" or "close"'),
    (lambda mesh: measures.Volume((mesh[0], mesh[1][1:])), "the faces are not closed"),
    (lambda mesh: measures.Thickness(mesh, method="cones"), 'method: "cones", expected "rays" or "spheres"'),
    (lambda mesh: measures.Thickness(mesh, tolerance=0), "tolerance: 0, expected a length over 0"),
    (lambda mesh: measures.ProjectedArea(mesh, "w"), "direction: 'w', expected one of x, y, z"),
    (lambda mesh: measures.ProjectedArea(mesh, (1, 2)), "direction: (1, 2), expected three numbers"),
    (lambda mesh: measures.Clearance(mesh, ((0, 0, 1), (1, 1, 0))), "keep_out: z of min, 1, is above that of max, 0"),
    (lambda mesh: measures.Clearance(mesh, (mesh[0], mesh[1][1:])), "keep_out: faces: the faces are not closed"),
    (lambda mesh: measures.Area(mesh)(mesh[0][1:]), "points: 257, the mesh has 258"),
    (lambda mesh: measures.Area(mesh)(mesh[0], threads=-1), "threads: -1"),
    (lambda mesh: measures.SobolevFilter(mesh, 0), "length: 0, expected a length over 0"),
    (lambda mesh: measures.SobolevFilter(mesh, 1)(np.zeros((3, 3))), "field: an array of shape (3, 3), expected (n,) or (n, components) with n = 258"),
])
def test_what_is_wrong(body, wrong, message):
    with pytest.raises(deformd.InvalidArgument) as raised:
        wrong(body)
    assert message in str(raised.value)


def test_a_design_that_has_no_value(body):
    with pytest.raises(deformd.NumericalFailure, match="enclose no volume"):
        measures.CentreOfGravity(body)(body[0] * (-1, 1, 1))


def test_threads_share_a_measure():
    points, faces = ball(5)
    thick = measures.Thickness((points, faces), tolerance=0.1)
    designs = [points * (1, 1, 1 + 0.1 * i) for i in range(4)]
    expected = [thick(each, threads=0) for each in designs]
    found = [None] * 4
    threads = [threading.Thread(target=lambda i=i: found.__setitem__(i, thick(designs[i]))) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for one, other in zip(found, expected):
        assert one.value == other.value
        np.testing.assert_array_equal(one.gradient, other.gradient)


# ---- Sobolev filter ----


def matrices(points, faces):
    """Lumped areas and stiffness, by angles."""
    n = len(points)
    mass, stiffness = np.zeros(n), sparse.lil_matrix((n, n))
    for face in faces:
        for i in range(3):
            a, b, c = face[i], face[(i + 1) % 3], face[(i + 2) % 3]
            u, v = points[b] - points[a], points[c] - points[a]
            angle = np.arccos(u @ v / np.linalg.norm(u) / np.linalg.norm(v))
            mass[a] += np.linalg.norm(np.cross(u, v)) / 6
            weight = 0.5 / np.tan(angle)
            for s, t, sign in ((b, b, 1), (c, c, 1), (b, c, -1), (c, b, -1)):
                stiffness[s, t] += sign * weight
    return mass, stiffness.tocsc()


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_the_filter_is_that_of_scipy(body, unit):
    points, faces = body[0] * unit, body[1]
    mass, stiffness = matrices(points, faces)
    r = 0.4 * unit
    A = sparse.diags(mass).tocsc() + r**2 * stiffness
    smooth = measures.SobolevFilter((points, faces), r, tolerance=1e-13)
    f = np.random.default_rng(6).normal(size=points.shape)
    np.testing.assert_allclose(smooth.areas, mass, rtol=1e-12)
    np.testing.assert_allclose(smooth(f).field, spsolve(A, mass[:, None] * f), atol=1e-10)
    gradient = smooth.gradient(f)
    np.testing.assert_allclose(gradient.field * unit**2, spsolve(A, f) * unit**2, atol=1e-8)
    assert gradient.converged and gradient.residual <= 1.01e-13 and gradient.iterations > 3
    np.testing.assert_allclose(smooth.transposed(f[:, 0]).field, mass * spsolve(A, f[:, 0]), atol=1e-10)
    moved = points * (1, 1, 2)
    mass, stiffness = matrices(moved, faces)
    there = measures.SobolevFilter((points, faces), r, moved, tolerance=1e-13)(f[:, 1]).field
    np.testing.assert_allclose(there, spsolve(sparse.diags(mass).tocsc() + r**2 * stiffness, mass * f[:, 1]), atol=1e-10)


def test_a_filter_that_does_not_converge_says_so(body):
    found = measures.SobolevFilter(body, 5, iterations=2)(np.random.default_rng(1).normal(size=len(body[0])))
    assert not found.converged and found.iterations == 2 and found.residual > 1e-6
