"""Simulated observers: who answers in people's place before there are any."""
