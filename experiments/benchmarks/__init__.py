"""Benchmarks that `benchmark.py` runs, one a module: cases from `cases`, times by `measure`."""
