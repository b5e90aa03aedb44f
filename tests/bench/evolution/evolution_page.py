#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes docs/evolution.md and its figures: the evolutionary optimization of thesis chapter 5 with OpenFOAM as the fitness.

usage: evolution_page.py [--seeds N] [--generations N] [--car-generations N] [--folder FOLDER] [--docs FOLDER] [BUILD_FOLDER]
  --seeds N         runs of each method, 10 unless given
  --generations N   of 15 designs each, 100 unless given, as in the thesis
  --car-generations N   of the one run of each method with the car, 20 unless given
  --folder FOLDER   of the studies, build/evolution unless given. What is there already is not evaluated again: run it again after an interruption,
                    or with more seeds or generations
  --docs FOLDER     where evolution.md and figures/ go, docs unless given

Exit code 1 where a figure misses its limit: noise, systems prepared, histories, evaluations with gradients. What differs from the thesis is told only.

Needs OpenFOAM (Debian: openfoam), matplotlib (python3-matplotlib) and pycma, and DEFORM_BUILD_PYTHON. A design takes about a quarter of a second
of one core, one of the car five, so all of it five hours on one core."""
import argparse
import json
import os
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # pycma's bits depend on it; before numpy is there

ROOT = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "tests/end_to_end"))

import matplotlib
matplotlib.use("Agg")
import matplotlib.collections  # noqa: E402
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

import car_page  # noqa: E402
import channel  # noqa: E402
import fitness  # noqa: E402
import gradient  # noqa: E402
from runs import COLOURS, Run, Server, records, run_study, save, table, value  # noqa: E402

NOISE, SHARE, TENTH = 1e-4, 0.02, 0.1


def quartiles(values):
    return np.percentile(values, [25, 50, 75])


def deformed(system, record):
    return system(np.array(record["x"]), bad="keep")


def solved(folder, points, iterations, write=False):
    """(drag coefficients, folder of the case), solved from the template; the caller removes the folder."""
    case = pathlib.Path(tempfile.mkdtemp(dir=folder)) / "case"
    shutil.copytree(folder / "template", case)
    channel.write_points(case / "constant/polyMesh/points", points)
    channel.solve(case, iterations, write)
    return channel.drags(case), case


def noise(folder, system, chosen):
    """The largest part by which the drag of designs is off after ITERATIONS, against ten times as many."""
    worst = 0
    for record in chosen:
        drags, case = solved(folder, deformed(system, record), 10 * channel.ITERATIONS)
        shutil.rmtree(case.parent)
        worst = max(worst, abs(drags[channel.ITERATIONS - 1] / drags[-1] - 1))
    return worst


def cost(folder, server, system, chosen):
    """Seconds of the processor per design: of deforming as the studies do, with the compiled deformation, checks of faces and cells and writing the
    points; the same by the server; of evaluating; of evaluating with the adjoint; and of the points alone."""
    import deformd

    def own():
        used = resource.getrusage(resource.RUSAGE_SELF)
        return used.ru_utime + used.ru_stime

    def of_children():
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    fast, faces, cells = system.local(), deformd.FaceCheck(system.geometry), deformd.CellCheck(system.geometry)

    def compiled(x):
        points = fast.deform(x, faces=faces).points
        cells.inverted(points)
        return points

    deforming = by_server = evaluating = with_adjoint = 0.0
    for record in chosen:  # in turns, so that what else the machine does slows both
        x = np.array(record["x"])
        before = own()
        for _ in range(20):
            system.geometry.write(str(folder / "written"), compiled(x))
        deforming += (own() - before) / 20
        before = own() + server.seconds()
        for _ in range(20):  # the processor time of another process is told in hundredths of a second
            system.geometry.write(str(folder / "written"), system.deform(x).points)
        by_server += (own() + server.seconds() - before) / 20
        before = own() + of_children()
        case = folder / "costs"
        shutil.copytree(folder / "template", case)
        shutil.copytree(folder / "written", case / "design")
        subprocess.run(["python3", "-I", "-S", "fitness.py", str(case / "design"), "result.json"], cwd=case, check=True)
        shutil.rmtree(case)
        evaluating += own() + of_children() - before
        before = own() + of_children()
        gradient.drag_and_slope(folder, system(x, bad="keep"))
        with_adjoint += own() + of_children() - before
    shutil.rmtree(folder / "written")
    before = own()
    for _ in range(100):
        for record in chosen:
            fast(np.array(record["x"]), bad="keep")
    points_alone = (own() - before) / 100
    return [total / len(chosen) for total in (deforming, by_server, evaluating, with_adjoint, points_alone)]


# ---- pictures ----


def convergence(figures, runs, descent):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.4, 2.8), layout="constrained")
    for method, seeds in runs.items():
        courses = np.array([run.course for run in seeds])
        low, middle, high = np.percentile(np.where(np.isfinite(courses), courses, descent[0]), [25, 50, 75], axis=0)
        at = np.arange(1, courses.shape[1] + 1)
        left.plot(at, middle, color=COLOURS[method], label=channel.METHODS[method])
        left.fill_between(at, low, high, color=COLOURS[method], alpha=0.2, linewidth=0)
        low, middle, high = np.percentile([run.steps for run in seeds], [25, 50, 75], axis=0)
        right.plot(np.arange(len(middle)), middle, color=COLOURS[method])
        right.fill_between(np.arange(len(middle)), low, high, color=COLOURS[method], alpha=0.2, linewidth=0)
    left.plot(np.arange(1, len(descent) + 1), descent, color="black", linewidth=1, label="RBF, adjoint gradients")
    left.set_xscale("log")
    left.set_xlabel("designs evaluated")
    left.set_ylabel("best fitness")
    left.set_ylim(None, descent[0] + 0.03)
    left.legend(frameon=False, loc="upper right")
    right.set_yscale("log")
    right.set_xlabel("generation")
    right.set_ylabel("step size, in diameters of the body")
    save(figure, figures, "evolution_convergence.svg")


def shapes(figures, folder, systems, runs, descent_best):
    ids = np.array(json.loads((folder / "template/outline.json").read_text()))
    figure, axes = plt.subplots(1, 4, figsize=(7.4, 2.2), sharex=True, sharey=True)
    closed = np.append(ids, ids[0])
    shown = [(channel.METHODS[method], COLOURS[method], systems[method], [run.best for run in seeds]) for method, seeds in runs.items()]
    for axis, (name, colour, system, bests) in zip(axes, [*shown, ("RBF, adjoint gradients", "black", systems["rbf"], [descent_best])]):
        rest = system.geometry.points[closed]
        axis.fill(rest[:, 0], rest[:, 1], color="#dddddd", linewidth=0)
        for record in bests:
            line = deformed(system, record)[closed]
            axis.plot(line[:, 0], line[:, 1], color=colour, linewidth=0.8)
        axis.set_title(name)
        axis.set_aspect("equal")
        axis.axis("off")
    save(figure, figures, "evolution_shapes.svg")


def flow(figures, folder, rest, best):
    figure, axes = plt.subplots(2, 1, figsize=(7.4, 3.6), sharex=True, sharey=True)
    for axis, points, name in zip(axes, (rest, best), ("at rest", "best design of all")):
        drags, case = solved(folder, points, 4 * channel.ITERATIONS, write=True)
        speed = np.linalg.norm(channel.read_field(case / str(4 * channel.ITERATIONS) / "U"), axis=1)
        shutil.rmtree(case.parent)
        corners, cells = channel.plane_cells(folder / "template")
        shown = matplotlib.collections.PolyCollection(points[corners][:, :, :2], array=speed[cells], cmap="viridis", edgecolors="face", linewidth=0.2)
        shown.set_clim(0, 1.6)
        axis.add_collection(shown)
        axis.set_xlim(-2, 7)
        axis.set_ylim(-2, 2)
        axis.set_aspect("equal")
        axis.set_title(f"{name}: drag coefficient {drags[-1]:.4f}")
        axis.axis("off")
    figure.colorbar(shown, ax=axes, shrink=0.7, label="speed / inflow")
    save(figure, figures, "evolution_flow.png")


# ---- the page ----


def reached(course, target):
    """After how many designs a course is at most `target`; None if never."""
    at = np.flatnonzero(np.asarray(course) <= target)
    return int(at[0]) + 1 if len(at) else None


def page(data):
    runs, descent = data["runs"], data["gradient"]
    medians = {method: float(np.median([run.course[-1] for run in seeds])) for method, seeds in runs.items()}
    generations = len(runs["rbf"][0].records) // 15
    seeds, designs = len(runs["rbf"]), 15 * generations
    initial = descent["course"][0]
    rows = []
    for method, each in runs.items():
        low, middle, high = quartiles([run.course[-1] for run in each])
        rows.append([channel.METHODS[method], f"{middle:.4f}", f"{low:.4f} to {high:.4f}", f"{min(run.course[-1] for run in each):.4f}",
                     f"{np.median([run.best['values']['drag'] for run in each]):.3f}", f"{np.median([run.best['values']['area'] for run in each]):.3f}",
                     f"{np.median([run.steps[-1] / run.steps[0] for run in each]):.2g}", f"{100 * np.mean([run.unusable for run in each]) / designs:.0f} %"])
    results = table(["method", "best fitness, median", "quartiles", "best of all seeds", "drag", "area", "last step size / first", "unusable designs"], rows)
    rows, targets = [], {}
    for method, name in channel.METHODS.items():
        targets[method] = reached(descent["course"], medians[method])
        rows.append([name, designs, f"{medians[method]:.4f}", targets[method] or "never", f"{targets[method] / designs:.3f}" if targets[method] else ""])
    against = table(["median of CMA-ES with", "designs", "fitness", "gradient run is there after", "part of the designs"], rows)
    share = data["deforming"] / (data["deforming"] + data["evaluating"])
    last = targets["rbf"]
    converged = max(float(np.median([run.steps[-1] / run.steps[0] for run in each])) for each in runs.values())
    wall = data["wall"]
    claims = [
        ("5.3.4", "initial fitness is equal for all methods", f"{initial:.5f}; points differ by {data['initial']:.0e}", data["initial"] <= 1e-12),
        ("5.3.4", "RBF yield a better fitness than FFD", f"{medians['rbf']:.4f} against {medians['ffd']:.4f}", medians["rbf"] <= medians["ffd"]),
        ("5.3.4", "DM-FFD yields a better fitness than FFD", f"{medians['dm_ffd']:.4f} against {medians['ffd']:.4f}", medians["dm_ffd"] <= medians["ffd"]),
        ("5.3.4", "step sizes do not fully converge", f"the last is at most {converged:.2g} of the first in the median", converged > 0.1),
        ("5.4", "deformation is a minor factor in the run time", f"{100 * share:.1f} % of the processor time", share <= SHARE),
        ("2.3", "gradients take far fewer evaluations", f"{last or 'more than ' + str(len(descent['course']))} of {designs} for the median of RBF",
         last is not None and last <= TENTH * designs),
    ]
    said = table(["section", "it says", "measured", "holds"], [[a, b, c, "yes" if d else "**no**"] for a, b, c, d in claims])
    facts = table(["what", "limit", "measured"], [
        ["numerical noise of the drag: 50 iterations from the flow of the parent against 500, the worst of "
         f"{data['noise_of']} designs", f"{NOISE:.0e}", f"{data['noise']:.1e}"],
        [f"systems that a server prepared for {data['served']['designs']:,} designs of all methods", "3", f"{data['served']['prepared']:.0f}"],
        ["share of deformation in the loop, processor time", f"{100 * SHARE:.0f} %", f"{100 * share:.1f} %"],
        ["the same by wall time of the workers, on a machine as busy as it was", "", ", ".join(f"{channel.METHODS[m]} {100 * w:.1f} %" for m, w in wall.items())],
        ["processor time of a design: deforming by the compiled deformation, checks of faces and cells, and writing the points", "",
         f"{1e3 * data['deforming']:.1f} ms"],
        ["of that the points alone", "", f"{1e3 * data['points_alone']:.2g} ms"],
        ["the same by the server, which also looks where on the way cells are inverted first, client and server together", "", f"{1e3 * data['by_server']:.1f} ms"],
        ["processor time of a design: OpenFOAM with starting, reading and its case", "", f"{1e3 * data['evaluating']:.0f} ms"],
        ["histories that pycma alone, told the same values, asks for bit for bit", "all", f"{sum(run.same for each in runs.values() for run in each)} of "
         f"{sum(map(len, runs.values()))}"]])
    return claims, f"""<!-- Made by tests/bench/evolution/evolution_page.py: change that, not this. -->
