"""10,000 connections are tried from ten addresses against a cap of 1,000: those in go on, /livez
answers all the while, the others are told 503 or closed and are counted, memory is bounded, and
when they have gone all is as it was."""

import errno
import select
import socket
import time

from support import Player, Rig, check, request, rig_frames, wait_until

TRIED, CAP = 10_000, 1_000
SETTINGS = {
    "limits.connections": CAP,
    "limits.header_timeout_secs": 60,
    "streams.defaults.tracking": "off",
    "streams.defaults.metrics": "sampled",
    "streams.defaults.target_faces": 400,
}
REFUSED = "steadymesh_connections_refused_total"


def run(workshop):
    server = workshop.server(settings=SETTINGS)
    rig = Rig(server, rig_frames(), fps=20)
    wait_until(lambda: rig.count("published"), 10, "a frame is out")
    player = Player(server)
    wait_until(lambda: player.seqs, 5, "the player has a frame")
    before, memory_before = server.metric("steadymesh_connections"), server.resident_mib()
    begun = time.monotonic()
    flood = Flood(server)
    flood.run()
    seconds = time.monotonic() - begun
    refused, open_now = server.metric(REFUSED), server.metric("steadymesh_connections")
    memory = server.resident_mib()
    check(open_now <= CAP, f"{open_now:.0f} connections are open")
    check(flood.open_count == CAP - before, f"{flood.open_count} of the flood are in")
    told = flood.told + flood.closed
    check(told + flood.open_count == TRIED, f"{told} refused, {flood.open_count} in, of {TRIED}")
    check(refused >= flood.told + flood.closed, f"{refused:.0f} are counted, of {told}")
    check(flood.slowest_livez < 2, f"/livez took {flood.slowest_livez:.2f} s")
    check(memory - memory_before < 200, f"memory grew from {memory_before:.0f} to {memory:.0f} MiB")
    check(player.is_there and player.lost == 0, f"{player.lost} frames were lost")
    flood.leave()
    wait_until(
        lambda: server.metric("steadymesh_connections") <= before, 10, "all places are given back"
    )
    check(request(server.url("/v1/streams"))[0] == 200, "a newcomer is let in")
    seen = len(player.seqs)
    wait_until(lambda: len(player.seqs) > seen + 20, 10, "the stream goes on")
    rig.stop()
    check(player.lost == 0 and rig.count("rejected") == 0, f"{player.lost} frames were lost")
    return {
        "tried": f"{TRIED} in {seconds:.1f} s",
        "in": flood.open_count,
        "told 503": flood.told,
        "closed": flood.closed,
        "counted": f"{refused:.0f}",
        "slowest /livez": f"{1000 * flood.slowest_livez:.0f} ms",
        "resident": f"{memory_before:.0f} to {memory:.0f} MiB",
        "frames": len(player.seqs),
        "p99": f"{1000 * player.p99():.0f} ms",
    }


class Flood:
    """Ten thousand connections, each of which stays for as long as the server lets it."""

    def __init__(self, server):
        self.server = server
        self.connections = {}
        self.answers = {}
        self.told = self.closed = 0
        self.slowest_livez = 0.0
        self.poll = select.epoll()

    @property
    def open_count(self):
        return len(self.connections)

    def run(self):
        for index in range(TRIED):
            self.connect(f"127.0.0.{2 + index % 10}")
            if index % 250 == 0:
                self.look(0)
                self.ask_livez()
        quiet_since = time.monotonic()
        deadline = quiet_since + 60
        # Some are tried again by the system, seconds later.
        while time.monotonic() < deadline and time.monotonic() - quiet_since < 5:
            if self.look(0.2):
                quiet_since = time.monotonic()
        self.ask_livez()

    def connect(self, source):
        connection = socket.socket()
        connection.bind((source, 0))
        connection.setblocking(False)
        result = connection.connect_ex(("127.0.0.1", self.server.port))
        check(result in (0, errno.EINPROGRESS), f"connect: {errno.errorcode.get(result)}")
        self.connections[connection.fileno()] = connection
        self.poll.register(connection.fileno(), select.EPOLLIN)

    def look(self, seconds):
        """Hears those that the server has something to say to."""
        events = self.poll.poll(seconds)
        for number, _ in events:
            try:
                received = self.connections[number].recv(4096)
            except OSError:
                received = b""
            self.answers[number] = self.answers.get(number, b"") + received
            if not received:
                self.end(number)
        return events

    def end(self, number):
        answer = self.answers.pop(number)
        if b"HTTP/1.1 503" in answer and b"limits.connections" in answer:
            self.told += 1
        else:
            self.closed += 1
        self.poll.unregister(number)
        self.connections.pop(number).close()

    def ask_livez(self):
        begun = time.monotonic()
        check(self.server.internal("/livez") == "alive\n", "/livez answers")
        self.slowest_livez = max(self.slowest_livez, time.monotonic() - begun)

    def leave(self):
        for connection in self.connections.values():
            connection.close()
