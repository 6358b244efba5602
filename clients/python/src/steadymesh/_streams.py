"""Streams and their frames, one request each.

All functions raise ProblemError for what the server refuses (404 ``no-stream`` where there is no
such stream) and ServerUnreachableError. ``token`` is sent as a bearer token.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ._address import ServerAddress, StreamAddress
from ._http import DEFAULT_TIMEOUT, HttpClient, Response, Token
from ._metrics import FrameMetrics

__all__ = [
    "StreamInfo",
    "configure",
    "delete",
    "frame",
    "latest",
    "metrics",
    "stream",
    "streams",
]


@dataclass(frozen=True)
class StreamInfo:
    """A stream, as the server shows it.

    - ``state``: ``live`` or ``idle``; ``config``: its configuration, defaults filled in.
    - ``counters``: ``received``, ``published``, ``dropped``, ``rejected`` frames, ``bytes_in`` and
      ``bytes_out`` since it was created.
    - ``subscribers``: players connected; ``queued``: frames accepted and not yet out.
    - ``latest_seq``: the newest frame that is out, None before the first.
    - ``created_us``: microseconds since 1970; ``raw``: all of it, as the server sent it.
    """

    name: str
    state: str
    config: Mapping[str, Any]
    counters: Mapping[str, int]
    subscribers: int
    queued: int
    latest_seq: int | None
    created_us: int
    raw: Mapping[str, Any] = field(repr=False, compare=False)

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> StreamInfo:
        """Reads what the server sends. Raises KeyError without a name."""
        return cls(
            name=document["stream"],
            state=document.get("state", ""),
            config=document.get("config", {}),
            counters=document.get("counters", {}),
            subscribers=document.get("subscribers", 0),
            queued=document.get("queued", 0),
            latest_seq=document.get("latest_seq"),
            created_us=document.get("created_us", 0),
            raw=document,
        )


def streams(server_url: str, *, token: Token = None) -> list[StreamInfo]:
    """All streams of the server, by name."""
    answer = _ask(ServerAddress.parse(server_url), "GET", "/v1/streams", token)
    return [StreamInfo.from_json(one) for one in answer.json()["streams"]]


def stream(url: str, *, token: Token = None) -> StreamInfo:
    """State, configuration and counters of a stream."""
    return StreamInfo.from_json(_ask_stream(url, "GET", "", token).json())


def configure(
    url: str,
    *,
    target_faces: int | None = None,
    target_ratio: float | None = None,
    tracking: str | None = None,
    tracking_strength: float | None = None,
    attribute_weight: float | None = None,
    position_bits: int | None = None,
    draco_speed: int | None = None,
    metrics: str | None = None,
    overload: str | None = None,
    extra: Mapping[str, Any] | None = None,
    token: Token = None,
) -> StreamInfo:
    """Makes a stream, or replaces its configuration; what is left out has the server's default.

    - ``target_faces`` or ``target_ratio``: faces of every frame out, or their share of the
      frame's own (above 0, at most 1).
    - ``tracking``: ``off`` (the original QEM), ``paper`` (Tracked QEM) or ``robust`` (the default).
    - ``tracking_strength``: how strongly ``robust`` holds a frame to the one before, 0 to 1.
    - ``attribute_weight``: how much colors, normals and texture coordinates count beside the shape,
      as a share of the frame's diagonal for a change by their whole range; 0 to 1.
    - ``position_bits``: 6 to 20 per coordinate; ``draco_speed``: 0 (smallest) to 10 (fastest).
    - ``metrics``: ``full``, ``sampled`` or ``off``. Without tracking, the previous frame is
      registered for ``full`` metrics only.
    - ``overload``: ``lossless`` (a full queue makes the publisher wait) or ``live`` (the oldest
      waiting frame is dropped).
    - ``extra``: fields of a newer server. A field that the server does not know is an error.
    """
    fields = {
        "target_faces": target_faces,
        "target_ratio": target_ratio,
        "tracking": tracking,
        "tracking_strength": tracking_strength,
        "attribute_weight": attribute_weight,
        "metrics": metrics,
        "overload": overload,
    }
    document: dict[str, Any] = {name: one for name, one in fields.items() if one is not None}
    draco = {"position_bits": position_bits, "speed": draco_speed}
    draco = {name: one for name, one in draco.items() if one is not None}
    if draco:
        document["draco"] = draco
    document.update(extra or {})
    answer = _ask_stream(url, "PUT", "", token, body=json.dumps(document).encode())
    return StreamInfo.from_json(answer.json())


def delete(url: str, *, token: Token = None) -> None:
    """Ends a stream and forgets its frames; players are told."""
    _ask_stream(url, "DELETE", "", token)


def frame(
    url: str, seq: int | str = "latest", format: str = "drc", *, token: Token = None
) -> bytes:
    """One simplified frame as a ``drc``, ``glb`` (with Draco inside) or ``ply`` file.

    ``seq`` is its number, or ``latest``. The server remembers the newest 300 or so.
    """
    return _ask_stream(url, "GET", f"frames/{seq}.{format}", token).body


def latest(url: str, format: str = "drc", *, token: Token = None) -> bytes:
    """The newest simplified frame as a ``drc``, ``glb`` (with Draco inside) or ``ply`` file."""
    return frame(url, "latest", format, token=token)


def metrics(url: str, last: int = 300, *, token: Token = None) -> list[FrameMetrics]:
    """The metrics of the newest ``last`` frames (the server remembers 300 or so), oldest first."""
    answer = _ask_stream(url, "GET", "metrics", token, query={"last": str(last)})
    return [FrameMetrics.from_json(one) for one in answer.json()["frames"]]


def _ask_stream(
    url: str,
    method: str,
    part: str,
    token: Token,
    *,
    query: Mapping[str, str] | None = None,
    body: bytes | None = None,
) -> Response:
    address = StreamAddress.parse(url)
    return _ask(address.server, method, address.path(part), token, query=query, body=body)


def _ask(
    server: ServerAddress,
    method: str,
    path: str,
    token: Token,
    *,
    query: Mapping[str, str] | None = None,
    body: bytes | None = None,
) -> Response:
    client = HttpClient(server, token, DEFAULT_TIMEOUT)
    try:
        headers = {} if body is None else {"Content-Type": "application/json"}
        return client.request(method, path, query=query, headers=headers, body=body)
    finally:
        client.close()
