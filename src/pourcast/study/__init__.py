"""A study: the folder on which every command works, and how its scenes are chosen."""
