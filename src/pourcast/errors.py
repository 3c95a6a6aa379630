"""Errors that the command line shows as one line."""


class InputError(ValueError):
    """Something that was given to pourcast is wrong.

    The message is one line that names the file or option, the field, and what
    was expected. The command line prints it and exits with status 2.
    """


class StoreError(RuntimeError):
    """Results can't be kept or read: the disk is full, read-only or gone.

    The message is one line. The command line prints it and exits with status 1.
    """


class ClusterError(RuntimeError):
    """A cluster that did the work is gone; what was finished is kept.

    The message is one line. The command line prints it and exits with status 1.
    """


class TrainingError(RuntimeError):
    """A network did not learn.

    The message is one line. The command line prints it and exits with status 1.
    """
