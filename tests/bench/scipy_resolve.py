#!/usr/bin/env python3
"""Solves one design from scratch with SciPy, as one would without a prepared system.

usage: scipy_resolve.py FOLDER
reads points.f64, centres.f64, displacements.f64 (n x 3 doubles); writes result.f64 (displacements) and scipy.json (seconds).
"""
import json
import os
import sys
import time

import numpy
from scipy.interpolate import RBFInterpolator

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
