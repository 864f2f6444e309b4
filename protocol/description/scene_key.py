"""What a key of the scene declares beside its type: meaning, limits, unit, and what sets it on the page.

A key is a field of a `Part` whose type is `Annotated[type, Key(...)]`, a section is one whose type is
`Annotated[part, Section(...)]`. A scene's checks, its file's comments, the command line, the page and the docs are made
from these.
"""

import math
from collections.abc import Iterator, Mapping
from enum import Enum
from fractions import Fraction
from functools import cache
from types import MappingProxyType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

import msgspec


class Limits(NamedTuple):
    least: float
    most: float
    above: bool = False  # the least itself is not allowed

    def hold(self, value: float) -> bool:
        return self.least <= value <= self.most and not (self.above and value == self.least)

    def words(self, joint: str) -> str:
        least, most = Fraction(self.least), Fraction(self.most)
        return f"above {least}{joint}at most {most}" if self.above else f"{least} to {most}"


UNIT_INTERVAL = Limits(0.0, 1.0)


class Switch(NamedTuple):
    """On or off."""

    label: str
    tip: str = ""


class Buttons(NamedTuple):
    """One of a few values, all in sight. `words` stand for values that do not say it themselves."""

    name: str
    labelled: bool = True  # else the words tell enough
    tip: str = ""
    words: Mapping[str, str] = MappingProxyType({})


class Menu(NamedTuple):
    """One of many values."""

    label: str


class Slide(NamedTuple):
    """A slider within the limits, or from a greater least value, and a field for the number."""

    label: str
    step: float  # of the value, or of its logarithm to the base 10
    tip: str = ""
    logarithmic: bool = False
    least: float | None = None


class Swatch(NamedTuple):
    """A colour."""

    label: str


class PartOf(NamedTuple):
    """The key is set by a control that is made for it, perhaps with others."""

    control: str


Widget = Switch | Buttons | Menu | Slide | Swatch | PartOf


class Key(NamedTuple):
    """`allowed` tells what may stand there if type, limits and unit do not, with its unit.

    A key of `slabs_alone` changes nothing in the steps that reconstruct without slabs.
    """

    meaning: str
    widget: Widget
    limits: Limits | None = None  # of the number, or of each number
    unit: str = ""
    allowed: str = ""
    slabs_alone: bool = False


class Section(NamedTuple):
    meaning: str
    title: str = ""  # what a person calls it, of a table


class Declared(NamedTuple):
    """A field of a part, with its type and what is declared of it."""

    name: str
    kind: Any
    key: Key | Section
    default: Any  # msgspec.NODEFAULT if there is none

    @property
    def kinds(self) -> tuple[Any, ...]:
        """The types of which a value has one, words not counted."""
        union = get_args(self.kind) if get_origin(self.kind) in (Union, UnionType) else (self.kind,)
        return tuple(kind for kind in union if get_origin(kind) is not Literal)

    @property
    def words(self) -> tuple[str, ...]:
        """The words that may stand for a value."""
        if isinstance(self.kind, type) and issubclass(self.kind, Enum):
            return tuple(str(member.value) for member in self.kind)
        union = get_args(self.kind) if get_origin(self.kind) in (Union, UnionType) else (self.kind,)
        return tuple(word for kind in union if get_origin(kind) is Literal for word in get_args(kind))

    def check(self, value: Any) -> None:
        """Raises ValueError for a number out of its limits, or one that is none."""
        limits = self.key.limits if isinstance(self.key, Key) else None
        if isinstance(value, tuple) and limits is None:
            if not all(math.isfinite(number) for number in value):
                raise ValueError(f"{self.name} must be finite, not {list(value)}")
        elif isinstance(value, tuple) and limits is not None:
            for channel in value:
                check_within(f"a {self.name} channel", channel, limits)
        elif limits is not None and not isinstance(value, str) and not limits.hold(value):
            check_within(self.name, value, limits, self._after_limits)

    @property
    def _after_limits(self) -> str:
        assert isinstance(self.key, Key)
        unit = f" {self.key.unit}" if self.key.unit else ""
        return unit + "".join(f' or "{word}"' for word in self.words)


def check_within(name: str, value: float, limits: Limits = UNIT_INTERVAL, after: str = "") -> None:
    """Raises ValueError, which has `after` after the limits."""
    if not limits.hold(value):
        raise ValueError(f"{name} must be {limits.words(' and ')}{after}, not {value}")


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of the scene's parts: immutable, keyword-only, strict about unknown keys and limits."""

    def __post_init__(self) -> None:
        for declared in _checked(type(self)):
            declared.check(getattr(self, declared.name))


@cache
def declarations(part: type[Part]) -> tuple[Declared, ...]:
    """What a part's fields declare, in their order."""
    return tuple(_declarations(part))


def _declarations(part: type[Part]) -> Iterator[Declared]:
    for field in msgspec.structs.fields(part):
        kind, *extras = get_args(field.type) if get_origin(field.type) is Annotated else (field.type,)
        told = [extra for extra in extras if isinstance(extra, (Key, Section))]
        if len(told) != 1:
            raise TypeError(f"{part.__name__}.{field.name} declares no Key or Section")
        yield Declared(field.name, kind, told[0], field.default)


@cache
def _checked(part: type[Part]) -> tuple[Declared, ...]:
    """The fields whose type does not say all that is wrong with a value."""
    return tuple(
        declared
        for declared in declarations(part)
        if isinstance(declared.key, Key)
        and (declared.key.limits is not None or any(get_args(kind)[:1] == (float,) for kind in declared.kinds))
    )
