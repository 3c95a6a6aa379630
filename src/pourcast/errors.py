"""The error for bad input, which the command line shows as one line."""


class InputError(ValueError):
    """Something that was given to pourcast is wrong.

    The message is one line that names the file or option, the field, and what
    was expected. The command line prints it and exits with status 2.
    """
