"""Who may see the page: decided here for the page, its sockets and uploads, and for the page that is waited on.

A token opens the page: the one that the terminal shows as often as the person likes, one in a redirect file once. It
becomes a cookie, another secret, so that it stays out of what the browser keeps and sends. Cookies do not know ports,
and loopback knows no users, so a cookie alone opens nothing: what asks must also say that it is this very page
(Host, Origin, Sec-Fetch-Site), and be a process of the same user.
"""

from __future__ import annotations

import hmac
import logging
import re
import secrets
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from urllib.parse import parse_qsl, quote, urlencode

from volsplat.client.ui.doors.peer_owner import PeerOwner, own_peers
from volsplat.client.ui.doors.public_address import PublicAddress

log = logging.getLogger(__name__)

TOKEN_PARAMETER = "token"

_SECRET_BYTES = 24
_METHODS = ("GET", "HEAD", "POST")
_HOST = re.compile(r"(?:localhost|127\.0\.0\.1|\[::1\])(?::[0-9]{1,5})?")
_FROM_ELSEWHERE = ("cross-site", "same-site")  # the latter: another port of this host

_STRANGER = "this page belongs to another user of this machine"
_PROXY_USER = "the proxy in front of it must run as that user, or as root"
_METHOD = "the page takes GET, HEAD and POST"
_ADDRESS = "this page is reached as localhost or 127.0.0.1; from another machine, forward its port with ssh -L"
_ANOTHER_PAGE = "another page asked for this; open the address yourself"
_TOKEN = "this page needs the token of its address; use the whole address that `volsplat view` printed"


@dataclass(frozen=True)
class Asked:
    """A request as far as it decides who asks."""

    method: str
    path: str
    query: str
    headers: Sequence[tuple[str, str]]  # names in lower case
    peer: tuple[str, int]
    here: tuple[str, int]
    is_socket: bool = False

    def values(self, name: str) -> list[str]:
        return [value for given, value in self.headers if given == name]

    def cookies(self, name: str) -> Iterator[str]:
        """Those of this name, whatever stands beside them: other programs of this host set any, well-formed or not."""
        for header in self.values("cookie"):
            for pair in header.split(";"):
                given, _, value = pair.strip().partition("=")
                if given == name:
                    yield value

    @property
    def parameters(self) -> list[tuple[str, str]]:
        return parse_qsl(self.query)

    @property
    def from_elsewhere(self) -> bool:
        """Another site's page, or another port's, has asked for it, as the browser says."""
        return any(value in _FROM_ELSEWHERE for value in self.values("sec-fetch-site"))

    @property
    def is_followed_link(self) -> bool:
        """A whole tab is to show the answer, and somebody else has led there."""
        whole_tab = self.values("sec-fetch-mode") == ["navigate"] and self.values("sec-fetch-dest") == ["document"]
        return self.method == "GET" and not self.is_socket and self.from_elsewhere and whole_tab


@dataclass(frozen=True)
class Admitted:
    """It may pass."""

    place: PublicAddress  # where the browser has it


@dataclass(frozen=True)
class Welcomed:
    """It came with a token, and is to go on to `location` with the cookie.

    `steps_aside`: a redirection would still count as coming from elsewhere, and browsers then keep strict cookies back;
    a page of our own has to lead on.
    """

    location: str
    cookie: str
    steps_aside: bool


@dataclass(frozen=True)
class Refused:
    """`instead`: what the person may go on to by a click, on this very host."""

    status: int
    reason: str
    instead: str = ""


class Admission:
    """One session's secrets, and what they open."""

    def __init__(self, peers: PeerOwner | None = None, behind: PublicAddress | None = None) -> None:
        """`behind`: where a proxy shows the page, if one does; it is admitted there as well as on this machine."""
        self.behind = behind
        self.token = secrets.token_urlsafe(_SECRET_BYTES)
        self._cookie = secrets.token_urlsafe(_SECRET_BYTES)
        self._once: dict[str, Callable[[], None]] = {}
        self._peers = peers or own_peers()
        self._told_of_proxy = False

    def token_for_once(self, on_use: Callable[[], None]) -> str:
        """A token that opens the page one time; `on_use` is called then."""
        token = secrets.token_urlsafe(_SECRET_BYTES)
        self._once[token] = on_use
        return token

    def judge(self, asked: Asked) -> Admitted | Welcomed | Refused:
        """From any thread."""
        if self._peers.is_stranger(asked.peer, asked.here):
            return Refused(403, _STRANGER if self.behind is None else f"{_STRANGER}; {_PROXY_USER}")
        if asked.method not in _METHODS:
            return Refused(405, _METHOD)
        place = self._place(asked)
        if place is None:
            return Refused(403, _ADDRESS)
        if any(origin.lower() != place.origin for origin in asked.values("origin")):
            return Refused(403, self._why_another_page(asked, place))
        cookie = f"volsplat-{place.port}"  # by the browser's port: several sessions may be forwarded to it
        if asked.method == "GET" and not asked.is_socket and (once := self._opens(asked)) is not None:
            return Welcomed(
                _without_token(asked, place),
                f"{cookie}={self._cookie}; HttpOnly; Path={place.prefix}/; SameSite=strict{_only_encrypted(place)}",
                once or asked.from_elsewhere,
            )
        if asked.is_followed_link:  # without the strict cookie, whoever it is
            return Refused(403, _ANOTHER_PAGE, _without_token(asked, place))
        if not any(_same(value, self._cookie) for value in asked.cookies(cookie)):
            return Refused(403, _TOKEN)
        if asked.from_elsewhere:
            return Refused(403, _ANOTHER_PAGE)
        return Admitted(place)

    def _place(self, asked: Asked) -> PublicAddress | None:
        """Where the browser thinks that the page is; None if it is nowhere there."""
        hosts = asked.values("host")
        if len(hosts) != 1:
            return None
        host = hosts[0].lower()
        if self.behind is not None and host == self.behind.host:
            return self.behind
        return PublicAddress("http", host) if _HOST.fullmatch(host) else None

    def _why_another_page(self, asked: Asked, place: PublicAddress) -> str:
        """The page where the proxy shows it is taken for another one if the proxy asks by another name."""
        if self.behind is None or [origin.lower() for origin in asked.values("origin")] != [self.behind.origin]:
            return _ANOTHER_PAGE
        why = (
            f"the proxy asks for {place.host}, but the page is at {self.behind.host}: have it hand on the browser's "
            "Host, as nginx does by `proxy_set_header Host $http_host`"
        )
        if not self._told_of_proxy:
            self._told_of_proxy = True
            log.warning("%s", why)
        return why

    def _opens(self, asked: Asked) -> bool | None:
        """Whether its token is one for once; None if it has none that opens anything."""
        for name, given in asked.parameters:
            if name == TOKEN_PARAMETER and _same(given, self.token):
                return False
            used = next((token for token in list(self._once) if name == TOKEN_PARAMETER and _same(given, token)), None)
            on_use = None if used is None else self._once.pop(used, None)
            if on_use is not None:
                on_use()
                return True
        return None


def _same(given: str, secret: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "surrogateescape"), secret.encode())


def _only_encrypted(place: PublicAddress) -> str:
    return "; Secure" if place.encrypted else ""


def _without_token(asked: Asked, place: PublicAddress) -> str:
    """What was asked for, on this very host whatever its path begins with."""
    others = [(name, value) for name, value in asked.parameters if name != TOKEN_PARAMETER]
    return quote(place.with_prefix(asked.path)) + ("?" + urlencode(others) if others else "")
