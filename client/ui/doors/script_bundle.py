"""The scripts of a page's components as one: a browser asks once, in place of once for each of some sixty modules.

They stay ECMAScript modules where they lie, each of which a browser could load alone; here each becomes a function that
runs once and returns what it exports. Imports stand at the left edge and name what they take, as formatters write them.

NiceGUI asks for a component's module once more when an element of its kind first changes, and registers its default
export: were that another instance, Vue would build all elements of the kind anew, with what was typed in them lost and
what was dragged let go. So the page's import map names the bundle in its place, which the browser has, and which has no
default: app.component() without a component registers none.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from hashlib import sha256
from http import HTTPStatus
from pathlib import Path

from nicegui.dependencies import js_components
from starlette.responses import PlainTextResponse, Response

from volsplat.client.ui.doors.static_files import MODULES

BUNDLES_PATH = "/volsplat/scripts"

_IMPORT = re.compile(r'^import (?:\{([^}]*)\}|\* as (\w+)) from "([^"]+)";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (default |(?:async )?(?:function|class|const) (\w+))", re.MULTILINE)
_COMPONENT = re.compile(rb'import \{ default as (\w+) \} from "([^"]*/components/([^"]+))";\n?')
_IMPORT_MAP = re.compile(rb'<script\b[^>]* type="importmap"[^>]*>\s*\{"imports": \{')
_PRELOAD = re.compile(rb'<link rel="modulepreload" href="[^"]*/components/[^"]+" />\s*')


class ScriptBundles:
    """Those of all pages, each made when the first page needs it."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, ...], str] = {}  # by the components' keys, of which each version has its own
        self._scripts: dict[str, bytes] = {}

    def in_page(self, html: bytes) -> bytes:
        """The page with one script where NiceGUI put one for each component."""
        found = [match for match in _COMPONENT.finditer(html) if match[3].decode() in js_components]
        components = {match[1].decode(): js_components[match[3].decode()] for match in found}
        if not components:
            return html
        keys = tuple(component.key for component in components.values())
        if keys not in self._names:
            script = bundled({name: component.path for name, component in components.items()}).encode()
            self._names[keys] = name = f"{sha256(script).hexdigest()[:16]}.js"
            self._scripts[name] = script
        address = f".{BUNDLES_PATH}/{self._names[keys]}"
        imported = f'import {{ {", ".join(components)} }} from "{address}";\n'.encode()
        preload = f'<link rel="modulepreload" href="{address}" />\n'.encode()
        mapped = "".join(f"{json.dumps(match[2].decode())}: {json.dumps(address)}, " for match in found).encode()
        html = _IMPORT_MAP.sub(lambda head: head[0] + mapped, html, count=1)
        return _instead(_COMPONENT, imported, _instead(_PRELOAD, preload, html))

    async def script(self, name: str) -> Response:
        """What browsers may keep for ever, since another one has another name."""
        if name not in self._scripts:
            return PlainTextResponse("volsplat: no such script\n", HTTPStatus.NOT_FOUND)
        kept = {"Cache-Control": "private, max-age=31536000, immutable"}
        return Response(self._scripts[name], media_type="text/javascript", headers=kept)


def bundled(modules: Mapping[str, Path]) -> str:
    """One module that exports by each name what the module at its path exports as the default.

    Raises ValueError for a module that imports what is no file of the page's.
    """
    bundle = _Bundle()
    ends = [f"export const {name} = {bundle.name_of(path)}.default;" for name, path in modules.items()]
    return "\n".join([*bundle.parts, *ends, ""])


def _instead(pattern: re.Pattern[bytes], text: bytes, html: bytes) -> bytes:
    """`html` with the text in place of what is found first, and without what is found later."""
    texts = iter([text])
    return pattern.sub(lambda _: next(texts, b""), html)


class _Bundle:
    def __init__(self) -> None:
        self.parts: list[str] = []  # each after all that it imports
        self._names: dict[Path, str] = {}

    def name_of(self, path: Path) -> str:
        """What holds the exports of the module there."""
        if path not in self._names:
            source = _IMPORT.sub(lambda found: self._imported(path, found), path.read_text("utf-8"))
            exported = [found[2] or "default: default_" for found in _EXPORT.finditer(source)]
            body = _EXPORT.sub(lambda found: "const default_ = " if found[1] == "default " else found[1], source)
            self._names[path] = name = f"module{len(self._names)}"
            self.parts.append(f"const {name} = (() => {{\n{body}\nreturn {{ {', '.join(exported)} }};\n}})();")
        return self._names[path]

    def _imported(self, path: Path, found: re.Match[str]) -> str:
        """What stands for an import of the module at `path`."""
        names, whole, place = found.groups()
        module = self.name_of(_place(path, place))
        return f"const {whole or '{' + names.replace(' as ', ': ') + '}'} = {module};"


def _place(path: Path, imported: str) -> Path:
    """Where what the module at `path` imports lies."""
    package, _, rest = imported.partition("/")
    if package in MODULES:
        return Path(MODULES[package]) / rest
    if not imported.startswith("."):
        raise ValueError(f"{path}: imports {imported}, which is no file of the page's")
    return (path.parent / imported).resolve()
