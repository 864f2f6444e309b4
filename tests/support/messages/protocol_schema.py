"""All that crosses the wire as one hash: fields of messages and scenes, their types and limits, without the prose."""

import json
from enum import Enum
from hashlib import sha256
from typing import Any

from msgspec import NODEFAULT, inspect

from volsplat.protocol.description.scene import Scene
from volsplat.protocol.messages.greetings import GREETINGS
from volsplat.protocol.messages.vocabulary import MESSAGES


def schema_hash() -> str:
    described: set[type] = set()
    kinds = [_plain(told, described) for told in inspect.multi_type_info([*GREETINGS, *MESSAGES, Scene])]
    payloads = {kind.__name__: [kind.largest_payload, *map(str, kind.ways)] for kind in MESSAGES}
    return sha256(json.dumps([kinds, payloads], sort_keys=True).encode()).hexdigest()


def _plain(told: Any, described: set[type]) -> Any:
    """What msgspec tells of a type, as JSON; a class is described if it is not `described` yet, else named."""
    cls = getattr(told, "cls", None)  # of a struct, a tuple with names, an enum
    match told:
        case type() if issubclass(told, Enum):
            return [told.__name__, {member.name: member.value for member in told}]
        case type():
            return told.__name__
        case inspect.Type() if cls in described:
            return cls.__name__
        case inspect.Type() | inspect.Field():
            described |= {cls} if cls else set()
            parts = {key: getattr(told, key) for key in told.__struct_fields__}
            if callable(make := parts.pop("default_factory", None)):
                parts["default"] = make()
            known = {key: value for key, value in parts.items() if value is not None and value is not NODEFAULT}
            return [type(told).__name__, {key: _plain(value, described) for key, value in known.items()}]
        case tuple() | list():
            return [_plain(one, described) for one in told]
    return told if isinstance(told, bool | int | float | str) else repr(told)
