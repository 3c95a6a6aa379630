"""The design of an experiment: its settings and words, materials, and who sees what when."""
