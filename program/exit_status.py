"""The exit statuses of every volsplat program."""

from volsplat.protocol.text.errors import BadInput, VolsplatError

EXIT_FAILED = 1
EXIT_BAD_INPUT = 2  # a person must put it right
EXIT_INTERRUPTED = 130  # as a shell says it of SIGINT
EXIT_TERMINATED = 143  # and of SIGTERM


def status_of(error: VolsplatError) -> int:
    """Of a program that this error ends."""
    return EXIT_BAD_INPUT if isinstance(error, BadInput) else EXIT_FAILED
