"""Errors, named by what the person who meets one can do about it."""


class VveError(Exception):
    """Base of every error that the package raises on purpose; its text is one line for a person."""

    exit_code = 1


class ConfigError(VveError, ValueError):
    """A file, key, option or name is wrong: edit it. Nothing was written or moved."""

    exit_code = 2


class RigError(VveError, RuntimeError):
    """The car, its sensors or its bus are not ready: check the rig."""

    exit_code = 3


class SimulationError(VveError, RuntimeError):
    """SUMO broke or contradicted itself: report it with the record."""

    exit_code = 4
