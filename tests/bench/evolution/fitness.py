# SPDX-License-Identifier: GPL-3.0-or-later
"""The fitness of one design: of the study's command, in the folder of the design, a copy of the template.

usage: fitness.py POINTS RESULT
  POINTS   the folder that has polyMesh/points of the design
  RESULT   JSON: fitness = drag + weight / size, drag (the coefficient), and the size of the body: area (in the plane) or volume

The template has outline.json, ids of the points around the body, or body.json, those of its faces.

The flow starts from that of the body at rest, which is in the template: the cells are the same. Only the standard library is needed, so that
starting Python costs nothing beside the solver.
"""
import json
import os
import shutil
import subprocess
import sys

WEIGHT = 0.82
"""The weight of the area. What is gained at the start by growing or shrinking the body as a whole is nothing."""
VOLUME_WEIGHT = 0.024
"""That of the volume of half a car, likewise."""
SETTLED, CAR_SETTLED, LAST = 1e-4, 5e-4, 5
"""The drag may change by this part over the last iterations: what is above, an optimizer would chase. That of a car swings more, and differs more
between designs."""


def area_of(points_file, outline):
    """The area of the polygon of the points with the ids `outline`, counterclockwise. points_file has a point per line, as blockMesh and deformd write it."""
    places = places_of(points_file)
    corners = [(float(places[i][0]), float(places[i][1])) for i in outline]
    return sum(x * v - u * y for (x, y), (u, v) in zip(corners, corners[1:] + corners[:1])) / 2


def volume_of(points_file, faces):
    """The volume of the body between the plane y = 0 and its faces, ids of their corners, whose normals lead into it: that of the triangles from the first
    corner of each face."""
    places = places_of(points_file)
    total = 0.0
    for face in faces:
        corners = [tuple(map(float, places[i])) for i in face]
        (x, y, z) = corners[0]
        for (a, b, c), (u, v, w) in zip(corners[1:], corners[2:]):
            normal = (c - z) * (u - x) - (a - x) * (w - z)  # its component along y, twice the area that the triangle has in that plane
            total -= normal / 2 * (y + b + v) / 3
    return total


def places_of(points_file):
    """The words of each line of a points file."""
    with open(points_file) as file:
        for line in file:
            if line.strip() == "(":
                break
        return [line.strip("()\n").split() for line in file]


def drag_of(case, settled=SETTLED):
    """The coefficient after the last iteration; ends the program where it has changed by more than `settled` of it over the last ones."""
    with open(os.path.join(case, "postProcessing/forces/0/coefficient.dat")) as file:
        history = [float(line.split()[1]) for line in file if not line.startswith("#")]
    change = abs(history[-1] - history[-1 - LAST])
    if not change <= settled * abs(history[-1]):
        sys.exit(f"the drag still changes by {change:.2g} in {LAST} iterations")
    return history[-1]


def main(points, result):
    moved = "constant/polyMesh/points"
    os.replace(os.path.join(points, "polyMesh/points"), moved)
    plane = os.path.exists("outline.json")
    with open("outline.json" if plane else "body.json") as file:
        size = (area_of if plane else volume_of)(moved, json.load(file))
    what, weight, settled = ("area", WEIGHT, SETTLED) if plane else ("volume", VOLUME_WEIGHT, CAR_SETTLED)
    if size <= 0:
        sys.exit(f"the body has the {what} {size:.3g}")
    os.environ.setdefault("WM_PROJECT_DIR", "/usr/share/openfoam")  # that of Debian
    with open("log", "w") as log:
        if subprocess.run(["simpleFoam"], stdout=log, stderr=log).returncode != 0:
            sys.exit("simpleFoam failed: " + open("log").read()[-500:])
    drag = drag_of(".", settled)
    with open(result, "w") as file:
        json.dump({"fitness": drag + weight / size, "drag": drag, what: size}, file)
    for folder in ("0", "constant", "system", "postProcessing", points):  # thousands of cases would fill the disk
        shutil.rmtree(folder)
    os.remove("log")


if __name__ == "__main__":
    main(*sys.argv[1:])
