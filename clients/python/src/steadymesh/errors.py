"""What can go wrong, all of it below :class:`SteadymeshError`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

__all__ = [
    "ConnectionEndedError",
    "FrameDroppedError",
    "InvalidAddressError",
    "InvalidMeshError",
    "InvalidMessageError",
    "MissingDracoError",
    "ProblemError",
    "PublishTimeoutError",
    "PublisherClosedError",
    "ServerUnreachableError",
    "SteadymeshError",
]

_PROBLEM_PREFIX = "urn:steadymesh:problem:"


class SteadymeshError(Exception):
    """The base of every error of this package."""


class InvalidAddressError(SteadymeshError, ValueError):
    """Text that is not the address of a stream or a server."""


class InvalidMeshError(SteadymeshError, ValueError):
    """Arrays that are no mesh: the message names the array and what is wrong with it."""


class InvalidMessageError(SteadymeshError, ValueError):
    """Bytes that are not the message that they should be."""


class MissingDracoError(SteadymeshError, ImportError):
    """Decoding a mesh needs the extra ``draco``."""


class ServerUnreachableError(SteadymeshError, ConnectionError):
    """No connection to the server could be made, or it broke before the answer."""


class PublishTimeoutError(SteadymeshError, TimeoutError):
    """The server did not take or finish a frame in time.

    Whether the frame has arrived is not known; to publish it again under the same number is
    harmless.
    """


class PublisherClosedError(SteadymeshError):
    """The publisher was closed before the frame was acknowledged."""


class FrameDroppedError(SteadymeshError):
    """An accepted frame is not coming out.

    ``seq`` is its number; ``reason`` is ``overload`` (a newer frame took its place), ``failed``
    (a defect of the server), ``ended`` (the stream has) or ``unknown`` (it is not among the
    frames that the server remembers).
    """

    def __init__(self, seq: int | None, reason: str) -> None:
        super().__init__(f"frame {seq} was dropped: {reason}")
        self.seq = seq
        self.reason = reason


class ConnectionEndedError(SteadymeshError):
    """The server has closed a WebSocket for good: the page of close codes is proto/README.md.

    ``code`` is the close code and ``reason`` its text, which may be empty.
    """

    def __init__(self, code: int, reason: str) -> None:
        meaning = _CLOSE_CODES.get(code, "the server closed the connection")
        super().__init__(f"{meaning} (close code {code}{': ' if reason else ''}{reason})")
        self.code = code
        self.reason = reason


_CLOSE_CODES = {
    1000: "the stream was deleted, or ended for lack of frames",
    4401: "the token has expired",
    4409: "another publisher has taken over",
}


class ProblemError(SteadymeshError):
    """The server refuses: a problem document (RFC 9457).

    - ``status``: the HTTP status, such as 422.
    - ``kind``: what stays the same and can be told apart, such as ``unusable-mesh``: the last
      part of the document's ``type``. Empty if something else than Steadymesh has answered.
    - ``title``, ``detail``: for people.
    - ``retry_after``: when it is worth trying again, in seconds; None where it is not.
    """

    def __init__(
        self,
        status: int,
        kind: str,
        title: str,
        detail: str,
        retry_after: float | None = None,
    ) -> None:
        super().__init__(f"{status} {title}: {detail}" if detail else f"{status} {title}")
        self.status = status
        self.kind = kind
        self.title = title
        self.detail = detail
        self.retry_after = retry_after

    @classmethod
    def from_document(cls, document: Mapping[str, Any], status: int = 0) -> ProblemError:
        """Reads a problem document; ``status`` counts where it says none."""
        kind = str(document.get("type", ""))
        milliseconds = document.get("retry_after_ms")
        return cls(
            status=int(document.get("status", status)),
            kind=kind[len(_PROBLEM_PREFIX) :] if kind.startswith(_PROBLEM_PREFIX) else kind,
            title=str(document.get("title", "Error")),
            detail=str(document.get("detail", "")),
            retry_after=None if milliseconds is None else float(milliseconds) / 1000.0,
        )

    @classmethod
    def from_response(cls, status: int, retry_after: str | None, body: bytes) -> ProblemError:
        """Reads an answer from 400 on, whoever has given it, and its header ``Retry-After``."""
        try:
            document = json.loads(body)
        except ValueError:
            document = None
        if isinstance(document, dict) and "title" in document:
            problem = cls.from_document(document, status)
        else:
            text = body[:200].decode("utf-8", "replace").strip()
            problem = cls(status, "", "The server answers", text)
        if problem.retry_after is None:
            problem.retry_after = _seconds(retry_after)
        return problem


def _seconds(value: str | None) -> float | None:
    """Reads ``Retry-After`` in seconds; its other form, a date, is not used by the server."""
    try:
        return None if value is None else max(0.0, float(value))
    except ValueError:
        return None
