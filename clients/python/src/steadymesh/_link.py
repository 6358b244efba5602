"""One connection to the ``publish`` WebSocket: credit, and which message is which frame."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from ._address import StreamAddress
from ._http import Token
from ._submission import Submission
from ._websocket import OPEN_TIMEOUT, WebSocket
from .errors import InvalidMessageError, ProblemError


class Link:
    """A connection that has been welcomed. The caller locks."""

    def __init__(self, websocket: WebSocket, welcome: Mapping[str, Any]) -> None:
        self.websocket = websocket
        self.session: str | None = welcome.get("session")
        self.latest_seq: int | None = welcome.get("latest_seq")
        self._credit = int(welcome.get("credit", 0))
        self._next_message = 0
        self._on_the_way: dict[int, Submission] = {}
        self._paused_until = 0.0

    @classmethod
    def open(
        cls, address: StreamAddress, token: Token, *, takeover: bool, session: str | None
    ) -> Link:
        """Connects and waits for the welcome.

        Raises ProblemError, ServerUnreachableError, TimeoutError, InvalidMessageError, and
        websockets' ConnectionClosed.
        """
        query = {}
        if takeover:
            query["takeover"] = "true"
        if session is not None:
            query["session"] = session
        websocket = WebSocket(address.websocket("publish", **query), token)
        try:
            welcome = websocket.receive(OPEN_TIMEOUT)
            if isinstance(welcome, bytes) or welcome.get("type") != "welcome":
                raise InvalidMessageError("the server's first message is not its welcome")
            try:
                return cls(websocket, welcome)
            except (TypeError, ValueError) as error:
                raise InvalidMessageError(f"the welcome {welcome} cannot be read") from error
        except BaseException:
            websocket.close()
            raise

    def may_send(self) -> bool:
        """Whether the server has room for a frame now."""
        return self._next_message < self._credit and self._paused_until <= time.monotonic()

    def pause_left(self) -> float | None:
        """The seconds until frames may be sent, where only time is missing."""
        left = self._paused_until - time.monotonic()
        return left if left > 0.0 else None

    def grant(self, credit: int) -> None:
        """Takes a ``credit`` message, which never lowers it."""
        self._credit = max(self._credit, credit)

    def add(self, submission: Submission) -> None:
        """Counts a frame that is about to be sent."""
        submission.attempted = True
        self._on_the_way[self._next_message] = submission
        self._next_message += 1

    def unacknowledged(self) -> list[Submission]:
        """The frames sent that the server has said nothing about, in order."""
        return [one for one in self._on_the_way.values() if not one.handle.acknowledged]

    def leave_all(self) -> list[Submission]:
        """Forgets everything, and gives what was not acknowledged.

        Frames that are accepted and not out will not be heard of again.
        """
        left = self.unacknowledged()
        for submission in self._on_the_way.values():
            if submission.handle.acknowledged:
                submission.handle.lose_touch()
        self._on_the_way.clear()
        return left

    def acknowledge(self, ack: Mapping[str, Any]) -> tuple[Submission | None, bool]:
        """Takes an ``ack`` message.

        Gives the frame that it is about, and whether that is to be sent again; no frame if the
        message is about none that is known.
        """
        number, state = ack.get("message"), ack.get("state")
        submission = self._on_the_way.get(number) if isinstance(number, int) else None
        if submission is None:
            return None, False
        handle, seq = submission.handle, ack.get("seq")
        if state == "accepted":
            handle.settle(state, seq=seq)
            return submission, False
        if state not in ("duplicate", "rejected", "published", "dropped"):
            return None, False
        del self._on_the_way[int(ack["message"])]
        if state == "rejected":
            problem = ProblemError.from_document(ack.get("problem") or {})
            if problem.retry_after is not None:
                self._paused_until = time.monotonic() + problem.retry_after
                return submission, True
            handle.settle(state, problem=problem)
        else:
            handle.settle(state, seq=seq, reason=ack.get("reason"))
        if state == "duplicate":
            # How it ended, or will, was said to the connection that it first came by.
            handle.lose_touch()
        return submission, False
