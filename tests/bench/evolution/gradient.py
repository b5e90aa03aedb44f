# SPDX-License-Identifier: GPL-3.0-or-later
"""The fitness of fitness.py with its gradient at the points, by the adjoint solver of OpenFOAM; for the `function` of a study.

Beside this file stand `template` and the folder `adjoint`, what a case needs in addition to it: channel.make() puts them there.
"""
import json
import os
import pathlib
import shutil
import tempfile

import numpy as np

import channel
import fitness as plain


def fitness(points, variables, report):
    """({"fitness", "drag", "area"}, {"fitness": gradient}). points (n, 3); the gradient as well, zero but on the body."""
    folder = pathlib.Path(__file__).resolve().parent
    drag, slope = drag_and_slope(folder, points)
    area, slope_of_area = area_and_slope(points, np.array(json.loads((folder / "template/outline.json").read_text())))
    return ({"fitness": drag + plain.WEIGHT / area, "drag": drag, "area": area}, {"fitness": slope - plain.WEIGHT / area**2 * slope_of_area})


def drag_and_slope(folder, points):
    """The drag coefficient, that of fitness.py, and its gradient at the points (n, 3). Raises RuntimeError where the flow does not settle."""
    folder = pathlib.Path(folder)
    with tempfile.TemporaryDirectory() as work:
        case = pathlib.Path(work) / "case"
        shutil.copytree(folder / "template", case)
        channel.write_points(case / "constant/polyMesh/points", points)
        channel.solve(case, channel.ITERATIONS, write=True)
        try:
            drag = plain.drag_of(case)
        except SystemExit as unsettled:
            raise RuntimeError(str(unsettled)) from None
        flow = case / str(channel.ITERATIONS)
        for field in ("U", "p"):
            os.replace(flow / field, case / "0" / field)
        shutil.rmtree(flow)
        shutil.copytree(folder / "adjoint", case, dirs_exist_ok=True)
        channel.solve(case, 2000, write=True, program="adjointOptimisationFoam")
        last = max((entry for entry in case.iterdir() if entry.name.isdigit()), key=lambda entry: int(entry.name))
        return drag, channel.read_field(last / "pointSensVecdragESI")


def area_and_slope(points, outline):
    """The area of the polygon of the points `outline`, counterclockwise, and its gradient at all points."""
    here = points[outline]
    before, after = np.roll(here, 1, axis=0), np.roll(here, -1, axis=0)
    slope = np.zeros_like(points)
    slope[outline, 0] = (after[:, 1] - before[:, 1]) / 2
    slope[outline, 1] = (before[:, 0] - after[:, 0]) / 2
    return float(np.sum(here[:, 0] * after[:, 1] - after[:, 0] * here[:, 1])) / 2, slope
