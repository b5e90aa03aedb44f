# SPDX-License-Identifier: GPL-3.0-or-later
"""The case of thesis chapter 5 in the small: a round body in a channel, laminar flow at Re 40, three methods with 23 variables each.

Makes the template of a design (OpenFOAM), the setups of RBF, DM-FFD and FFD, and the files of the studies. Needs blockMesh and simpleFoam of
OpenFOAM (Debian: openfoam), found in PATH; WM_PROJECT_DIR is set to where Debian has them unless it is set.
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

HERE = pathlib.Path(__file__).resolve().parent
METHODS = {"rbf": "RBF", "dm_ffd": "DM-FFD", "ffd": "FFD"}
RADIUS = 0.5
PLACES = range(15, 360, 30)
"""Degrees around the body, 0 downstream: what each handle is at."""
FRONT = (165, 195)
"""These two share the variable along the channel, which leaves 23 of 24 and keeps the body from travelling at no cost."""
BOUND = 0.2
CELL, REACH, LATTICE = 0.25, 1.1, 1.875
"""The lattice: its cells, how far from the centre control points move, and half of its width."""
ITERATIONS = 50

os.environ.setdefault("WM_PROJECT_DIR", "/usr/share/openfoam")


def openfoam():
    """Whether OpenFOAM is there."""
    return all(shutil.which(program) for program in ("blockMesh", "simpleFoam", "adjointOptimisationFoam"))


def solve(case, iterations, write=False, program="simpleFoam"):
    """Runs the solver from the fields in `case`/0, and writes the last fields if asked to. Raises RuntimeError with the end of its log."""
    limit(case, iterations, write)
    shutil.rmtree(case / "postProcessing", ignore_errors=True)
    done = subprocess.run([program], cwd=case, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    (case / "log").write_text(done.stdout)
    if done.returncode != 0:
        raise RuntimeError(f"{program} in {case} ended with {done.returncode}:\n{done.stdout[-2000:]}")


def limit(case, iterations, write):
    control = case / "system/controlDict"
    text = re.sub(r"endTime \d+;", f"endTime {iterations};", control.read_text())
    control.write_text(re.sub(r"writeInterval \d+; writePrecision", f"writeInterval {iterations if write else 10**6}; writePrecision", text))


def drags(case):
    """The drag coefficient after each iteration."""
    with open(case / "postProcessing/forces/0/coefficient.dat") as file:
        return np.array([float(line.split()[1]) for line in file if not line.startswith("#")])


def make(folder):
    """Makes in FOLDER a setup per method, what the fitness with gradients needs beside its study, and, unless it is there, the folder `template`:
    what a design starts from, with the settled flow around the body at rest."""
    folder = pathlib.Path(folder)
    for name in ("channel.py", "fitness.py", "gradient.py"):
        shutil.copy(HERE / name, folder)
    shutil.copytree(HERE / "adjoint", folder / "adjoint", dirs_exist_ok=True)
    for method in METHODS:
        (folder / f"{method}.yaml").write_text(json.dumps(setup(method), indent=1))  # JSON is YAML
    case = folder / "template"
    if (case / "outline.json").exists():
        return
    shutil.rmtree(case, ignore_errors=True)
    shutil.copytree(HERE / "case", case)
    subprocess.run(["blockMesh"], cwd=case, stdout=subprocess.DEVNULL, check=True)
    solve(case, 500, write=True)
    for field in ("U", "p"):
        os.replace(case / "500" / field, case / "0" / field)
    shutil.rmtree(case / "500")
    shutil.rmtree(case / "postProcessing")
    (case / "log").unlink()
    shutil.copy(HERE / "fitness.py", case)
    limit(case, ITERATIONS, write=False)
    (case / "outline.json").write_text(json.dumps(outline(read_points(case / "constant/polyMesh/points")).tolist()))  # last: it says that all is there


def read_points(path):
    """(n, 3) of a points file as blockMesh writes it."""
    text = path.read_text()
    return np.array(re.findall(r"^\((\S+) (\S+) (\S+)\)$", text, re.MULTILINE), dtype=float)


def write_points(path, points):
    """Writes the points (n, 3) into a points file that has as many."""
    rows = iter("(%.17g %.17g %.17g)" % tuple(point) for point in points)
    path.write_text(re.sub(r"^\(\S+ \S+ \S+\)$", lambda _: next(rows), path.read_text(), flags=re.MULTILINE))


def read_field(path):
    """The values of a field of vectors inside, (n, 3)."""
    text = path.read_text()
    return np.array(re.findall(r"^\((\S+) (\S+) (\S+)\)$", text[:text.index("boundaryField")], re.MULTILINE), dtype=float)


def plane_cells(case):
    """(corners, cells): the four corners of each cell in the plane of the lower z, (c, 4), and which cell they belong to, (c,)."""
    mesh = case / "constant/polyMesh"
    points = read_points(mesh / "points")
    faces = [list(map(int, corners.split())) for corners in re.findall(r"^4\(([\d ]+)\)$", (mesh / "faces").read_text(), re.MULTILINE)]
    owner = list(map(int, re.findall(r"^\d+$", (mesh / "owner").read_text(), re.MULTILINE)[1:]))
    found = [i for i, corners in enumerate(faces) if (points[corners, 2] < 0).all()]
    return np.array([faces[i] for i in found]), np.array([owner[i] for i in found])


def outline(rest):
    """Ids of the points around the body in the plane of the lower z, counterclockwise."""
    ids = np.flatnonzero((np.hypot(rest[:, 0], rest[:, 1]) < RADIUS * 1.0001) & (rest[:, 2] < 0))
    return ids[np.argsort(np.arctan2(rest[ids, 1], rest[ids, 0]))]


def setup(method):
    """As the YAML file of a setup has it."""
    count = round(2 * LATTICE / CELL) + 3
    lattice = {"box": {"min": [-LATTICE, -LATTICE, -0.1], "max": [LATTICE, LATTICE, 0.1]}, "points": [count, count, 4]}
    if method == "ffd":
        regions = _groups(count)
    else:
        regions = {place: {"intersection": [{"group": "body"}, _box(*_at(place), 0.01)]} for place in PLACES}
    variables = []
    for place in PLACES:
        for axis, name in enumerate("xy"):
            if (name, place) == ("x", FRONT[1]):
                continue
            variable = {"name": f"{name}{place}", "handle": f"at{place}", "translate": [float(axis == 0), float(axis == 1), 0.0], "lower": -BOUND,
                        "upper": BOUND}
            if (name, place) == ("x", FRONT[0]):
                variable["also"] = [{"handle": f"at{FRONT[1]}"}]
            variables.append(variable)
    made = {"geometry": "template",
            "method": {"rbf": {"rbf": {"kernel": "TRIHARMONIC"}}, "dm_ffd": {"ffd": {"control": "MESH", "lattice": lattice}},
                       "ffd": {"ffd": {"control": "CONTROLS", "lattice": lattice}}}[method],
            "handles": [{"name": f"at{place}", "region": region} for place, region in regions.items()], "variables": variables}
    if method == "rbf":
        made["fixed"] = [{"group": group} for group in ("inlet", "outlet", "walls")]
    elif method == "dm_ffd":  # what the lattice does not reach, and three of its cells at the boundary
        made["fixed"] = [{"complement": _box(0, 0, LATTICE - 3 * CELL)}]
    return made


def _at(place):
    return RADIUS * math.cos(math.radians(place)), RADIUS * math.sin(math.radians(place))


def _box(x, y, half):
    return {"box": {"min": [x - half, y - half, -1], "max": [x + half, y + half, 1]}}


def _groups(count):
    """Control points by sectors of 30 degrees, each around a place, those in the middle of the body left out."""
    groups = {place: [] for place in PLACES}
    along = [-LATTICE + CELL * (i - 1) for i in range(count)]
    for i, x in enumerate(along):
        for j, y in enumerate(along):
            if CELL < math.hypot(x, y) <= REACH:
                groups[int(math.degrees(math.atan2(y, x)) % 360 // 30) * 30 + 15].append({"lattice": {"i": [i, i], "j": [j, j]}})
    return {place: {"union": regions} for place, regions in groups.items()}


def study(folder, method, seed, generations):
    """Writes the file of a study in FOLDER and returns its path: the (2,15) strategy of the thesis."""
    path = pathlib.Path(folder) / f"{method}-{seed}.yaml"
    path.write_text(f"""setup: {method}.yaml
