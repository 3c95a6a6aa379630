"""Where what participants answered is kept: a database, and a journal beside it."""
