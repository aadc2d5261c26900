"""What is wrong with what somebody gave: errors that a command prints as one line."""


class AuvplanError(ValueError):
    """Bad input or output; the message is one line that names what is wrong."""


class ScenarioError(AuvplanError):
    """A scenario that cannot be built; the message is one line."""


class ScenarioWarning(UserWarning):
    """What may not be meant in a scenario or its files, and was assumed; the message is one line."""
