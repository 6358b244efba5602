"""Publishing by WebSocket: credit, acknowledgements, coming back after a break.

One thread sends, one receives and reconnects; whoever publishes waits for the first to have
sent its frame. All that they share is behind one condition, which nobody holds while sending,
receiving or connecting.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from typing import Any, Callable

from websockets.exceptions import ConnectionClosed

from ._address import StreamAddress
from ._backoff import Backoff
from ._handle import PublishedFrame
from ._http import Token
from ._link import Link
from ._submission import Payload, Submission
from ._websocket import CLOSE_TIMEOUT, NO_STATUS, close_code
from .errors import (
    ConnectionEndedError,
    InvalidMessageError,
    ProblemError,
    PublisherClosedError,
    PublishTimeoutError,
    ServerUnreachableError,
)

_log = logging.getLogger("steadymesh")

_ENDED, _TOO_LARGE, _TOKEN_EXPIRED, _TAKEN_OVER = 1000, 1009, 4401, 4409
_PASSING_STATUSES = (429, 500, 502, 503, 504)


class WebSocketTransport:
    """Sends frames over a WebSocket that is opened again when it breaks."""

    def __init__(
        self,
        address: StreamAddress,
        *,
        takeover: bool,
        token: Token,
        tell: Callable[[PublishedFrame], None],
    ) -> None:
        """Connects. Raises ProblemError and ServerUnreachableError."""
        self._address = address
        self._token = token
        self._tell = tell
        self._changed = threading.Condition()
        self._waiting: deque[Submission] = deque()
        self._link: Link | None = None
        self._next_seq = 0
        self._session: str | None = None
        self._failure: Exception | None = None
        self._frames_lost = False
        self._closing = threading.Event()
        self._adopt(self._open(takeover=takeover))
        self._threads = [
            threading.Thread(target=target, name=f"steadymesh-{address.name}", daemon=True)
            for target in (self._send_all, self._receive_all)
        ]
        for thread in self._threads:
            thread.start()

    def submit(
        self, payload: Payload, handle: PublishedFrame, timeout: float | None, wait: bool
    ) -> None:
        """Sends a frame once the server has room for it, and returns when it is on its way.

        ``wait`` is not looked at: the acknowledgements tell how it ends. Raises
        PublishTimeoutError, and what ended the connection for good.
        """
        with self._changed:
            self._raise_if_over()
            seq = self._next_seq if payload.seq is None else payload.seq
            self._next_seq = seq + 1
            handle.seq = seq
            submission = Submission(payload, seq, handle)
            self._waiting.append(submission)
            self._changed.notify_all()
            done = self._changed.wait_for(lambda: submission.sent or self._is_over(), timeout)
            if submission.sent or handle.acknowledged:
                return
            in_line = submission in self._waiting
            if in_line:
                self._waiting.remove(submission)
            submission.abandoned = True
            if done:
                self._raise_if_over()
            reason = "the server grants no credit" if self._link else "there is no connection"
            if not in_line and self._link is not None:
                # In the middle of sending: what has come through is no whole message.
                reason = "the server does not read"
                self._link.websocket.abort()
        raise PublishTimeoutError(f"frame {seq} was not sent within {timeout} seconds: {reason}")

    def flush(self, timeout: float | None) -> None:
        """Waits until every frame is acknowledged.

        Raises PublishTimeoutError, and what ended the connection for good.
        """
        with self._changed:
            done = self._changed.wait_for(
                lambda: not self._open_count() or self._is_over(), timeout
            )
            if self._frames_lost:
                self._raise_if_over()
            if not done:
                raise PublishTimeoutError(f"{self._open_count()} frames are not acknowledged yet")

    def close(self) -> None:
        """Takes leave of the server. What is not acknowledged fails."""
        with self._changed:
            self._closing.set()
            link = self._link
            self._changed.notify_all()
        if link is not None:
            # Before the farewell, which waits for a message that is being sent.
            self._threads[0].join(CLOSE_TIMEOUT)
            if self._threads[0].is_alive():
                link.websocket.abort()
            link.websocket.close()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(CLOSE_TIMEOUT)

    def _is_over(self) -> bool:
        return self._failure is not None or self._closing.is_set()

    def _raise_if_over(self) -> None:
        if self._failure is not None:
            raise self._failure
        if self._closing.is_set():
            raise PublisherClosedError("the publisher is closed")

    def _open_count(self) -> int:
        on_the_way = len(self._link.unacknowledged()) if self._link else 0
        return len(self._waiting) + on_the_way

    # The sending thread.

    def _send_all(self) -> None:
        while True:
            with self._changed:
                while not self._may_send():
                    if self._is_over():
                        return
                    self._changed.wait(self._link.pause_left() if self._link else None)
                if self._link is None:
                    continue
                link, submission = self._link, self._waiting.popleft()
                link.add(submission)
            try:
                for message in submission.messages():
                    link.websocket.send(message)
            except (ConnectionClosed, OSError):
                # The receiving thread learns it too, and sees to it that the frame is sent again.
                continue
            with self._changed:
                submission.sent = True
                self._changed.notify_all()

    def _may_send(self) -> bool:
        if self._is_over() or not self._waiting or self._link is None:
            return False
        return self._link.may_send()

    # The receiving thread.

    def _receive_all(self) -> None:
        try:
            self._receive_and_reconnect()
        except Exception as error:  # Whoever publishes has to learn it, whatever it is.
            _log.exception("publishing to %s failed", self._address.name)
            self._end(error)

    def _receive_and_reconnect(self) -> None:
        link = self._link
        while link is not None:
            code, reason = self._receive_until_closed(link)
            link.websocket.close()
            self._put_back(link, code)
            if self._closing.is_set():
                self._end(PublisherClosedError("the publisher is closed"))
                return
            fatal = code in (_ENDED, _TAKEN_OVER)
            if fatal or (code == _TOKEN_EXPIRED and not callable(self._token)):
                self._end(ConnectionEndedError(code, reason))
                return
            _log.info("connection to %s ended (%s): coming back", self._address.name, code)
            link = self._reconnect()

    def _receive_until_closed(self, link: Link) -> tuple[int, str]:
        while True:
            try:
                message = link.websocket.receive()
                if not isinstance(message, bytes):
                    self._on_message(link, message)
            except ConnectionClosed as error:
                return close_code(error)
            except InvalidMessageError as error:
                _log.warning("%s: %s", self._address.name, error)
                return NO_STATUS, str(error)

    def _on_message(self, link: Link, message: dict[str, Any]) -> None:
        submission = None
        with self._changed:
            if message.get("type") == "credit" and isinstance(message.get("credit"), int):
                link.grant(message["credit"])
            elif message.get("type") == "ack":
                submission, again = link.acknowledge(message)
                if submission is not None and again and not submission.abandoned:
                    self._line_up(submission)
                    submission = None
            self._changed.notify_all()
        if submission is not None:
            self._tell(submission.handle)

    def _put_back(self, link: Link, code: int) -> None:
        """What a connection leaves behind is sent again by the next one."""
        too_large = None
        with self._changed:
            self._link = None
            left = [one for one in link.leave_all() if not one.abandoned]
            if code == _TOO_LARGE and left:
                # The server does not say which one it was. To send it again would end in the
                # same way for ever.
                too_large = max(left, key=lambda one: len(one.payload.body))
                left.remove(too_large)
                too_large.handle.settle("rejected", problem=_too_large(too_large))
                too_large.sent = True
            for submission in left:
                self._line_up(submission)
            self._changed.notify_all()
        if too_large is not None:
            self._tell(too_large.handle)

    def _line_up(self, submission: Submission) -> None:
        """Puts a frame that has to be sent again where its number belongs."""
        before = sum(one.seq < submission.seq for one in self._waiting)
        self._waiting.insert(before, submission)

    def _reconnect(self) -> Link | None:
        backoff = Backoff()
        asked: float | None = None
        while not self._closing.wait(backoff.next(asked)):
            asked = None
            try:
                link = self._open(takeover=False)
            except ProblemError as problem:
                if problem.status not in _PASSING_STATUSES:
                    self._end(problem)
                    return None
                asked = problem.retry_after
            except ServerUnreachableError as error:
                _log.info("%s", error)
            else:
                self._adopt(link)
                return link
        self._end(PublisherClosedError("the publisher is closed"))
        return None

    def _open(self, *, takeover: bool) -> Link:
        try:
            return Link.open(self._address, self._token, takeover=takeover, session=self._session)
        except (ConnectionClosed, TimeoutError, InvalidMessageError) as error:
            reason = str(error) or "no welcome"
            raise ServerUnreachableError(f"the server does not let us publish: {reason}") from error

    def _adopt(self, link: Link) -> None:
        told = []
        with self._changed:
            resumed = self._session is not None and link.session == self._session
            self._session = link.session
            if link.latest_seq is not None:
                self._next_seq = max(self._next_seq, link.latest_seq + 1)
                if resumed:
                    told = self._settle_arrived(link.latest_seq)
            self._link = link
            self._changed.notify_all()
        if self._closing.is_set():
            link.websocket.close()
        for submission in told:
            self._tell(submission.handle)

    def _settle_arrived(self, latest_seq: int) -> list[Submission]:
        """Numbers ascend and nobody else publishes: frames up to the newest number have arrived.

        One that was rejected just before the break is taken for accepted here; waiting for it to
        be published tells.
        """
        arrived = [one for one in self._waiting if one.attempted and one.seq <= latest_seq]
        for submission in arrived:
            self._waiting.remove(submission)
            submission.sent = True
            submission.handle.settle("accepted")
            submission.handle.lose_touch()
        return arrived

    def _end(self, failure: Exception) -> None:
        with self._changed:
            if not isinstance(failure, PublisherClosedError):
                self._failure = failure
            left = list(self._waiting)
            self._frames_lost = self._frames_lost or bool(left)
            self._waiting.clear()
            self._changed.notify_all()
        for submission in left:
            submission.handle.fail(failure)


def _too_large(submission: Submission) -> ProblemError:
    length = len(submission.payload.body)
    return ProblemError(
        413,
        "too-large",
        "Over a limit",
        f"a message of {length} bytes is over the server's limit: send a smaller mesh, or raise "
        "limits.body_bytes in its configuration",
    )