seed: {seed}
evaluate: {{command: "python3 -I -S fitness.py {{points}} {{result}}", template: template, timeout: 120}}
minimize: fitness
optimizer: {{cma: {{sigma: 0.1, popsize: 15, CMA_mu: 2, CMA_active: false}}}}
budget: {15 * generations}
deformation: compiled
place: {{threads: {min(15, os.cpu_count() or 1)}}}
""")
    return path


def gradient_study(folder, budget):
    """Writes the file of the study with gradients in FOLDER and returns its path."""
    path = pathlib.Path(folder) / "gradient-rbf.yaml"
    path.write_text(f"""setup: rbf.yaml
evaluate: {{function: "gradient:fitness"}}
minimize: fitness
optimizer: {{scipy: {{method: trust-constr, initial_tr_radius: 0.25}}}}
budget: {budget}
""")
    return path


def gradient_angle(folder, system, step=2e-3):
    """Degrees between the gradient of the drag by the adjoint solver and central differences, at rest, in the space of the variables."""
    import gradient

    def drag(x):
        with tempfile.TemporaryDirectory(dir=folder) as work:
            case = pathlib.Path(work) / "case"
            shutil.copytree(pathlib.Path(folder) / "template", case)
            write_points(case / "constant/polyMesh/points", system(x))
            solve(case, 6 * ITERATIONS)
            return drags(case)[-1]

    rest = np.zeros(len(system.names))
    by_adjoint = system.vjp(rest, gradient.drag_and_slope(folder, system(rest))[1])
    differences = np.array([(drag(rest + step * direction) - drag(rest - step * direction)) / (2 * step) for direction in np.eye(len(rest))])
    cosine = by_adjoint @ differences / np.linalg.norm(by_adjoint) / np.linalg.norm(differences)
    return float(np.degrees(np.arccos(cosine)))
