"""How a process has ended, for a person: a signal leaves no line on its output."""

import signal

HINTS = {
    signal.SIGKILL: "by hand, or by the system for want of memory",
    signal.SIGBUS: "a file was cut short or a disk failed while it was read",
    signal.SIGSEGV: "internal error in volsplat, please report it",
    signal.SIGABRT: "internal error in volsplat, please report it",
    signal.SIGILL: "this processor lacks an instruction; VOLSPLAT_CPU_PATH=baseline does without",
}


def told_end(status: int) -> str:
    """What `subprocess` gives as return code, in words that follow the program's name."""
    if status == 0:
        return "ended by itself"
    if status > 0:
        return f"ended with status {status}; its own output tells why"
    try:
        number = signal.Signals(-status)
    except ValueError:  # one that has no name
        return f"was killed by signal {-status}"
    hint = f" ({HINTS[number]})" if number in HINTS else ""
    return f"was killed by {number.name}{hint}"
