# SPDX-License-Identifier: Apache-2.0
"""A system as a component of OpenMDAO."""

from typing import Any

import openmdao.api as om

from ..errors import FailedPrecondition


class DeformationComponent(om.ExplicitComponent):  # type: ignore[misc]
    """Design variables to points: input "x" (k,), output "points" (n, 3) of the system, model units, with matrix-free derivatives in both modes.

    option system: a System or CompiledDeformation. A design that must not be used raises AnalysisError, which drivers of OpenMDAO take for a
    failed design.
    """

    def initialize(self) -> None:
        self.options.declare("system", recordable=False, desc="System or CompiledDeformation")

    def setup(self) -> None:
        system = self.options["system"]
        rest = system([0.0] * len(system.names), bad="keep")
        if rest.size == 0:
            raise FailedPrecondition("system: it has no points")
        self.add_input("x", shape=len(system.names))
        self.add_output("points", val=rest)

    def compute(self, inputs: Any, outputs: Any, discrete_inputs: Any = None, discrete_outputs: Any = None) -> None:
        points, report = self.options["system"].deform(inputs["x"])
        if report.bad:
            raise om.AnalysisError("; ".join(report.reasons) or "the verdict is bad")
        outputs["points"] = points

    def compute_jacvec_product(self, inputs: Any, d_inputs: Any, d_outputs: Any, mode: str, *_: Any) -> None:
        if "points" not in d_outputs or "x" not in d_inputs:
            return
        system = self.options["system"]
        if mode == "fwd":
            d_outputs["points"] += system.jvp(inputs["x"], d_inputs["x"])
        else:
            d_inputs["x"] += system.vjp(inputs["x"], d_outputs["points"])
