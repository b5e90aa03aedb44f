# SPDX-License-Identifier: Apache-2.0
import numpy as np

import deformd

with deformd.Client() as client:  # DEFORM_SERVER, else 127.0.0.1:50051
    system = client.prepare("ahmed.yaml")  # once
    low, high = system.bounds.T
    designs = np.random.default_rng(1).uniform(low, high, (45, 2))
    population = system.deform(designs)  # points (45, n, 3) and a report of each
    heights = np.where(population.usable, population.points[:, :, 2].mean(axis=1), np.inf)
    best = int(heights.argmin())
    print(dict(zip(system.names, designs[best])), population.reports[best].verdict)
    system.geometry.write("best.obj", population.points[best])
