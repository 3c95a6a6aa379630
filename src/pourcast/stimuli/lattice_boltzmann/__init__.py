"""A free-surface lattice-Boltzmann solver: liquid that shares nothing with the particle engine."""
