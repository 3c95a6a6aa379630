"""The figures: one function each, tables or scenes in, a matplotlib figure out."""
