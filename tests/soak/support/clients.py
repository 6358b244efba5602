"""Clients that do what they are told, also what no honest client does."""

import base64
import json
import os
import resource
import select
import socket
import struct
import threading
import time
import urllib.error
import urllib.request

from .checks import Failed, wait_until

TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10


def raise_file_limit():
    """As many files at once as the system allows."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def request(url, method="GET", body=None, headers=None, seconds=30):
    """One request; gives the status and the body."""
    asked = urllib.request.Request(url, data=body, method=method, headers=headers or {})
    try:
        with urllib.request.urlopen(asked, timeout=seconds) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


class Refused(Exception):
    """A handshake was answered with another status."""

    def __init__(self, status, body):
        super().__init__(f"{status} {body[:300]}")
        self.status = status


class WebSocket:
    """A client of the kind that does everything by hand."""

    def __init__(self, server, path, token=None, receive_buffer=None):
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(30)
        self.socket.connect(("127.0.0.1", server.port))
        self.buffer = b""
        self.sending = threading.Lock()
        bearer = f"Authorization: Bearer {token}\r\n" if token else ""
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            f"GET {path} HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n{bearer}"
            f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n"
            "\r\n".encode()
        )
        while b"\r\n\r\n" not in self.buffer:
            self.buffer += self.receive_some()
        head, self.buffer = self.buffer.split(b"\r\n\r\n", 1)
        status = int(head.split(b" ")[1])
        if status != 101:
            body = self.buffer.decode(errors="replace")
            self.socket.close()
            raise Refused(status, body)

    def receive_some(self):
        received = self.socket.recv(1 << 18)
        if not received:
            raise ConnectionError("the server has closed the connection")
        return received

    def take(self, count):
        while len(self.buffer) < count:
            self.buffer += self.receive_some()
        taken, self.buffer = self.buffer[:count], self.buffer[count:]
        return taken

    @staticmethod
    def head(opcode, length):
        """A masked message's head; the mask is zero, which leaves the bytes as they are."""
        if length < 126:
            size = struct.pack(">B", 0x80 | length)
        elif length < 1 << 16:
            size = struct.pack(">BH", 0x80 | 126, length)
        else:
            size = struct.pack(">BQ", 0x80 | 127, length)
        return bytes([0x80 | opcode]) + size + bytes(4)

    def send(self, opcode, payload, share=1.0):
        message = self.head(opcode, len(payload)) + payload
        with self.sending:
            self.socket.sendall(message[: int(len(message) * share)])

    def message(self, answers_pings=True):
        """The next message but pings: its kind and its bytes."""
        while True:
            first, length = self.take(2)
            if length == 126:
                (length,) = struct.unpack(">H", self.take(2))
            elif length == 127:
                (length,) = struct.unpack(">Q", self.take(8))
            opcode, payload = first & 15, self.take(length)
            if opcode == PING and answers_pings:
                self.send(PONG, payload)
            elif opcode not in (PING, PONG):
                return opcode, payload

    def close(self):
        # Wakes whoever reads.
        try:
            self.socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self.socket.close()


def close_code(payload):
    return struct.unpack(">H", payload[:2])[0] if len(payload) >= 2 else None


class Player:
    """Receives a stream in a thread of its own, and remembers what it has seen."""

    def __init__(self, server, stream="demo", token=None):
        self.socket = WebSocket(server, f"/v1/streams/{stream}/subscribe", token)
        self.seqs, self.controls, self.latencies = [], [], []
        self.arrivals = []
        self.code = self.error = None
        self.thread = threading.Thread(target=self.read, daemon=True)
        self.thread.start()

    def read(self):
        try:
            while True:
                opcode, payload = self.socket.message()
                if opcode == CLOSE:
                    self.code = close_code(payload)
                    return
                if opcode == TEXT:
                    self.controls.append(json.loads(payload))
                    continue
                (length,) = struct.unpack("<I", payload[8:12])
                metrics = json.loads(payload[16 : 16 + length])
                self.seqs.append(metrics["seq"])
                self.latencies.append(metrics["latency_us"] / 1e6)
                self.arrivals.append(time.monotonic())
        except (OSError, ConnectionError) as error:
            self.error = error

    @property
    def is_there(self):
        return self.thread.is_alive()

    @property
    def lost(self):
        """Frames that did not come although they were numbered."""
        return sum(after - before - 1 for before, after in zip(self.seqs, self.seqs[1:]))

    @property
    def skipped(self):
        return sum(control.get("missed", 0) for control in self.controls)

    def gap(self, since=0.0):
        """The longest time between two frames, the last of which came after a moment."""
        pairs = zip(self.arrivals, self.arrivals[1:])
        return max((b - a for a, b in pairs if since <= b), default=0.0)

    def p99(self):
        ordered = sorted(self.latencies)
        return ordered[int(0.99 * (len(ordered) - 1))] if ordered else 0.0

    def leave(self):
        self.socket.close()
        self.thread.join(5)


