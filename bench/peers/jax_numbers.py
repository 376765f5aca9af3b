"""The functions over JAX's numbers, in double precision."""

from __future__ import annotations

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

JAX = {
    "sin": jnp.sin,
    "cos": jnp.cos,
    "tan": jnp.tan,
    "atan": jnp.arctan,
    "tanh": jnp.tanh,
    "exp": jnp.exp,
    "log": jnp.log,
    "sqrt": jnp.sqrt,
    "absolute": jnp.abs,
    "sign": jnp.sign,
    "where": jnp.where,
    "maximum": jnp.maximum,
    "minimum": jnp.minimum,
}
