"""What draws a pour: one file each.

A file defines a subclass of `pourcast.stimuli.renderers.base.Renderer` and names it `RENDERER`;
its `name` is the file's. Renderers don't import one another.
"""
