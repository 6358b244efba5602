"""Publishing frames, as a capture rig does."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections import Counter
from types import TracebackType
from typing import Callable

import numpy.typing as npt

from . import native
from ._address import StreamAddress
from ._handle import PublishedFrame
from ._http import HttpClient, Token
from ._http_transport import HttpTransport
from ._metrics import FrameMetrics
from ._submission import Payload
from ._ws_transport import WebSocketTransport
from .errors import ProblemError, PublisherClosedError

__all__ = ["Publisher"]

_log = logging.getLogger("steadymesh")

_TRANSPORTS: dict[str, type[HttpTransport] | type[WebSocketTransport]] = {
    "ws": WebSocketTransport,
    "http": HttpTransport,
}


class Publisher:
    """Publishes frames to one stream; any thread may.

    - ``url``: the stream, as ``http://127.0.0.1:8080/v1/streams/demo``, ``…/watch/demo`` or
      ``…/demo``. It is made with the server's defaults if it is not there.
    - ``transport``: ``ws``, one WebSocket with acknowledgements, on which many frames may be on
      their way; or ``http``, one request and its answer after the other.
    - ``takeover``: whether to end the connection of another publisher, if there is one.
    - ``token``: a bearer token, or a function that gives a fresh one.
    - ``timeout``: seconds that publishing, flushing and closing may take; None for no limit.
    - ``on_update``: called with a :class:`PublishedFrame` whenever its state changes, from a
      thread of the publisher (``ws``) or the one that publishes (``http``). It must not block.

    A connection that breaks is opened again, and what was not acknowledged is sent again under
    the same number. Numbers ascend; frames without one are counted on. A context manager, which
    waits at its end until every frame is acknowledged.

    The constructor raises InvalidAddressError and, with ``ws``, which connects at once,
    ProblemError (409 if there is another publisher) and ServerUnreachableError.
    """

    def __init__(
        self,
        url: str,
        transport: str = "ws",
        *,
        takeover: bool = False,
        token: Token = None,
        timeout: float | None = 30.0,
        on_update: Callable[[PublishedFrame], None] | None = None,
    ) -> None:
        kind = _TRANSPORTS.get(transport)
        if kind is None:
            raise ValueError(f"transport is {transport!r}, neither 'ws' nor 'http'")
        self._address = StreamAddress.parse(url)
        self._client = HttpClient(self._address.server, token)
        self._timeout = timeout
        self._on_update = on_update
        self._counts: Counter[str] = Counter()
        self._counts_lock = threading.Lock()
        self._closed = False
        self._transport = kind(self._address, takeover=takeover, token=token, tell=self._tell)

    @property
    def counts(self) -> dict[str, int]:
        """How many frames have come to each state so far, such as ``accepted``."""
        with self._counts_lock:
            return dict(self._counts)

    def publish(
        self,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
        *,
        normals: npt.ArrayLike | None = None,
        colors: npt.ArrayLike | None = None,
        texture_coordinates: npt.ArrayLike | None = None,
        seq: int | None = None,
        capture_time_us: int | None = None,
        wait: bool = False,
        timeout: float | None = None,
    ) -> PublishedFrame:
        """Publishes a mesh and returns once it is on its way.

        - ``vertices``: numbers of shape (n, 3) in any unit, sent as float32.
        - ``faces``: integers of shape (m, 3), from 0, counterclockwise seen from outside.
        - ``normals``: shape (n, 3). ``colors``: uint8, shape (n, 3) or (n, 4).
          ``texture_coordinates``: shape (n, 2).
        - ``seq``: the frame's number; counted on without one.
        - ``capture_time_us``: microseconds since 1970-01-01T00:00:00Z.
        - ``wait``: whether to wait until the frame is out; then its ``metrics()`` are there.
        - ``timeout``: seconds, in place of the publisher's.

        With ``ws`` it blocks while the server has no room. A frame that the server does not take
        is no error here, so that one bad frame does not end a recording: it is logged, and the
        result's ``state`` is ``rejected``. With ``wait`` it is.

        Raises InvalidMeshError for arrays that are no mesh; PublishTimeoutError;
        ConnectionEndedError if the stream was deleted or another publisher took over;
        ProblemError for what every frame would meet; ServerUnreachableError; with ``wait``
        ProblemError and FrameDroppedError for this frame.
        """
        body = native.encode(
            vertices,
            faces,
            normals=normals,
            colors=colors,
            texture_coordinates=texture_coordinates,
            seq=seq,
            capture_time_us=capture_time_us,
        )
        payload = Payload(body, native.CONTENT_TYPE, seq, capture_time_us)
        return self._publish(payload, wait, timeout)

    def publish_file(
        self,
        path: str | os.PathLike[str],
        *,
        seq: int | None = None,
        capture_time_us: int | None = None,
        wait: bool = False,
        timeout: float | None = None,
    ) -> PublishedFrame:
        """Publishes a ``.ply``, ``.obj``, ``.glb``, ``.drc`` or ``.smf`` (native) file as it is.

        The rest is as with :meth:`publish`; ``seq`` and ``capture_time_us`` overrule those of a
        native frame. Also raises OSError, and InvalidMessageError for a broken native frame.
        """
        return self._publish(Payload.from_file(path, seq, capture_time_us), wait, timeout)

    def flush(self, timeout: float | None = None) -> None:
        """Waits until every frame is acknowledged: accepted, duplicate or rejected.

        Raises PublishTimeoutError, and what ended the connection for good.
        """
        self._transport.flush(self._timeout if timeout is None else timeout)

    def close(self) -> None:
        """Flushes and takes leave of the server; a second time it does nothing.

        Frames that are accepted come out all the same. Raises what :meth:`flush` does.
        """
        if self._closed:
            return
        try:
            self.flush()
        finally:
            self._close_now()

    def __enter__(self) -> Publisher:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self.close()
        else:
            self._close_now()

    def _publish(self, payload: Payload, wait: bool, timeout: float | None) -> PublishedFrame:
        if self._closed:
            raise PublisherClosedError("the publisher is closed")
        timeout = self._timeout if timeout is None else timeout
        deadline = None if timeout is None else time.monotonic() + timeout
        handle = PublishedFrame(payload.seq, self._ask_server)
        self._transport.submit(payload, handle, timeout, wait)
        if wait:
            handle.metrics(None if deadline is None else max(0.0, deadline - time.monotonic()))
        return handle

    def _close_now(self) -> None:
        self._closed = True
        self._transport.close()
        self._client.close()

    def _ask_server(self, seq: int) -> tuple[str, FrameMetrics | None]:
        """What has become of an accepted frame: see ``AskServer``."""
        metrics = self._fetch_metrics(seq)
        if metrics is not None:
            return "published", metrics
        try:
            stream = self._client.request("GET", self._address.path()).json()
        except ProblemError as problem:
            if problem.status == 404:
                return "ended", None
            raise
        latest = stream.get("latest_seq")
        passed = latest is not None and seq <= latest
        if stream.get("queued") and not passed:
            return "waiting", None
        # Frames come out in order, so this one is out, since a moment ago, or not coming.
        metrics = self._fetch_metrics(seq)
        return ("unknown" if metrics is None else "published"), metrics

    def _fetch_metrics(self, seq: int) -> FrameMetrics | None:
        try:
            answer = self._client.request("GET", self._address.path(f"frames/{seq}/metrics"))
        except ProblemError as problem:
            if problem.status == 404:
                return None
            raise
        return FrameMetrics.from_json(answer.json())

    def _tell(self, handle: PublishedFrame) -> None:
        with self._counts_lock:
            self._counts[handle.state] += 1
        if handle.state == "rejected":
            _log.warning("frame %s is rejected: %s", handle.seq, handle.problem)
        if self._on_update is not None:
            try:
                self._on_update(handle)
            except Exception:
                _log.exception("on_update failed for frame %s", handle.seq)
