"""Opening a WebSocket, and what its end means."""

from __future__ import annotations

import json
import socket
from contextlib import ExitStack, suppress
from typing import Any

from websockets.exceptions import (
    ConnectionClosed,
    InvalidHandshake,
    InvalidStatus,
    WebSocketException,
)
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from ._http import Token, authorization
from .errors import InvalidMessageError, ProblemError, ServerUnreachableError
from .native import SUBPROTOCOL

OPEN_TIMEOUT = 10.0
CLOSE_TIMEOUT = 5.0
# Simplified frames are some 10 KB; a server that sends more than this is none.
MAX_MESSAGE_BYTES = 256 << 20

NO_STATUS = 1006
"""The close code of a connection that broke without one (RFC 6455)."""


class WebSocket:
    """A connection to a stream's WebSocket."""

    def __init__(self, url: str, token: Token) -> None:
        """Connects. Raises ProblemError if the server refuses, and ServerUnreachableError."""
        self._stack = ExitStack()
        try:
            self._connection: Connection = self._stack.enter_context(
                connect(
                    url,
                    subprotocols=[Subprotocol(SUBPROTOCOL)],
                    # Draco and float arrays do not become smaller by it.
                    compression=None,
                    additional_headers=authorization(token),
                    open_timeout=OPEN_TIMEOUT,
                    close_timeout=CLOSE_TIMEOUT,
                    max_size=MAX_MESSAGE_BYTES,
                    # As the HTTP side: a rig and its server are in one network.
                    proxy=None,
                )
            )
        except InvalidStatus as error:
            response = error.response
            raise ProblemError.from_response(
                response.status_code,
                response.headers.get("Retry-After"),
                bytes(response.body or b""),
            ) from error
        except (OSError, InvalidHandshake, WebSocketException) as error:
            reason = str(error) or type(error).__name__
            raise ServerUnreachableError(f"{url} cannot be reached: {reason}") from error

    def receive(self, timeout: float | None = None) -> bytes | dict[str, Any]:
        """The next message: bytes, or a JSON object.

        Raises TimeoutError, websockets' ConnectionClosed, and InvalidMessageError for text that
        is no object.
        """
        message = self._connection.recv(timeout)
        if isinstance(message, bytes):
            return message
        try:
            document = json.loads(message)
        except ValueError as error:
            raise InvalidMessageError(f"a text message is not JSON: {error}") from error
        if not isinstance(document, dict):
            raise InvalidMessageError("a text message is not a JSON object")
        return document

    def send(self, message: bytes | str) -> None:
        """Sends a message. Raises ConnectionClosed."""
        self._connection.send(message)

    def close(self) -> None:
        """Takes leave with code 1000; does nothing if that has happened."""
        # What the other side makes of the farewell is of no interest.
        with suppress(WebSocketException, OSError):
            self._stack.close()

    def abort(self) -> None:
        """Breaks the connection, also if somebody is in the middle of sending."""
        with suppress(OSError):
            self._connection.socket.shutdown(socket.SHUT_RDWR)


def close_code(error: ConnectionClosed) -> tuple[int, str]:
    """The code and the reason that the other side has given; NO_STATUS if it gave none."""
    received = error.rcvd
    return (NO_STATUS, "") if received is None else (received.code, received.reason)
