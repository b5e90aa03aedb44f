# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes from files, arrays and objects of other libraries, and files written again."""

import os
import types

import numpy as np
import pytest

import deformd
from conftest import brick
from harness import read_obj


def test_files_and_arrays_are_the_same_geometry(case, client):
    file = client.register(case.mesh)
    sizes, corners = file.faces
    points, _ = read_obj(str(case.mesh))
    np.testing.assert_array_equal(file.points, points)
    assert set(sizes) == {3} and file.info.faces == len(sizes) and not file.points.flags.writeable
    groups = {name: {"points": ids, "faces": faces} for name, (ids, faces) in file.groups.items()}
    again = client.register((np.array(points), corners.reshape(-1, 3), groups))
    assert again.id == file.id and again.info.existed and again.info.name == "ahmed.obj"
    assert client.register((points, corners.reshape(-1, 3).tolist()), groups=groups).id == file.id


def test_progress_of_an_upload(case, client):
    seen = []
    points, hexahedra = brick((40, 40, 30))
    client.register((points + 0.125, {"hexahedron": hexahedra}), progress=lambda stage, fraction: seen.append((stage, fraction)))
    assert seen and all(stage == "upload" for stage, _ in seen) and [f for _, f in seen] == sorted(f for _, f in seen)


def test_faces_of_several_sizes(client):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 2, 0]])
    geometry = client.register((points, [[0, 1, 2, 3], [3, 2, 4]], {"roof": {"faces": [1]}, "floor": [0, 1]}))
    np.testing.assert_array_equal(geometry.faces[0], [4, 3])
    np.testing.assert_array_equal(geometry.faces[1], [0, 1, 2, 3, 3, 2, 4])
    np.testing.assert_array_equal(geometry.groups["roof"][1], [1])
    np.testing.assert_array_equal(geometry.groups["floor"][0], [0, 1])
    flat = client.register((points[:, :2], [[0, 1, 2, 3], [3, 2, 4]]))
    np.testing.assert_array_equal(flat.points, points)


def test_cells(client):
    points, hexahedra = brick()
    geometry = client.register((points, {"hexahedron": hexahedra}))
    assert geometry.info.cells == 36 and geometry.info.faces == 2 * (4 * 3 + 4 * 3 + 3 * 3)
    tetra = client.register((points[[0, 1, 5, 20]], {"tetra": [[0, 1, 2, 3]], "triangle": [[0, 2, 1]]}))
    assert tetra.info.cells == 1 and tetra.info.faces == 1


@pytest.mark.parametrize("mesh, message", [
    (np.zeros((4, 3)), "expected a path"),
    (([[0, 0, 0]],), "a tuple of 1"),
    ((np.zeros((3, 4)), [[0, 1, 2]]), r"points: .*\(3, 4\)"),
    ((np.eye(3), np.zeros((2, 2, 2), int)), r"faces: an array of shape \(2, 2, 2\)"),
    ((np.eye(3), [[0.0, 1.0, 2.0]]), "faces: numbers of type float64"),
    ((np.eye(3), [[0, 1, -2]]), "faces: entry 2 is -2"),
    ((np.eye(3), [[0, 1, 3]]), "3"),
    ((np.full((3, 3), np.nan), [[0, 1, 2]]), r"points\[0\]: coordinate x is not a finite number"),
    ((np.eye(3), {"hexagon": [[0, 1, 2]]}), '"hexagon" is not taken'),
    ((np.eye(3), {"tetra": [[0, 1, 2]]}), "element_points ends before"),
    ((np.eye(3), [[0, 1, 2]], {"a": {"cells": [0]}}), r"\['cells'\]"),
    ((np.eye(3), [[0, 1, 2]], {"a": [7]}), "7"),
])
def test_what_is_no_mesh(client, mesh, message):
    with pytest.raises(deformd.InvalidArgument, match=f"(?i){message}"):
        client.register(mesh)


