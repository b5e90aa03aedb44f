#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes docs/which-method.md and its figures from what methods_bench measures.

usage: methods_page.py [--from FILE] [BUILD_FOLDER]     defaults: build/release
  --from FILE   the JSON that methods_bench printed, instead of running it

Wants an otherwise idle machine; takes a few minutes on two cores. Needs matplotlib (Debian: python3-matplotlib)."""
import argparse
import json
import os
import pathlib
import subprocess
import sys

import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import matplotlib.tri as tri  # noqa: E402
import numpy as np  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[3]
FIGURES = ROOT / "docs" / "figures"
COLOURS = {"RBF": "#00798c", "DM-FFD": "#d1495b", "DM-cage": "#7b2d8b", "MLS": "#2e8b57", "DM-FFD-5": "#f2c14e",
           "DM-FFD-10": "#f78154", "DM-FFD-15": "#d1495b", "DM-FFD-25": "#7b2d8b"}
PAGES = "methods"  # where docs/which-method.md finds the pages of the methods
plt.rcParams.update({"font.size": 8, "font.family": "DejaVu Sans", "axes.spines.top": False, "axes.spines.right": False,
                     "svg.hashsalt": "deformd", "svg.fonttype": "path", "savefig.bbox": "tight"})


def save(figure, name):
    FIGURES.mkdir(exist_ok=True)
    figure.savefig(FIGURES / name, dpi=110, metadata={"Date": None} if name.endswith(".svg") else {"Software": None})
    plt.close(figure)


def seconds(value):
    if value < 1e-3:
        return f"{1e6 * value:.0f} µs"
    return f"{1e3 * value:.3g} ms" if value < 1 else f"{value:.3g} s"


def size(value):
    return f"{value / 2**20:.3g} MiB"


def sci(value):
    return "0" if value == 0 else f"{value:.1e}"


def link(method):
    return f"[{method}]({PAGES}/{method}.md)"


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows])


def by_name(rows):
    return {row["method"]: row for row in rows}


def performance(rows):
    figure, axes = plt.subplots(figsize=(6.4, 2.6))
    totals = [row["prepare"] for row in rows]
    limit = 1.15 * sorted(totals)[-2]
    left = np.zeros(len(rows))
    for stage, colour in zip(["select", "assemble", "factor", "basis"], ["#bbbbbb", "#edae49", "#d1495b", "#00798c"]):
        width = np.array([row["stages"].get(stage, 0) for row in rows])
        axes.barh([row["method"] for row in rows], width, left=left, color=colour, label=stage, height=0.7)
        left += width
    axes.set_xlabel("seconds")
    axes.set_xlim(0, limit)
    for i, total in enumerate(left):
        axes.text(min(total, 0.91 * limit), i, f" {seconds(total)}", va="center")
    axes.invert_yaxis()
    axes.legend(frameon=False, ncol=4, loc="upper center", bbox_to_anchor=(0.5, 1.15))
    save(figure, "methods_speed.svg")
    return table(["method", "unknowns", "prepare, one thread", "prepare", "one design", "memory"],
                 [[row["method"], row["unknowns"], seconds(row["prepare_one_thread"]), seconds(row["prepare"]),
                   seconds(row["design"]), size(row["bytes"])] for row in rows])


def smoothness(data):
    """Maps of the sphere from the side, the handle on top, and the table of roughness."""
    rows = data["rows"]
    longitude, latitude = np.array(data["places"]).T
    keep = np.cos(latitude) > 0.12
    mesh = tri.Triangulation((longitude * np.cos(latitude))[keep], latitude[keep])
    closed = mesh.triangles[:, [0, 1, 2, 0]]
    edges = np.hypot(np.diff(mesh.x[closed], axis=1), np.diff(mesh.y[closed], axis=1))
    mesh.set_mask(edges.max(axis=1) > 0.25)
    figure, axes = plt.subplots(3, 3, figsize=(7.2, 5.2), sharex=True, sharey=True)
    for axis, row in zip(axes.flat, rows):
        values = np.array([0 if value is None else value for value in row["curvature"]])[keep]
        shown = axis.tripcolor(mesh, values, shading="gouraud", vmin=0.4, vmax=1.8, cmap="viridis")
        axis.set_title(f"{row['method']}: {row['high_pass']:.3g}")
        axis.axis("off")
    figure.colorbar(shown, ax=axes, shrink=0.6, label="mean curvature; the sphere at rest has 1")
    save(figure, "methods_curvature.png")
    rbf = by_name(rows)["RBF"]["high_pass"]
    return table(["method", "roughness", "to RBF"],
                 [[row["method"], f"{row['high_pass']:.3g}", f"{row['high_pass'] / rbf:.2g}"] for row in rows])


def adaptivity(data):
    figure, axes = plt.subplots(figsize=(4.8, 2.8))
    rows = []
    for name in ["RBF", "DM-FFD", "DM-cage"]:
        series = [row for row in data[name] if row["largest"] > 0]
        axes.loglog([row["unknowns"] for row in series], [row["largest"] for row in series], marker="o", markersize=3,
                    color=COLOURS[name], label=name)
        for most in (250, 500, 1100):
            row = [entry for entry in data[name] if entry["unknowns"] <= most][-1]
            rows.append([name, row["unknowns"], sci(row["largest"]), sci(row["rms"])])
    axes.set_xlabel("degrees of freedom")
    axes.set_ylabel("largest error / D")
    axes.legend(frameon=False)
    save(figure, "methods_adaptivity.svg")
    return table(["method", "degrees of freedom", "largest error / D", "rms / D"], rows)


def pipe(data):
    figure, axes = plt.subplots(figsize=(4.8, 2.8))
    rows = []
    for row in data["rows"]:
        if "refused" in row:
            rows.append([row["method"], "refused: " + row["refused"], "", "", ""])
            continue
        axes.plot(range(11), [data["at_rest"]] + row["least_scaled_jacobian"], marker="o", markersize=3,
                  color=COLOURS[row["method"]], label=row["method"])
        rows.append([row["method"], seconds(row["prepare"]), f"{row['least_scaled_jacobian'][4]:.3f} ({row['inverted'][4]})",
                     f"{row['least_scaled_jacobian'][-1]:.3f} ({row['inverted'][-1]})", sci(row["missed"][-1])])
    axes.set_xlabel("tenths of the change")
    axes.set_ylabel("least scaled Jacobian")
    axes.legend(frameon=False, loc="center right")
    save(figure, "methods_pipe.svg")
    return table(["method", "prepare", "least scaled Jacobian (inverted cells) at half the change", "at the whole change",
                  "largest distance of the boundary from where it is sent / D"], rows)


def car(data):
    """The table of thesis 7.2: checkMesh's figures where it ran, else ours, which are the same to three digits."""
    by = "checkMesh" if "checkMesh" in data["at_rest"] else "ours"

    def figures(entry):
        values = entry[by]
        return [f"{values['aspect_ratio']:.3g}", f"{values['non_orthogonality']:.3g}", f"{values['average_non_orthogonality']:.3g}",
                f"{values['skewness']:.3g}", values["failed_checks"]]

    rows = [["at rest", "", "", *figures(data["at_rest"]), ""]]
    for row in data["rows"]:
        if "refused" in row:
            rows.append([row["method"], "refused: " + row["refused"], "", "", "", "", "", "", ""])
            continue
        for i, entry in enumerate(row["lifts"]):
            rows.append([row["method"], "" if i else seconds(row["prepare"]), f"{entry['lift']} m", *figures(entry),
                         sci(entry["missed"] / data["D"])])
    return by, table(["method", "prepare", "lift", "aspect ratio", "non-orthogonality", "on average", "skewness", "failed checks",
                      "largest distance from where points are sent / D"], rows)


