#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Deforms by the radial basis functions of PhysicsNeMo on the CPU, for python_rivals.py; for a Python that has nvidia-physicsnemo.

usage: physicsnemo_resolve.py FOLDER
reads points.f64, centres.f64 (n x 3 doubles) and displacements.f64 (designs x centres x 3); writes physicsnemo.f64 (displacements of the first
design) and physicsnemo.json (processor seconds of each design, version).
"""
import importlib.metadata
import json
import os
import sys
import time

import numpy
import torch
from physicsnemo.nn.functional.geometry.deform.rbf import RadialBasisFunctionDeformPoints

folder = sys.argv[1]


def read(name, *shape):
    return torch.from_numpy(numpy.fromfile(os.path.join(folder, name)).reshape(*shape, 3))


points, centres = read("points.f64", -1), read("centres.f64", -1)
seconds = []
for i, displacements in enumerate(read("displacements.f64", -1, len(centres))):
    start = time.process_time()
    with torch.no_grad():
        result = RadialBasisFunctionDeformPoints.dispatch(points, centres, displacements, implementation="torch")
    seconds.append(time.process_time() - start)
    if i == 0:
        (result - points).numpy().tofile(os.path.join(folder, "physicsnemo.f64"))
with open(os.path.join(folder, "physicsnemo.json"), "w") as out:
    json.dump({"seconds": seconds, "version": importlib.metadata.version("nvidia-physicsnemo")}, out)