def test_an_object_like_those_of_meshio(client):
    points, hexahedra = brick()
    block = lambda kind, data: types.SimpleNamespace(type=kind, data=np.asarray(data))  # noqa: E731
    mesh = types.SimpleNamespace(
        points=points, cells=[block("vertex", [[0]]), block("triangle", [[0, 1, 6]]), block("quad", [[1, 2, 7, 6], [2, 3, 8, 7]]),
                              block("hexahedron", hexahedra)],
        point_sets={"corner": np.array([0, 4])},
        cell_sets={"wall": [None, None, np.array([1]), None], "first": [None, None, None, np.array([0])], "none": [None] * 4})
    geometry = client.register(mesh)
    assert geometry.info.cells == 36 and geometry.info.faces == 3
    assert set(geometry.groups) == {"corner", "wall", "first"}
    np.testing.assert_array_equal(geometry.groups["wall"][1], [2])
    np.testing.assert_array_equal(geometry.groups["first"][0], np.sort(hexahedra[0]))


def test_meshes_of_meshio_itself(case, client):
    import meshio

    points, hexahedra = brick()
    mesh = meshio.Mesh(points, [("quad", [[0, 1, 6, 5]]), ("hexahedron", hexahedra)], point_sets={"corner": [0, 4]},
                       cell_sets={"wall": [np.array([0]), np.array([], int)]})
    taken = client.register(mesh)
    by_hand = client.register((points, {"quad": [[0, 1, 6, 5]], "hexahedron": hexahedra}, {"corner": [0, 4], "wall": {"faces": [0]}}))
    assert taken.id == by_hand.id
    meshio.write(case.folder / "brick.vtk", meshio.Mesh(points, [("hexahedron", hexahedra)]))
    assert client.register(meshio.read(case.folder / "brick.vtk")).id == client.register(case.folder / "brick.vtk").id


def test_objects_like_those_of_pyvista(client):
    points, hexahedra = brick()
    surface = types.SimpleNamespace(points=points.astype(np.float32), faces=np.array([3, 0, 1, 6, 4, 1, 2, 7, 6]))
    geometry = client.register(surface)
    np.testing.assert_array_equal(geometry.faces[0], [3, 4])
    np.testing.assert_array_equal(geometry.faces[1], [0, 1, 6, 1, 2, 7, 6])
    cells = np.hstack([np.full((36, 1), 8), hexahedra]).ravel()
    grid = types.SimpleNamespace(points=points, cells=cells, celltypes=np.full(36, 12))
    assert client.register(grid).id == client.register((points, {"hexahedron": hexahedra})).id
    grid.celltypes[3] = 42
    with pytest.raises(deformd.InvalidArgument, match="VTK's type 42"):
        client.register(grid)


def test_a_new_file_from_arrays(case, client):
    points = np.array([[0, 0, 0], [1, 0, 0.1], [1, 1, 0], [0, 1, 0]])
    geometry = client.register((points, [[0, 1, 2], [0, 2, 3]]))
    geometry.write(case.folder / "new.obj", points + 0.1)
    np.testing.assert_array_equal(read_obj(str(case.folder / "new.obj"))[0], points + 0.1)
    for wrong, message in [(points[1:], "points: 3, the geometry has 4"), (points + np.inf, "finite"), (points[:, :2], r"\(4, 2\)")]:
        with pytest.raises(deformd.InvalidArgument, match=message):
            geometry.write(case.folder / "wrong.obj", wrong)
        assert not (case.folder / "wrong.obj").exists()


def test_the_source_is_not_replaced_by_accident(case, client):
    content = case.mesh.read_bytes()
    geometry = client.register(case.mesh)
    link = case.folder / "link.obj"
    os.symlink(case.mesh, link)
    for path in (case.mesh, link):
        with pytest.raises(deformd.FailedPrecondition, match="would replace"):
            geometry.write(path, geometry.points + 1)
    assert case.mesh.read_bytes() == content
    geometry.write(case.mesh, geometry.points, overwrite_source=True)
    assert case.mesh.read_bytes() == content


def test_a_geometry_of_the_server(case, client):
    registered = client.register(case.mesh)
    with deformd.Client(case.server.address) as other:
        found = other.geometry(registered.id[:12])
        np.testing.assert_array_equal(found.points, registered.points)
        with pytest.raises(deformd.FailedPrecondition, match="register its mesh again"):
            found.write(case.folder / "never.obj", registered.points)


def test_damaged_files_are_read_in_a_process_of_their_own(case, client):
    """A netCDF-4 file by its signature, with nothing behind it."""
    path = case.folder / "damaged.exo"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(4000))
    with pytest.raises(deformd.InvalidArgument, match=r"damaged\.exo"):
        client.register(path)
