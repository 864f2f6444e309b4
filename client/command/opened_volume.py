"""The volume that a command draws, and the processes that hold it: started here, joined by hand, or this one alone."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from importlib import import_module
from ipaddress import ip_address
from shlex import quote
from typing import Any

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.server_options import Servers
from volsplat.client.session.kept_cluster import KeptCluster
from volsplat.client.session.renderer import Renderer
from volsplat.client.session.session import Session
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.many_imports import many_imports
from volsplat.program.plain_console import PlainConsole
from volsplat.protocol.wire.addresses import Address, everywhere
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.tokens import TOKEN_VARIABLE


def ignored(text: str) -> None:
    """Tells nobody."""


@contextmanager
def opened(
    volume: str,
    servers: Servers,
    console: PlainConsole,
    also_say: Callable[[str], None] = ignored,
    imports: Sequence[str] = (),
) -> Iterator[Renderer]:
    """The volume, ready to be drawn, with a line on the terminal that says what is going on, and elsewhere as well.

    The modules `imports` are imported while the servers start and read.
    """
    with console.status("starting") as status:

        def say(text: str) -> None:
            status.update(text)
            also_say(text)
            if servers.by_hand and not console.is_terminal and text.startswith("waiting for servers"):
                console.say(text)

        with opened_quietly(volume, servers, say, console) as renderer:
            with interrupts_held(), many_imports():
                for module in imports:
                    import_module(module)
            renderer.volume.check_has_values()
            tell_notes(renderer.volume, console)
            yield renderer


def tell_notes(volume: SurveyedVolume, console: PlainConsole) -> None:
    """What the reader and the survey warn of, a line each."""
    for warning in volume.warnings():
        console.say(f"note: {warning}")


@contextmanager
def opened_quietly(
    volume: str, servers: Servers, say: Callable[[str], None], console: PlainConsole
) -> Iterator[Renderer]:
    """As `opened`, with whatever `say` does with the words for what is going on; a lost server is told to stay."""
    if servers.single:
        from volsplat.client.session.single import SingleProcess

        with SingleProcess(
            volume, threads=servers.threads, memory=servers.memory, trace=servers.trace, on_progress=say
        ) as single:
            yield single
        return

    with session_of(volume, servers, say, console) as session:
        if servers.by_hand:
            tell_how_to_join(session, servers, console)
        yield session


@contextmanager
def servers_kept(servers: Servers, say: Callable[[str], None], console: PlainConsole) -> Iterator[Servers]:
    """For several volumes in turn: a cluster is brought up once for all of them, and no other client's between two."""
    if servers.cluster is None:
        yield servers
        return
    with closing(KeptCluster(servers.cluster, say, lambda missing: console.say(f"note: {missing}"))) as kept:
        yield replace(servers, kept=kept)


def session_of(volume: str | None, servers: Servers, say: Callable[[str], None], console: PlainConsole) -> Session:
    """A session that these servers draw for, if there is a volume; it does not wait for that.

    A lost server is told on the console, to stay.
    """
    return Session(
        volume,
        **_whose(servers),
        memory=servers.memory,
        trace=servers.trace,
        on_progress=say,
        on_loss=lambda loss: console.say(f"note: {loss}"),
    )


def _whose(servers: Servers) -> dict[str, Any]:
    """What a session is told of where they come from."""
    if servers.cluster is not None:
        return {"cluster": servers.kept or servers.cluster}
    started = {"threads": servers.threads, "data_root": servers.data_root} if servers.here else {"spawn": False}
    return {
        "workers": servers.workers,
        "splat_servers": servers.splat_servers,
        "listen": servers.listen,
        "token": servers.token,
        "silence": servers.silence,
        "tls": servers.tls,
        **started,
    }


def tell_how_to_join(session: Session, servers: Servers, console: PlainConsole) -> None:
    """Print the commands that start servers by hand; with a token that nobody has said, it stands in them."""
    address = session.address
    secret = "" if servers.token is not None else f"{TOKEN_VARIABLE}={session.token.key.decode()} "
    options = list(Encryption.of(servers.tls).options)
    if servers.token_file is not None:
        options += ["--token-file", quote(str(servers.token_file))]
    anywhere = ip_address(address.host).is_unspecified
    joined = quote(str(Address(socket.gethostname(), address.port) if anywhere else address))
    # Servers on other machines must reach the splat server as well, which by itself listens on its own alone.
    opened = "" if ip_address(address.host).is_loopback else f" --listen {quote(str(everywhere(address.host)))}"
    for command in (f"splat-server --connect {joined}{opened}", f"mapshade-server --connect {joined}"):
        console.say(" ".join((f"{secret}volsplat {command}", *options)))
