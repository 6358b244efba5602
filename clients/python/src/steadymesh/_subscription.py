"""Receiving a stream's frames, as a player does."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Union

from websockets.exceptions import ConnectionClosed

from ._address import StreamAddress
from ._backoff import Backoff
from ._frame import Frame
from ._http import Token
from ._websocket import WebSocket, close_code
from .errors import ConnectionEndedError, InvalidMessageError, ProblemError, ServerUnreachableError

__all__ = ["Ended", "Event", "Hello", "Skipped", "Subscription", "subscribe"]

_log = logging.getLogger("steadymesh")

# After these the server may have something again.
_PASSING_ENDS = ("idle", "shutdown")
# A stream that has ended, a server that stops or has too much to do.
_PASSING_STATUSES = (404, 429, 500, 502, 503, 504)
_TOKEN_EXPIRED = 4401


@dataclass(frozen=True)
class Hello:
    """A connection has been made; ``latest_seq`` is None before the stream's first frame."""

    stream: str
    latest_seq: int | None
    config: Mapping[str, Any] = field(repr=False)


@dataclass(frozen=True)
class Skipped:
    """The reader was too slow: so many frames are left out, and the next one is the newest."""

    missed: int


@dataclass(frozen=True)
class Ended:
    """The stream ended: ``deleted``, ``idle`` or ``shutdown``.

    After the last two the subscription goes on once there is something again.
    """

    reason: str


Event = Union[Frame, Hello, Skipped, Ended]


def subscribe(
    url: str,
    *,
    max_frames: int | None = None,
    timeout: float | None = None,
    reconnect: bool = True,
    wait_for_stream: bool = False,
    token: Token = None,
) -> Subscription:
    """Connects to a stream and gives its frames: the newest at once, then each as it comes out.

    - ``url``: the stream, as ``http://127.0.0.1:8080/v1/streams/demo``, ``…/watch/demo`` or
      ``…/demo``.
    - ``max_frames``: ends after so many.
    - ``timeout``: the longest to wait for the next frame, in seconds; TimeoutError then.
    - ``reconnect``: whether to come back by itself when a connection breaks.
    - ``wait_for_stream``: whether to wait for a stream, or a server, that is not there yet; else
      the first connection has to succeed.

    Raises ProblemError (404 ``no-stream`` if there is no such stream) and ServerUnreachableError.
    """
    return Subscription(
        StreamAddress.parse(url),
        max_frames=max_frames,
        timeout=timeout,
        reconnect=reconnect,
        wait_for_stream=wait_for_stream,
        token=token,
    )


class Subscription:
    """An iterator of frames and a context manager: see :func:`subscribe`.

    It ends when the stream is deleted, after ``max_frames``, and when somebody has called
    :meth:`close`, which any thread may. ``missed`` counts the frames that were left out because
    this reader was too slow, ``end_reason`` is the last reason that the server gave for an end.

    Iterating raises ConnectionEndedError and ProblemError where to come back is of no use or not
    wanted, and TimeoutError.
    """

    def __init__(
        self,
        address: StreamAddress,
        *,
        max_frames: int | None = None,
        timeout: float | None = None,
        reconnect: bool = True,
        wait_for_stream: bool = False,
        token: Token = None,
    ) -> None:
        self.missed = 0
        self.end_reason: str | None = None
        self._address = address
        self._frames_left = max_frames
        self._timeout = timeout
        self._reconnect = reconnect
        self._token = token
        self._closed = threading.Event()
        self._last_message = b""
        self._backoff = Backoff()
        self._socket: WebSocket | None = None
        self._deadline: float | None = None
        if not wait_for_stream:
            self._socket = self._connect()

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        while True:
            event = self.next_event()
            if event is None:
                raise StopIteration
            if isinstance(event, Frame):
                return event

    def events(self) -> Iterator[Event]:
        """Frames, and what happens between them: Hello, Skipped and Ended."""
        while True:
            event = self.next_event()
            if event is None:
                return
            yield event

    def next_event(self) -> Event | None:
        """The next event; None when there will be none."""
        self._deadline = None if self._timeout is None else time.monotonic() + self._timeout
        while not self._closed.is_set() and self._frames_left != 0:
            try:
                if self._socket is None:
                    self._socket = self._connect_patiently()
                    continue
                event = self._read(self._socket)
            except ConnectionClosed as error:
                self._on_closed(error)
                continue
            if event is not None:
                return event
        self.close()
        return None

    def close(self) -> None:
        """Takes leave of the server; the iteration ends."""
        self._closed.set()
        if self._socket is not None:
            self._socket.close()

    def __enter__(self) -> Subscription:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _connect(self) -> WebSocket:
        return WebSocket(self._address.websocket("subscribe"), self._token)

    def _connect_patiently(self) -> WebSocket | None:
        """A connection, or None if somebody closes the subscription meanwhile."""
        while not self._closed.is_set():
            asked = None
            try:
                return self._connect()
            except ProblemError as problem:
                if problem.status not in _PASSING_STATUSES:
                    raise
                asked = problem.retry_after
            except ServerUnreachableError:
                # The server may be about to start again.
                pass
            self._pause(self._backoff.next(asked))
        return None

    def _pause(self, seconds: float) -> None:
        left = self._seconds_left()
        if left is not None and left <= seconds:
            self._closed.wait(max(0.0, left))
            raise TimeoutError(f"no frame within {self._timeout} seconds")
        self._closed.wait(seconds)

    def _seconds_left(self) -> float | None:
        return None if self._deadline is None else self._deadline - time.monotonic()

    def _read(self, websocket: WebSocket) -> Event | None:
        left = self._seconds_left()
        try:
            message = websocket.receive(None if left is None else max(0.0, left))
        except TimeoutError:
            raise TimeoutError(f"no frame within {self._timeout} seconds") from None
        if isinstance(message, bytes):
            return self._on_frame(message)
        return self._on_control(message)

    def _on_frame(self, message: bytes) -> Frame | None:
        self._backoff.reset()
        # After coming back the newest frame is sent again.
        if message == self._last_message:
            return None
        frame = Frame.from_message(message)
        self._last_message = message
        if self._frames_left is not None:
            self._frames_left -= 1
        return frame

    def _on_control(self, message: dict[str, Any]) -> Event | None:
        kind = message.get("type")
        try:
            if kind == "hello":
                return Hello(
                    str(message["stream"]), message.get("latest_seq"), message.get("config", {})
                )
            if kind == "skipped":
                skipped = Skipped(int(message["missed"]))
                self.missed += skipped.missed
                return skipped
            if kind == "end":
                return self._on_end(str(message["reason"]))
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidMessageError(f"the message {message} cannot be read") from error
        return None

    def _on_end(self, reason: str) -> Ended:
        self.end_reason = reason
        websocket, self._socket = self._socket, None
        if websocket is not None:
            websocket.close()
        if not (self._reconnect and reason in _PASSING_ENDS):
            self._closed.set()
        return Ended(reason)

    def _on_closed(self, error: ConnectionClosed) -> None:
        websocket, self._socket = self._socket, None
        if websocket is not None:
            websocket.close()
        if self._closed.is_set():
            return
        code, reason = close_code(error)
        if not self._reconnect or (code == _TOKEN_EXPIRED and not callable(self._token)):
            raise ConnectionEndedError(code, reason) from error
        _log.info("connection to %s ended (%s): coming back", self._address.name, code)
        self._pause(self._backoff.next())