class Rig:
    """Publishes frames in turns, in a thread of its own."""

    def __init__(self, server, frames, fps=10, stream="demo", token=None, query=""):
        path = f"/v1/streams/{stream}/publish{query}"
        self.socket = WebSocket(server, path, token)
        self.frames, self.fps = frames, fps
        self.credit = self.sent = 0
        self.states = {}
        self.code = self.error = self.session = None
        self.stopping = threading.Event()
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.writer = threading.Thread(target=self.write, daemon=True)
        self.reader.start()
        wait_until(lambda: self.session, 10, "the rig is welcomed")
        self.writer.start()

    def read(self):
        try:
            while True:
                opcode, payload = self.socket.message()
                if opcode == CLOSE:
                    self.code = close_code(payload)
                    return
                said = json.loads(payload)
                self.credit = max(self.credit, said.get("credit", 0))
                self.session = self.session or said.get("session")
                if said["type"] == "ack":
                    self.states.setdefault(said["state"], []).append(said["message"])
        except (OSError, ConnectionError) as error:
            self.error = error

    def write(self):
        due = time.monotonic()
        try:
            while not self.stopping.is_set() and self.reader.is_alive():
                due = max(due + 1 / self.fps, time.monotonic() - 1)
                self.stopping.wait(max(0.0, due - time.monotonic()))
                while self.credit <= self.sent and not self.stopping.is_set():
                    if not self.reader.is_alive():
                        return
                    time.sleep(0.005)
                if self.stopping.is_set():
                    return
                about = {"type": "frame", "capture_time_us": time.time_ns() // 1000}
                self.socket.send(TEXT, json.dumps(about).encode())
                self.socket.send(BINARY, self.frames[self.sent % len(self.frames)])
                self.sent += 1
        except (OSError, ConnectionError) as error:
            self.error = error

    def count(self, state):
        return len(self.states.get(state, []))

    def stop(self):
        """Lets what has been sent come out, and leaves with a farewell."""
        self.stopping.set()
        self.writer.join(10)
        if self.reader.is_alive():
            wait_until(
                lambda: self.count("accepted") + self.count("rejected") >= self.sent
                and self.count("published") >= self.count("accepted"),
                20,
                f"all frames of the rig come out: {self.states}",
            )
            self.socket.send(CLOSE, struct.pack(">H", 1000))
            self.reader.join(5)
        self.socket.close()


class Slow:
    """Many connections that send a little at a time, or nothing. Those that do not read hear
    only that they have been reset, until they are told to."""

    def __init__(self, server, count, head, piece=b"", every=0.5, reads=True):
        self.head, self.piece, self.every = head, piece, every
        self.begun = time.monotonic()
        self.open, self.ended = {}, []
        self.poll = select.epoll()
        for _ in range(count):
            connection = socket.socket()
            if not reads:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
            connection.connect(("127.0.0.1", server.port))
            connection.sendall(head)
            connection.setblocking(False)
            self.open[connection.fileno()] = connection
            self.poll.register(connection.fileno(), select.EPOLLIN if reads else 0)
        self.answers = {}
        self.thread = threading.Thread(target=self.work, daemon=True)
        self.thread.start()

    def work(self):
        due = time.monotonic() + self.every
        while self.open:
            for number, _ in self.poll.poll(0.05):
                self.hear(number)
            if self.piece and due <= time.monotonic():
                due += self.every
                for connection in list(self.open.values()):
                    try:
                        connection.send(self.piece)
                    except BlockingIOError:
                        continue
                    except OSError:
                        self.end(connection.fileno())

    def read_all(self):
        """Reads what has come, to the end."""
        for number in list(self.open):
            self.poll.modify(number, select.EPOLLIN)

    def hear(self, number):
        try:
            received = self.open[number].recv(1 << 16)
        except OSError:
            received = b""
        if received:
            self.answers[number] = self.answers.get(number, b"") + received
        else:
            self.end(number)

    def end(self, number):
        self.poll.unregister(number)
        self.open.pop(number).close()
        self.ended.append(time.monotonic() - self.begun)

    def wait(self, seconds):
        """Waits until the server has ended all of them; gives when it did the first and last."""
        self.thread.join(seconds)
        if self.open:
            raise Failed(f"{len(self.open)} of {len(self.open) + len(self.ended)} are still open")
        return min(self.ended), max(self.ended)
