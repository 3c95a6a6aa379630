"""Experiments: one file each, data only.

A file makes one `pourcast.study.experiments.base.Experiment` and names it `EXPERIMENT`; its name
is the file's. `pourcast scenes`, `new`, `sweep`, `experiment`, `report`, `reproduce` and
`convnet` take it by that name. Experiments don't import one another.
"""
