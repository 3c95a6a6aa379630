"""Liquids: one file of data each, in the form in which a study's `study.toml` defines its own."""
