"""Experiments: who answers, and in what form the answers are kept."""
