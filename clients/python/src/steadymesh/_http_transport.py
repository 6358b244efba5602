"""Publishing by POST, one frame after the other."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import Callable

from ._address import StreamAddress
from ._backoff import Backoff
from ._handle import PublishedFrame
from ._http import DEFAULT_TIMEOUT, HttpClient, Response, Token
from ._metrics import FrameMetrics
from ._submission import Payload
from .errors import ProblemError, PublisherClosedError, PublishTimeoutError, ServerUnreachableError

_TAKEN = "seq-goes-back"
_LOST = "frame-lost"
# These are about one frame; the next one may do better.
_FRAME_STATUSES = (413, 415, 422)
_PASSING_STATUSES = (408, 429, 502, 503, 504)
# A server that answers with these has not looked at the frame.
_NOT_LOOKED_AT = (408, 429, 503)
# What the server is asked to wait at a time, in seconds; the answer has to come in time.
_MAX_WAIT = DEFAULT_TIMEOUT * 2 / 3


@dataclass(frozen=True)
class _Answer:
    """What the server says in the end."""

    response: Response | None
    problem: ProblemError | None
    # Whether an earlier attempt may have come through although its answer did not.
    may_be_second: bool

    def number_is_taken(self) -> bool:
        """Whether another frame has the number."""
        if self.may_be_second:
            return False
        if self.problem is not None:
            return self.problem.kind == _TAKEN
        return self.response is not None and bool(self.response.json().get("duplicate"))


class HttpTransport:
    """Sends each frame with a request of its own, and again where the server asks for it."""

    def __init__(
        self,
        address: StreamAddress,
        *,
        takeover: bool,
        token: Token,
        tell: Callable[[PublishedFrame], None],
    ) -> None:
        self._path = address.path("frames")
        self._client = HttpClient(address.server, token)
        self._takeover = takeover
        self._tell = tell
        self._closed = threading.Event()
        self._lock = threading.Lock()
        # The next frame's number, once the server has given one. With it a frame whose answer
        # was lost can be sent again without coming twice.
        self._next_seq: int | None = None

    def submit(
        self, payload: Payload, handle: PublishedFrame, timeout: float | None, wait: bool
    ) -> None:
        """Posts a frame and waits for the answer; with ``wait``, until the frame is out.

        Raises PublishTimeoutError, ServerUnreachableError if not even the first frame gets
        through, and ProblemError for what the next frame would meet too.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        with self._lock:
            seq = self._next_seq if payload.seq is None else payload.seq
            answer = self._post(payload, seq, deadline, wait)
            if payload.seq is None and seq is not None and answer.number_is_taken():
                # Somebody else publishes too, so the server has to count. On a new connection,
                # since this request must not be repeated if a kept one turns out to be closed.
                self._client.close()
                seq = None
                answer = self._post(payload, seq, deadline, wait)
            handle.seq = seq
            self._settle(handle, answer)
            if handle.seq is not None and handle.state != "rejected":
                self._next_seq = handle.seq + 1
        self._tell(handle)

    def flush(self, timeout: float | None) -> None:
        """Does nothing: every frame has had its answer."""

    def close(self) -> None:
        """Closes the connection."""
        self._closed.set()
        self._client.close()

    def _post(
        self, payload: Payload, seq: int | None, deadline: float | None, wait: bool
    ) -> _Answer:
        """Sends a frame until there is an answer that is not "later"."""
        backoff = Backoff()
        may_be_second = False
        while True:
            if self._closed.is_set():
                raise PublisherClosedError("the publisher is closed")
            try:
                response = self._post_once(payload, seq, deadline, wait)
                return _Answer(response, None, may_be_second)
            except ProblemError as problem:
                if problem.kind == _LOST or problem.status not in _PASSING_STATUSES:
                    return _Answer(None, problem, may_be_second)
                reason, pause = str(problem), backoff.next(problem.retry_after)
                may_be_second = may_be_second or problem.status not in _NOT_LOOKED_AT
            except ServerUnreachableError as error:
                if seq is None:
                    raise
                # At first it is but the kept connection, which the server may close at any time.
                reason, pause = str(error), backoff.next() if may_be_second else 0.0
                may_be_second = True
            left = _left(deadline)
            if left is not None and left <= pause:
                raise PublishTimeoutError(f"the frame was not taken in time: {reason}")
            self._closed.wait(pause)

    def _post_once(
        self, payload: Payload, seq: int | None, deadline: float | None, wait: bool
    ) -> Response:
        query = {
            "seq": seq,
            "capture_time_us": payload.capture_time_us,
            "takeover": "true" if self._takeover else None,
        }
        headers = {"Content-Type": payload.content_type}
        left = _left(deadline)
        if wait:
            patience = _MAX_WAIT if left is None else min(left, _MAX_WAIT)
            headers["Prefer"] = f"wait={max(1, math.ceil(patience))}"
        return self._client.request(
            "POST",
            self._path,
            query={name: str(value) for name, value in query.items() if value is not None},
            headers=headers,
            body=payload.body,
            repeatable=False,
        )

    def _settle(self, handle: PublishedFrame, answer: _Answer) -> None:
        """Writes the answer into the handle. Raises what is not about this frame alone."""
        # How it ends is said to no connection, so that the server has to be asked.
        handle.lose_touch()
        problem, response = answer.problem, answer.response
        if problem is not None:
            if problem.kind == _LOST:
                handle.settle("dropped", reason=problem.detail)
            elif problem.status in _FRAME_STATUSES or problem.kind == _TAKEN:
                handle.settle("rejected", problem=problem)
            else:
                raise problem
        elif response is not None and response.status == 202:
            accepted = response.json()
            state = "duplicate" if accepted.get("duplicate") else "accepted"
            handle.settle(state, seq=accepted["seq"])
        elif response is not None:
            metrics = FrameMetrics.from_json(response.json())
            handle.settle("published", seq=metrics.seq, metrics=metrics)


def _left(deadline: float | None) -> float | None:
    return None if deadline is None else max(0.0, deadline - time.monotonic())
