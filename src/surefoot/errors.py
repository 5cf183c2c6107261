"""The one error type that a user is meant to read."""


class UserError(ValueError):
    """Something a user gave is wrong: the message is one line that names the value and the valid ones."""
