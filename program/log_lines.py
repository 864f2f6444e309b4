"""What the programs log: lines on stderr that nothing in a name can steer."""

import logging

from volsplat.protocol.text.printable import one_line


class _Lines(logging.Formatter):
    """Makes each message one printable line; a traceback after it stays as it is."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        return one_line(super().formatMessage(record))


def log_to_stderr(title: str, level: int) -> None:
    """Have everything from `level` on logged as `title: message`."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Lines(f"{title}: %(message)s"))
    logging.basicConfig(level=level, handlers=[handler])
