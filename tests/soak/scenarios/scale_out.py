"""One stream of frames of 40,000 faces through a gateway and NATS, with one worker of one thread, then
with two: how many come out a second, and what the processes take for them."""

import os
import pathlib
import time

from support import Nats, check, wait_until

SECONDS = 20
SETTINGS = {"compute.threads": 1, "bus.frames": 8}
PUBLISHED = 'steadymesh_frames_published_total{stream="demo"}'
TICKS = os.sysconf("SC_CLK_TCK")


def run(workshop):
    figures = {}
    for count in (1, 2):
        rate, cpu = measure(workshop, count)
        figures[count] = rate
        print(f"  {count} workers: {rate:.1f} frames/s; CPU ms a frame: {cpu}", flush=True)
    ratio = figures[2] / figures[1]
    # What two workers gain on two cores that everything else runs on too.
    check(ratio > 1.2, f"two workers make {ratio:.2f} times what one makes")
    return {
        "one worker": f"{figures[1]:.1f} frames/s",
        "two": f"{figures[2]:.1f} frames/s",
        "ratio": f"{ratio:.2f}",
    }


def measure(workshop, count):
    """Frames a second that come out, and CPU time a frame of each kind of process."""
    nats = Nats(workshop)
    settings = SETTINGS | {"bus.nats_url": nats.url}
    gateway = workshop.server(settings=settings, arguments=("--role", "gateway"))
    workers = [
        workshop.server(settings=settings, arguments=("--role", "worker")) for _ in range(count)
    ]
    url = gateway.url("/v1/streams/demo")
    rig = workshop.start(
        ["publish", url, "--synthetic", "--vertices", 20_000, "--loop", "--transport", "ws"]
    )
    try:
        wait_until(lambda: gateway.metric(PUBLISHED) > 20, 120, "frames come out")
        kinds = {
            "gateway": [gateway.process],
            "workers": [worker.process for worker in workers],
            "nats": [nats.process],
            "rig": [rig],
        }
        before = {kind: cpu_seconds(processes) for kind, processes in kinds.items()}
        began, frames = time.monotonic(), gateway.metric(PUBLISHED)
        time.sleep(SECONDS)
        frames = gateway.metric(PUBLISHED) - frames
        elapsed = time.monotonic() - began
        cpu = {
            kind: round(1000 * (cpu_seconds(processes) - before[kind]) / frames, 1)
            for kind, processes in kinds.items()
        }
    finally:
        for process in [rig, gateway.process, *(worker.process for worker in workers), nats.process]:
            process.kill()
            process.wait()
    return frames / elapsed, cpu


def cpu_seconds(processes):
    total = 0
    for process in processes:
        text = pathlib.Path(f"/proc/{process.pid}/stat").read_text()
        fields = text.rsplit(")", 1)[1].split()
        total += int(fields[11]) + int(fields[12])
    return total / TICKS
