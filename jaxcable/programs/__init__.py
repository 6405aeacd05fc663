"""Programs of jax evaluated by NumPy at once, and compiled by XLA when that pays."""
