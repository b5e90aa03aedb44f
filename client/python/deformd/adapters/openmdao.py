# SPDX-License-Identifier: Apache-2.0
"""A system as a component of OpenMDAO."""

from typing import Any

import numpy as np
import openmdao.api as om

from ..errors import FailedPrecondition, InvalidArgument
from ..quality import NAMES, REPORT_MEASURES, differences


class DeformationComponent(om.ExplicitComponent):  # type: ignore[misc]
    """Design variables to points: input "x" (k,), output "points" (n, 3) of the system, model units, with matrix-free derivatives in both modes.

    option system: a System or CompiledDeformation. A design that must not be used raises AnalysisError, which drivers of OpenMDAO take for a
    failed design.
    options quality, measures: a Quality, and names of its measures, which become outputs: prob.model.add_constraint("deform.scaled_jacobian", lower=0.1).
    Dots in names, as in "hexahedron.volume", are written "_". Their derivatives are differences of two designs per variable; counts have none and are
    0, so that only drivers without gradients hold them.
    """

    def initialize(self) -> None:
        self.options.declare("system", recordable=False, desc="System or CompiledDeformation")
        self.options.declare("quality", default=None, recordable=False, desc="Quality of the mesh")
        self.options.declare("measures", default=(), types=(list, tuple), desc="names of measures of quality that become outputs")

    def setup(self) -> None:
        system = self.options["system"]
        rest = system([0.0] * len(system.names), bad="keep")
        if rest.size == 0:
            raise FailedPrecondition("system: it has no points")
        self.add_input("x", shape=len(system.names))
        self.add_output("points", val=rest)
        self._quality_outputs = {name.replace(".", "_"): name for name in self.options["measures"]}
        self._quality_slopes: Any = None  # of them with respect to x, and that x
        if self._quality_outputs and self.options["quality"] is None:
            raise InvalidArgument("quality: missing; it measures " + ", ".join(self._quality_outputs.values()))
        for output, name in self._quality_outputs.items():
            if name not in REPORT_MEASURES:
                self.options["quality"].check(name)
            self.add_output(output)

    def compute(self, inputs: Any, outputs: Any, discrete_inputs: Any = None, discrete_outputs: Any = None) -> None:
        points, report = self.options["system"].deform(inputs["x"])
        if report.bad:
            raise om.AnalysisError("; ".join(report.reasons) or "the verdict is bad")
        outputs["points"] = points
        if self._quality_outputs:
            values = self.options["quality"].values(points, list(self._quality_outputs.values()), report)
            for output, name in self._quality_outputs.items():
                outputs[output] = values[name]

    def _quality_slope(self, x: Any, name: str) -> Any:
        if self._quality_slopes is None or not np.array_equal(self._quality_slopes[0], x):
            smooth = [each for each in self._quality_outputs.values() if not NAMES[each]]
            self._quality_slopes = np.array(x), differences(self.options["system"], x, self.options["quality"], smooth)
        return self._quality_slopes[1].get(name, np.zeros(len(x)))

    def compute_jacvec_product(self, inputs: Any, d_inputs: Any, d_outputs: Any, mode: str, *_: Any) -> None:
        if "x" not in d_inputs:
            return
        for output, name in self._quality_outputs.items():
            if output not in d_outputs:
                continue
            if mode == "fwd":
                d_outputs[output] += self._quality_slope(inputs["x"], name) @ d_inputs["x"]
            elif np.any(d_outputs[output]):
                d_inputs["x"] += self._quality_slope(inputs["x"], name) * d_outputs[output]
        if "points" not in d_outputs:
            return
        system = self.options["system"]
        if mode == "fwd":
            d_outputs["points"] += system.jvp(inputs["x"], d_inputs["x"])
        else:
            d_inputs["x"] += system.vjp(inputs["x"], d_outputs["points"])
