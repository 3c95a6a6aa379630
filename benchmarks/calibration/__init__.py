"""History matching of what the paper leaves open; `python -m benchmarks.calibrate` drives it."""
