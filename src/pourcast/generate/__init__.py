"""Scene families, one file each, and what chooses among their draws.

`voronoi` (Experiment 1) and `shapes` (Experiment 2) know geometry only;
`select` simulates, to drop scenes and to choose contrasting ones; `importers`
and `exporters` are the doors to scenes made elsewhere.
"""
