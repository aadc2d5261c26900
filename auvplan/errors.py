"""Errors about user input, printed as one line by the commands."""


class AuvplanError(ValueError):
    """Bad input or output; the message is one line that names what is wrong."""


class ScenarioError(AuvplanError):
    """A scenario that cannot be built; the message is one line."""


class ScenarioWarning(UserWarning):
    """What may not be meant in a scenario or its files, and was assumed; the message is one line."""
