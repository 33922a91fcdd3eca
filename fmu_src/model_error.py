"""The one exception that a model raises on purpose."""


class ModelError(Exception):
    """Why the model cannot go on, in a sentence that names variables and values."""
