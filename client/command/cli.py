"""The entry point of the command `volsplat`: how errors, Ctrl-C and other ends end it.

Every mistake of the person at the keyboard is one line on stderr and exit status 2.
"""

import os
import signal
import sys
import warnings
from contextlib import suppress
from io import TextIOWrapper
from typing import NoReturn

from volsplat.program.blas_threads import NO_MORE_THREADS
from volsplat.program.exit_status import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_INTERRUPTED, status_of

COMPLETION = "_VOLSPLAT_COMPLETE"  # set by the shell that asks what a word may become


def main() -> NoReturn:
    """Run a sub-command and exit with its status."""
    # Until there is something to clean up, Ctrl-C ends the process at once and without a word.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    for name, value in NO_MORE_THREADS.items():
        os.environ.setdefault(name, value)  # a person may have said otherwise
    sys.exit(_status())


def _status() -> int:
    """Of the sub-command, once it has ended in whatever way, with its cause printed."""
    import click

    from volsplat.client.caller.interrupts import process_is_a_commands
    from volsplat.client.command.commands import reading_modules, starts_servers, volsplat
    from volsplat.deploy.forked_servers import begin_ahead
    from volsplat.program.system_failures import system_failure
    from volsplat.protocol.text.errors import VolsplatError

    if isinstance(sys.stdout, TextIOWrapper):  # a terminal that is not UTF-8 shows what it lacks as an escape
        sys.stdout.reconfigure(errors="backslashreplace")
    if not sys.warnoptions:  # what libraries say to programmers is not for whoever uses the command
        warnings.simplefilter("ignore")
    process_is_a_commands()
    try:
        _listen_to_signals()
        if COMPLETION not in os.environ and starts_servers(sys.argv[1:]):
            begin_ahead(reading_modules(sys.argv[1:]))
        volsplat.main(standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return EXIT_BAD_INPUT
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        hint = f"; see {context.command_path} --help" if context is not None else ""
        return _told(error.format_message().rstrip(".") + _taken_for_option(error) + hint, EXIT_BAD_INPUT)
    except VolsplatError as error:
        return _told(str(error), status_of(error))
    except MemoryError:
        return _told(
            "not enough memory on this machine; choose a smaller --size, or more servers elsewhere", EXIT_FAILED
        )
    except (KeyboardInterrupt, click.Abort):
        return _told("interrupted", EXIT_INTERRUPTED)
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else EXIT_FAILED if error.code else 0
    except Exception as error:
        if (told := system_failure(error)) is None:
            raise
        return _told(str(told), status_of(told))
    return 0


def _taken_for_option(error: Exception) -> str:
    """How a file is named whose name begins like an option's."""
    from click import NoSuchOption

    files = (word for word in sys.argv[1:] if word.startswith("-") and os.path.exists(word))
    file = next(files, None) if isinstance(error, NoSuchOption) else None
    return "" if file is None else f"; the file of that name is given as ./{file}"


def _listen_to_signals() -> None:
    signal.signal(signal.SIGINT, _interrupt)
    signal.signal(signal.SIGTERM, _terminate)
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as nohup has it
        signal.signal(signal.SIGHUP, _terminate)


def _interrupt(signal_number: int, frame: object) -> NoReturn:
    """Leave by an exception, once: impatience must not end the work of ending servers. SIGTERM still can be sent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise KeyboardInterrupt


def _terminate(signal_number: int, frame: object) -> NoReturn:
    """Leave by an exception, so that every server is ended on the way out."""
    raise SystemExit(128 + signal_number)


def _told(line: str, status: int) -> int:
    from volsplat.program.log_lines import say_last

    with suppress(OSError):  # nobody may be there any more
        say_last("volsplat", line)
    return status
