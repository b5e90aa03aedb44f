# SPDX-License-Identifier: GPL-3.0-or-later
"""The fitness of fitness.py with its gradient at the points, by the adjoint solver of OpenFOAM; for the `function` of a study.

Beside this file stand the template and the folder `adjoint`, what a case needs in addition to it.
"""
import json
import os
import pathlib
import re
import shutil
import tempfile

import numpy as np

import channel
import fitness as plain

HERE = pathlib.Path.cwd()


def fitness(points, variables, report):
    """({"fitness", "drag", "area"}, {"fitness": gradient}). points (n, 3); the gradient as well, zero but on the body."""
    base = pathlib.Path(__file__).resolve().parent
    with tempfile.TemporaryDirectory() as folder:
        case = pathlib.Path(folder) / "case"
        shutil.copytree(base / "template", case)
        channel.write_points(case / "constant/polyMesh/points", points)
        channel.solve(case, channel.ITERATIONS, write=True)
        drag = plain.drag_of(case)
        for field in ("U", "p"):
            os.replace(case / str(channel.ITERATIONS) / field, case / "0" / field)
        shutil.rmtree(case / str(channel.ITERATIONS))
        shutil.copytree(base / "adjoint", case, dirs_exist_ok=True)
        channel.solve(case, 2000, write=True, program="adjointOptimisationFoam")
        last = max((entry for entry in case.iterdir() if entry.name.isdigit()), key=lambda entry: int(entry.name))
        slope = channel.read_field(last / "pointSensVecdragESI")
    ids = np.array(json.loads((base / "template/outline.json").read_text()))
    area, slope_of_area = area_and_slope(points, ids)
    return ({"fitness": drag + plain.WEIGHT / area, "drag": drag, "area": area}, {"fitness": slope - plain.WEIGHT / area**2 * slope_of_area})


def area_and_slope(points, outline):
    """The area of the polygon of the points `outline`, and its gradient at all points."""
    here = points[outline]
    before, after = np.roll(here, 1, axis=0), np.roll(here, -1, axis=0)
    slope = np.zeros_like(points)
    slope[outline, 0] = (after[:, 1] - before[:, 1]) / 2
    slope[outline, 1] = (before[:, 0] - after[:, 0]) / 2
    return float(np.sum(here[:, 0] * after[:, 1] - after[:, 0] * here[:, 1])) / 2, slope
