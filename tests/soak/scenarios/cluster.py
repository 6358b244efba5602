"""Two workers and two gateways on NATS JetStream. One worker after the other is killed every five
seconds for two minutes, a gateway and NATS once each: every acknowledged frame comes out exactly
once and in order, at players of either gateway."""

import http.client
import random
import threading
import time
import urllib.error

from support import Nats, Player, check, rig_frames, wait_until

MINUTES = 2.0
SETTINGS = {
    "streams.defaults.target_faces": 400,
    "log.level": "info",
    "compute.threads": 1,
    "bus.ack_wait_secs": 1.0,
}


def run(workshop):
    nats = Nats(workshop)
    settings = SETTINGS | {"bus.nats_url": nats.url}
    gateways = [workshop.server(settings=settings, arguments=("--role", "gateway")) for _ in range(2)]
    workers = [workshop.server(settings=settings, arguments=("--role", "worker")) for _ in range(2)]
    rig = Posting(gateways[0], rig_frames(rings=20, segments=30), fps=15)
    wait_until(lambda: len(rig.acknowledged) > 5, 20, "frames are acknowledged")
    wait_until(lambda: is_known(gateways[1]), 20, "the other gateway knows the stream")
    near, far = Player(gateways[0]), Player(gateways[1])
    wait_until(lambda: near.seqs and far.seqs, 20, "frames come out")

    kills, chance = 0, random.Random(5)
    until = time.monotonic() + 60 * (workshop.minutes or MINUTES)
    while time.monotonic() < until:
        time.sleep(5)
        victim = chance.choice(workers)
        victim.kill()
        kills += 1
        time.sleep(0.5)
        victim.start()
    everything_out(rig, near, far, "after workers were killed")

    nats.kill()
    wait_until(lambda: not ready(gateways[0]), 20, "a gateway that is cut off says so")
    wait_until(lambda: not ready(workers[0]), 20, "a worker that is cut off says so")
    acknowledged = len(rig.acknowledged)
    time.sleep(2)
    nats.start()
    wait_until(lambda: ready(gateways[0]) and ready(workers[0]), 30, "they are ready again")
    wait_until(
        lambda: len(rig.acknowledged) > acknowledged + 30, 60, "frames are acknowledged again"
    )
    everything_out(rig, near, far, "after NATS was killed")

    gateways[0].kill()
    before = len(far.seqs)
    gateways[0].start()
    wait_until(lambda: len(far.seqs) > before + 30, 60, "the stream goes on at the other gateway")
    rig.stop()
    wait_until(
        lambda: far.seqs[-1] >= max(rig.acknowledged), 30, "what was acknowledged comes out"
    )
    check(far.seqs == list(range(far.seqs[0], far.seqs[-1] + 1)), "frames are missing or come twice")
    check(far.is_there and not far.skipped, f"the player missed {far.skipped} frames")
    return {
        "workers killed": kills,
        "acknowledged": len(rig.acknowledged),
        "out": len(far.seqs),
        "longest gap": f"{far.gap():.1f} s",
    }


def everything_out(rig, near, far, when):
    """All that is acknowledged by now comes out, once and in order."""
    newest = max(rig.acknowledged)
    for player in (near, far):
        wait_until(
            lambda p=player: p.seqs[-1] >= newest,
            30,
            f"frame {newest} comes out {when}, at {player.seqs[-1]}",
        )
        whole = list(range(player.seqs[0], player.seqs[-1] + 1))
        check(player.seqs == whole, f"frames are missing or come twice {when}")
        check(not player.skipped, f"a player skipped {player.skipped} frames {when}")


def is_known(gateway):
    connection = http.client.HTTPConnection("127.0.0.1", gateway.port, timeout=5)
    connection.request("GET", "/v1/streams/demo/frames/latest/metrics")
    return connection.getresponse().status == 200


def ready(server):
    try:
        return server.internal("/readyz") == "ready\n"
    except (OSError, urllib.error.URLError):
        return False


class Posting:
    """A rig that numbers its frames, posts one after the other, and sends each again until it is
    acknowledged."""

    def __init__(self, gateway, bodies, fps):
        self.gateway, self.bodies, self.fps = gateway, bodies, fps
        self.acknowledged = {}
        self.stopping = threading.Event()
        self.thread = threading.Thread(target=self.work, daemon=True)
        self.thread.start()

    def work(self):
        seq, connection = 0, None
        while not self.stopping.wait(1 / self.fps):
            while not self.stopping.is_set():
                try:
                    if connection is None:
                        port = self.gateway.port
                        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
                    body = self.bodies[seq % len(self.bodies)]
                    connection.request("POST", f"/v1/streams/demo/frames?seq={seq}", body)
                    answer = connection.getresponse()
                    answer.read()
                    if answer.status == 202:
                        self.acknowledged[seq] = time.monotonic()
                        seq += 1
                        break
                except (OSError, http.client.HTTPException):
                    connection = None
                self.stopping.wait(0.1)

    def stop(self):
        self.stopping.set()
        self.thread.join(30)
