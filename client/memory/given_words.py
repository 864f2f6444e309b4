"""What a script says of an array: words, and lengths that may bring their unit, as astropy's and pint's do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from volsplat.protocol.text.errors import BadInput


def words(name: str, value: Any) -> str:
    """A text, or what a library's unit is called. Raises BadInput."""
    if value is None or isinstance(value, str):
        return value or ""
    if hasattr(value, "to_string"):
        return str(value.to_string())
    if hasattr(value, "dimensionality"):
        return f"{value:~}"
    raise BadInput(f"{name} must be a text, not {value!r:.60}")


def letters(name: str, value: str | Sequence[str] | None, cure: str) -> str:
    """Letters in one text or one by one. Raises BadInput."""
    if value is None or isinstance(value, str):
        return value or ""
    if isinstance(value, list | tuple) and all(isinstance(letter, str) for letter in value):
        return "".join(value)
    raise BadInput(f"{name}={value!r:.60}: {cure}")


def unit_of(lengths: Any) -> str:
    """The unit that these bring, or the first of them that brings one; "" where none does."""
    each = (lengths, *lengths) if isinstance(lengths, list | tuple) else (lengths,)
    return next((unit_name(one) for one in each if _has_unit(one)), "")


def is_of_pint(one: Any) -> bool:
    """Whether it is such a library's quantity: a magnitude of units."""
    return hasattr(one, "magnitude") and hasattr(one, "units")


def unit_name(quantity: Any) -> str:
    """The unit of a quantity, in short."""
    return f"{quantity.units:~}" if is_of_pint(quantity) else str(quantity.unit)


def numbers(name: str, lengths: Any, shape: tuple[int, ...], unit: str) -> Any:
    """As an array; lengths that bring their unit in this one. Raises BadInput."""
    try:
        given = np.asarray(_in_unit(lengths, unit), float)
    except (TypeError, ValueError, AttributeError) as error:  # the last by pint, of a unit that it does not know
        if unit_of(lengths):
            raise BadInput(f"{name}={lengths!r:.60} cannot be brought to “{unit}”: {error}") from None
        given = np.empty(0)
    if given.shape != shape or not np.isfinite(given).all():
        raise BadInput(f"{name} must be {' x '.join(map(str, shape))} finite numbers, not {lengths!r:.60}")
    return given


def _in_unit(lengths: Any, unit: str) -> Any:
    if _has_unit(lengths):
        return _value(lengths, unit)
    if not isinstance(lengths, list | tuple) or not any(map(_has_unit, lengths)):
        return lengths
    if not all(map(_has_unit, lengths)):
        raise ValueError("some of them have no unit")
    return [_value(one, unit) for one in lengths]


def _has_unit(one: Any) -> bool:
    return is_of_pint(one) or (hasattr(one, "to_value") and hasattr(one, "unit"))


def _value(quantity: Any, unit: str) -> Any:
    return quantity.to(unit).magnitude if is_of_pint(quantity) else quantity.to_value(unit)
