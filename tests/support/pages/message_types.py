"""The types of what page and process say to each other, as TypeScript for the page's modules; in tests/:

    python -m support.pages.message_types

writes them anew from client/ui/viewport/viewport_messages.py and slice_messages.py beside it.
"""

import enum
import inspect
import types
from collections.abc import Iterator
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

from support.checkout import ROOT
from volsplat.client.ui.viewport import viewport_messages as said
from volsplat.client.ui.viewport.slice_messages import SliceHeader

HEAD = (
    "// What page and process say to each other, made from viewport_messages.py (tests/support/pages/message_types.py)."
)
WRITTEN = ROOT / "client/ui/static/viewport/viewport_messages.d.ts"
NAMES = {int: "number", float: "number", str: "string", bool: "boolean", type(None): "null"}
UNIONS = {"PageMessage": said.PageMessage, "ProcessMessage": said.ProcessMessage}


def type_text(kind: Any) -> str:
    """A type in TypeScript. Raises TypeError for one that JSON does not have."""
    if kind in NAMES:
        return NAMES[kind]
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return " | ".join(dict.fromkeys(type_text(part) for part in parts))
    if origin is Literal:
        return " | ".join(f'"{part}"' for part in parts)
    if origin is tuple and parts[-1] is ...:
        return f"({type_text(parts[0])})[]"
    if origin is tuple:
        return f"[{', '.join(type_text(part) for part in parts)}]"
    if origin is dict:
        return f"Record<{type_text(parts[0])}, {type_text(parts[1])}>"
    if isinstance(kind, type) and issubclass(kind, enum.StrEnum):
        return " | ".join(f'"{member.value}"' for member in kind)
    if isinstance(kind, type) and issubclass(kind, tuple):
        return f"[{', '.join(type_text(part) for part in get_type_hints(kind).values())}]"
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return kind.__name__
    raise TypeError(f"{kind} is nothing that JSON has")


def structs_in(kind: Any) -> Iterator[type[msgspec.Struct]]:
    """The structs that a type is made of, each after those that it needs."""
    for part in get_args(kind):
        yield from structs_in(part)
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        for part in get_type_hints(kind).values():
            yield from structs_in(part)
        yield kind


def interface(struct: type[msgspec.Struct]) -> str:
    tag = struct.__struct_config__.tag
    hints = {field.encode_name: get_type_hints(struct)[field.name] for field in msgspec.structs.fields(struct)}
    lines = [f"  {name}: {type_text(kind)};" for name, kind in hints.items()]
    told = (inspect.getdoc(struct) or "").splitlines()[0]
    return "\n".join(
        [
            f"/** {told} */",
            f"export interface {struct.__name__} {{",
            *([f'  type: "{tag}";'] if tag else []),
            *lines,
            "}",
        ]
    )


def message_types() -> str:
    """The whole file."""
    structs = dict.fromkeys(
        [*structs_in(said.PageMessage | said.ProcessMessage), *structs_in(said.PictureHeader), *structs_in(SliceHeader)]
    )
    unions = [
        f"export type {name} = {' | '.join(part.__name__ for part in get_args(union))};"
        for name, union in UNIONS.items()
    ]
    return "\n\n".join([HEAD, *(interface(struct) for struct in structs), *unions]) + "\n"


if __name__ == "__main__":
    WRITTEN.write_text(message_types(), encoding="utf-8")