def car_difference(data):
    """The largest relative difference between checkMesh's figures and ours."""
    entries = [data["at_rest"]] + [entry for row in data["rows"] for entry in row.get("lifts", [])]
    return max(abs(entry["ours"][name] - value) / value for entry in entries if "checkMesh" in entry
               for name, value in entry["checkMesh"].items() if name != "failed_checks")


def car_section(data):
    if "car" not in data:
        return """The car of the thesis (7.3.2) is not public; `methods_bench --data FOLDER` lifts the roof of another one where it is told of its mesh."""
    lifted = data["car"]
    by, rows = car(lifted)
    whose = (f"`checkMesh` measured; our own measures differ from its by at most {sci(car_difference(lifted))}, relatively."
             if by == "checkMesh" else "Our own measures, after OpenFOAM's definitions (`checkMesh` is not installed here).")
    return f"""The car of the thesis (7.3.2, table 7.2) is not public. Here the roof of a fastback is lifted by three of its points in a box of
{lifted["cells"]:,} polyhedral cells ({lifted["points"]:,} points), whose walls stay: {lifted["prescribed"]:,} points are prescribed. Angles in degrees.
{whose}

{rows}

In the thesis the finest lattice turns cells inside out (largest non-orthogonality 180 degrees); here its cells only lean more the farther the
roof rises. A likely reason, which was not tested: control points that hardly reach a prescribed point are held back by the automatic damping,
which the thesis leaves to a value found by trial (4.3).
"""


