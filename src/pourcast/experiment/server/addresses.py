"""Whom a request comes from, also where it was passed on by web servers (proxies) of ours."""

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from starlette.types import ASGIApp, Receive, Scope, Send

from pourcast.errors import InputError

IPAddress = ipaddress.IPv4Address | ipaddress.IPv6Address
Network = ipaddress.IPv4Network | ipaddress.IPv6Network

_LOOPBACK: tuple[Network, ...] = (
    ipaddress.ip_network("127.0.0.0/8"),
    ipaddress.ip_network("::1/128"),
)


@dataclass(frozen=True)
class Proxies:
    """Web servers of ours that requests pass before they come here.

    Parameters
    ----------
    hops
        How many each request passes.
    networks
        Where they are. Without any, the last one is on this machine, and of those before it only
        the number is known.
    """

    hops: int = 0
    networks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.hops < 0:
            raise InputError(f"proxy-hops: expected 0 or more, found {self.hops}")
        for network in self.networks:
            _network(network)

    @cached_property
    def _trusted(self) -> tuple[Network, ...]:
        return (*_LOOPBACK, *map(_network, self.networks))

    def client(self, peer: str, forwarded: Sequence[str]) -> str:
        """Address of the client.

        Each proxy of ours wrote one entry, the last first: the address that its request came from.
        What stands further left the client can have written itself, and is never looked at.

        Parameters
        ----------
        peer
            Who is at the other end of the connection.
        forwarded
            Entries of X-Forwarded-For, from left to right.
        """
        found = peer
        for hop, entry in enumerate(list(reversed(forwarded))[: self.hops]):
            before = _address(entry)
            is_checked = hop == 0 or bool(self.networks)
            if before is None or (is_checked and not self._is_trusted(found)):
                break
            found = str(before)
        return found

    def _is_trusted(self, address: str) -> bool:
        here = _address(address)
        return here is not None and any(here in network for network in self._trusted)


NO_PROXIES = Proxies()
"""Whoever connects is the client."""


class ForwardedAddress:
    """Middleware: the client's address in place of the proxy's. Nothing else is believed."""

    def __init__(self, app: ASGIApp, proxies: Proxies) -> None:
        self.app, self.proxies = app, proxies

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Look at who passed the request on."""
        if scope["type"] == "http" and scope.get("client"):
            peer, port = scope["client"]
            forwarded = [
                entry
                for name, value in scope["headers"]
                if name == b"x-forwarded-for"
                for entry in value.decode("latin-1").split(",")
            ]
            found = self.proxies.client(peer, forwarded)
            if found != peer:
                scope["client"] = (found, port)
        await self.app(scope, receive, send)


def visitors_place(address: str) -> str:
    """What is counted as one place: an address, or the network that an IPv6 household has."""
    found = _address(address)
    if isinstance(found, ipaddress.IPv6Address):
        return str(ipaddress.ip_network((found, 64), strict=False))
    return address if found is None else str(found)


def _network(text: str) -> Network:
    try:
        return ipaddress.ip_network(text.strip(), strict=False)
    except ValueError:
        raise InputError(
            f"trusted-proxy: expected an address or network such as 10.0.0.0/8, found {text}"
        ) from None


def _address(text: str) -> IPAddress | None:
    """An address, its port cut off; None if it is none."""
    text = text.strip()
    if text.startswith("["):
        text = text[1:].partition("]")[0]
    elif text.count(":") == 1:
        text = text.partition(":")[0]
    try:
        found = ipaddress.ip_address(text.partition("%")[0])
    except ValueError:
        return None
    mapped = found.ipv4_mapped if isinstance(found, ipaddress.IPv6Address) else None
    return mapped or found
