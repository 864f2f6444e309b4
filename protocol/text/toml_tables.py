"""TOML that people write: what it holds, and where in it something is wrong."""

import json
import re
import tomllib
from typing import Any, NamedTuple

import msgspec

from volsplat.protocol.text.errors import BadInput

LONGEST_SHOWN = 60  # characters of a value
_SYNTAX_PLACE = re.compile(r"^(.*) \(at line (\d+), column (\d+)\)$", re.DOTALL)
_VALUE_PLACE = re.compile(r"^(.*) - at `(?:key in )?\$\.?(.*)`$", re.DOTALL)


class Complaint(NamedTuple):
    """What is wrong with a value, and its place: keys and indices, as in tables.emit.points[2][0]; "" of the whole."""

    what: str
    place: str


def toml_tables(text: str, name: str) -> dict[str, Any]:
    """What TOML text holds. Raises BadInput, which begins with its `name`, and line and column where they are known."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = _SYNTAX_PLACE.match(str(error))
        what, where = (place[1], f":{place[2]}:{place[3]}") if place else (str(error), "")
        raise BadInput(f"{name}{where}: this is not TOML: {what}; put it right there") from error
    except ValueError as error:  # an integer of more than 4300 digits, an impossible date
        raise BadInput(f"{name}: this is not TOML: {error}; put it right") from error
    except RecursionError as error:
        raise BadInput(f"{name}: its arrays or tables are nested too deeply; make it flatter") from error


def complaint_of(error: msgspec.ValidationError) -> Complaint:
    match = _VALUE_PLACE.match(str(error))
    return Complaint(match[1], match[2]) if match else Complaint(str(error), "")


def value_at(tables: dict[str, Any], place: str) -> Any:
    """The value that lies there, as far as the place leads."""
    value: Any = tables
    for part in re.findall(r"[^.\[\]]+", place):
        if isinstance(value, list | tuple) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        elif isinstance(value, dict) and part in value:
            value = value[part]
    return value


def shown_place(place: str) -> str:
    return place if place.isprintable() else json.dumps(place)


def shown_value(value: Any) -> str:
    """As far as it goes into a line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    try:
        text = repr(value)
    except ValueError:  # Python writes no integer of more than 4300 digits
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + "..."
