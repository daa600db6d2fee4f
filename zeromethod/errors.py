"""The two ways a run can end badly; the command line turns them into exit codes."""


class InputError(ValueError):
    """What the user gave cannot be used (exit code 2).

    The message is one line: where (file, key or argument), the value, what is allowed.
    """


class MeasurementError(RuntimeError):
    """The input was sound but the measurement failed (exit code 1); the message is the reason."""
