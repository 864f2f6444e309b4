"""Which clusters have a task pool: those whose servers Dask places."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from volsplat.deploy.cluster_file import Cluster, Machine, read_cluster
from volsplat.program.task_pool import TaskPool
from volsplat.protocol.text.errors import BadInput


@contextmanager
def opened_pool(path: Path, report: Callable[[str], None]) -> Iterator[TaskPool]:
    """That of a cluster file. Raises BadInput for a cluster that has none, and for an engine that does not answer."""
    machines = batch_machines(read_cluster(path), str(path))
    from volsplat.deploy.batch.dask_pool import dask_pool  # brings the engine's library

    with dask_pool(machines, report) as pool:
        yield pool


def batch_machines(cluster: Cluster, name: str) -> list[Machine]:
    """Those of a cluster that share batch work, all by one scheduler. Raises BadInput if there are none."""
    machines = [machine for machine in cluster.machines if machine.launcher == "dask"]
    if not machines:
        launchers = ", ".join(sorted({machine.launcher for machine in cluster.machines}))
        raise BadInput(
            f'{name}: only machines with launcher = "dask" share this work, and it has {launchers}; start `dask '
            "scheduler` and `dask worker` on them and name it, or leave --cluster out"
        )
    if len({str(machine.dask) for machine in machines}) > 1:
        raise BadInput(f"{name}: its dask machines differ in scheduler or resources; leave one of them in the file")
    return machines
