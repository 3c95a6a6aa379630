"""The models: one file each, and the paper's presets in `presets.toml`.

A file defines a subclass of `pourcast.models.base.Model` and names it `MODEL`; its
name on the command line is the file's. Models don't import one another.
"""
