"""Motion about and from a loaded state: natural modes, response in time, wind."""
