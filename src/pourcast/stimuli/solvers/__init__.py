"""What pours a liquid for the pictures: one file each.

A file defines a subclass of `pourcast.stimuli.solvers.base.Solver` and names it `SOLVER`; its
`name` is the file's. Solvers don't import one another.
"""
