"""The disk that a stream is recorded on fills up and is cleared again. The stream goes on, the gap
is recorded and alarmed, and what was recorded before and after it can be read."""

import json
import os

from support import Player, Rig, Skipped, check, request, rig_frames, track, wait_until

SETTINGS = {
    "streams.defaults.tracking": "off",
    "streams.defaults.metrics": "off",
    "streams.defaults.target_faces": 400,
    "streams.defaults.record": "raw",
    "recordings.queue_bytes": 4 << 20,
    "recordings.segment_secs": 0.3,
}
LOST = 'steadymesh_recording_lost_frames_total{stream="demo",track="raw"}'
FAILING = 'steadymesh_recording_failing{stream="demo"}'


def run(workshop):
    if os.geteuid() != 0:
        raise Skipped("a small disk takes root")
    disk = workshop.small_disk(20 << 10)
    ballast = disk / "ballast"
    ballast.write_bytes(bytes(8 << 20))
    server = workshop.server(settings=SETTINGS | {"recordings.url": f"file://{disk}/recordings"})
    rig = Rig(server, rig_frames(rings=40, segments=60))
    wait_until(lambda: rig.count("published"), 10, "a frame is out")
    player = Player(server)
    wait_until(lambda: server.metric(FAILING) == 1, 60, "the full disk is alarmed")
    wait_until(lambda: server.metric(LOST) > 20, 60, "frames are lost for the recording")
    _, body = request(server.url("/v1/streams/demo"))
    said = json.loads(body)["recording"]["failing"]
    check("No space left" in said, f"it is not said why: {said}")
    seen = len(player.seqs)
    wait_until(lambda: len(player.seqs) > seen + 30, 20, "the stream goes on")
    ballast.unlink()
    wait_until(lambda: server.metric(FAILING) == 0, 20, "writing goes on")
    wait_until(lambda: len(player.seqs) > seen + 60, 20, "the stream goes on")
    rig.stop()
    status, _ = request(server.url("/v1/streams/demo/recording"), "DELETE")
    check(status == 204, f"ending the recording answered {status}")

    def complete():
        _, body = request(server.url("/v1/recordings?stream=demo"))
        recordings = json.loads(body)["recordings"]
        return recordings and recordings[0]["state"] == "complete" and recordings[0]

    wait_until(complete, 10, "the recording ends")
    recording = complete()
    (path,) = (disk / "recordings").glob("demo/*")
    frames, gaps = track(path / "raw")
    lost = sum(gap["frames"] for gap in gaps)
    check(lost == server.metric(LOST) or lost > 20, f"{lost} frames in gaps")
    check(recording["raw"]["gaps"] == gaps, "the recording's gaps are not those of its segments")
    seqs = {entry["seq"] for entry, _ in frames}
    for gap in gaps:
        missing = range(gap["first_seq"], gap["last_seq"] + 1)
        check(not seqs.intersection(missing), f"frames of {gap} are there")
    check(len(seqs) + lost == max(seqs) + 1, "frames are missing that no gap has")
    check(player.is_there and player.lost == 0, f"{player.lost} frames were lost")
    return {"frames": len(player.seqs), "recorded": len(frames), "in gaps": lost}
