"""Where a file is written before it takes its name, so that whoever looks finds the old one or a whole one."""

import hashlib
import os
import re
import secrets
import shutil
import socket
import stat
from contextlib import suppress
from pathlib import Path

PREFIX = ".volsplat"


def behind_links(path: Path) -> Path:
    """What is written where `path` is asked for: the file that a link leads to, so that the link stays one."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def temporary_name(path: Path) -> Path:
    """A name beside `path`, of the same kind, that is renamed to it once the file is whole.

    What programs of this machine have left there under such names, because they were killed, is removed.
    """
    _sweep(path.parent)
    return path.with_name(f"{PREFIX}-{_machine()}-{os.getpid()}-{secrets.token_hex(8)}{path.suffix.lower()}")


def take_mode(written: Path, target: Path) -> None:
    """Let those into a file that is to take another's place, if there is one, who are let into that. Raises OSError."""
    with suppress(FileNotFoundError):
        mode = stat.S_IMODE(target.stat().st_mode)
        if stat.S_IMODE(written.stat().st_mode) != mode:  # some file systems have one mode, which nobody may set
            written.chmod(mode)


def _sweep(folder: Path) -> None:
    """Names tell the machine and process that write there: of other machines nothing is known, nor what others keep."""
    with suppress(OSError):  # whoever writes there will hear of it
        for left in list(folder.glob(f"{PREFIX}-{_machine()}-*")):
            named = re.fullmatch(rf"{re.escape(PREFIX)}-\w+-(\d+)-[0-9a-f]+(\.\w+)?", left.name)
            if named is not None and left.lstat().st_uid == os.geteuid() and not _is_running(int(named[1])):
                _remove(left)


def _remove(left: Path) -> None:
    if left.is_dir() and not left.is_symlink():
        shutil.rmtree(left, ignore_errors=True)
    else:
        left.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):  # another user's; or no number of a process
        return True
    return True


def _machine() -> str:
    """Of two containers, which may share a name and a folder, each knows its own processes alone."""
    processes = os.stat("/proc/self/ns/pid").st_ino if os.path.exists("/proc/self/ns/pid") else 0
    return hashlib.blake2b(f"{socket.gethostname()} {processes}".encode(), digest_size=4).hexdigest()
