"""What a preparation reports while it runs."""

from typing import Protocol


class Progress(Protocol):
    """Told of each stage of the work in its turn, and of its advance, in bytes of source values."""

    def note(self, text: str) -> None:
        """Something worth a line."""
        ...

    def begin(self, stage: str, total: int) -> None: ...

    def advance(self, done: int) -> None: ...

    def check_wanted(self) -> None:
        """Raises KeyboardInterrupt if the person has asked to stop; so may `advance`."""
        ...
