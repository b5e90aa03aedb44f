# SPDX-License-Identifier: GPL-3.0-or-later
"""The fitness of one design: of the study's command, in the folder of the design, a copy of the template.

usage: fitness.py POINTS RESULT
  POINTS   the folder that has polyMesh/points of the design
  RESULT   JSON: fitness = drag + WEIGHT / area, drag (the coefficient), area (that of the body in the plane)

The flow starts from that of the body at rest, which is in the template: the cells are the same. Only the standard library is needed, so that
starting Python costs nothing beside the solver.
"""
import json
import os
import shutil
import subprocess
import sys

WEIGHT = 0.82
SETTLED, LAST = 1e-4, 5
"""The drag may change by this part over the last iterations: what is above, an optimizer would chase."""


def area_of(points_file, outline):
    """Of the polygon of the points with the ids `outline`, counterclockwise. points_file has a point per line, as blockMesh and deformd write it."""
    with open(points_file) as file:
        for line in file:
            if line.strip() == "(":
                break
        places = [line.strip("()\n").split() for line in file]
    corners = [(float(places[i][0]), float(places[i][1])) for i in outline]
    return sum(x * v - u * y for (x, y), (u, v) in zip(corners, corners[1:] + corners[:1])) / 2


def drag_of(case):
    """The coefficient after the last iteration; ends the program where it has not settled."""
    with open(os.path.join(case, "postProcessing/forces/0/coefficient.dat")) as file:
        history = [float(line.split()[1]) for line in file if not line.startswith("#")]
    change = abs(history[-1] - history[-1 - LAST])
    if not change <= SETTLED * abs(history[-1]):
        sys.exit(f"the drag still changes by {change:.2g} in {LAST} iterations")
    return history[-1]


def main(points, result):
    os.replace(os.path.join(points, "polyMesh/points"), "constant/polyMesh/points")
    with open("outline.json") as file:
        area = area_of("constant/polyMesh/points", json.load(file))
    if area <= 0:
        sys.exit(f"the body has the area {area:.3g}")
    os.environ.setdefault("WM_PROJECT_DIR", "/usr/share/openfoam")  # that of Debian
    with open("log", "w") as log:
        if subprocess.run(["simpleFoam"], stdout=log, stderr=log).returncode != 0:
            sys.exit("simpleFoam failed: " + open("log").read()[-500:])
    drag = drag_of(".")
    with open(result, "w") as file:
        json.dump({"fitness": drag + WEIGHT / area, "drag": drag, "area": area}, file)
    for folder in ("0", "constant", "system", "postProcessing", points):  # thousands of cases would fill the disk
        shutil.rmtree(folder)
    os.remove("log")


if __name__ == "__main__":
    main(*sys.argv[1:])