# Evolutionary optimization with OpenFOAM

Chapter 5 of the [thesis](thesis.md) on a machine of today's desk: CMA-ES moves a body, OpenFOAM computes its drag, and three methods of
deformation compete with {len(runs["rbf"][0].records[0]["x"])} variables each. The thesis has the back of a Honda Civic, 2 million points and two weeks per method on a cluster.
Here it is a round body in a plane channel with 1,507 cells, because then a design takes a quarter of a second and many seeds can be run. The page is made by one
command, which goes on where it was stopped:

```
tests/bench/evolution/evolution_page.py --seeds {seeds} --generations {generations} --car-generations {data["car"]["generations"]}
```

It needs Debian's `openfoam` (1912) and `python3-matplotlib`, and pycma. Without `--seeds` and `--generations` it runs 10 seeds and 100 generations, those of the thesis.
**The figures below are of {seeds} seeds and {generations} generations**, {seeds * designs:,} designs per method, on two cores that had other work besides.
[A car](#a-car) was optimized once with each method.

![best fitness and step size](figures/evolution_convergence.svg)

Best fitness so far and step size, medians of {seeds} seeds with quartiles; in black one run with gradients.

![best shapes](figures/evolution_shapes.svg)

The best body of every seed, in front of the one at rest; the flow comes from the left.

![flow at rest and around the best design](figures/evolution_flow.png)

## The case

- **Flow.** Laminar, Reynolds number 40 by the diameter 1 of the body, in a channel of 14 by 6 with frictionless walls; `simpleFoam` (SIMPLEC).
  A design starts from the settled flow around the body at rest, since the cells are the same, and takes {channel.ITERATIONS} iterations.
- **Fitness.** $f = w_d D + w_v V$ with $w_d = 1$ and the drag coefficient $D$. The thesis has $V = 1 / \\|b_{{max}} - b_{{min}}\\|$ of the bounding box with
  $w_v = 50$, calls that too simple in its conclusion, and recommends the true volume. So here $V = 1 / A$ with the area $A$ of the body in
  the plane, and $w_v = {fitness.WEIGHT}$: with it nothing is gained at the start by growing or shrinking the body as a whole.
- **Strategy.** pycma as `(2,15)`, `{{popsize: 15, CMA_mu: 2, CMA_active: false}}`, variables within ±{channel.BOUND} diameters, first step size 0.04. It runs through
  [python -m deformd.study](studies.md), where the fitness is a command per design and workers carry the [compiled deformation](compiled.md), whose points have the bits of
  the server's. Designs with inverted cells are refused before they cost a flow.
- **RBF.** Triharmonic. Twelve handles, every 30 degrees a pair of points of the body, each moved along and across the channel; the two in front share the motion along it,
  which leaves 23 variables. Inlet, outlet and walls are fixed.
- **DM-FFD.** The same handles move a lattice with cells of {channel.CELL} around the body (`control: MESH`); fixed are three of its cells at the boundary.
- **FFD.** Of the same lattice the control points up to {channel.REACH} from the middle, in twelve groups by angle, are moved by the same variables (`control: CONTROLS`).
- The whole volume mesh is deformed, as in part II of the thesis; its chapter 5 deforms the surface and makes a new mesh for each design, whose noise
  is then part of the fitness.

## Results

{results}

The fitness at rest is {initial:.4f}. Designs are unusable where cells are inverted or the flow did not settle; the optimizer ranks them last.

## What the thesis says, and what was measured

{said}

{differences(medians, runs, converged, generations)}

## With gradients

The same fitness, the same RBF system, SciPy's `trust-constr`, which takes gradients: the derivative of the drag at the points of the body by OpenFOAM's
`adjointOptimisationFoam`, that of the area exactly, both carried to the 23 variables by `system.vjp`. One flow and one adjoint take about as long as {data["adjoint"]:.1f}
designs of CMA-ES; the table counts designs.

{against}

The adjoint of OpenFOAM is that of the differential equations, not of its discretization; at rest its gradient and central differences of the computed drag
include an angle of {data["angle"]:.0f} degrees. That is good enough to come down, not to end exactly at the minimum.

{car_page.section(data["car"])}
## What it costs

{facts}

{missed_share(data, share)}Preparing takes {", ".join(f"{1e3 * seconds:.0f} ms ({channel.METHODS[m]})" for m, seconds in data["preparing"].items())}, once for all designs.
"""


def missed_share(data, share):
    if share <= SHARE:
        return ""
    return (f"The goal of {100 * SHARE:.0f} % is missed beside a flow as small as this one: it leaves {1e3 * SHARE / (1 - SHARE) * data['evaluating']:.1f} ms. The points "
            f"are the least of it. The rest are the checks of cells and faces, by which designs are refused before they cost a flow, the call, and the file.\n\n")


def differences(medians, runs, converged, generations):
    parts = []
    worse = [channel.METHODS[method] for method in ("rbf", "dm_ffd") if medians[method] > medians["ffd"]]
    spread = max(np.ptp([run.course[-1] for run in each]) for each in runs.values())
    if worse:
        unusable = {method: np.mean([run.unusable for run in each]) for method, each in runs.items()}
        parts.append(f"{' and '.join(worse)} did not beat FFD here; one body with the same 23 variables in all methods is not the car of the thesis. Its FFD lattice had to be "
                     "fitted by hand to a car with few groups, of which some hardly move the surface. Here a group of control points lies at every place of the body, so the "
                     f"coupling between variables and shape, to which the thesis attributes the difference, is as strong for FFD. FFD also loses fewer designs to inverted "
                     f"cells ({unusable['ffd']:.0f} of a run in the mean, RBF {unusable['rbf']:.0f}, DM-FFD {unusable['dm_ffd']:.0f}), since its groups cannot be moved against each other as sharply as single points of the body.")
    else:
        parts.append("The order is that of the thesis. The difference between the medians of RBF and DM-FFD is "
                     f"{abs(medians['rbf'] - medians['dm_ffd']):.3f}, seeds of one method are up to {spread:.3f} apart: one run per method, as the thesis has it, does not tell "
                     "such methods apart.")
    if generations < 100:
        parts.append(f"Fewer generations than the thesis' 100 were run; lines that still fall at the right end of the figure would go on.")
    return "\n\n".join(parts)


def gather(folder, figures, server, seeds, generations):
    import deformd

    paths = {(method, seed): channel.study(folder, method, seed, generations) for seed in range(1, seeds + 1) for method in channel.METHODS}
    before = sum(len(records(path)) for path in paths.values() if (path.with_suffix("") / "journal.jsonl").exists())
    # Of each method one seed after the other, methods side by side: an interruption leaves them with about the same numbers.
    for seed in range(1, seeds + 1):
        with ThreadPoolExecutor(len(channel.METHODS)) as pool:
            list(pool.map(lambda method: run_study(paths[method, seed], server), channel.METHODS))
    gradient_path = channel.gradient_study(folder, max(20, round(TENTH * 15 * generations)))
    run_study(gradient_path, server)
    runs = {method: [Run(paths[method, seed], seed, generations, channel.BOUND) for seed in range(1, seeds + 1)] for method in channel.METHODS}
    descent = records(gradient_path)
    with deformd.Client(server.address) as client:
        systems = {method: client.prepare(str(folder / f"{method}.yaml")) for method in channel.METHODS}
        prepared = server.figure('deformd_stage_seconds_count{stage="prepare"}')
        usable = [record for record in runs["rbf"][0].records if record["values"]]
        chosen = [*usable[:: max(1, len(usable) // 10)], *(run.best for run in runs["rbf"])]
        deforming, by_server, evaluating, with_adjoint, points_alone = cost(folder, server, systems["rbf"], chosen[:10])
        rest = systems["rbf"].geometry.points
        starts = [system(np.zeros(len(system.names))) for system in systems.values()]
        best = min((run.best for run in runs["rbf"]), key=value)
        best = min([best, *[record for record in descent if record["values"]]], key=value)
        convergence(figures, runs, np.minimum.accumulate([value(record) for record in descent]))
        shapes(figures, folder, systems, runs, min(descent, key=value))
        flow(figures, folder, rest, deformed(systems["rbf"], best))
        of_loop = {}
        for method, each in runs.items():
            sums = [sum(record[f"seconds_{what}"] for run in each for record in run.records) for what in ("deforming", "evaluating")]
            of_loop[method] = sums[0] / sum(sums)
        sessions = folder / "sessions.json"
        served = json.loads(sessions.read_text()) if sessions.exists() else []
        served.append({"designs": sum(len(records(path)) for path in paths.values()) - before, "prepared": prepared})
        sessions.write_text(json.dumps(served))
        return {"runs": runs, "gradient": {"course": np.minimum.accumulate([value(record) for record in descent])},
                "initial": max(float(np.abs(start - rest).max()) for start in starts), "noise": noise(folder, systems["rbf"], chosen),
                "noise_of": len(chosen), "served": max(served, key=lambda session: session["designs"]),
                "deforming": deforming, "by_server": by_server, "evaluating": evaluating, "points_alone": points_alone, "wall": of_loop,
                "preparing": {method: sum(stage.seconds for stage in system.info.stages) for method, system in systems.items()},
                "adjoint": with_adjoint / evaluating, "angle": channel.gradient_angle(folder, systems["rbf"])}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--generations", type=int, default=100)
    parser.add_argument("--car-generations", type=int, default=20)
    parser.add_argument("--folder", type=pathlib.Path, default=ROOT / "build" / "evolution")
    parser.add_argument("--docs", type=pathlib.Path, default=ROOT / "docs")
    parser.add_argument("build", nargs="?", type=pathlib.Path, default=ROOT / "build" / "release")
    args = parser.parse_args()
    if not channel.openfoam():
        sys.exit("evolution_page.py: no OpenFOAM; install it (Debian: openfoam)")
    build = args.build.resolve()
    os.environ.update(DEFORM_BIN=str(build / "client/cli/deform"), DEFORMD_BIN=str(build / "server/deformd"), PYTHONPATH=str(build / "client/python"))
    sys.path.insert(0, str(build / "client/python"))
    folder = args.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    channel.make(folder)
    server = Server(folder / "server")
    try:
        data = gather(folder, args.docs / "figures", server, args.seeds, args.generations)
        data["car"] = car_page.gather(folder / "car", args.docs / "figures", server, args.car_generations)
    finally:
        server.stop()
    claims, text = page(data)
    (args.docs / "evolution.md").write_text(text, encoding="utf-8")
    for section, what, measured, holds in claims:
        if not holds:
            print(f"does not hold: {section}: {what}: {measured}", file=sys.stderr)
    same = all(run.same for each in data["runs"].values() for run in each)
    after = reached(data["gradient"]["course"], float(np.median([run.course[-1] for run in data["runs"]["rbf"]])))
    missed = [what for what, holds in (("noise of the drag", data["noise"] <= NOISE), ("systems prepared", data["served"]["prepared"] == len(channel.METHODS)),
                                       ("histories of pycma", same), ("evaluations with gradients", after and after <= TENTH * 15 * args.generations))
              if not holds]
    if missed:
        sys.exit("misses its limit: " + ", ".join(missed))


if __name__ == "__main__":
    main()
