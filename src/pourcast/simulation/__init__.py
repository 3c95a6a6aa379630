"""From scenes and liquids to the engine's arrays and back: the only place where they meet.

`settings` says how we compute, `pour` what is to be run and how it ended, `run` runs it.
"""
