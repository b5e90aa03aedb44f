# SPDX-License-Identifier: Apache-2.0
"""A system as a differentiable function of PyTorch."""

from typing import Any, Callable

import numpy as np
import torch


def torch_function(system: Any, **options: Any) -> Callable[[torch.Tensor], torch.Tensor]:
    """points = f(x): x (k,) to (n, 3), or X (m, k) to (m, n, 3), with gradients with respect to x by `vjp`.

    system: a System or CompiledDeformation. options: those of calling it; a bad design raises BadDesign unless bad="keep". Computed in doubles on
    the CPU; points have the type and device of x. Gradients once, not gradients of gradients.
    """

    class Deform(torch.autograd.Function):
        @staticmethod
        def forward(context: Any, x: torch.Tensor) -> torch.Tensor:
            context.save_for_backward(x)
            points = system(x.detach().cpu().to(torch.float64).numpy(), **options)
            return torch.as_tensor(points, dtype=x.dtype, device=x.device)

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[misc]
        def backward(context: Any, gradient: torch.Tensor) -> torch.Tensor:
            (x,) = context.saved_tensors
            designs = np.atleast_2d(x.detach().cpu().to(torch.float64).numpy())
            weights = gradient.detach().cpu().to(torch.float64).numpy().reshape(len(designs), -1, 3)
            rows = [system.vjp(design, np.ascontiguousarray(weight)) for design, weight in zip(designs, weights)]
            return torch.as_tensor(np.array(rows).reshape(x.shape), dtype=x.dtype, device=x.device)

    return Deform.apply  # type: ignore[no-any-return]
