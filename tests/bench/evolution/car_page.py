# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of docs/evolution.md about the car of car.py: for evolution_page.py."""
import json
import re
import shutil

import matplotlib.collections
import matplotlib.pyplot as plt
import numpy as np

import car
import channel
import fitness
from runs import COLOURS, Run, run_study, save, table, value


def gather(folder, figures, server, generations):
    """Runs the studies in FOLDER as far as they have not been run, draws the figures, and returns what section() needs."""
    import deformd

    car.make(folder)
    paths = {method: car.study(folder, method, generations) for method in channel.METHODS}
    for path in paths.values():
        run_study(path, server)
    runs = {method: Run(path, 1, generations, car.BOUND) for method, path in paths.items()}
    points = folder / "template/constant/polyMesh/points"
    faces = json.loads((folder / "template/body.json").read_text())
    with deformd.Client(server.address) as client:
        systems = {method: client.prepare(str(folder / f"{method}.yaml")) for method in channel.METHODS}
        start = _rest(folder, points, faces)
        convergence(figures, runs, start["fitness"])
        bests = {method: systems[method](np.array(runs[method].best["x"]), bad="keep") for method in channel.METHODS}
        reports = {method: systems[method].deform(np.array(runs[method].best["x"])).report for method in channel.METHODS}
        bodies(figures, systems["rbf"].geometry.points, bests, faces)
        return {"runs": runs, "generations": generations, "start": start, "cells": _cells(folder), "reports": reports,
                "preparing": {method: sum(stage.seconds for stage in system.info.stages) for method, system in systems.items()}}


def _rest(folder, points, faces):
    """Fitness, drag and volume of the body at rest."""
    case = folder / "rest"
    if not (case / "postProcessing").exists():
        shutil.rmtree(case, ignore_errors=True)
        shutil.copytree(folder / "template", case)
        channel.solve(case, car.ITERATIONS)
    drag, volume = float(channel.drags(case)[-1]), fitness.volume_of(points, faces)
    return {"fitness": drag + fitness.VOLUME_WEIGHT / volume, "drag": drag, "volume": volume}


def _cells(folder):
    """How many there are: the header of the mesh says it."""
    return int(re.search(r"nCells:\s*(\d+)", (folder / "template/constant/polyMesh/owner").read_text()).group(1))


def convergence(figures, runs, start):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.4, 2.6), layout="constrained")
    for method, run in runs.items():
        left.plot(np.arange(1, len(run.course) + 1), np.minimum(run.course, start), color=COLOURS[method], label=channel.METHODS[method])
        right.plot(run.steps, color=COLOURS[method])
    left.set_xlabel("designs evaluated")
    left.set_ylabel("best fitness")
    left.legend(frameon=False, loc="upper right")
    right.set_yscale("log")
    right.set_xlabel("generation")
    right.set_ylabel("step size, metres")
    save(figure, figures, "evolution_car_convergence.svg")


def bodies(figures, rest, bests, faces):
    """The body at rest and the best of each method, seen from behind, coloured by how far its faces have moved outwards or inwards."""
    figure, axes = plt.subplots(2, 2, figsize=(7.4, 4.0), layout="constrained", sharex=True, sharey=True)
    # Looking along `view` towards the front, from behind, from the side and from above.
    view = np.array([-0.62, -0.62, -0.48])
    view /= np.linalg.norm(view)
    right = np.cross(view, [0, 0, 1])
    right /= np.linalg.norm(right)
    up = np.cross(right, view)
    mirror = np.array([1, -1, 1])
    shown = None
    for axis, (name, points) in zip(axes.flat, [("at rest", rest), *((channel.METHODS[method], best) for method, best in bests.items())]):
        polygons, depths, moved, shades = [], [], [], []
        for face in faces:
            corners, before = points[face], rest[face]
            normal = -sum(np.cross(a, b) for a, b in zip(corners - corners[0], np.roll(corners - corners[0], -1, axis=0)))
            normal /= np.linalg.norm(normal)
            outwards = float((corners - before).mean(axis=0) @ normal)
            for side in (np.ones(3), mirror):
                facing = -(normal * side) @ view
                if facing <= 0:
                    continue
                seen = corners * side
                polygons.append(np.column_stack([seen @ right, seen @ up]))
                depths.append(float((seen @ view).mean()))
                moved.append(outwards)
                shades.append(0.45 + 0.55 * facing)
        order = np.argsort(depths)[::-1]  # the farthest first
        norm = matplotlib.colors.Normalize(-car.BOUND, car.BOUND)
        colours = plt.get_cmap("coolwarm")(norm(np.array(moved)[order]))
        colours[:, :3] *= np.array(shades)[order][:, None]
        axis.add_collection(matplotlib.collections.PolyCollection([polygons[i] for i in order], facecolors=colours, edgecolors=colours, linewidth=0.2))
        axis.autoscale_view()
        axis.set_aspect("equal")
        axis.set_title(name)
        axis.axis("off")
        shown = plt.cm.ScalarMappable(norm, "coolwarm")
    figure.colorbar(shown, ax=axes, shrink=0.7, label="moved outwards, metres")
    save(figure, figures, "evolution_car_bodies.png")


