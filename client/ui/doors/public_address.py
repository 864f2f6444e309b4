"""Where the browser sees the page: on this machine, or under the longer address of a proxy, as JupyterHub's."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import urlsplit

from volsplat.protocol.text.errors import BadInput

_PORTS = {"http": "80", "https": "443"}
_PREFIX = re.compile(r"(?:/[\w.~@:+-]+)*")


@dataclass(frozen=True)
class PublicAddress:
    """Scheme, host and prefix, as the browser has them in front of the page's own paths."""

    scheme: str
    host: str  # in lower case, with its port if it has one
    prefix: str = ""  # of paths: empty, or with a slash before it and none behind

    @classmethod
    def of(cls, url: str) -> PublicAddress:
        """Raises BadInput if it is none, or has what an address of a page cannot have."""
        try:
            parts = urlsplit(url)
            parts.port  # noqa: B018 raises if it is no port
        except ValueError as error:
            raise BadInput(f"--behind {url}: {error}; give the page's address, as https://HOST/PATH/") from None
        prefix = parts.path.rstrip("/")
        plain = not (parts.query or parts.fragment or "@" in parts.netloc) and _PREFIX.fullmatch(prefix)
        if parts.scheme not in _PORTS or not parts.hostname or not plain:
            raise BadInput(f"--behind {url}: give the page's address in the browser, as https://HOST/PATH/")
        return cls(parts.scheme, parts.netloc.lower(), prefix)

    @property
    def url(self) -> str:
        return f"{self.origin}{self.prefix}/"

    @property
    def origin(self) -> str:
        return f"{self.scheme}://{self.host}"

    @property
    def port(self) -> str:
        return str(urlsplit(self.origin).port or _PORTS[self.scheme])

    @property
    def encrypted(self) -> bool:
        return self.scheme == "https"

    def without_prefix(self, path: str) -> str:
        """A path as the page has it: some proxies cut their prefix from what they pass on, others do not."""
        begins = path == self.prefix or path.startswith(self.prefix + "/")
        return (path.removeprefix(self.prefix) or "/") if begins else path

    def with_prefix(self, path: str) -> str:
        """A path as the browser has it, on this very host whatever it begins with."""
        return f"{self.prefix}/{self.without_prefix(path).lstrip('/')}"
