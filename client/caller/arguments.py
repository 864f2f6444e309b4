"""What a script hands in, checked and converted at once, so that an error reaches the caller.

Scripts hold their numbers as numpy's and torch's scalars, as arrays without axes and as lists; what goes on from here
are Python's own, as they will come out of a message on the servers' side.
"""

import math
import os
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

import msgspec

from volsplat.protocol.description.python_values import python_value
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Index
from volsplat.protocol.rules.levels import Thinning
from volsplat.protocol.text.byte_sizes import bytes_from_option
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import Address, parse_address

MAKE_A_SCENE = (
    "session.default_scene() gives one, whose with_(zoom=2) changes a part; volsplat.render(session, 'ct-bone') draws "
    "a preset's"
)
GRID_AXES = ("i", "j", "k")
MOST_OCTAVES = 64  # more leave nothing of any volume, and are refused with its step
_SHOWN = 60  # characters of a value that is refused
_Word = TypeVar("_Word", bound=StrEnum)


def checked_scene(scene: Scene) -> Scene:
    """The scene with Python's own numbers in it, by way of the bytes that the servers get. Raises BadInput."""
    if not isinstance(scene, Scene):
        raise BadInput(f"a Scene is wanted, not {_shown(scene)}; {MAKE_A_SCENE}")
    try:
        return _SCENES.decode(_ENCODER.encode(scene))
    except (msgspec.DecodeError, ValueError, TypeError, ArithmeticError, RecursionError) as error:
        raise BadInput(f"the scene cannot be drawn: {' '.join(str(error).split())}") from None


def checked_step(step: Step | str, name: str = "step") -> Step:
    """One of A to G; its letter will do. Raises BadInput."""
    return _checked_word(step, Step, name)


def checked_steps(steps: Iterable[Step | str], name: str) -> frozenset[Step]:
    """Steps, each as `checked_step` takes it. Raises BadInput."""
    try:
        each = list(steps)
    except TypeError:
        raise BadInput(f"{name} must be steps, as (Step.F,), not {_shown(steps)}") from None
    return frozenset(checked_step(step, name) for step in each)


def checked_thinning(thinning: Thinning) -> Thinning:
    """With Python's own numbers. Raises BadInput; whether so much can be left out, the step and the volume decide."""
    if not isinstance(thinning, Thinning):
        raise BadInput(f"thinning must be a Thinning, as Thinning(octaves=1), not {_shown(thinning)}")
    return Thinning(
        min(checked_place(thinning.octaves, "thinning.octaves"), MOST_OCTAVES),
        checked_count(thinning.sheets, "thinning.sheets"),
        checked_count(thinning.rows, "thinning.rows"),
        checked_number(thinning.frozen_alpha, "thinning.frozen_alpha", least=0.0),
    )


def checked_number(value: float, name: str, least: float | None = None) -> float:
    """A number; neither NaN nor below `least` if that is set. Raises BadInput."""
    number = python_value(value)
    if isinstance(number, bool) or not isinstance(number, int | float):
        raise BadInput(f"{name} must be a number, not {_shown(value)}")
    try:
        number = float(number)
    except OverflowError:
        number = math.copysign(math.inf, number)
    if least is not None and not number >= least:
        raise BadInput(f"{name} must be a number from {least:g} on, not {_shown(value)}")
    return number


def checked_count(value: int, name: str) -> int:
    """A whole number from 1 on. Raises BadInput."""
    number = python_value(value)
    if not _is_whole(number):
        raise BadInput(f"{name} must be a whole number, not {_shown(value)}")
    if number < 1:
        raise BadInput(f"{name} must be 1 or more, not {number}")
    return number


def checked_index(index: Any) -> Index:
    """The three indices of a voxel. Raises BadInput."""
    own = python_value(index)
    parts = [python_value(part) for part in own] if isinstance(own, list | tuple) else []
    if len(parts) != 3 or not all(map(_is_whole, parts)):
        raise BadInput(f"index must be three whole numbers (i, j, k), not {_shown(index)}")
    i, j, k = parts
    return (i, j, k)


def checked_axis(value: str) -> int:
    """The number of a grid axis, told by its letter. Raises BadInput."""
    if not isinstance(value, str) or value not in GRID_AXES:
        raise BadInput(f"axis must be one of {', '.join(GRID_AXES)}, not {_shown(value)}")
    return GRID_AXES.index(value)


def checked_place(value: int, name: str) -> int:
    """A whole number from 0 on. Raises BadInput."""
    number = python_value(value)
    if not _is_whole(number) or number < 0:
        raise BadInput(f"{name} must be a whole number from 0 on, not {_shown(value)}")
    return number


def checked_bytes(value: int | str, name: str) -> int:
    """A number of bytes, "2G" as well. Raises BadInput."""
    return bytes_from_option(name, value) if isinstance(value, str) else checked_count(value, name)


def checked_volume(volume: "str | os.PathLike[str]") -> str:
    """A volume's name. Raises BadInput."""
    try:
        name = os.fspath(volume)
    except TypeError:
        name = ""
    if not isinstance(name, str) or not name or "\0" in name:
        cure = "; make an array of it by np.array" if isinstance(volume, list | tuple) else ""
        raise BadInput(f"a volume's path or URL, or an array, is wanted, not {_shown(volume)}{cure}")
    return str(Path(name)) if isinstance(volume, Path) else name


def checked_address(address: Address | str, name: str) -> Address:
    """Where to listen, "HOST:PORT" as well. Raises BadInput."""
    if isinstance(address, str):
        return parse_address(address)
    match address:
        case (str() as host, port) if isinstance(number := python_value(port), int) and 0 <= number <= 65535:
            return Address(host, number)
    raise BadInput(f"{name} must be an Address or HOST:PORT, not {_shown(address)}")


def _checked_word(value: _Word | str, words: type[_Word], name: str) -> _Word:
    try:
        return words(value)
    except ValueError:
        raise BadInput(f"{name} must be one of {', '.join(words)}, not {_shown(value)}") from None


def _is_whole(own: Any) -> TypeGuard[int]:
    return isinstance(own, int) and not isinstance(own, bool)


def _plain(value: Any) -> Any:
    """For msgspec: what it does not know. Raises TypeError."""
    plain = python_value(value)
    if plain is value:
        raise TypeError(f"{_shown(value)} is neither a number nor a word")
    return plain


def _shown(value: object) -> str:
    """The value for a person, in one short line."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # it is a stranger's
        text = "?"
    text = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
    return f"the {type(value).__name__} {text}"


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_plain)
_SCENES = msgspec.msgpack.Decoder(Scene)
