"""Values of Python's own, made of what scripts hold: scalars and arrays of numpy and torch, and other numbers."""

import operator
from numbers import Real
from typing import Any


def python_value(value: Any) -> Any:
    """The value as Python's own number, text or list if it is another library's; else itself."""
    if type(value) in (bool, int, float, str):
        return value
    if hasattr(value, "tolist"):  # numpy's and torch's scalars and arrays
        try:
            return value.tolist()
        except (TypeError, ValueError, RuntimeError):  # of a tensor that has no values
            return value
    if isinstance(value, str):
        return str.__str__(value)
    if hasattr(value, "__index__"):
        return operator.index(value)
    return float(value) if isinstance(value, Real) else value
