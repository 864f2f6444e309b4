"""The entry point of the command `volsplat`: how errors and Ctrl-C end it.

Every mistake of the person at the keyboard is one line on stderr and exit status 2.
"""

import signal
import sys
from typing import NoReturn

from volsplat.protocol.exit_status import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_INTERRUPTED


def main() -> NoReturn:
    """Run a sub-command and exit with its status."""
    # Until there is something to clean up, Ctrl-C ends the process at once and without a word.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    import click

    from volsplat.client.commands import volsplat
    from volsplat.protocol.errors import BadInput, VolsplatError

    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, _terminate)
        volsplat.main(standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(EXIT_BAD_INPUT)
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        hint = f"; see {context.command_path} --help" if context is not None else ""
        _end(error.format_message().rstrip(".") + hint, EXIT_BAD_INPUT)
    except BadInput as error:
        _end(str(error), EXIT_BAD_INPUT)
    except VolsplatError as error:
        _end(str(error), EXIT_FAILED)
    except MemoryError:
        _end("not enough memory on this machine; choose a smaller --size, or more servers elsewhere", EXIT_FAILED)
    except (KeyboardInterrupt, click.Abort):
        _end("interrupted", EXIT_INTERRUPTED)
    sys.exit(0)


def _terminate(signal_number: int, frame: object) -> NoReturn:
    """Leave by an exception, so that every server is ended on the way out."""
    raise SystemExit(128 + signal_number)


def _end(line: str, status: int) -> NoReturn:
    from volsplat.protocol.printable import one_line

    print(f"volsplat: {one_line(line)}", file=sys.stderr)
    sys.exit(status)
