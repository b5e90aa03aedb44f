# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts of the car of tests/bench/evolution that need no flow solver."""

import os
import sys

import numpy as np
import pytest
from conftest import ROOT
from harness import DEFORM

sys.path.insert(0, str(ROOT / "tests" / "bench" / "evolution"))
import car  # noqa: E402
import channel  # noqa: E402
import fitness  # noqa: E402


def written(path, points):
    rows = "\n".join("(%.17g %.17g %.17g)" % tuple(point) for point in points)
    path.write_text(f"FoamFile {{ class vectorField; }}\n\n{len(points)}\n(\n{rows}\n)\n")
    return path


def test_the_volume_between_the_plane_and_the_faces(tmp_path):
    corners = np.array([[x, y, z] for z in (0.0, 3.0) for y in (0.0, 1.0) for x in (0.0, 2.0)])
    sides = [[0, 2, 6, 4], [1, 5, 7, 3], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]]  # without the one in the plane
    outwards = []
    for face in sides:
        normal = np.cross(corners[face[1]] - corners[face[0]], corners[face[2]] - corners[face[0]])
        outwards.append(face if normal @ (corners[face].mean(axis=0) - corners.mean(axis=0)) > 0 else face[::-1])
    inwards = [face[::-1] for face in outwards]
    assert fitness.volume_of(written(tmp_path / "points", corners), inwards) == pytest.approx(6, rel=1e-14)
    shear = np.array([[1, 0.3, -0.2], [0, 1, 0], [0.4, 0.5, 1]])  # keeps the plane y = 0 where it is
    expected = 6 * np.linalg.det(shear)
    assert fitness.volume_of(written(tmp_path / "points", corners @ shear.T + [5, 0, -7]), inwards) == pytest.approx(expected, rel=1e-13)
    assert fitness.volume_of(written(tmp_path / "points", corners), outwards) < 0


def test_the_body_is_closed_where_the_stilts_stood(tmp_path, monkeypatch):
    monkeypatch.setitem(os.environ, "DEFORM_BIN", DEFORM)
    path = tmp_path / "body.stl"
    car.write_body(path)
    vertices = np.array([line.split()[1:] for line in path.read_text().splitlines() if line.startswith("vertex")], dtype=float).reshape(-1, 3, 3)
    ids = {tuple(place): number for number, place in enumerate(np.unique(vertices.reshape(-1, 3), axis=0))}
    edges = [(ids[tuple(triangle[i])], ids[tuple(triangle[i - 1])]) for triangle in vertices for i in range(3)]
    assert len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges)
    volume = np.einsum("ij,ij->i", vertices[:, 0], np.cross(vertices[:, 1], vertices[:, 2])).sum() / 6
    wedge = 0.5 * (car.LENGTH - car.EDGE) ** 2 * np.tan(np.radians(car.SLANT)) * 2 * car.HALF_WIDTH
    box = car.LENGTH * 2 * car.HALF_WIDTH * (car.TOP - 0.05)
    assert 0.93 * (box - wedge) < volume < box - wedge  # the nose is rounded
    assert vertices[..., 2].min() == pytest.approx(0.05, abs=1e-9)
    for (x, y, z), _ in car.places().values():
        assert np.linalg.norm(vertices - [x, y, z], axis=-1).min() < car.PATCH, "a handle is away from the body"


def test_methods_have_the_same_variables():
    setups = {method: car.setup(method) for method in channel.METHODS}
    of_rbf = setups["rbf"]["variables"]
    assert len(of_rbf) == 23 and len({variable["name"] for variable in of_rbf}) == 23
    for setup in setups.values():
        assert setup["variables"] == of_rbf and setup["symmetry"] == [{"region": {"group": "middle"}}]
        assert {handle["name"] for handle in setup["handles"]} == {variable["handle"] for variable in of_rbf}


def test_groups_of_control_points_leave_the_ground():
    """A cubic spline reaches two cells: those of a layer at less than that would move the ground, which the flow takes for plane."""
    seen = set()
    for handle in car.setup("ffd")["handles"]:
        for region in handle["region"]["union"]:
            i, j, k = (region["lattice"][axis][0] for axis in "ijk")
            assert car.BOX[0][2] + car.CELL * (k - 1) >= 2 * car.CELL - 1e-12
            assert (i, j, k) not in seen, "two handles move one control point"
            seen.add((i, j, k))
