"""A cluster file with fewer machines: what `--cluster` measures, one size after the other."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from volsplat.bench.renderers import Row, opened_rows
from volsplat.client.session.session import Session
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.deploy.cluster_file import Cluster, Machine
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput


class MeasuredCluster(NamedTuple):
    """The sizes of a cluster, by the number of map/shade servers; all have all of its splat servers."""

    cluster: Cluster
    sizes: Sequence[int]


def measured_cluster(path: Path, counts: Sequence[int] | None) -> MeasuredCluster:
    """With so many map/shade servers; by default those of the first machine, of the first two, and so on.

    Raises BadInput for a file that cannot be used, one that asks for fewer servers, and a cluster that is up.
    """
    running = RunningCluster(path)
    cluster, servers = running.cluster, running.cluster.map_shade_servers
    if running.folder.load() is not None:
        raise BadInput(f"the cluster {cluster.name} is up; end it first: volsplat deploy down {path}")
    sizes = list(counts or _by_machine(cluster))
    if max(sizes) > servers:
        raise BadInput(f"--workers {max(sizes)}: {path} asks for {servers} map/shade servers; give at most as many")
    return MeasuredCluster(cluster, sizes)


def _by_machine(cluster: Cluster) -> list[int]:
    """Of one machine alone: one server, two, and so on."""
    several = [machine.map_shade_servers for machine in cluster.machines if machine.map_shade_servers]
    steps = several if len(several) > 1 else [1] * several[0]
    return [sum(steps[: n + 1]) for n in range(len(steps))]


Drawers = MeasuredCluster | list[int]  # a cluster, or numbers of map/shade servers of this machine


def groups_of(
    drawers: Drawers, volume: str, memory: int | None, say: Callable[[str], None], like_machines: bool = False
) -> Generator[list[Row]]:
    """Rows that take turns: all of this machine at once, a cluster's sizes one after the other.

    Each is there until the next is asked for, or the generator is closed. The single process comes first, if the volume
    is seen here. `like_machines`: see opened_rows.
    """
    if not isinstance(drawers, MeasuredCluster):
        with opened_rows(volume, drawers, say, memory, like_machines) as rows:
            yield rows
        return
    if Path(volume).exists():
        with opened_rows(volume, [], say, memory) as single:
            yield single
    with tempfile.TemporaryDirectory(prefix="volsplat-bench-") as folder:
        for servers in drawers.sizes:
            path = Path(folder, f"{servers}.toml")
            path.write_text(toml_of(narrowed(drawers.cluster, servers)), encoding="utf-8")
            with Session(volume, cluster=path, memory=memory, on_progress=say) as session:
                assert session.volume, "wait until its servers have read the volume"
                _check_all_are_there(session, servers)
                yield [Row(servers, session)]


def _check_all_are_there(session: Session, map_shade_servers: int) -> None:
    """A session draws without servers that do not come. Raises BadInput where it does."""
    there = sum(one.role is Role.MAPSHADE_SERVER and not one.lost for one in session.servers)
    if there < map_shade_servers:
        raise BadInput(
            f"{there} of {map_shade_servers} map/shade servers draw, which says nothing of all; the lines above say why"
        )


def narrowed(cluster: Cluster, map_shade_servers: int) -> Cluster:
    """With the first so many map/shade servers alone, and machines that run anything."""
    left, machines = map_shade_servers, list[Machine]()
    for machine in cluster.machines:
        kept = min(left, machine.map_shade_servers)
        left -= kept
        if kept or machine.splat_servers:
            machines.append(msgspec.structs.replace(machine, map_shade_servers=kept))
    return msgspec.structs.replace(cluster, name=f"{cluster.name[:54]}-bench", machines=tuple(machines))


def toml_of(cluster: Cluster) -> str:
    """A cluster file that says so."""
    keys: dict[str, Any] = msgspec.to_builtins(cluster)
    return "".join(f"{key} = {_value(value)}\n" for key, value in keys.items() if value is not None)


def _value(value: Any) -> str:
    match value:
        case dict():
            pairs = (f"{json.dumps(key)} = {_value(one)}" for key, one in value.items() if one is not None)
            return f"{{{', '.join(pairs)}}}"
        case list() | tuple():
            return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value)
