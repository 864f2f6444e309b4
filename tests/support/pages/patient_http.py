"""HTTP as httpx has it, without its five seconds, which a busy machine needs."""

from functools import partial

import httpx

from support.patience import PATIENCE

get = partial(httpx.get, timeout=PATIENCE)  # noqa: TID251
post = partial(httpx.post, timeout=PATIENCE)  # noqa: TID251
request = partial(httpx.request, timeout=PATIENCE)  # noqa: TID251
Client = partial(httpx.Client, timeout=PATIENCE)  # noqa: TID251
