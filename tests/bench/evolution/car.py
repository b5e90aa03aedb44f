# SPDX-License-Identifier: GPL-3.0-or-later
"""The car of thesis chapter 5, once: half an Ahmed body over a moving ground, about 24,000 cells, turbulent; the methods of channel.py with 23
variables each, which move the back.

Makes the template of a design (OpenFOAM, with snappyHexMesh), the setups and the files of the studies. Needs `deform` in DEFORM_BIN.
"""
import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import tempfile

import numpy as np

import channel

HERE = pathlib.Path(__file__).resolve().parent
LENGTH, HALF_WIDTH, TOP = 1.044, 0.1945, 0.338
EDGE, SLANT = 0.843, 25
"""Where the roof ends, and by how many degrees it falls from there."""
STATIONS = (0.60, 0.75, 0.90, LENGTH)
PATCH = 0.022
"""Half of the boxes around the places of handles: the cells of the body have this side."""
BOUND = 0.04
CELL, BOX = 0.08, ((0.12, -0.64, 0.0), (1.64, 0.64, 0.8))
"""The lattice: its cells, and its corners. It surrounds the whole car."""
ITERATIONS = 60


def make(folder):
    """Makes in FOLDER a setup per method and, unless it is there, the folder `template`: what a design starts from, with the settled flow around
    the body at rest."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for method in channel.METHODS:
        (folder / f"{method}.yaml").write_text(json.dumps(setup(method), indent=1))  # JSON is YAML
    case = folder / "template"
    if (case / "body.json").exists():
        return
    shutil.rmtree(case, ignore_errors=True)
    shutil.copytree(HERE / "car_case", case)
    (case / "constant/triSurface").mkdir()
    write_body(case / "constant/triSurface/body.stl")
    for command in (["blockMesh"], ["snappyHexMesh", "-overwrite"]):
        done = subprocess.run(command, cwd=case, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{command[0]} ended with {done.returncode}:\n{done.stdout[-2000:]}")
    channel.solve(case, 1000, write=True)
    for field in ("U", "p", "k", "omega", "nut"):
        os.replace(case / "1000" / field, case / "0" / field)
    shutil.rmtree(case / "1000")
    shutil.rmtree(case / "postProcessing")
    shutil.rmtree(case / "constant/triSurface")
    for name in ("cellLevel", "pointLevel", "level0Edge", "surfaceIndex", "cellZones", "faceZones", "pointZones"):
        (case / "constant/polyMesh" / name).unlink(missing_ok=True)
    (case / "log").unlink()
    shutil.copy(HERE / "fitness.py", case)
    channel.limit(case, ITERATIONS, write=False)
    (case / "body.json").write_text(json.dumps(body_faces(case)))  # last: it says that all is there


def write_body(path):
    """Writes the Ahmed body of `deform sample` without its stilts as STL, closed where they stood."""
    with tempfile.TemporaryDirectory() as work:
        sample = pathlib.Path(work) / "ahmed.obj"
        subprocess.run([os.environ["DEFORM_BIN"], "sample", "-o", str(sample), "--slant", str(SLANT), "--points", "20000"], check=True, stdout=subprocess.DEVNULL)
        points, triangles, group = [], [], None
        for line in sample.read_text().splitlines():
            kind, *words = line.split() or [""]
            if kind == "v":
                points.append([float(word) for word in words[:3]])
            elif kind == "g":
                group = words[0]
            elif kind == "f" and group != "stilts":
                triangles.append([int(word.split("/")[0]) - 1 for word in words])
    edges = {(a, b) for triangle in triangles for a, b in zip(triangle, triangle[1:] + triangle[:1])}
    following = {b: a for a, b in edges if (b, a) not in edges}  # around the holes, the other way
    while following:
        first, last = following.popitem()
        loop = [first, last]
        while (last := following.pop(last)) != first:
            loop.append(last)
        triangles += [[loop[0], b, c] for b, c in zip(loop[1:], loop[2:])]
    facets = "".join("facet normal 0 0 0\nouter loop\n" + "".join("vertex %.9g %.9g %.9g\n" % tuple(points[i]) for i in triangle) + "endloop\nendfacet\n"
                     for triangle in triangles)
    path.write_text(f"solid body\n{facets}endsolid body\n")


def body_faces(case):
    """Ids of the corners of the faces of the body, as the mesh has them: seen from inside the fluid, so outwards of it and into the body."""
    mesh = case / "constant/polyMesh"
    found = re.search(r"body\s*\{[^}]*nFaces\s+(\d+);\s*startFace\s+(\d+);", (mesh / "boundary").read_text())
    count, start = map(int, found.groups())
    faces = re.findall(r"^\d+\(([\d ]+)\)$", (mesh / "faces").read_text(), re.MULTILINE)[start:start + count]
    return [list(map(int, corners.split())) for corners in faces]


def height(x):
    """The height of the roof and the slant."""
    return TOP - max(0.0, x - EDGE) * math.tan(math.radians(SLANT))


def places():
    """{name of a handle: (place, axes that its variables move it along)}, 23 variables in all. The last station has the axis of the car, too."""
    found = {}
    for number, x in enumerate(STATIONS, 1):
        along = "x" if x == LENGTH else ""
        found[f"middle{number}"] = ((x, 0.0, height(x)), along + "z")
        found[f"roof{number}"] = ((x, 0.1, height(x)), "z")
        found[f"corner{number}"] = ((x, HALF_WIDTH, height(x)), along + "yz")
        found[f"side{number}"] = ((x, HALF_WIDTH, 0.17), along + "y")
    return found


def setup(method):
    """As the YAML file of a setup has it."""
    counts = [round((high - low) / CELL) + 3 for low, high in zip(*BOX)]
    lattice = {"box": {"min": BOX[0], "max": BOX[1]}, "points": counts}
    if method == "ffd":
        regions = _groups(counts)
    else:
        regions = {name: {"intersection": [{"group": "body"}, _box(place, PATCH)]} for name, (place, _) in places().items()}
    variables = [{"name": name + axis, "handle": name, "translate": [float(axis == each) for each in "xyz"], "lower": -BOUND, "upper": BOUND}
                 for name, (_, axes) in places().items() for axis in axes]
    made = {"geometry": "template",
            "method": {"rbf": {"rbf": {"kernel": "TRIHARMONIC"}}, "dm_ffd": {"ffd": {"control": "MESH", "lattice": lattice}},
                       "ffd": {"ffd": {"control": "CONTROLS", "lattice": lattice}}}[method],
            "symmetry": [{"region": {"group": "middle"}}],
            "handles": [{"name": name, "region": region} for name, region in regions.items()], "variables": variables}
    if method == "rbf":
        made["fixed"] = [{"group": group} for group in ("inlet", "outlet", "walls", "ground")]
    elif method == "dm_ffd":  # what the lattice does not reach, and three of its cells at the boundary
        low, high = ([corner + side * 3 * CELL for corner in BOX[side < 0]] for side in (1, -1))
        low[2] = 0.01  # and the ground
        made["fixed"] = [{"complement": {"box": {"min": low, "max": high}}}]
    return made


def _box(place, half):
    return {"box": {"min": [each - half for each in place], "max": [each + half for each in place]}}


def _groups(counts):
    """Control points of the back around each place: each belongs to the nearest, if it is within two cells, and does not reach the ground."""
    groups = {name: [] for name in places()}
    for i in range(counts[0]):
        for j in range(counts[1]):
            for k in range(counts[2]):
                at = [low + CELL * (index - 1) for low, index in zip(BOX[0], (i, j, k))]
                if at[1] < -CELL / 2 or at[2] < 2 * CELL - 1e-9:
                    continue
                distances = {name: math.dist(at, place) for name, (place, _) in places().items()}
                nearest = min(distances, key=distances.get)
                if distances[nearest] <= 1.5 * CELL:
                    groups[nearest].append({"lattice": {"i": [i, i], "j": [j, j], "k": [k, k]}})
    return {name: {"union": regions} for name, regions in groups.items()}


def study(folder, method, generations):
    """Writes the file of a study in FOLDER and returns its path: the (2,15) strategy of the thesis, one run."""
    path = pathlib.Path(folder) / f"{method}-1.yaml"
    path.write_text(f"""setup: {method}.yaml
seed: 1
evaluate: {{command: "python3 -I -S fitness.py {{points}} {{result}}", template: template, timeout: 600}}
minimize: fitness
optimizer: {{cma: {{sigma: 0.1, popsize: 15, CMA_mu: 2, CMA_active: false}}}}
budget: {15 * generations}
place: {{threads: 2}}
""")
    return path
