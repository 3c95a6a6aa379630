"""Convolutional networks that judge a picture of a scene's start.

`picture` paints scenes small, `backbones` knows networks by name, `network` judges, saves and
loads. How they learn is in `training`, above the sweeps.
"""
