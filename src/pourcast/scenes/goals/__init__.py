"""What is asked of a scene: one file each.

A file defines a subclass of `pourcast.scenes.goals.base.Goal` and names it `GOAL`; its
`kind` is the file's name. Goals don't import one another.
"""
