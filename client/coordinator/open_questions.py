"""Questions on their way, by their numbers."""

from typing import Generic, TypeVar

from volsplat.client.coordinator.events.instructions import Found, GiveAnswer, Instruction
from volsplat.protocol.text.errors import VolsplatError

Known = TypeVar("Known")  # of a question, while it is open


class OpenQuestions(Generic[Known]):
    """Those of one kind. Every answer is given once."""

    def __init__(self) -> None:
        self._open: dict[int, Known] = {}

    def _answer(self, number: int, found: Found = None, error: VolsplatError | None = None) -> list[Instruction]:
        """Nothing if it has been given."""
        return [] if self._open.pop(number, None) is None else [GiveAnswer(number, found, error)]

    def refused(self, number: int, error: VolsplatError) -> list[Instruction]:
        """One ends in an error."""
        return self._answer(number, error=error)

    def failed(self, error: VolsplatError) -> list[Instruction]:
        """All end in an error."""
        return [told for number in list(self._open) for told in self.refused(number, error)]


class AskedOfOne(OpenQuestions[int]):
    """Each is asked of one server, by whose number it is known."""

    def _end(self, server: int, error: VolsplatError | None) -> list[Instruction]:
        """This server will tell nothing more."""
        numbers = [number for number, teller in self._open.items() if teller == server]
        return [told for number in numbers for told in self._answer(number, error=error)]
