"""The client: owns the scene, divides the volume, coordinates every server."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from volsplat.client.session.session import Session as Session

__all__ = ["Session"]

if not TYPE_CHECKING:  # to checkers it would give any name whatever, misspelt ones included

    def __getattr__(name: str) -> object:
        # Only who asks for Session pays for its import; the command has not got that time.
        if name == "Session":
            from volsplat.client.session.session import Session

            return Session
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
