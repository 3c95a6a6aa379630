"""Scene families: ways to draw scenes at random, one file each; they know geometry only."""
