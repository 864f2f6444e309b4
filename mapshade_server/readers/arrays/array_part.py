"""The part of an array's name, after `#`: its path within the file, then options that describe it, parted by commas.

/entry/data,t=3        2,c=1        dims=256x256x113,type=uint16,endian=big        spacing=1x1x2

What has no `=` before the first option belongs to the path; after it, to the option before: spacing=1,1,2 is one
option. So paths may hold commas, and an `=` that does not follow a plain word; others, as `a,c=d`, where a file that
has them is asked for the longest that it has.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from volsplat.protocol.text.errors import BadInput

_OPTION = re.compile(r"\s*([A-Za-z_]\w*)\s*=(.*)", re.DOTALL)


class ArrayPart(NamedTuple):
    """A part taken to pieces. `place` is the file, folder or URL that it belongs to, for messages."""

    place: str
    path: str
    options: Mapping[str, str]

    @property
    def whole(self) -> str:
        """The volume's name down to the path, for messages and advice."""
        return f"{self.place}#{self.path}" if self.path else self.place

    def advice(self, option: str) -> str:
        """The name that the person should give to say `option` too."""
        return f"{self.place}#{self.with_option(option)}"

    def with_option(self, option: str) -> str:
        """The part that says `option` too."""
        given = [f"{key}={value}" for key, value in self.options.items()]
        return ",".join([*([self.path] if self.path else []), *given, option])

    def wrong(self, key: str, why: str) -> BadInput:
        return BadInput(f"{self.place}: “{key}={self.options[key]}” {why}")

    def check_known(self, known: Iterable[str]) -> None:
        """Raises BadInput if an option is given that is not among `known`."""
        names = list(known)
        for key in self.options:
            if key not in names:
                raise self.wrong(key, f"is not an option here; there are {', '.join(names) or 'none'}")

    def text(self, key: str, among: Iterable[str]) -> str | None:
        """The option's value, which must be one of `among`; None if it is not given."""
        allowed = list(among)
        value = self.options.get(key)
        if value is not None and value not in allowed:
            raise self.wrong(key, f"is not one of {', '.join(allowed)}")
        return value

    def whole_number(self, key: str) -> int | None:
        numbers = self.whole_numbers(key, 1)
        return None if numbers is None else numbers[0]

    def whole_numbers(self, key: str, count: int) -> tuple[int, ...] | None:
        """`count` whole numbers, 0 or more, parted by `x` or commas; None if the option is not given."""
        numbers = self.numbers(key, count)
        if numbers is not None and not all(number >= 0 and number.is_integer() for number in numbers):
            raise self.wrong(key, f"needs {_counted(count, 'whole number')}, 0 or more{_example(count)}")
        return None if numbers is None else tuple(int(number) for number in numbers)

    def numbers(self, key: str, count: int) -> tuple[float, ...] | None:
        """`count` numbers, parted by `x` or commas; None if the option is not given."""
        if key not in self.options:
            return None
        try:
            numbers = tuple(float(word) for word in re.split("[x,]", self.options[key]))
        except ValueError:
            numbers = ()
        if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
            raise self.wrong(key, f"needs {_counted(count, 'number')}{_example(count)}")
        return numbers


def array_part(place: object, part: str, is_path: Callable[[str], bool] = lambda path: False) -> ArrayPart:
    """The pieces of `part`; of beginnings that look as if they had options the longest that `is_path` is its path.

    Raises BadInput if an option has no value or is given twice.
    """
    items = part.split(",") if part else []
    plain = next((n for n, item in enumerate(items) if _OPTION.fullmatch(item)), len(items))
    length = next((n for n in range(len(items), plain, -1) if is_path(",".join(items[:n]).strip())), plain)
    path = items[:length]
    options: dict[str, str] = {}
    key = ""
    for item in items[length:]:
        if match := _OPTION.fullmatch(item):
            key, value = match[1], match[2].strip()
            if not value or key in options:
                what = "is given twice" if value else "has no value"
                raise BadInput(f"{place}: the option “{key}” in “{part}” {what}")
            options[key] = value
        elif options:
            options[key] += f",{item.strip()}"
        else:
            path.append(item)
    return ArrayPart(str(place), ",".join(path).strip(), options)


def _counted(count: int, what: str) -> str:
    return f"one {what}" if count == 1 else f"{count} {what}s"


def _example(count: int) -> str:
    return "" if count == 1 else f", as in {'x'.join(str(n + 1) for n in range(count))}"
