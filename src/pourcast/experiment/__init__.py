"""The experiment with people: design, page, server, storage of what they answer, data."""
