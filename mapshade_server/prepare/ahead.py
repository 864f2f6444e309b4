"""Work in threads, a bounded amount of it ahead of whoever takes the results."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def ahead(work: Callable[[Item], Result], items: Iterable[Item], count: int) -> Iterator[Result]:
    """The results in the items' order; up to `count` are begun, or ready, besides the one that was taken last.

    With a count of 0, each is worked on when it is asked for.
    """
    if count == 0:
        yield from map(work, items)
        return
    waiting = iter(items)
    with ThreadPoolExecutor(count, "prepare") as pool:
        begun: deque[Future[Result]] = deque(pool.submit(work, item) for item in islice(waiting, count))
        try:
            while begun:
                result = begun.popleft().result()
                begun.extend(pool.submit(work, item) for item in islice(waiting, 1))
                yield result
        finally:
            for future in begun:
                future.cancel()
