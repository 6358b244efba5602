"""Servers that follow the contract as far as a test needs it."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Callable, Optional
from urllib.parse import parse_qs, urlsplit

from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve
from websockets.typing import Subprotocol

from steadymesh import native


class Peer:
    """The server's side of one WebSocket."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection
        self._announced: dict[str, Any] = {}

    @property
    def query(self) -> dict[str, str]:
        request = self.connection.request
        assert request is not None
        return {name: one[0] for name, one in parse_qs(urlsplit(request.path).query).items()}

    @property
    def headers(self) -> Any:
        request = self.connection.request
        assert request is not None
        return request.headers

    def say(self, kind: str, **fields: Any) -> None:
        self.connection.send(json.dumps({"type": kind, **fields}))

    def welcome(
        self, credit: int = 100, session: str = "s1", latest_seq: int | None = None
    ) -> None:
        self.say(
            "welcome",
            protocol="steadymesh.v1",
            stream="demo",
            session=session,
            latest_seq=latest_seq,
            credit=credit,
            config={},
        )

    def ack(self, message: int, state: str, **fields: Any) -> None:
        self.say("ack", message=message, state=state, **fields)

    def frame(self) -> tuple[int | None, bytes]:
        """The next frame's number, as it or the message before it says, and its bytes."""
        while True:
            message = self.connection.recv()
            if isinstance(message, bytes):
                announced, self._announced = self._announced, {}
                if message.startswith(b"SMF1"):
                    return native.stamps(message)[0], message
                return announced.get("seq"), message
            self._announced = json.loads(message)
            assert self._announced["type"] == "frame"

    def accept_all(self) -> None:
        """Takes every frame until the client leaves."""
        message = 0
        while True:
            seq, _ = self.frame()
            self.ack(message, "accepted", seq=seq)
            self.ack(message, "published", seq=seq)
            message += 1

    def break_off(self) -> None:
        """Ends the connection without a farewell."""
        self.connection.socket.shutdown(2)

    def wait_for_farewell(self) -> int:
        """The close code of the client."""
        try:
            while True:
                self.connection.recv()
        except ConnectionClosed as error:
            return 1006 if error.rcvd is None else error.rcvd.code


Handler = Callable[[Peer], None]
Refusal = tuple[int, dict[str, Any]]


@dataclass
class FakeServer:
    """What a test says about a server, and what it asks it afterwards."""

    url: str = ""
    # What a plain GET of a path answers.
    pages: dict[str, Any] = field(default_factory=dict)
    # What handshakes are answered with, one each, before connections are made.
    refusals: list[Refusal] = field(default_factory=list)
    # Failed assertions of the handlers, which run in other threads.
    failures: list[BaseException] = field(default_factory=list)

    def process(self, connection: ServerConnection, request: Request) -> Response | None:
        path = urlsplit(request.path).path
        if "Upgrade" not in request.headers:
            known = path in self.pages
            document = self.pages[path] if known else problem(404, "not-found")
            return connection.respond(200 if known else 404, json.dumps(document))
        if self.refusals:
            status, document = self.refusals.pop(0)
            return connection.respond(status, json.dumps(document))
        return None


@contextmanager
def websocket_server(*handlers: Handler) -> Iterator[FakeServer]:
    """A server that gives each new connection to the next handler, the last ones to the last."""
    fake = FakeServer()
    remaining = list(handlers)
    threads: list[threading.Thread] = []

    def handle(connection: ServerConnection) -> None:
        threads.append(threading.current_thread())
        handler = remaining.pop(0) if len(remaining) > 1 else remaining[0]
        try:
            handler(Peer(connection))
        except ConnectionClosed:
            pass
        except BaseException as error:
            fake.failures.append(error)
            raise

    with serve(
        handle,
        "127.0.0.1",
        0,
        process_request=fake.process,
        subprotocols=[Subprotocol("steadymesh.v1")],
        compression=None,
        max_size=None,
        close_timeout=1,
    ) as server:
        host, port = server.socket.getsockname()[:2]
        fake.url = f"http://{host}:{port}/v1/streams/demo"
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield fake
        finally:
            server.shutdown()
            for one in [thread, *threads]:
                one.join(10.0)
    assert not fake.failures


@dataclass
class Posted:
    """A request that the fake HTTP server has had."""

    path: str
    query: dict[str, str]
    headers: dict[str, str]
    body: bytes


# A status and a document, or None to break the connection without an answer.
Reply = Optional[tuple[int, dict[str, Any]]]


@dataclass
class FakeHttpServer:
    """Answers POSTs with ``replies``, one each, and remembers what it was asked."""

    url: str
    replies: list[Reply]
    posted: list[Posted] = field(default_factory=list)


@contextmanager
def http_server(*replies: Reply) -> Iterator[FakeHttpServer]:
    fake = FakeHttpServer("", list(replies))

    class RequestHandler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_POST(self) -> None:
            parts = urlsplit(self.path)
            query = {name: one[0] for name, one in parse_qs(parts.query).items()}
            body = self.rfile.read(int(self.headers["Content-Length"]))
            headers = {name.lower(): one for name, one in self.headers.items()}
            fake.posted.append(Posted(parts.path, query, headers, body))
            reply = fake.replies.pop(0)
            if reply is None:
                self.close_connection = True
                return
            text = json.dumps(reply[1]).encode()
            self.send_response(reply[0])
            self.send_header("Content-Length", str(len(text)))
            self.end_headers()
            self.wfile.write(text)

        def log_message(self, format: str, *args: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), RequestHandler)
    server.daemon_threads = True
    fake.url = f"http://127.0.0.1:{server.server_address[1]}/v1/streams/demo"
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield fake
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def problem(status: int, kind: str, **more: Any) -> dict[str, Any]:
    document = {"type": f"urn:steadymesh:problem:{kind}", "title": "No", "status": status}
    return {**document, "detail": "because", **more}
