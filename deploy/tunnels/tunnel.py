"""One tunnel: an ssh connection that carries ports, dialled anew whenever it ends until it is closed.

ssh and what it runs there end with the process that has opened the tunnel, however that ends: they read from it.
"""

import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from volsplat.deploy.launchers.launcher import Report
from volsplat.deploy.launchers.shell import PROCESS_FUNCTIONS
from volsplat.deploy.launchers.ssh import NO_SSH, ssh_command
from volsplat.deploy.process_group import end_group
from volsplat.deploy.tunnels.ports import Way
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import one_line
from volsplat.protocol.wire.addresses import LOOPBACK

OPEN_SECONDS = 30.0  # for one try
FIRST_PAUSE_SECONDS, LONGEST_PAUSE_SECONDS = 0.5, 8.0  # between two tries
OWN_CONNECTION = (  # a shared one would carry the ports on after this end has gone
    "-T", "-o", "ControlMaster=no", "-o", "ControlPath=none", "-o", "ForwardAgent=no", "-o", "ForwardX11=no",
    "-o", "ExitOnForwardFailure=yes", "-o", "ServerAliveInterval=2", "-o", "ServerAliveCountMax=3",
)  # fmt: skip
OPEN = "volsplat-tunnel"

# Says which process holds the ports there: that of sshd for this connection. On a line of its own, whatever the login
# shell has printed before.
_HOLDS = f'{PROCESS_FUNCTIONS}printf "\\n{OPEN} %s %s\\n" "$PPID" "$(began $PPID)"\nexec cat >/dev/null\n'


class Tunnel:
    """Open to machines' loopback alone. Any thread may call it."""

    def __init__(self, way: Way, report: Report) -> None:
        """Begins to dial. `report` gets a line when it fails, and when it is open again."""
        self.way, self._report = way, report
        self.host = str(way.machine.host)
        self._changed = threading.Condition()  # guards what follows
        self._since: float | None = None  # time.monotonic(), as far as it is open
        self._why = ""  # it is not open
        self._ssh: subprocess.Popen[str] | None = None
        self._closed = False
        self._holder: list[str] = []  # of the ports there: process and beginning; the keeping thread's
        self._keeper = threading.Thread(target=self._keep, name=f"tunnel to {self.host}", daemon=True)
        self._keeper.start()

    @property
    def open_for(self) -> float:
        """Seconds; 0 if it is not open."""
        with self._changed:
            return time.monotonic() - self._since if self._since is not None else 0.0

    def failure(self, seconds: float) -> str:
        """Why it is not open, as soon as a try has failed or after so many seconds; empty as soon as it is."""
        with self._changed:
            self._changed.wait_for(lambda: self._since is not None or self._why, seconds)
            return "" if self._since is not None else self._why or "ssh has not answered yet"

    def close(self) -> None:
        """Returns once ssh has ended. May be called again."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            ssh = self._ssh
        if ssh is not None:
            end_group(ssh)
        self._keeper.join()

    def _keep(self) -> None:
        pause = FIRST_PAUSE_SECONDS
        while not self._closed:
            try:
                self._let_go_of_ports()
                if self._carry():
                    pause = FIRST_PAUSE_SECONDS
            except BadInput as error:
                self._fails(str(error))
            with self._changed:
                self._changed.wait_for(lambda: self._closed, pause)
            pause = min(2 * pause, LONGEST_PAUSE_SECONDS)

    def _let_go_of_ports(self) -> None:
        """A host that was cut off may not know for hours that the tunnel before has ended."""
        if not self._holder:
            return
        process, began = self._holder
        script = f"{PROCESS_FUNCTIONS}if runs {process} {began}; then kill {process}; fi"
        with self._running(ssh_command(self.way.machine, script, *OWN_CONNECTION)) as ssh, _limited(ssh):
            said, _ = ssh.communicate()
        if ssh.returncode:
            raise BadInput(self._reason([said], ssh.returncode))
        self._holder = []

    def _carry(self) -> bool:
        """Have ssh carry the ports until it ends. Whether they were open."""
        was_open, said = False, deque[str](maxlen=3)
        ports = (*_carried("-R", self.way.here), *_carried("-L", self.way.there))
        with self._running(ssh_command(self.way.machine, _HOLDS, *OWN_CONNECTION, *ports)) as ssh:
            assert ssh.stdout is not None
            with _limited(ssh) as limit:
                for line in ssh.stdout:
                    if line.startswith(OPEN):
                        was_open = True
                        limit.cancel()
                        self._begins(line.split()[1:])
                    elif line.strip():
                        said.append(line)
        self._fails(self._reason(said, ssh.returncode))
        return was_open

    @contextmanager
    def _running(self, command: list[str]) -> Iterator["subprocess.Popen[str]"]:
        """ssh, which close() ends."""
        try:
            ssh = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,  # Ctrl-C is for this process, which still has servers to speak to then
            )
        except FileNotFoundError as error:
            raise BadInput(NO_SSH) from error
        with ssh:
            with self._changed:
                self._ssh = ssh
                closed = self._closed
            try:
                if closed:
                    end_group(ssh)
                yield ssh
            finally:
                end_group(ssh)

    def _begins(self, holder: list[str]) -> None:
        self._holder = holder if len(holder) == 2 and all(part.isdecimal() for part in holder) else []
        with self._changed:
            again = bool(self._why)
            self._since, self._why = time.monotonic(), ""
            self._changed.notify_all()
        if again:
            self._report(f"the tunnel to {self.host} is open again")

    def _fails(self, reason: str) -> None:
        with self._changed:
            told = self._closed or self._why == reason
            self._since, self._why = None, reason
            self._changed.notify_all()
        if not told:
            self._report(f"the tunnel to {self.host}: {reason}")

    def _reason(self, said: Iterable[str], status: int) -> str:
        line = one_line(" ".join(said)) or f"ssh has ended with {status}"
        if "forwarding failed" in line or "Address already in use" in line:
            ports = ", ".join(map(str, (*self.way.here, *self.way.there)))
            return (
                f"{line}; one of the ports {ports} is taken, or sshd there forbids them (AllowTcpForwarding): bring "
                "the cluster down and up again, which chooses others, or give client another port"
            )
        return line


@contextmanager
def _limited(ssh: "subprocess.Popen[str]") -> Iterator[threading.Timer]:
    """For one try, unless the timer is cancelled: a host that is cut off may never answer."""
    late = threading.Timer(OPEN_SECONDS, end_group, [ssh, signal.SIGKILL])
    late.daemon = True
    late.start()
    try:
        yield late
    finally:
        late.cancel()


def _carried(option: str, ports: Iterable[int]) -> list[str]:
    return [word for port in ports for word in (option, f"{LOOPBACK}:{port}:{LOOPBACK}:{port}")]
