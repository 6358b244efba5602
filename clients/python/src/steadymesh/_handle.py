"""What becomes of a published frame."""

from __future__ import annotations

import threading
import time
from typing import Callable

from ._metrics import FrameMetrics
from .errors import FrameDroppedError, ProblemError, PublishTimeoutError

__all__ = ["PublishedFrame"]

_FIRST_POLL = 0.1
_MAX_POLL = 1.0

AskServer = Callable[[int], "tuple[str, FrameMetrics | None]"]
"""Asks by HTTP what has become of a frame: ``published`` and its metrics, ``waiting``, or the
reason for which it was dropped."""


class PublishedFrame:
    """A frame on its way, as :meth:`Publisher.publish` returns it.

    ``state`` is one of

    - ``sent``: the server has not said anything yet;
    - ``accepted``: it is a good one and has its place; ``duplicate``: it had it before;
    - ``rejected``: it is not taken; ``problem`` says why;
    - ``published``: it is out;
    - ``dropped``: it was accepted and is not coming; ``reason`` says why (a word, as
      FrameDroppedError explains, or by HTTP a sentence of the server).

    ``seq`` is its number, None until it is known. Any thread may ask.
    """

    def __init__(self, seq: int | None, ask_server: AskServer) -> None:
        self.seq = seq
        self.state = "sent"
        self.problem: ProblemError | None = None
        self.reason: str | None = None
        self._failure: Exception | None = None
        self._metrics: FrameMetrics | None = None
        self._ask_server = ask_server
        # Set while nobody will tell how it ends: the connection that it came by is no more.
        self._unheard_of = False
        self._changed = threading.Condition()

    def __repr__(self) -> str:
        return f"PublishedFrame(seq={self.seq}, state={self.state!r})"

    @property
    def acknowledged(self) -> bool:
        """Whether the server has said what it makes of the frame."""
        return self.state != "sent"

    def wait(self, timeout: float | None = None) -> PublishedFrame:
        """Waits until the frame is acknowledged, at most ``timeout`` seconds.

        Raises ProblemError if it is rejected, PublishTimeoutError, and what ended the publisher.
        """
        with self._changed:
            done = self._changed.wait_for(lambda: self.acknowledged or self._failure, timeout)
            self._raise_failure()
            if not done:
                raise PublishTimeoutError(f"frame {self.seq} is not acknowledged yet")
        return self

    def wait_published(self, timeout: float | None = None) -> PublishedFrame:
        """Waits until the frame is out, at most ``timeout`` seconds.

        Raises ProblemError if it is rejected, FrameDroppedError, PublishTimeoutError, what ended
        the publisher, and ServerUnreachableError where the server has to be asked.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        pause = _FIRST_POLL
        while True:
            with self._changed:
                told = self._changed.wait_for(self._no_news_to_come, _left(deadline))
                self._raise_failure()
                if self.state == "dropped":
                    raise FrameDroppedError(self.seq, self.reason or "unknown")
                if self.state == "published":
                    return self
                seq = self.seq
            # Nobody tells, so the server has to be asked.
            if told and seq is not None and self._ask(seq):
                continue
            left = _left(deadline)
            if not told or seq is None or left == 0.0:
                raise PublishTimeoutError(f"frame {seq} is not out yet")
            time.sleep(pause if left is None else min(pause, left))
            pause = min(2.0 * pause, _MAX_POLL)

    def metrics(self, timeout: float | None = None) -> FrameMetrics:
        """Waits until the frame is out and gives its metrics.

        Raises what :meth:`wait_published` does, ServerUnreachableError, and ProblemError (404)
        if the server does not remember the frame any more.
        """
        self.wait_published(timeout)
        if self._metrics is None and self.seq is not None:
            self._ask(self.seq)
        if self._metrics is None:
            raise ProblemError(
                404, "not-found", "Not found", f"the server does not remember frame {self.seq}"
            )
        return self._metrics

    # What follows is for the transports.

    def settle(
        self,
        state: str,
        *,
        seq: int | None = None,
        problem: ProblemError | None = None,
        reason: str | None = None,
        metrics: FrameMetrics | None = None,
    ) -> None:
        """The server has said something."""
        with self._changed:
            self.state = state
            self.seq = self.seq if seq is None else seq
            self.problem, self.reason = problem, reason
            self._metrics = metrics or self._metrics
            self._changed.notify_all()

    def lose_touch(self) -> None:
        """Nothing more will be heard of the frame unless the server is asked."""
        with self._changed:
            self._unheard_of = True
            self._changed.notify_all()

    def fail(self, failure: Exception) -> None:
        """The publisher is at its end, and the frame is not acknowledged."""
        with self._changed:
            self._failure = failure
            self._changed.notify_all()

    def _no_news_to_come(self) -> bool:
        settled = self.state in ("rejected", "published", "dropped")
        return settled or self._unheard_of or self._failure is not None

    def _raise_failure(self) -> None:
        if self.problem is not None:
            raise self.problem
        if self._failure is not None:
            raise self._failure

    def _ask(self, seq: int) -> bool:
        """Asks the server what has become of the frame; whether that is certain now."""
        state, metrics = self._ask_server(seq)
        if state == "waiting":
            return False
        if state == "published":
            self.settle("published", metrics=metrics)
        elif self.state != "published":
            self.settle("dropped", reason=state)
        return True


def _left(deadline: float | None) -> float | None:
    return None if deadline is None else max(0.0, deadline - time.monotonic())
