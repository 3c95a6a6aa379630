"""The design of an experiment: `experiment.toml`, the words shown, who sees what and when."""