def precision_class(row):
    if row["misfit"] <= 1e-12:
        return "exact"
    return "least squares" if row["misfit"] <= 1e-4 else "qualitative"


def claims(data):
    """What the thesis says, what was measured of it, and whether that is so."""
    smooth, misfit = by_name(data["smoothness"]["rows"]), by_name(data["precision"]["rows"])
    speed, robust = by_name(data["performance"]["rows"]), by_name(data["robustness"]["rows"])
    curves, pipes = data["adaptivity"], by_name(data["pipe"]["rows"])
    greedy = [row for row in curves["RBF"] if row["unknowns"] <= 900][-1]["largest"]
    lattices = min(row["largest"] for name in ("DM-FFD", "DM-cage") for row in curves[name] if row["unknowns"] <= 1100)
    ffd = [row for name, row in pipes.items() if name.startswith("DM-FFD") and "refused" not in row]
    rough = (max(smooth[name]["high_pass"] for name in ("RBF", "shell")) /
             min(smooth[name]["high_pass"] for name in ("DM-FFD", "DM-cage")))
    direct = min(speed[name]["prepare"] for name in ("DM-FFD", "DM-cage"))
    slowest = max(speed[name]["prepare"] for name in ("RBF", "shell"))
    to_shell = speed["RBF"]["prepare"] / speed["shell"]["prepare"]
    defects = max(robust[name]["difference"] for name in ("FFD", "DM-FFD", "cage", "DM-cage", "RBF"))
    exact = max(misfit[name]["misfit"] for name in ("RBF", "shell"))
    steps, partial = data["resolution"]["rows"][0]["steps"], data["resolution"]["partial"]
    best = max(row["least_scaled_jacobian"][-1] for row in ffd)
    rbf = pipes["RBF"]["least_scaled_jacobian"][-1]
    return [
        ["4.2", "direct manipulation takes longer than RBF and the shell", f"{direct / slowest:.2g} times", direct > slowest],
        ["4.2", "RBF and the shell take about the same time", f"{to_shell:.2g} times", 0.5 <= to_shell <= 2],
        ["4.3", "defects of the mesh do nothing to FFD, cages and RBF", sci(defects) + " D", defects <= 1e-12],
        ["4.3", "the shell cannot take them", "refused" if "refused" in robust["shell"] else "taken", "refused" in robust["shell"]],
        ["4.4", "RBF and the shell are smoother than direct manipulation", f"{rough:.2g} of its roughness", rough <= 0.5],
        ["4.4", "the shape depends on the resolution of the lattice",
         ", ".join(f"{step['from']}³ to {step['to']}³: {step['difference']:.2g}" for step in steps) + " of the motion",
         steps[-1]["difference"] > 0.01],
        ["4.4", "planes of control points at rest make a partial lattice continuous",
         ", ".join(f"{entry['planes']}: {entry['torn_edges']} torn edges" for entry in partial),
         partial[0]["torn_edges"] > 0 and partial[-1]["torn_edges"] == 0],
        ["4.5", "at 1,000 degrees of freedom RBF are nearest to the target", f"{greedy / lattices:.1e} of the next error",
         greedy <= 0.2 * lattices],
        ["4.6", "RBF and the shell are exact", sci(exact) + " D", exact <= 1e-12],
        ["7.3.1", "RBF keep better cells than direct manipulation of any lattice", f"{rbf:.2f} against {best:.2f}", rbf > best],
        ["7.3.1", "a coarse lattice misses the boundary", sci(pipes["DM-FFD-5"]["missed"][-1]) + " D",
         pipes["DM-FFD-5"]["missed"][-1] > 1e-3],
    ] + car_claims(data)


