"""Which method takes which message or event: methods declare it, and programs check that none is missing at start."""

from collections.abc import Callable, Iterable
from enum import Enum
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar

Self = TypeVar("Self")
Taken = TypeVar("Taken")
More = ParamSpec("More")
Result = TypeVar("Result")


class Handler(NamedTuple):
    method: Callable[..., Any]
    states: tuple[Enum, ...]  # in which it may come; none: in any


def takes(
    kind: type[Taken], *states: Enum
) -> Callable[[Callable[Concatenate[Self, Taken, More], Result]], Callable[Concatenate[Self, Any, More], Result]]:
    """Marks a method as one that takes this kind of message or event, which may come in these states.

    One that takes several kinds is marked for each.
    """

    def mark(
        method: Callable[Concatenate[Self, Taken, More], Result],
    ) -> Callable[Concatenate[Self, Any, More], Result]:
        vars(method)["takes"] = {**vars(method).get("takes", {}), kind: states}
        return method

    return mark


def handlers(owner: type) -> dict[type, Handler]:
    """The methods of a class that take something, its bases' included, by what they take."""
    return {
        kind: Handler(method, states)
        for method in (getattr(owner, name) for name in dir(owner))
        for kind, states in getattr(method, "takes", {}).items()
    }


def check_handlers(kinds: Iterable[type], *owners: type) -> None:
    """Raises TypeError unless each of these kinds has one method among these classes, and no other kind has any."""
    expected, found = set(kinds), [kind for owner in owners for kind in handlers(owner)]
    names = " and ".join(owner.__name__ for owner in owners)
    for kind in expected.symmetric_difference(found):
        raise (
            TypeError(f"{names} must have a method that takes {kind.__name__}")
            if kind in expected
            else TypeError(f"{names} takes {kind.__name__}, which never comes")
        )
    if len(found) > len(expected):
        raise TypeError(f"{names} takes something twice: {sorted(kind.__name__ for kind in found)}")
