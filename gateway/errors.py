"""What can go wrong, as one tree. The command line turns each into one line and an exit status."""


class ShadowError(Exception):
    """The work failed: exit status 1. The message says what, where and what to do."""

    exit_status = 1


class BadInput(ShadowError):
    """A file, option or value that cannot be used: exit status 2."""

    exit_status = 2
