"""Training convolutional networks on scenes that the ground truth has labelled.

`data` draws and labels scenes, `learner` trains one network, `pair` the two of an experiment.
"""
