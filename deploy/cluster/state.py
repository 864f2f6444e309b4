"""What is remembered of a cluster that is up, so that other commands find it."""

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from volsplat.deploy.cluster.file_lock import EXCLUSIVE, SHARED, taken
from volsplat.deploy.cluster.lasting_clock import Moment
from volsplat.deploy.launchers.launcher import StartedServer
from volsplat.deploy.private_file import write_private
from volsplat.deploy.server_command import Program
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.tokens import Token, find_token, new_token

LOOK_SECONDS = 0.001  # as long as anyone looks whether a cluster is locked


class KnownServer(msgspec.Struct, frozen=True, kw_only=True):
    """A server that was started, and how a client finds it."""

    started: StartedServer
    program: Program
    machine: int  # its place in the cluster file
    wait_at: str = ""  # HOST:PORT that clients dial; empty: it dials them

    def is_process(self, name: str) -> bool:
        """Whether a server that names its process so is the one that was started as this."""
        return name.endswith(f", {self.started.name}")


class ClusterState(msgspec.Struct, frozen=True, kw_only=True):
    file: str  # the cluster file as of `up`
    listen_port: int  # where clients listen for servers that dial in
    mark: str = ""  # tells it from the same cluster brought up at another time
    host: str = ""  # the machine whose servers those of the launcher `local` are
    servers: tuple[KnownServer, ...] = ()
    unanswered_since: dict[int, Moment] = {}  # of the first `down` to which a machine did not answer

    @property
    def can_draw(self) -> bool:
        """Whether there are servers of both kinds."""
        return {one.program for one in self.servers} == set(Program)


class MachinesFailed(BadInput):
    """Servers of some machines could not be started; the others are up, as the state has them."""

    def __init__(self, reasons: Iterable[str], state: ClusterState) -> None:
        super().__init__("; ".join(reasons))
        self.state = state


class ClusterBusy(BadInput):
    """Another command brings the cluster up or down."""


class StateFolder:
    """The folder of one cluster, $XDG_STATE_HOME/volsplat/clusters/NAME. Only its owner may look into it."""

    def __init__(self, name: str) -> None:
        """Raises BadInput where this user has no home."""
        base = os.environ.get("XDG_STATE_HOME") or _home() / ".local" / "state"
        self.path = Path(base) / "volsplat" / "clusters" / name

    @contextmanager
    def locked(self) -> Iterator[None]:
        """One command at a time changes the cluster. Raises ClusterBusy where another one does, and BadInput."""
        descriptor = self.opened("lock")
        try:
            self._take(descriptor)
            yield
        finally:
            os.close(descriptor)

    def opened(self, name: str) -> int:
        """The descriptor of a file that is there from now on, for whoever closes it. Raises BadInput."""
        self._make()
        try:
            return os.open(self.path / name, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise self.unusable("written", error) from error

    def _take(self, descriptor: int) -> None:
        try:
            while not taken(descriptor, EXCLUSIVE):
                if self.is_locked:
                    raise ClusterBusy(
                        f"another command brings {self.path.name} up or down now; wait until it has ended"
                    )
                time.sleep(LOOK_SECONDS)
        except OSError as error:
            raise self.unusable("locked", error) from error

    def unusable(self, how: str, error: OSError) -> BadInput:
        """What a person is told of this folder."""
        return BadInput(f"{self.path} cannot be {how}: {error.strerror}; set XDG_STATE_HOME to a folder of yours")

    @property
    def is_locked(self) -> bool:
        """Whether another command brings the cluster up or down now.

        To look is to share the lock for a moment.
        """
        try:
            with (self.path / "lock").open("rb") as lock:
                return not taken(lock.fileno(), SHARED)
        except OSError:  # it has never been up
            return False

    def load(self) -> ClusterState | None:
        """None where the cluster is not up. Raises BadInput for a file that cannot be read."""
        try:
            state = msgspec.json.decode((self.path / "state.json").read_bytes(), type=ClusterState)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.DecodeError) as error:
            raise BadInput(
                f"{self.path / 'state.json'} cannot be read: {error}; remove it, and end the servers"
            ) from error
        return state if state.servers else None  # none could be started

    def save(self, state: ClusterState) -> None:
        self._make()
        write_private(self.path / "state.json", msgspec.json.format(msgspec.json.encode(state)))

    def forget(self) -> None:
        """The cluster is down: its token is good for nothing any more."""
        for name in ("state.json", "token"):
            (self.path / name).unlink(missing_ok=True)

    @property
    def own_token_file(self) -> Path:
        """Where the cluster file names none."""
        return self.path / "token"

    def token(self, token_file: Path) -> Token:
        """The cluster's; its own is made where there is none. Raises BadInput."""
        self._make()
        if token_file == self.own_token_file and not token_file.exists():
            new_token().write(token_file)
        token = find_token({}, token_file)
        assert token is not None
        return token

    def _make(self) -> None:
        try:
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
            self.path.chmod(0o700)
        except OSError as error:
            raise self.unusable("made", error) from error


def _home() -> Path:
    try:
        return Path.home()
    except RuntimeError as error:  # as for a container's user whom the container does not know
        raise BadInput("this user's home is not known; set HOME, or XDG_STATE_HOME to a folder of yours") from error
