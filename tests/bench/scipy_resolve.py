#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Solves one design from scratch with SciPy, as one would without a prepared system.

usage: scipy_resolve.py FOLDER
reads points.f64, centres.f64, displacements.f64 (n x 3 doubles); writes result.f64 (displacements), scipy.json (seconds) and
reference.f64: the same interpolant solved and evaluated in extended precision, at every REFERENCE_STRIDE-th point.
"""
import json
import os
import sys
import time

import numpy
import scipy.linalg
from scipy.interpolate import RBFInterpolator

REFERENCE_STRIDE = 7

folder = sys.argv[1]


def read(name):
    return numpy.fromfile(os.path.join(folder, name)).reshape(-1, 3)


points, centres, displacements = read("points.f64"), read("centres.f64"), read("displacements.f64")
start = time.perf_counter()
interpolator = RBFInterpolator(centres, displacements, kernel="cubic", degree=1)
fitted = time.perf_counter()
result = interpolator(points)
done = time.perf_counter()
result.tofile(os.path.join(folder, "result.f64"))
with open(os.path.join(folder, "scipy.json"), "w") as out:
    json.dump({"fit_seconds": fitted - start, "evaluate_seconds": done - fitted}, out)


def cubes(a, b):
    squares = sum((a[:, None, k] - b[None, :, k]) ** 2 for k in range(3))
    return squares * numpy.sqrt(squares)


def reference(places):
    """LU with iterative refinement, residuals and sums in numpy.longdouble; coordinates scaled to the unit box."""
    extended = numpy.longdouble
    low = centres.min(axis=0).astype(extended)
    size = (centres.max(axis=0) - centres.min(axis=0)).max()
    c, p = (centres - low) / size, (places - low) / size
    m = len(c)
    matrix = numpy.zeros((m + 4, m + 4), extended)
    matrix[:m, :m] = cubes(c, c)
    matrix[:m, m], matrix[:m, m + 1:] = 1, c
    matrix[m:, :m] = matrix[:m, m:].T
    right = numpy.zeros((m + 4, 3), extended)
    right[:m] = displacements
    factor = scipy.linalg.lu_factor(matrix.astype(float))
    x = numpy.zeros_like(right)
    for _ in range(4):
        x = x + scipy.linalg.lu_solve(factor, (right - matrix @ x).astype(float))
    parts = [cubes(p[k:k + 1000], c) @ x[:m] for k in range(0, len(p), 1000)]
    return (numpy.concatenate(parts) + x[m] + p @ x[m + 1:]).astype(float)


reference(points[::REFERENCE_STRIDE]).tofile(os.path.join(folder, "reference.f64"))
