"""Imports NiceGUI, for whoever imports this first, without what this page never needs and every start would wait for.

The library of its sockets brings clients: nothing here asks others by HTTP or by sockets, and they take a third of the
time until the page is served. What finds the addresses for NiceGUI's welcome, which is not shown, has ldconfig started.
FastAPI has what validates the models of its catalogue of interfaces (`/docs`), which this page does not have: it is
built once a model is used, and most never are.
"""

from __future__ import annotations

import importlib.util
import sys

from pydantic import BaseModel

_CLIENTS = tuple(name for name in ("aiohttp", "requests", "tornado") if name not in sys.modules)


def _when_used(name: str) -> None:
    """Have a module imported once something of it is asked for."""
    spec = None if name in sys.modules else importlib.util.find_spec(name)
    if spec is None or spec.loader is None:
        return
    spec.loader = importlib.util.LazyLoader(spec.loader)
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)


_when_used("ifaddr")
for _client in _CLIENTS:
    sys.modules[_client] = None  # type: ignore[assignment]  # as if it were not installed: it is optional to that library
_configured = BaseModel.model_config
BaseModel.model_config = _configured | {"defer_build": True}
try:
    import nicegui as nicegui
finally:
    BaseModel.model_config = _configured
    for _client in _CLIENTS:
        del sys.modules[_client]
