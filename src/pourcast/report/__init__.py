"""Figures, published values, and the report: one HTML page that needs nothing else."""
