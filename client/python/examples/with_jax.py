# SPDX-License-Identifier: Apache-2.0
import jax
import numpy as np
from scipy.optimize import minimize

import deformd
from deformd.adapters.jax import jax_function

jax.config.update("jax_enable_x64", True)
system = deformd.Client().prepare("ahmed.yaml")
deform = jax_function(system)
goal = system([0.02, -0.1])
loss = jax.jit(jax.value_and_grad(lambda x: ((deform(x) - goal) ** 2).sum()))
found = minimize(lambda x: [np.asarray(each) for each in loss(x)], np.zeros(2), jac=True, bounds=list(map(tuple, system.bounds)))
print(found.x)
