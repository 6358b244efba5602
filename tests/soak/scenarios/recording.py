"""A server that records is killed at a random moment, 200 times. Every segment can be read and has
the bytes that were sent, the index never names what is not there, and of the frames that were
acknowledged no more than the last second is missing."""

import http.client
import json
import random
import time

from support import check, request, rig_frames, track

KILLS = 200
SETTINGS = {
    "streams.defaults.tracking": "off",
    "streams.defaults.metrics": "off",
    "streams.defaults.target_faces": 50,
    "streams.defaults.record": "both",
    "log.level": "error",
}


def run(workshop):
    folder = workshop.folder / "recordings"
    server = workshop.server(settings=SETTINGS | {"recordings.url": f"file://{folder}"})
    bodies = rig_frames(rings=6, segments=10)
    chance = random.Random(6)
    recorded = acknowledged = unfinished = 0
    worst = 0.0
    for round_number in range(KILLS):
        # Some are killed before the first segment is complete.
        acks = publish(server, bodies, chance.uniform(0.1, 3.0))
        server.kill()
        killed = time.monotonic()
        known = set(folder.glob("demo/*"))
        found, lost = examine(folder, bodies, acks, killed)
        for path in known:
            unfinished += sum(1 for _ in path.rglob("*#*"))
        recorded += found
        acknowledged += len(acks)
        worst = max(worst, lost)
        server.start()
        # The server reads what its predecessor left, once in a while: it takes longer.
        if round_number % 20 == 0 and found:
            compare(server, folder)
        remove(folder)
    check(recorded > 50 * KILLS / 4, f"only {recorded} frames were recorded")
    return {
        "kills": KILLS,
        "acknowledged": acknowledged,
        "recorded": recorded,
        "files of unfinished writes": unfinished,
        "oldest acknowledged frame that is missing": f"{worst:.2f} s before the kill",
    }


def publish(server, bodies, seconds):
    """Posts frames one after the other; gives when each was acknowledged."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    acks, until = {}, time.monotonic() + seconds
    seq = 0
    while time.monotonic() < until:
        connection.request("POST", f"/v1/streams/demo/frames?seq={seq}", bodies[seq % len(bodies)])
        answer = connection.getresponse()
        answer.read()
        if answer.status == 202:
            acks[seq] = time.monotonic()
            seq += 1
        time.sleep(0.01)
    connection.close()
    return acks


def examine(folder, bodies, acks, killed):
    """Frames found of the only recording, and how old the oldest is that is missing."""
    recordings = list(folder.glob("demo/*"))
    check(len(recordings) <= 1, f"{len(recordings)} recordings of one run")
    seqs, count = set(), 0
    for recording in recordings:
        for name in ("raw", "output"):
            if not (recording / name).is_dir():
                continue
            frames, gaps = track(recording / name)
            check(not gaps, f"there are gaps: {gaps}")
            count += len(frames)
            if name == "raw":
                seqs = {entry["seq"] for entry, _ in frames}
                for entry, body in frames:
                    check(body == bodies[entry["seq"] % len(bodies)], f"frame {entry['seq']} differs")
        manifest = recording / "recording.json"
        if manifest.is_file():
            check(json.loads(manifest.read_text())["version"] == 1, "the manifest")
        else:
            check(not count, "there are frames without a manifest")
    missing = [killed - at for seq, at in acks.items() if seq not in seqs]
    oldest = max(missing, default=0.0)
    check(oldest < 1.2, f"a frame acknowledged {oldest:.2f} s before the kill is missing")
    return count, oldest


def compare(server, folder):
    """What the server says of it is what is there."""
    (path,) = folder.glob("demo/*")
    frames, _ = track(path / "raw")
    _, body = request(server.url("/v1/recordings?stream=demo"))
    (listed,) = json.loads(body)["recordings"]
    check(listed["state"] == "interrupted", f"it is called {listed['state']}")
    check(listed["raw"]["frames"] == len(frames), f"{listed['raw']} of {len(frames)} frames")
    seq = frames[-1][0]["seq"]
    _, body = request(server.url(f"/v1/recordings/demo/{path.name}/raw/{seq}"))
    check(body == frames[-1][1], f"frame {seq} is another one")


def remove(folder):
    for path in sorted(folder.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
