# SPDX-License-Identifier: Apache-2.0
"""A system as a differentiable function of JAX."""

from typing import Any, Callable

import jax
import jax.numpy as jnp
import numpy as np


def jax_function(system: Any, **options: Any) -> Callable[[Any], Any]:
    """points = f(x): x (k,) to (n, 3), with gradients with respect to x by `vjp` (a custom_vjp: jax.grad, not jax.jvp). May be jitted.

    system: a System or CompiledDeformation. options: those of calling it; a bad design raises BadDesign, inside of JAX's own error, unless
    bad="keep". Computed in doubles on the host; points have the type of x, so set jax_enable_x64 for doubles.
    """
    count = len(system([0.0] * len(system.names), bad="keep"))

    def points_of(x: Any) -> np.ndarray:
        return np.asarray(system(np.asarray(x, dtype=np.float64), **options), dtype=x.dtype)

    def gradient_of(x: Any, weights: Any) -> np.ndarray:
        return np.asarray(system.vjp(np.asarray(x, dtype=np.float64), np.asarray(weights, dtype=np.float64)), dtype=x.dtype)

    @jax.custom_vjp
    def deform(x: Any) -> Any:
        x = jnp.asarray(x)
        return jax.pure_callback(points_of, jax.ShapeDtypeStruct((count, 3), x.dtype), x, vmap_method="sequential")

    def forward(x: Any) -> Any:
        return deform(x), jnp.asarray(x)

    def backward(x: Any, weights: Any) -> Any:
        return (jax.pure_callback(gradient_of, jax.ShapeDtypeStruct(x.shape, x.dtype), x, weights, vmap_method="sequential"),)

    deform.defvjp(forward, backward)
    return deform  # type: ignore[no-any-return]
