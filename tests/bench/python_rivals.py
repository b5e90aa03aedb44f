#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""One new design of many, 50,000 points from 2,000 centres: deformd beside what a Python user would write instead.

usage: python_rivals.py BUILD [--physicsnemo PYTHON] [--points N] [--centres M]      needs DEFORM_BUILD_PYTHON; prints a table
  --physicsnemo PYTHON   a Python that has nvidia-physicsnemo, which is left out unless given
All in one run, on the same points, centres and displacements, with the thin plate kernel r^2 log r and linear polynomials, which all of
them have. Times are processor time of all threads and processes (of deformd: client and server), which others on the machine change little;
the median of several designs. Results are held against one in extended precision.
"""
import argparse
import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
parser = argparse.ArgumentParser()
parser.add_argument("build", type=pathlib.Path)
parser.add_argument("--physicsnemo", metavar="PYTHON")
parser.add_argument("--points", type=int, default=50_000)
parser.add_argument("--centres", type=int, default=2000)
options = parser.parse_args()
BUILD = options.build.resolve()
os.environ["DEFORM_BIN"], os.environ["DEFORMD_BIN"] = str(BUILD / "client/cli/deform"), str(BUILD / "server/deformd")
sys.path[:0] = [str(BUILD / "client/python"), str(ROOT / "tests/end_to_end")]

import numpy as np  # noqa: E402
import scipy  # noqa: E402
import scipy.linalg  # noqa: E402
from scipy.interpolate import RBFInterpolator  # noqa: E402

import deformd  # noqa: E402
from harness import DEFORM, Server  # noqa: E402

HANDLES, POPULATION, REFERENCE_STRIDE = 20, 15, 50
AGREEMENT = 1e-9
"""A fraction of the largest displacement: how far deformd may be from extended precision."""


def own_seconds():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def process_seconds(pid):
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def median_seconds(work, repetitions):
    times = []
    for i in range(repetitions):
        before = own_seconds()
        work(i)
        times.append(own_seconds() - before)
    return float(np.median(times))


class Case:
    """The Ahmed body. Half of the centres are in 20 handles, the points nearest to as many places far apart; the others are fixed, spread over what
    is at least three times as far from the places as a handle reaches."""

    def __init__(self, folder, client, server):
        subprocess.run([DEFORM, "sample", "-o", "ahmed.obj", "--points", str(options.points)], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        random = np.random.default_rng(1)
        geometry = client.register(os.path.join(folder, "ahmed.obj"))
        self.points = np.array(geometry.points)
        places = [self.points[0]]
        for _ in range(1, HANDLES):
            places.append(self.points[np.argmax(np.min([((self.points - place) ** 2).sum(axis=1) for place in places], axis=0))])
        away = np.sqrt([((self.points - place) ** 2).sum(axis=1) for place in places])
        each = options.centres // 2 // HANDLES
        moving = np.concatenate([np.argsort(distances)[:each] for distances in away])
        assert len(set(moving)) == len(moving)
        self.handle = np.repeat(np.arange(HANDLES), each)
        reach = max(np.sort(distances)[each] for distances in away)
        fixed = random.choice(np.flatnonzero(away.min(axis=0) > 3 * reach), options.centres - len(moving), replace=False)
        self.ids = np.concatenate([moving, fixed])
        self.centres = self.points[self.ids]
        handles = [{"name": f"h{h}", "region": {"ids": moving[self.handle == h].tolist()}} for h in range(HANDLES)]
        variables = [{"name": f"h{h}{axis}", "handle": f"h{h}", "translate": [float(axis == other) for other in "xyz"]}
                     for h in range(HANDLES) for axis in "xyz"]
        before = process_seconds(server.process.pid)
        self.system = client.prepare({"method": {"rbf": {"kernel": "THIN_PLATE"}}, "handles": handles, "fixed": [{"ids": fixed.tolist()}],
                                      "variables": variables}, geometry)
        self.prepared = process_seconds(server.process.pid) - before
        assert self.system.info.centres == options.centres
        self.designs = random.uniform(-0.01, 0.01, (20 * POPULATION, len(variables)))

    def displacements(self, design):
        """At the centres: (m, 3)."""
        return np.concatenate([design.reshape(HANDLES, 3)[self.handle], np.zeros((len(self.centres) - len(self.handle), 3))])


def kernel(a, b):
    squares = sum((a[:, None, k] - b[None, :, k]) ** 2 for k in range(3))
    return squares * np.log(np.where(squares > 0, squares, 1)) / 2


def bordered(centres):
    count = len(centres)
    matrix = np.zeros((count + 4, count + 4), centres.dtype)
    matrix[:count, :count] = kernel(centres, centres)
    matrix[:count, count], matrix[:count, count + 1:] = 1, centres
    matrix[count:, :count] = matrix[:count, count:].T
    return matrix


def right_hand_side(displacements):
    return np.concatenate([displacements, np.zeros((4, displacements.shape[1]))])


def reference(points, centres, displacements):
    """LU with refinement; residuals and sums in numpy.longdouble."""
    points, centres = points.astype(np.longdouble), centres.astype(np.longdouble)
    matrix, right = bordered(centres), right_hand_side(displacements).astype(np.longdouble)
    factor = scipy.linalg.lu_factor(matrix.astype(float))
    solution = np.zeros_like(right)
    for _ in range(4):
        solution = solution + scipy.linalg.lu_solve(factor, (right - matrix @ solution).astype(float))
    return (kernel(points, centres) @ solution[:-4] + solution[-4] + points @ solution[-3:]).astype(float)


def with_deformd(case, server):
    """(seconds by the server, seconds without it, displacements of the first design by either)."""
    def spent():
        return own_seconds() + process_seconds(server.process.pid)

    case.system.deform(case.designs[:POPULATION], encoding="RAW_F64")
    before = spent()
    for first in range(0, len(case.designs), POPULATION):
        case.system.deform(case.designs[first:first + POPULATION], encoding="RAW_F64")
    served = (spent() - before) / len(case.designs)
    fast = case.system.local()
    out = np.empty((POPULATION, *case.points.shape))
    local = median_seconds(lambda i: fast(case.designs[:POPULATION], out=out, bad="keep"), 20) / POPULATION
    return served, local, case.system(case.designs[0], bad="keep") - case.points, fast(case.designs[0], bad="keep") - case.points


def with_scipy(case):
    """[(name, seconds, displacements of the first design)]"""
    kept = {}

    def again(i):
        kept["again"] = kept.get("again", RBFInterpolator(case.centres, case.displacements(case.designs[i]), kernel="thin_plate_spline", degree=1)(case.points))

    start = own_seconds()
    factor = scipy.linalg.lu_factor(bordered(case.centres))
    matrix = np.concatenate([kernel(part, case.centres) for part in np.array_split(case.points, 50)])
    ones = np.concatenate([np.ones((len(case.points), 1)), case.points], axis=1)
    prepared = own_seconds() - start
    interpolator = RBFInterpolator(case.centres, case.displacements(case.designs[0]), kernel="thin_plate_spline", degree=1)
    interpolator._shift, interpolator._scale = np.zeros(3), np.ones(3)  # coefficients in the coordinates as they are

    def factored(i):
        interpolator._coeffs = scipy.linalg.lu_solve(factor, right_hand_side(case.displacements(case.designs[i])))
        kept.setdefault("factored", interpolator(case.points))

    def multiplied(i):
        rows = np.concatenate([case.displacements(design) for design in case.designs[:POPULATION]], axis=1)
        solution = scipy.linalg.lu_solve(factor, right_hand_side(rows))
        result = matrix @ solution[:-4]
        result += ones @ solution[-4:]
        kept.setdefault("multiplied", result[:, :3].copy())

    return prepared, [
        ("SciPy's RBFInterpolator, fitted again for each design", median_seconds(again, 3), kept["again"]),
        ("SciPy, the factor kept, RBFInterpolator evaluates", median_seconds(factored, 3), kept["factored"]),
        (f"the same, the matrix of the kernel kept ({matrix.nbytes / 1e9:.2g} GB), one product for {POPULATION} designs",
         median_seconds(multiplied, 3) / POPULATION, kept["multiplied"])]


def with_physicsnemo(case, folder):
    case.points.tofile(os.path.join(folder, "points.f64"))
    case.centres.tofile(os.path.join(folder, "centres.f64"))
    np.array([case.displacements(design) for design in case.designs[:3]]).tofile(os.path.join(folder, "displacements.f64"))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run([options.physicsnemo, str(ROOT / "tests/bench/physicsnemo_resolve.py"), folder], check=True, env=environment)
    told = json.loads(pathlib.Path(folder, "physicsnemo.json").read_text())
    result = np.fromfile(os.path.join(folder, "physicsnemo.f64")).reshape(-1, 3)
    return f"PhysicsNeMo {told['version']}, on the CPU", float(np.median(told["seconds"])), result


def main():
    with tempfile.TemporaryDirectory(prefix="deform-rivals-") as folder:
        server = Server(folder).start()
        try:
            with deformd.Client(server.address) as client:
                case = Case(folder, client, server)
                served, local, by_server, by_local = with_deformd(case, server)
        finally:
            server.stop()
        prepared, rivals = with_scipy(case)
        if options.physicsnemo:
            rivals.append(with_physicsnemo(case, folder))
    exact = reference(case.points[::REFERENCE_STRIDE], case.centres, case.displacements(case.designs[0]))
    largest = np.abs(exact).max()

    def error(result):
        return np.abs(result[::REFERENCE_STRIDE] - exact).max() / largest

    print(f"\n### One design of many: {len(case.points):,} points, {options.centres:,} centres, {HANDLES} handles\n\nSciPy {scipy.__version__}, numpy "
          f"{np.__version__}. SciPy's factor and matrix took {prepared:.2g} s of processor time, deformd's "
          f"system {case.prepared:.2g} s.\n")
    print("| | processor time of a design | against deformd | against `system.local()` | error / largest displacement |\n|---|---|---|---|---|")
    print(f"| deformd: a server and its client, populations of {POPULATION} | {1e3 * served:.3g} ms | 1 | | {error(by_server):.1e} |")
    print(f"| deformd: `system.local()`, the same | {1e3 * local:.3g} ms | | 1 | {error(by_local):.1e} |")
    for name, seconds, result in rivals:
        print(f"| {name} | {1e3 * seconds:.4g} ms | {seconds / served:.3g} | {seconds / local:.3g} | {error(result):.1e} |")
    checks = [("against RBFInterpolator fitted again", rivals[0][1] / served, 300, ""), ("against SciPy with the factor kept", rivals[1][1] / served, 20, "")]
    print("\n| figure | must reach | measured | |\n|---|---|---|---|")
    missed = 0
    for name, value, limit, _ in checks:
        missed += value < limit
        print(f"| {name} | >= {limit}x | {value:.4g}x | {'PASS' if value >= limit else 'MISS'} |")
    for name, result in (("the server", by_server), ("`system.local()`", by_local)):
        missed += not error(result) <= AGREEMENT
        print(f"| error of {name} / largest displacement | <= {AGREEMENT} | {error(result):.1e} | {'PASS' if error(result) <= AGREEMENT else 'MISS'} |")
    for name, _, result in rivals:  # else they would not do the same work
        away = error(result)
        missed += not away <= 1e-6
        print(f"| error of {name} | <= 1e-6 | {away:.1e} | {'PASS' if away <= 1e-6 else 'MISS'} |")
    return missed > 0


if __name__ == "__main__":
    sys.exit(main())
