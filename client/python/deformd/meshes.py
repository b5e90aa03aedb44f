# SPDX-License-Identifier: Apache-2.0
"""Meshes from arrays, and from objects of meshio and PyVista, which need not be installed."""

from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple

import numpy as np

from . import _deformd
from .errors import InvalidArgument

# Names of meshio -> numbers of ElementType (core/mesh/elements.h), of those whose nodes stand in the same order.
_ELEMENTS = {"tetra": 0, "pyramid": 1, "wedge": 2, "hexahedron": 3, "tetra10": 4}
_FACES = {"triangle": 3, "quad": 4}
_SKIPPED = {"vertex", "line", "line3"}
_VTK_NAMES = {1: "vertex", 3: "line", 5: "triangle", 7: "polygon", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid", 24: "tetra10"}

_Block = Tuple[str, np.ndarray]


def mesh_from(source: Any, groups: Optional[Mapping[str, Any]] = None) -> "_deformd.Mesh":
    """The mesh of `Client.register`: (points, faces), (points, faces, groups), or an object with points and cells or faces."""
    if isinstance(source, tuple):
        if not 2 <= len(source) <= 3:
            raise InvalidArgument(f"mesh: a tuple of {len(source)}, expected (points, faces) or (points, faces, groups)")
        named = dict(source[2]) if len(source) == 3 else {}
        return _mesh(source[0], _blocks_of(source[1]), {**named, **(groups or {})})
    points = getattr(source, "points", None)
    if points is None:
        raise InvalidArgument(f"mesh: {type(source).__name__}, expected a path, (points, faces), or an object with points and cells or faces")
    if hasattr(source, "celltypes"):  # an unstructured grid of PyVista
        return _mesh(points, _vtk_blocks(np.asarray(source.cells), np.asarray(source.celltypes)), dict(groups or {}))
    if hasattr(source, "cell_sets"):  # a mesh of meshio
        blocks = [(block.type, np.asarray(block.data)) for block in source.cells]
        return _mesh(points, blocks, {**_meshio_groups(source, blocks), **(groups or {})})
    if hasattr(source, "faces"):  # a surface of PyVista: sizes and corners, one face after the other
        return _mesh(points, _polygons(np.asarray(source.faces)), dict(groups or {}))
    raise InvalidArgument(f"mesh: {type(source).__name__} has points, but neither cells nor faces")


def _blocks_of(faces: Any) -> List[_Block]:
    """Faces as an array (f, k) or as lists of any lengths; or a mapping of names of cells to arrays (c, nodes)."""
    if isinstance(faces, Mapping):
        return [(str(name), np.asarray(cells)) for name, cells in faces.items()]
    if isinstance(faces, np.ndarray) or len({len(face) for face in faces}) == 1:
        corners = np.asarray(faces)
        if corners.ndim != 2:
            raise InvalidArgument(f"faces: an array of shape {corners.shape}, expected (f, corners)")
        return [("polygon", corners)]
    return [("polygon", np.asarray(face).reshape(1, -1)) for face in faces]


def _polygons(faces: np.ndarray) -> List[_Block]:
    return [("polygon", corners.reshape(1, -1)) for corners in _split(faces)] if len(set(_sizes(faces))) > 1 else [
        ("polygon", faces.reshape(-1, int(faces[0]) + 1)[:, 1:])] if len(faces) else []


def _sizes(flat: np.ndarray) -> Iterator[int]:
    at = 0
    while at < len(flat):
        yield int(flat[at])
        at += int(flat[at]) + 1


def _split(flat: np.ndarray) -> Iterator[np.ndarray]:
    at = 0
    for size in _sizes(flat):
        yield flat[at + 1:at + 1 + size]
        at += size + 1


def _vtk_blocks(cells: np.ndarray, types: np.ndarray) -> List[_Block]:
    blocks: List[Tuple[str, List[np.ndarray]]] = []
    for kind, nodes in zip(types, _split(cells)):
        name = _VTK_NAMES.get(int(kind))
        if name is None:
            raise InvalidArgument(f"celltypes: cells of VTK's type {int(kind)} are not taken from arrays; write the mesh to a file and register that")
        if blocks and blocks[-1][0] == name and len(blocks[-1][1][0]) == len(nodes):
            blocks[-1][1].append(nodes)
        else:
            blocks.append((name, [nodes]))
    return [(name, np.array(block)) for name, block in blocks]


def _is_face(name: str) -> bool:
    return name in _FACES or name.startswith("polygon")


def _meshio_groups(mesh: Any, blocks: List[_Block]) -> Dict[str, Any]:
    """Sets of points; sets of cells as faces where they are faces, else as the points of the cells."""
    groups: Dict[str, Dict[str, np.ndarray]] = {}
    for name, ids in (getattr(mesh, "point_sets", None) or {}).items():
        groups.setdefault(name, {})["points"] = np.asarray(ids)
    for name, members in (mesh.cell_sets or {}).items():
        first_face = 0
        faces: List[np.ndarray] = []
        points: List[np.ndarray] = [groups.get(name, {}).get("points", np.empty(0, dtype=np.int64))]
        for (kind, data), ids in zip(blocks, members):
            chosen = np.asarray(ids if ids is not None else [], dtype=np.int64)
            if _is_face(kind):
                faces.append(chosen + first_face)
                first_face += len(data)
            else:
                points.append(np.unique(data[chosen]))
        groups[name] = {"points": np.unique(np.concatenate(points)), "faces": np.concatenate(faces) if faces else np.empty(0, dtype=np.int64)}
    return {name: group for name, group in groups.items() if any(len(ids) for ids in group.values())}


def _ids(values: Any, what: str) -> np.ndarray:
    array = np.asarray(values)
    if array.size == 0:
        return np.empty(0, dtype=np.uint32)
    if array.dtype.kind not in "iu":
        raise InvalidArgument(f"{what}: numbers of type {array.dtype}, expected integers from 0 to 4294967295")
    flat = array.reshape(-1)
    wrong = np.flatnonzero((flat < 0) | (flat > 0xFFFFFFFF)) if array.dtype != np.uint32 else ()
    if len(wrong):
        raise InvalidArgument(f"{what}: entry {wrong[0]} is {flat[wrong[0]]}, expected an integer from 0 to 4294967295")
    return np.ascontiguousarray(flat, dtype=np.uint32)


def _groups(groups: Mapping[str, Any]) -> List[Tuple[str, np.ndarray, np.ndarray]]:
    result = []
    for name, members in groups.items():
        given = members if isinstance(members, Mapping) else {"points": members}
        unknown = set(given) - {"points", "faces"}
        if unknown:
            raise InvalidArgument(f'groups: group "{name}" has {sorted(unknown)}, expected "points", "faces" or both')
        result.append((str(name), _ids(given.get("points", ()), f'groups: points of "{name}"'), _ids(given.get("faces", ()), f'groups: faces of "{name}"')))
    return result


def _mesh(points: Any, blocks: List[_Block], groups: Mapping[str, Any]) -> "_deformd.Mesh":
    coordinates = np.asarray(points, dtype=np.float64)
    if coordinates.ndim == 2 and coordinates.shape[1] == 2:  # a mesh in the plane
        coordinates = np.column_stack([coordinates, np.zeros(len(coordinates))])
    sizes, corners, types, nodes = [], [], [], []
    for name, cells in blocks:
        if name in _SKIPPED:
            continue
        if cells.ndim != 2:
            raise InvalidArgument(f"cells: {name} has shape {cells.shape}, expected (cells, nodes)")
        if _is_face(name):
            sizes.append(np.full(len(cells), cells.shape[1], dtype=np.uint32))
            corners.append(_ids(cells, "faces"))
        elif name in _ELEMENTS:
            types.append(np.full(len(cells), _ELEMENTS[name], dtype=np.uint8))
            nodes.append(_ids(cells, f"cells: {name}"))
        else:
            raise InvalidArgument(f'cells: "{name}" is not taken from arrays, only {", ".join([*_FACES, *_ELEMENTS])}; write the mesh to a file and register that')
    return _deformd.Mesh.from_arrays(coordinates, _joined(sizes, np.uint32), _joined(corners, np.uint32), _groups(groups), _joined(types, np.uint8), _joined(nodes, np.uint32))


def _joined(parts: List[np.ndarray], kind: Any) -> np.ndarray:
    return np.concatenate(parts) if parts else np.empty(0, dtype=kind)
