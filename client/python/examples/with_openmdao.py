# SPDX-License-Identifier: Apache-2.0
import numpy as np
import openmdao.api as om

import deformd
from deformd.adapters.openmdao import DeformationComponent


class Distance(om.ExplicitComponent):
    def setup(self):
        self.add_input("points", shape=goal.shape)
        self.add_output("distance")
        self.declare_partials("distance", "points")

    def compute(self, inputs, outputs):
        outputs["distance"] = np.sum((inputs["points"] - goal) ** 2)

    def compute_partials(self, inputs, partials):
        partials["distance", "points"] = 2 * (inputs["points"] - goal).reshape(1, -1)


system = deformd.Client().prepare("ahmed.yaml")
goal = system([0.02, -0.1])
problem = om.Problem(reports=False)
problem.model.add_subsystem("shape", DeformationComponent(system=system), promotes=["*"])
problem.model.add_subsystem("distance", Distance(), promotes=["*"])
low, high = system.bounds.T
problem.model.add_design_var("x", lower=low, upper=high)
problem.model.add_objective("distance")
problem.driver = om.ScipyOptimizeDriver(optimizer="L-BFGS-B", tol=1e-12, disp=False)
problem.setup()
problem.set_val("x", [0, 0])
problem.run_driver()
print(problem.get_val("x"))
