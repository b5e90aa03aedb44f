# SPDX-License-Identifier: Apache-2.0
"""A system as the simulator of libEnsemble, and the user's part of its generators."""

from typing import Any, Dict

import numpy as np

from ..quality import NAMES
from ..system import System
from . import Objective


def sim_function(h: Any, persis_info: Any, sim_specs: Dict[str, Any], *_: Any) -> Any:
    """A sim_f of libEnsemble: evaluates the rows of H["x"] (m, k) in one batch and gives "f", and "usable" where sim_specs["out"] has it.

    sim_specs["user"]: "system", a System or CompiledDeformation (both travel to workers, which connect anew), "objective"(points, report), and
    "penalty", 1e30 unless given, which is f of designs that must not be used or have no finite value. "quality", a Quality (of a path, where
    workers are processes): outputs that bear the names of its measures get them, NaN of designs that must not be used.
    """
    user = sim_specs["user"]
    objective: Objective = user["objective"]
    population = user["system"].deform(np.ascontiguousarray(h["x"]))
    out = np.zeros(len(h), dtype=sim_specs["out"])
    usable = population.usable
    quality = user.get("quality")
    measures = [name for name in out.dtype.names or () if quality is not None and name in NAMES]
    for i, (points, report) in enumerate(zip(population.points, population.reports)):
        value = np.nan if report.bad else np.asarray(objective(points, report), dtype=np.float64)
        usable[i] = np.isfinite(value).all()
        out["f"][i] = value if usable[i] else user.get("penalty", 1e30)
        known = {} if report.bad or not measures else quality.values(points, measures, report)
        for name in measures:
            out[name][i] = known.get(name, np.nan)
    if "usable" in (out.dtype.names or ()):
        out["usable"] = usable
    return out, persis_info


def generator_user(system: System, **more: Any) -> Dict[str, Any]:
    """gen_specs["user"] of the generators of libEnsemble: "lb" and "ub" of the design variables, and `more`."""
    low, high = system.bounds.T
    return {"lb": low, "ub": high, **more}
