"""The volumes that volsplat makes itself, as files that servers of this machine can open."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from volsplat.protocol.text.errors import BadInput

if TYPE_CHECKING:
    from torch import Tensor


class GivenUp(BadInput):
    """Somebody no longer wanted what was being opened."""

    def __init__(self) -> None:
        super().__init__("it was given up")


PHANTOMS = {
    "head": "a head, as CT shows one",
    "galaxy": "a turning galaxy, as radio telescopes see gas",
    "protein": "a protein's electron density",
    "rna": "a strand of RNA",
    "p-orbital": "an electron's orbital",
    "seismic": "layers of rock with a salt dome",
    "structure-factors": "reflections of a crystal",
    "shells": "shells, one in another",
    "marschner-lobb": "the signal that tests reconstruction",
}
"""What there is to look at, and what it is in a few words. Making one needs torch, so that this list stands here."""


class PhantomFiles:
    """Each is made when it is first asked for, in a folder that somebody else removes."""

    def __init__(self, make_folder: Callable[[], Path]) -> None:
        """The folder is made for the first of them. Raises BadInput if it cannot be."""
        self._make_folder = make_folder

    @cached_property
    def _folder(self) -> Path:
        return self._make_folder()

    @property
    def names(self) -> list[str]:
        """Of those that can be made here."""
        return list(PHANTOMS) if find_spec("torch") else []

    def made(self, name: str, given_up: Callable[[], bool]) -> str:
        """The path of its file. Raises BadInput if there is no such phantom, or it is given up meanwhile."""
        if name not in PHANTOMS:
            raise BadInput(f"phantom {name}: no such phantom; choose one of {', '.join(PHANTOMS)}")
        path = self._folder / f"{name}.nrrd"
        if not path.exists():
            from volsplat.client.phantoms import streamed_phantom  # takes torch
            from volsplat.client.phantoms.volume_writer import write_phantom

            made = streamed_phantom(name)
            write_phantom(path, made._replace(sheets=_until(given_up, made.sheets)))
        return str(path)


def _until(given_up: Callable[[], bool], sheets: Iterator[Tensor]) -> Iterator[Tensor]:
    for some in sheets:
        if given_up():
            raise GivenUp
        yield some
