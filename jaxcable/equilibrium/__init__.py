"""From a system to its equilibrium: Newton's method, its globalization, the incremental scheme."""
