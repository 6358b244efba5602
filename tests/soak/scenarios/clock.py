"""The wall clock jumps hours ahead and back while frames flow: no frame is lost, no stream and no
connection without an expiring token ends, latencies stay what they are, and a token that expires
follows the wall clock."""

import datetime
import hashlib
import pathlib
import time

from support import Player, Rig, check, request, rig_frames, skip, wait_until

LIBRARIES = ("/usr/lib/*/faketime/libfaketimeMT.so.1", "/usr/lib/faketime/libfaketimeMT.so.1")
HOUR = 3600
CONFIGURATION = """
[streams]
idle_timeout_secs = 600
defaults = {{ tracking = "off", metrics = "sampled", target_faces = 400 }}
[[auth.tokens]]
name = "for ever"
hash = "{forever}"
scopes = ["admin"]
[[auth.tokens]]
name = "for an hour"
hash = "{hour}"
scopes = ["subscribe"]
expires = "{expires}"
"""


def run(workshop):
    found = [path for pattern in LIBRARIES for path in pathlib.Path("/").glob(pattern[1:])]
    if not found:
        skip("libfaketime is not here: apt-get install faketime")
    clock = workshop.folder / "clock"
    clock.write_text("+0")
    file = workshop.folder / "steadymesh.toml"
    expires = datetime.datetime.now(datetime.timezone.utc) + datetime.timedelta(hours=1)
    file.write_text(
        CONFIGURATION.format(
            forever=digest("forever"), hour=digest("hour"), expires=expires.isoformat("T", "seconds")
        )
    )
    environment = {
        "LD_PRELOAD": str(found[0]),
        "FAKETIME_TIMESTAMP_FILE": str(clock),
        "FAKETIME_NO_CACHE": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }
    server = workshop.server(environment=environment, arguments=("--config", file))
    rig = Rig(server, rig_frames(), fps=10, token="forever")
    wait_until(lambda: rig.count("published"), 10, "a frame is out")
    player = Player(server, token="forever")
    guest = Player(server, token="hour")
    check(status(server, "hour") == 200, "a token that has not expired is taken")
    for hours in (3, -5, 24 * 400, 0):
        clock.write_text(f"{hours * HOUR:+d}")
        seen = len(player.seqs)
        wait_until(lambda: len(player.seqs) >= seen + 15, 20, f"frames flow at {hours:+d} h")
        if hours == 3:
            wait_until(lambda: guest.code == 4401, 15, "the guest is told that its token expired")
            check(status(server, "hour") == 401, "a token that has expired is refused")
    check(status(server, "hour") == 200, "the token is good again when the clock is back")
    time.sleep(1)
    rig.stop()
    check(rig.count("dropped") + rig.count("rejected") == 0, f"{rig.states}")
    check(player.is_there, f"the player is there ({player.code}, {player.error})")
    check(player.lost + player.skipped == 0, f"{player.lost} frames were lost")
    slowest = max(player.latencies)
    check(slowest < 5, f"a frame took {slowest:.1f} s")
    latency = "steadymesh_frame_latency_seconds"
    mean = server.metric(f'{latency}_sum{{stream="demo"}}') / rig.sent
    check(0 <= mean < 1, f"the histogram says {mean:.3f} s a frame")
    return {
        "frames": rig.sent,
        "lost": player.lost,
        "slowest": f"{1000 * slowest:.0f} ms",
        "mean": f"{1000 * mean:.0f} ms",
    }


def digest(token):
    return "sha256:" + hashlib.sha256(token.encode()).hexdigest()


def status(server, token):
    headers = {"Authorization": f"Bearer {token}"}
    return request(server.url("/v1/streams/demo"), headers=headers)[0]
