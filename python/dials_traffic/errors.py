"""Errors of this package."""


class SimulatorError(RuntimeError):
    """An environment's process could not do what it was asked, for example because a config names a missing file."""


class ProcessDied(SimulatorError):
    """An environment's process has ended. The message names it, says how it ended and what it printed last."""
