"""The client's way to a server that waits for clients: it dials, and the server speaks first."""

from collections.abc import Callable

from volsplat.protocol.text.errors import BadInput, VolsplatError
from volsplat.protocol.wire.accepting import Accepter
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import dialled_socket, patiently
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.port import HANDSHAKE_SECONDS


def call(
    address: Address,
    name: str,
    accepter: Accepter,
    *,
    encryption: Encryption = Encryption.BETWEEN_MACHINES,
    patience: float,
    report: Callable[[str], None],
    given_up: Callable[[], bool],
    failed: Callable[[VolsplatError], None] = lambda error: None,
) -> Connection:
    """An open connection to the server that waits at `address`; `name` is what people know it by.

    It is tried again while nobody listens there or another client is served; `report` gets each reason once,
    and `failed` the error of each try.
    Raises PeerLost where that goes on for `patience` seconds, or BadInput or RemoteProtocolError as `connect` does.
    """
    place = f"{name} at {address}"

    def attempt() -> Connection:
        try:
            return _try_once(address, place, accepter, encryption)
        except VolsplatError as error:
            failed(error)
            raise

    return patiently(attempt, patience, lambda error: report(str(error)), given_up)


def _try_once(address: Address, place: str, accepter: Accepter, encryption: Encryption) -> Connection:
    connection = Connection(dialled_socket(address, place), place)
    try:
        connection.limit(HANDSHAKE_SECONDS)
        connection.encrypt(encryption, accepts=False)
        accepter.greet(connection, address)
    except BadInput as error:
        connection.close()
        raise BadInput(f"cannot use the {place}: {error}") from error
    except BaseException:
        connection.close()
        raise
    return connection
