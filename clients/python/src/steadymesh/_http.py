"""HTTP over one connection that is kept open."""

from __future__ import annotations

import http.client
import json
import socket
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Callable, Union
from urllib.parse import urlencode

from ._address import ServerAddress
from .errors import InvalidMessageError, ProblemError, ServerUnreachableError

Token = Union[str, Callable[[], str], None]
"""A bearer token, or a function that gives a fresh one for every connection and request."""

DEFAULT_TIMEOUT = 30.0
"""Seconds to wait for an answer."""


def authorization(token: Token) -> dict[str, str]:
    """The header that carries ``token``; none without one."""
    text = token() if callable(token) else token
    return {} if text is None else {"Authorization": f"Bearer {text}"}


@dataclass(frozen=True)
class Response:
    """An answer, whatever its status; ``retry_after`` is its header of that name."""

    status: int
    retry_after: str | None
    body: bytes

    def json(self) -> Any:
        """The body as JSON."""
        try:
            return json.loads(self.body)
        except ValueError as error:
            raise InvalidMessageError(f"the server's answer is not JSON: {error}") from error


class HttpClient:
    """Requests to one server, one at a time; any thread may ask."""

    def __init__(
        self, server: ServerAddress, token: Token = None, timeout: float = DEFAULT_TIMEOUT
    ) -> None:
        self._server = server
        self._token = token
        self._timeout = timeout
        self._lock = threading.Lock()
        self._connection: http.client.HTTPConnection | None = None

    def request(
        self,
        method: str,
        path: str,
        *,
        query: Mapping[str, str] | None = None,
        headers: Mapping[str, str] | None = None,
        body: bytes | None = None,
        timeout: float | None = None,
        repeatable: bool = True,
    ) -> Response:
        """Asks and waits for the answer.

        A ``repeatable`` request is sent a second time if the server had closed the connection
        that was kept, which it may do at any time.

        Raises ProblemError for an answer from 400 on, and ServerUnreachableError.
        """
        target = f"{path}?{urlencode(query)}" if query else path
        with self._lock:
            kept = self._connection is not None
            try:
                response = self._ask(method, target, headers or {}, body, timeout)
            except ServerUnreachableError as error:
                timed_out = isinstance(error.__cause__, socket.timeout)
                if not (kept and repeatable) or timed_out:
                    raise
                response = self._ask(method, target, headers or {}, body, timeout)
        if response.status >= 400:
            raise ProblemError.from_response(response.status, response.retry_after, response.body)
        return response

    def close(self) -> None:
        """Closes the connection; a later request opens another one."""
        with self._lock:
            self._drop()

    def _ask(
        self,
        method: str,
        target: str,
        headers: Mapping[str, str],
        body: bytes | None,
        timeout: float | None,
    ) -> Response:
        connection = self._open(self._timeout if timeout is None else timeout)
        try:
            try:
                connection.request(method, target, body, {**headers, **authorization(self._token)})
            except (BrokenPipeError, ConnectionResetError):
                # A server that refuses a body may answer before it has all of it.
                if body is None:
                    raise
            answer = connection.getresponse()
            content = answer.read()
        except (OSError, http.client.HTTPException) as error:
            self._drop()
            reason = str(error) or type(error).__name__
            raise ServerUnreachableError(
                f"{self._server.scheme}://{self._server.authority} does not answer: {reason}"
            ) from error
        except BaseException:
            # Interrupted between a request and its answer: the connection is of no more use.
            self._drop()
            raise
        if answer.will_close:
            self._drop()
        return Response(answer.status, answer.getheader("Retry-After"), content)

    def _open(self, timeout: float) -> http.client.HTTPConnection:
        if self._connection is None:
            kind = (
                http.client.HTTPSConnection
                if self._server.scheme == "https"
                else http.client.HTTPConnection
            )
            self._connection = kind(self._server.authority, timeout=timeout)
        self._connection.timeout = timeout
        # Typed as always there, but None until the first request connects.
        sock: Any = self._connection.sock
        if sock is not None:
            sock.settimeout(timeout)
        return self._connection

    def _drop(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None
