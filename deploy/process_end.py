"""How a process has ended, for a person: a signal leaves no line on its output."""

import signal

from volsplat.protocol.text.want_of_threads import CURE

# Which no process can end with:
WITH_ITS_STARTER = 256  # it was ended once the process that starts servers had
NEVER_BEGAN = 257  # the system has no process left to give

HINTS = {
    signal.SIGKILL: "by hand, or by the system for want of memory",
    signal.SIGBUS: "a file was cut short or a disk failed while it was read",
    signal.SIGSEGV: "internal error in volsplat, please report it",
    signal.SIGABRT: "internal error in volsplat, please report it",
    signal.SIGILL: "this processor lacks an instruction; VOLSPLAT_CPU_PATH=baseline does without",
}


def told_end(status: int) -> str:
    """What `subprocess` gives as return code, or one of the two above, in words that follow the program's name."""
    if status == 0:
        return "ended by itself"
    if status == WITH_ITS_STARTER:
        return "was ended, since the process that starts servers had ended"
    if status == NEVER_BEGAN:
        return f"could not be started: {CURE}"
    if status > 0:
        return f"ended with status {status}; its own output tells why"
    try:
        number = signal.Signals(-status)
    except ValueError:  # one that has no name
        return f"was killed by signal {-status}"
    hint = f" ({HINTS[number]})" if number in HINTS else ""
    return f"was killed by {number.name}{hint}"
