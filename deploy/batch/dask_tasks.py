"""What a worker of Dask's does for a task pool (see dask_pool.py)."""

from collections.abc import Callable
from typing import TypeVar

from distributed import get_worker

from volsplat.protocol.text.errors import BadInput

Result = TypeVar("Result")


def done(task: Callable[[], Result]) -> Result:
    """The task's result. Raises BadInput with the worker's name before it."""
    try:
        return task()
    except BadInput as error:
        raise BadInput(f"Dask's worker {get_worker().name}: {error}") from None
