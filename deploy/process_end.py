"""How a process has ended, for a person: a signal leaves no line on its output."""

import errno
import signal

from volsplat.protocol.text.want_of_threads import CURE

# Which no process can end with:
WITH_ITS_STARTER = 256  # it was ended once the process that starts servers had
NO_PROCESS = 257  # the system has none left to give
NO_MEMORY = 258  # nor memory for one
NEVER_BEGAN = (NO_PROCESS, NO_MEMORY)

HINTS = {
    signal.SIGKILL: "by hand, or by the system for want of memory",
    signal.SIGBUS: "a file was cut short or a disk failed while it was read",
    signal.SIGSEGV: "internal error in volsplat, please report it",
    signal.SIGABRT: "internal error in volsplat, please report it",
    signal.SIGILL: "this processor lacks an instruction; VOLSPLAT_CPU_PATH=baseline does without",
}


def never_began(refused: int) -> int:
    """The status of a process that the system refused with this error number."""
    return NO_MEMORY if refused == errno.ENOMEM else NO_PROCESS


def told_end(status: int) -> str:
    """What `subprocess` gives as return code, or one of those above, in words that follow the program's name."""
    if status == 0:
        return "ended by itself"
    if status == WITH_ITS_STARTER:
        return "was ended, since the process that starts servers had ended"
    if status == NO_PROCESS:
        return f"could not be started: {CURE}"
    if status == NO_MEMORY:
        return "could not be started: this machine has not enough memory left; free some"
    if status > 0:
        return f"ended with status {status}; its own output tells why"
    try:
        number = signal.Signals(-status)
    except ValueError:  # one that has no name
        return f"was killed by signal {-status}"
    hint = f" ({HINTS[number]})" if number in HINTS else ""
    return f"was killed by {number.name}{hint}"
