"""The secret words in links, which decide who may look at the page and who may drive, and the host names of
browsers."""

from __future__ import annotations

import hmac
import re
import secrets
import socket
from collections.abc import Sequence
from enum import StrEnum
from ipaddress import ip_address

from msgspec import Struct

# 128 bits: nobody can guess it.
WORD_BYTES = 16
# A name or an address, with an optional port: what a browser sends. It is copied into a header of ours.
_HOST = re.compile(r"(?P<name>\[[0-9a-fA-F:.]+\]|[0-9A-Za-z._-]+)(:[0-9]{1,5})?")


class PageRole(StrEnum):
    """Rights of a viewer."""

    LOOK = "look"
    DRIVE = "drive"


class PageLink(Struct, frozen=True):
    """A link to the page, and its rights."""

    role: PageRole
    address: str


class PageAccess:
    """Rights on the page. With `words` they depend on the word in the link; without, all admitted people have
    the same."""

    def __init__(self, *, words: bool, control: bool, host: str = "", names: Sequence[str] = ()) -> None:
        """`host` is the address by which other machines reach the page, as given. A forwarder shows it under
        `names`; anybody may reach the forwarder, so that they need `words`."""
        roles = (PageRole.LOOK, PageRole.DRIVE) if control else (PageRole.LOOK,)
        self._words = {role: secrets.token_urlsafe(WORD_BYTES) for role in roles} if words else {}
        self._free = None if words else roles[-1]
        self._forwarded = {name.lower() for name in names}
        self._names = {"localhost", host.lower(), socket.gethostname().lower(), *self._forwarded} - {""}

    def role_of(self, word: str) -> PageRole | None:
        """The role of a viewer with this word; None for a wrong word."""
        if self._free is not None:
            return self._free
        found = None
        # All are compared, in constant time: the time shows nothing about the words.
        for role, known in self._words.items():
            if hmac.compare_digest(known.encode(), word.encode()):
                found = role
        return found

    def is_host(self, host: str) -> bool:
        """True if a browser that names this host means this page: an address, or a name of this machine.

        Any other name may belong to an attacker, who has it resolve to us (DNS rebinding).
        """
        found = _HOST.fullmatch(host)
        if found is None:
            return False
        name = found["name"].strip("[]").lower().rstrip(".")
        try:
            ip_address(name)
        except ValueError:
            return name in self._names or name.removesuffix(".local") in self._names
        return True

    def is_origin(self, origin: str, host: str) -> bool:
        """True if a page with this origin, requested at this host, is ours. A forwarder may ask for another
        host than the browser did, but only a name that was given."""
        if origin in (f"http://{host}", f"https://{host}"):
            return True
        found = _HOST.fullmatch(origin.removeprefix("https://"))
        return found is not None and found["name"].lower() in self._forwarded

    def links(self, host: str, port: int) -> tuple[PageLink, ...]:
        """The links to print."""
        place = f"http://{f'[{host}]' if ':' in host else host}:{port}/"
        if self._free is not None:
            return (PageLink(self._free, place),)
        places = [place, *(f"https://{name}/" for name in sorted(self._forwarded))]
        return tuple(
            PageLink(role, f"{place}#{word}") for place in places for role, word in self._words.items()
        )


def shown_host(host: str) -> str:
    """The address for links to a page that is served on `host`."""
    if host not in ("0.0.0.0", "::"):
        return host
    family, elsewhere = (socket.AF_INET6, "2001:db8::1") if host == "::" else (socket.AF_INET, "192.0.2.1")
    try:
        # Addresses reserved for documentation; nothing is sent. The system reports the address it would send
        # from.
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((elsewhere, 9))
            return str(probe.getsockname()[0])
    except OSError:
        return socket.gethostname()
