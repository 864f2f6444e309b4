"""Has the system let this process read nothing but some folders, whatever names it is led to: Linux's Landlock.

It holds for what is opened in the end, after every `..` and symbolic link, in libraries of C and C++ as well, and it
cannot be taken back. What Python itself may need later (modules, libraries, the machine's figures) stays readable.
"""

import ctypes
import errno
import os
import site
import struct
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import volsplat
from volsplat.protocol.text.errors import BadInput

WHICH_VERSION = 1  # a flag of the first of these calls, which then tells the version of Landlock
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446  # system calls, by the same numbers on every machine
PATH_BENEATH = 1
NO_NEW_PRIVILEGES = 38  # of prctl
READ_FILE, READ_FOLDER = 1 << 2, 1 << 3
HANDLED = struct.Struct("=Q")  # struct landlock_ruleset_attr, its first field
BENEATH = struct.Struct("=Qi")  # struct landlock_path_beneath_attr

LIBRARIES = ("/usr", "/lib", "/lib64", "/bin", "/nix/store", "/opt")
FIGURES = (  # none is a secret; /proc/self as a whole would show the environment
    "/etc/ld.so.cache",
    "/etc/localtime",
    "/etc/hosts",
    "/etc/nsswitch.conf",
    "/etc/resolv.conf",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/proc/stat",
    "/proc/self/cgroup",
    "/proc/self/maps",
    "/proc/self/status",
    "/sys/devices/system",
    "/sys/fs/cgroup",
    "/dev/null",
    "/dev/urandom",
)


def can_confine() -> bool:
    """Whether this system has Landlock."""
    if sys.platform != "linux":
        return False
    return bool(ctypes.CDLL(None).syscall(CREATE_RULESET, None, ctypes.c_size_t(0), WHICH_VERSION) >= 1)


def confine_reading(folders: Iterable[Path]) -> None:
    """From now on this thread, and those that it starts, open no file for reading but below `folders`.

    Call it before there are other threads. Raises BadInput where the system cannot do it.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    libc.syscall.restype = ctypes.c_long
    handled = HANDLED.pack(READ_FILE | READ_FOLDER)
    rules = libc.syscall(CREATE_RULESET, handled, ctypes.c_size_t(len(handled)), 0)
    if rules < 0:
        raise BadInput("--data-root needs Landlock, which this system lacks; use Linux 5.13 or later, or leave it out")
    folders = tuple(folders)
    try:
        for place in {*map(str, (*folders, *_named_by_pythonpath(folders))), *_own()}:
            _allow(libc, rules, place)
        if libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0) or libc.syscall(RESTRICT_SELF, rules, 0):
            raise BadInput(f"--data-root cannot be held to: {os.strerror(ctypes.get_errno())}; leave it out")
    finally:
        os.close(rules)


def _own() -> Iterator[str]:
    """What the program itself reads."""
    yield from (*LIBRARIES, *FIGURES, sys.prefix, sys.base_prefix, sys.exec_prefix, *site.getsitepackages())
    if site.ENABLE_USER_SITE:
        yield site.getusersitepackages()
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] == volsplat.__name__:
            yield from getattr(module, "__path__", ())


def _named_by_pythonpath(folders: Iterable[Path]) -> list[Path]:
    """Where PYTHONPATH, as environment modules set it, says that more libraries lie.

    Not what holds a folder of volumes, a person's home, or where the program was begun: much else lies there. Nor what
    .pth files add: those of an editable install name the folder that the checkout lies in.
    """
    if sys.flags.ignore_environment:
        return []
    private = [*folders, *_private()]
    named = [Path(place).resolve() for place in os.environ.get("PYTHONPATH", "").split(os.pathsep) if place]
    return [place for place in named if not any(one.resolve().is_relative_to(place) for one in private)]


def _private() -> Iterator[Path]:
    for found in (Path.home, Path.cwd):
        with suppress(OSError, RuntimeError):  # there is none any more
            yield found()


def _allow(libc: ctypes.CDLL, rules: int, place: str) -> None:
    try:
        opened = os.open(place, os.O_PATH | os.O_CLOEXEC)
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ENOTDIR, errno.EACCES):  # what is not there is not read
            return
        raise
    try:
        rights = READ_FILE | (READ_FOLDER if Path(place).is_dir() else 0)
        beneath = BENEATH.pack(rights, opened)
        if libc.syscall(ADD_RULE, rules, PATH_BENEATH, beneath, 0):
            raise BadInput(f"--data-root cannot allow {place}: {os.strerror(ctypes.get_errno())}; leave it out")
    finally:
        os.close(opened)
