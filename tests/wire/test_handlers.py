"""Every message that may come has one method that takes it, and no method waits for what never comes."""

import subprocess
import sys
from types import SimpleNamespace
from typing import get_args

import pytest

from volsplat.client.coordinator import coordinator
from volsplat.client.trace.frame_tracer import FrameTracer
from volsplat.mapshade_server import server as mapshade_server
from volsplat.mapshade_server.links import data_link
from volsplat.protocol.messages.greetings import Hello
from volsplat.protocol.messages.handlers import check_handlers, handlers, takes
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.vocabulary import taken_by
from volsplat.splat_server import merge, merge_events
from volsplat.splat_server import server as splat_server

PROGRAMS: list[tuple[frozenset[type], tuple[type, ...]]] = [
    (coordinator.TAKEN, coordinator.OWNERS),
    (coordinator.OF_TRACES, (FrameTracer,)),
    (taken_by(Role.MAPSHADE_SERVER), mapshade_server.OWNERS),
    (taken_by(Role.SPLAT_SERVER), splat_server.OWNERS),
    (taken_by(Role.DATA_LINK), (data_link.DataLink,)),
    (frozenset(get_args(merge_events.Event)), (merge.Merge,)),
]
LACKING = [
    (kinds, owners, kind) for kinds, owners in PROGRAMS for kind in sorted(kinds, key=lambda kind: kind.__name__)
]


def without(owner: type, kind: type) -> type:
    """A class whose methods take what the owner's do, but for this."""
    methods = {name: method for name, method in vars(owner).items() if hasattr(method, "takes")}
    taken = {
        name: {one: method.takes[one] for one in method.takes if one is not kind} for name, method in methods.items()
    }
    return type(owner.__name__, (), {name: SimpleNamespace(takes=kinds) for name, kinds in taken.items()})


@pytest.mark.parametrize(("kinds", "owners", "kind"), LACKING, ids=lambda value: getattr(value, "__name__", ""))
def test_what_nothing_takes_is_named(kinds: frozenset[type], owners: tuple[type, ...], kind: type) -> None:
    check_handlers(kinds, *owners)
    with pytest.raises(TypeError, match=rf"must have a method that takes {kind.__name__}$"):
        check_handlers(kinds, *(without(owner, kind) for owner in owners))


def test_who_takes_what_never_comes_or_comes_to_another_is_named() -> None:
    class Greeted:
        @takes(Hello)
        def greet(self, message: Hello) -> None: ...

    for kinds, owners in PROGRAMS:
        with pytest.raises(TypeError, match="takes Hello, which never comes$"):
            check_handlers(kinds, *owners, Greeted)
        with pytest.raises(TypeError, match="takes something twice"):
            check_handlers(kinds, *owners, owners[-1])


@pytest.mark.parametrize(
    ("program", "place", "lacks"),
    [
        ("volsplat.mapshade_server.command", "volsplat.mapshade_server.held_volume.HeldVolume", "PackVoxels"),
        ("volsplat.splat_server.command", "volsplat.splat_server.worker_links.WorkerLinks", "Batch"),
        ("volsplat.client.session.session", "volsplat.client.coordinator.frames.Frames", "ImageRead"),
    ],
)
def test_a_program_that_lacks_a_handler_ends_at_start(program: str, place: str, lacks: str) -> None:
    module, owner = place.rsplit(".", 1)
    spoilt = f"""
from {module} import {owner}
for name, method in list(vars({owner}).items()):
    if any(kind.__name__ == {lacks!r} for kind in getattr(method, "takes", ())):
        delattr({owner}, name)
import {program}
"""
    ended = subprocess.run([sys.executable, "-c", spoilt], capture_output=True, text=True)
    assert ended.returncode != 0 and ended.stderr.splitlines()[-1].endswith(f"must have a method that takes {lacks}")


def test_methods_of_a_base_count() -> None:
    class Derived(merge.Merge):
        pass

    assert handlers(Derived).keys() == handlers(merge.Merge).keys()