def section(data):
    """Markdown."""
    runs, start, generations = data["runs"], data["start"], data["generations"]
    rows = []
    for method, run in runs.items():
        best = run.best["values"]
        report = data["reports"][method]
        missed = f"{report.interpolation_residual / car.BOUND:.2g}" if method == "dm_ffd" else ""
        rows.append([channel.METHODS[method], f"{run.course[-1]:.4f}", f"{100 * (run.course[-1] / start['fitness'] - 1):+.1f} %", f"{best['drag']:.4f}",
                     f"{best['volume']:.4f}", f"{run.steps[-1] / run.steps[0]:.2g}", f"{100 * run.unusable / len(run.records):.0f} %", missed,
                     f"{data['preparing'][method]:.1f} s"])
    results = table(["method", "best fitness", "against rest", "drag", "volume", "last step size / first", "unusable designs",
                     "handles missed by, of the bound", "preparing"], rows)
    order = sorted(runs, key=lambda method: runs[method].course[-1])
    names = [channel.METHODS[method] for method in order]
    same = all(run.same for run in runs.values())
    thesis = ("That is the thesis' order of FFD and the two others" if order[-1] == "ffd" else
              "The thesis has FFD behind both others, with handles and groups of control points chosen by hand")
    return f"""## A car

Half an Ahmed body (1.044 m long, slant of {car.SLANT} degrees, without its stilts) over a ground that moves with the air: `snappyHexMesh`, {data["cells"]:,} cells,
`simpleFoam` with k-omega SST. Twelve to sixteen seconds of one core would settle it from nothing; from the flow at rest, {car.ITERATIONS} iterations do.
As in the thesis each method was run once and the back is moved by 23 variables: at four stations along the body the middle of the roof, a point beside it and its
corner move up and down, the corner and the side also sideways, the base also along the car, each by up to {100 * car.BOUND:.0f} cm. Every setup has the plane in the middle
of the car as its symmetry plane; RBF and DM-FFD hold the ground and the outer boundaries, FFD groups reach neither. {15 * generations} designs per method,
{generations} generations, went through one server, which prepared each method once.

$f = D + {fitness.VOLUME_WEIGHT} / V$ with the volume $V$ of the half body; at rest it is {start["fitness"]:.4f} with the drag coefficient {start["drag"]:.4f} and {start["volume"]:.4f} m³.
Advection is of first order, which settles well on so few cells and exaggerates the drag: the figures compare designs, they do not predict a wind tunnel.

![best fitness and step size of the car](figures/evolution_car_convergence.svg)

![the car at rest and the best of each method](figures/evolution_car_bodies.png)

{results}

{names[0]} comes out best, then {names[1]} and {names[2]}. {thesis}; one run per method of {15 * generations} designs is no more than an example, as the seeds of the
channel show. DM-FFD misses its handles by the part of the table, since several lie within one cell of its lattice ({car.CELL} m); the verdict of its designs says so.
{"All histories are those of pycma alone, bit for bit." if same else "**Not all histories are those of pycma alone.**"}

"""
