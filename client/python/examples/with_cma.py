# SPDX-License-Identifier: Apache-2.0
import cma

import deformd
from deformd.adapters.cma import CmaObjective

system = deformd.Client().prepare("ahmed.yaml")
f = CmaObjective(system, lambda points, report: points[:, 2].mean())
strategy = cma.CMAEvolutionStrategy([0, 0], 0.02, {"bounds": f.cma_bounds, "popsize": 15, "CMA_mu": 2, "CMA_active": False, "seed": 1, "maxfevals": 150})
while not strategy.stop():
    designs = strategy.ask()
    strategy.tell(designs, f(designs))
print(dict(zip(system.names, strategy.result.xbest)), strategy.result.fbest)
