"""What `benchmark.py` runs: a benchmark a module, from the cases in `cases` and by `measure`."""
