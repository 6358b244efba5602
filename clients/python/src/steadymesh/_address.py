"""The address of a stream or a server, as people write it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import urlencode, urlsplit

from .errors import InvalidAddressError

_EXAMPLE = "http://127.0.0.1:8080/v1/streams/demo"
_NAME = re.compile(r"[a-z0-9-]{1,64}")
_SCHEMES = {"http": "http", "https": "https", "ws": "http", "wss": "https"}


@dataclass(frozen=True)
class ServerAddress:
    """A server: ``scheme`` is ``http`` or ``https``, ``authority`` is ``host`` or ``host:port``."""

    scheme: str
    authority: str

    @classmethod
    def parse(cls, text: str) -> ServerAddress:
        """Reads ``http://host:port``; whatever follows, such as a stream's path, is left out."""
        try:
            parts = urlsplit(text)
            # Reading the port is what checks it.
            host, _ = parts.hostname, parts.port
        except ValueError as error:
            raise InvalidAddressError(f"{text!r} is no address: {error}") from error
        if parts.scheme not in _SCHEMES or not host:
            raise InvalidAddressError(
                f"{text!r} is not an http:// or https:// address, such as {_EXAMPLE}"
            )
        if "@" in parts.netloc:
            raise InvalidAddressError(
                "the address contains a user name or password: pass token= instead"
            )
        return cls(_SCHEMES[parts.scheme], parts.netloc)


@dataclass(frozen=True)
class StreamAddress:
    """A stream on a server."""

    server: ServerAddress
    name: str

    @classmethod
    def parse(cls, text: str) -> StreamAddress:
        """Reads the address of a stream in any of its forms.

        ``http://host:port/v1/streams/NAME``, the address of its page
        (``http://host:port/watch/NAME``), or just ``http://host:port/NAME``; a query is ignored.
        """
        server = ServerAddress.parse(text)
        path = urlsplit(text).path.strip("/")
        for prefix in ("v1/streams/", "watch/"):
            if path.startswith(prefix):
                path = path[len(prefix) :]
                break
        if not _NAME.fullmatch(path):
            raise InvalidAddressError(
                f"{text!r} does not name a stream (1 to 64 of a-z, 0-9 and -), as {_EXAMPLE} does"
            )
        return cls(server, path)

    def path(self, part: str = "") -> str:
        """The path of the stream, or of a part of it such as ``frames``."""
        return f"/v1/streams/{self.name}/{part}" if part else f"/v1/streams/{self.name}"

    def websocket(self, part: str, **query: str) -> str:
        """The address for a WebSocket, such as that of ``subscribe``."""
        scheme = "wss" if self.server.scheme == "https" else "ws"
        suffix = f"?{urlencode(query)}" if query else ""
        return f"{scheme}://{self.server.authority}{self.path(part)}{suffix}"
