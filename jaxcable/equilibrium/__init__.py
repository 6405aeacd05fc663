"""From a system to its equilibrium: Newton's method and what steers it, the incremental scheme."""