def car_claims(data):
    if "car" not in data:
        return []
    rows = by_name(data["car"]["rows"])

    def last(name):
        return rows[name]["lifts"][-1]["ours"]

    rbf, fine = last("RBF"), last("DM-FFD-25")
    return [
        ["7.3.2", "with RBF the mesh around the car passes all checks",
         f"{rbf['failed_checks']} fail, non-orthogonality {rbf['non_orthogonality']:.3g} degrees", rbf["failed_checks"] == 0],
        ["7.3.2", "with direct manipulation of 25³ control points it does not",
         f"{fine['failed_checks']} fail, non-orthogonality {fine['non_orthogonality']:.3g} degrees", fine["failed_checks"] > 0],
    ]


def page(data):
    robust, ball, plate, bent = by_name(data["robustness"]["rows"]), data["performance"], data["adaptivity"], data["pipe"]
    said = table(["section", "it says", "measured", "holds"],
                 [[section, what, value, "yes" if holds else "**no**"] for section, what, value, holds in claims(data)])

    def with_defects(name):
        if "refused" in robust[name]:
            return "refused"
        change = robust[name]["difference"]
        return "the same" if change <= 1e-12 else f"moves by {sci(change)} D"

    classes = table(["method", "largest distance from where handle and fixed points are sent / D", "class", "with defects"],
                    [[row["method"], sci(row["misfit"]), precision_class(row), with_defects(row["method"])]
                     for row in data["precision"]["rows"]])
    resolution = table(["method", "from", "to", "the shape changes by, of the motion"],
                       [[row["method"], f"{step['from']}³", f"{step['to']}³", f"{step['difference']:.2g}"]
                        for row in data["resolution"]["rows"] for step in row["steps"]])
    partial = table(["planes at rest on each side", "largest step over an edge, of the motion", "torn edges"],
                    [[entry["planes"], f"{entry['largest_step']:.2g}", entry["torn_edges"]]
                     for entry in data["resolution"]["partial"]])
    return f"""<!-- Made by tests/bench/methods/methods_page.py: change that, not this. -->
# Which method when

Every method of deformd on the same cases, after chapter 4 of the [thesis](thesis.md) and its section 7.3. Its models are not public, so the
cases here are made by a program: a ball, a plate and a bent pipe{"; a car is added" if "car" in data else ""}. The page is made by one command, in a few minutes:

```
tests/bench/methods/methods_page.py
```

The methods are as one gets them who names nothing but the lattice, the cage or the number of samples. Lengths are fractions of $D$, the
diagonal of the model; times are of a machine with {os.cpu_count()} cores and count beside each other only.

## What to take

| it matters that | take | because |
|---|---|---|
| handles and fixed parts are exactly where they are sent, in any mesh | {link("rbf")} | exact, smooth, untouched by defects; cells stay best |
| fixed parts have boundary layers with first cells below 1e-7 of the model | {link("rbf")} with `BIHARMONIC`, {link("ffd")} | `TRIHARMONIC` loses its digits there, and says so |
| the surface is clean and bends like sheet metal | {link("shell")} | exact and as smooth as RBF; refuses meshes with defects |
| bores stay round, flanges flat, in any mesh | {link("mls")} with constraints | exact, about as smooth, good cells; preparing takes longest |
| the same few control points span all designs, whatever the handles | {link("ffd")} with `ENERGY` | exact at the handles as far as they reach, nearly as smooth as RBF, little change with the lattice |
| a lattice or a cage is given, and designs are its control points | {link("ffd")}, {link("cage")} with `CONTROLS` | nothing is solved for; where points of the model go is only seen afterwards |
| a given lattice or cage is to follow handles of the model | the same with `MESH` | least squares; look at the shape: it is the roughest, and changes with the lattice |

## What the thesis says, and what was measured

{said}

## Speed

A sphere of {ball["points"]:,} points, {ball["handle"]} of the handle and {ball["fixed"]} fixed; lattices of 8³, a cage of {ball["cage"]} vertices. Preparing
computes the handle basis too, so that a design takes the same time for all.

![time to prepare, by stages](figures/methods_speed.svg)

{performance(ball["rows"])}

A handle that moves as a whole needs four fields of the basis, whatever the number of its points. Cages spend their time on mean value
coordinates, MLS on functions and integration points inside the body, which the other methods do without.

## Smoothness

Mean curvature of the ball after its handle was moved, turned and sheared along no axis of the lattice (9³ control points, a cage of 812
vertices). Roughness: root mean square of what is left of the mean curvature without what is longer than
{data["smoothness"]["length"]:.2g}, a cell of the lattice, three rings away from handle and fixed points.

![mean curvature by method](figures/methods_curvature.png)

{smoothness(data["smoothness"])}

## Precision and robustness

Misfit of the same motion, and what {data["robustness"]["faces_added"]} caps, needles, faces on their backs, edges with three faces and a loose triangle
do to it.

{classes}

Energies on faces count a face that lies twice twice: *subspace* follows the weights of such faces, and *MLS* places its samples by them.

## Dependence on the lattice

The same motion with lattices of three resolutions.

{resolution}

A lattice over a part of a plate whose middle planes are lifted: without planes at rest the plate tears where the lattice ends.

{partial}

## Adaptivity

A flat plate of {plate["points"]} points follows a target with two steps one edge high; every point is prescribed. RBF get centres where the error
is largest, DM-FFD planes of control points along x and y, DM-cages finer boxes.

![error against degrees of freedom](figures/methods_adaptivity.svg)

{adaptivity(plate)}

## Volume meshes

A bent pipe of {bent["cells"]:,} hexahedra is straightened by a third, narrowed and bulged; all {bent["boundary"]:,} boundary points are prescribed.

![least scaled Jacobian along the change](figures/methods_pipe.svg)

{pipe(bent)}

The lattices meet the boundary better the finer they are, and pay with cells: control points between the walls are left to the least
motion, not to the smoothest one.

{car_section(data)}"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--from", dest="source")
    parser.add_argument("build", nargs="?", default=str(ROOT / "build" / "release"))
    args = parser.parse_args()
    if args.source:
        text = pathlib.Path(args.source).read_text(encoding="utf-8")
    else:
        program = pathlib.Path(args.build) / "tests/bench/methods_bench"
        text = subprocess.run([str(program)], check=True, stdout=subprocess.PIPE, encoding="utf-8").stdout
    data = json.loads(text)
    (ROOT / "docs" / "which-method.md").write_text(page(data), encoding="utf-8")
    for section, what, value, holds in claims(data):
        if not holds:
            print(f"does not hold: {section}: {what}: {value}", file=sys.stderr)


if __name__ == "__main__":
    main()
