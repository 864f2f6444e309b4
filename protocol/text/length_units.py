"""Units of length by the names that files give them: micrometer, um, µm, MICRONS, ... all become µm."""

from collections.abc import Sequence
from typing import NamedTuple


class LengthUnit(NamedTuple):
    """A unit by the symbol that people are shown, and how many metres it is."""

    symbol: str
    metres: float


_PREFIXES = (
    ("pico", "p", 1e-12),
    ("nano", "n", 1e-9),
    ("micro", "µ", 1e-6),
    ("milli", "m", 1e-3),
    ("centi", "c", 1e-2),
    ("", "", 1.0),
    ("kilo", "k", 1e3),
    ("mega", "M", 1e6),
)
_OTHERS = (
    (LengthUnit("Å", 1e-10), "å angstrom angstroms ångström"),
    (LengthUnit("µm", 1e-6), "um \u03bcm micron microns"),  # the Greek letter beside the micro sign
    (LengthUnit("in", 0.0254), "inch inches"),
    (LengthUnit("ft", 0.3048), "foot feet"),
    (LengthUnit("pc", 3.0856775814913673e16), "parsec parsecs"),
)
_BY_SYMBOL = {symbol + "m": LengthUnit(symbol + "m", metres) for _, symbol, metres in _PREFIXES}
_BY_SYMBOL |= {unit.symbol: unit for unit, _ in _OTHERS}
_BY_NAME = {name: unit for unit, names in _OTHERS for name in names.split()}
_BY_NAME |= {
    prefix + ending: LengthUnit(symbol + "m", metres)
    for prefix, symbol, metres in _PREFIXES
    for ending in ("meter", "meters", "metre", "metres")
}


def length_unit(text: str) -> LengthUnit | None:
    """The unit that `text` names, None if that is no length. Symbols have their case: mm is not Mm."""
    name = text.strip()
    return _BY_SYMBOL.get(name) or _BY_NAME.get(name.lower())


class CommonUnit(NamedTuple):
    """A unit, and what lengths in others are multiplied by to be in it."""

    unit: str
    factors: list[float]

    @classmethod
    def none(cls) -> "CommonUnit":
        """Of three axes in several units that have nothing in common: they are drawn as if these were one."""
        return cls("", [1.0] * 3)


def told_several(names: Sequence[str]) -> str:
    """The warning about such axes."""
    return f"its axes are in several units ({', '.join(names)}), drawn as if these were one"


def in_one_unit(names: Sequence[str]) -> CommonUnit | None:
    """The first of several units, None if they have none in common: all are lengths, or all are alike."""
    units = [unit for name in names if (unit := length_unit(name)) is not None]
    if len(units) == len(names):
        return CommonUnit(units[0].symbol, [unit.metres / units[0].metres for unit in units])
    return CommonUnit(names[0], [1.0] * len(names)) if len(set(names)) == 1 else None
