# SPDX-License-Identifier: Apache-2.0
import torch

import deformd
from deformd.adapters.torch import torch_function

system = deformd.Client().prepare("ahmed.yaml")
deform = torch_function(system)
goal = torch.as_tensor(system([0.02, -0.1]))
low, high = torch.as_tensor(system.bounds).T
free = torch.zeros(2, dtype=torch.float64, requires_grad=True)  # becomes variables within their bounds
optimizer = torch.optim.LBFGS([free], max_iter=60, line_search_fn="strong_wolfe")


def variables():
    return low + (high - low) * torch.sigmoid(free)


def loss():
    optimizer.zero_grad()
    value = ((deform(variables()) - goal) ** 2).sum()
    value.backward()
    return value


optimizer.step(loss)
print(variables().detach().numpy())
