"""The MuZero local planner."""


class ModelError(RuntimeError):
    """A model cannot be used; the message names the file, the key and the mend."""
