"""Sweeps: grids of models and parameters over a study's scenes, that survive anything.

`grid` says what is asked, `settings` what must be computed for it, `plan` cuts
that into shards of work, `store` keeps what is done, `survey` finds what is left,
`shard` does a piece, `executors` say where, `run` drives them, `table` gathers the
judgments, `status` tells how far it is, and `estimate` beforehand how long it takes.
`judgments` lets models judge a study through all this, and finds what was judged.
"""
