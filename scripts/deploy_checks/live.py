"""What compose.yaml starts, without containers: a server that records, gateways and a worker on NATS,
their rigs and players, and Prometheus."""

import contextlib
import http.server
import re
import signal
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from dataclasses import dataclass
from pathlib import Path

import yaml

from .common import DEPLOY, STEADYMESH, clean_environment, expect, read_yaml
from .compose import compose

# Streams of the server alone and of the gateways.
ALONE, SCALED = "demo", "scaled"


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def get(url, **headers):
    """Status and body of the answer."""
    request = urllib.request.Request(url, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status, answer.read().decode(errors="replace")
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(errors="replace")


def eventually(what, seconds, holds):
    """The first true value that `holds` gives."""
    end = time.monotonic() + seconds
    while True:
        with contextlib.suppress(OSError):
            found = holds()
            if found:
                return found
        expect(time.monotonic() < end, f"{what}: not within {seconds} s")
        time.sleep(0.2)


class Processes:
    """What was started, with its log. It ends with this."""

    def __init__(self, folder):
        self.folder, self.running = Path(folder), []

    def start(self, name, *command, **env):
        with open(self.folder / f"{name}.log", "wb") as log:
            command = [str(part) for part in command]
            process = subprocess.Popen(command, env=clean_environment(**env), stdin=subprocess.DEVNULL,
                                       cwd=self.folder, stdout=log, stderr=subprocess.STDOUT)
        self.running.append((name, process))

    def expect_alive(self):
        for name, process in self.running:
            log = self.folder / f"{name}.log"
            expect(process.poll() is None, f"{name} has ended:\n{log.read_text()[-2000:]}")

    def until(self, what, seconds, url, **headers):
        """Waits until an address answers with 200."""
        eventually(what, seconds, lambda: self.expect_alive() or get(url, **headers)[0] == 200)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        # Rigs and players before the server, so that they do not wait for one that is gone.
        for _, process in reversed(self.running):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(timeout=20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@contextlib.contextmanager
def webhook_endpoint():
    """The address of an endpoint that takes every message."""

    class Taken(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            self.rfile.read(int(self.headers.get("content-length", 0)))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Taken)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()


def make_token():
    done = subprocess.run([STEADYMESH, "token"], capture_output=True, text=True, check=True)
    return done.stdout.strip(), re.search(r"sha256:[0-9a-f]{64}", done.stderr)[0]


@dataclass
class Node:
    """A server, gateway or worker, and where it listens."""

    name: str
    public: str
    internal: str

    @property
    def operations(self):
        return f"http://{self.internal}"


def start_node(processes, name, **env):
    """Starts what compose.yaml has under this name, on ports of this machine."""
    public, internal = free_port(), free_port()
    node = Node(name, f"127.0.0.1:{public}", f"127.0.0.1:{internal}")
    service = compose()[name]
    addresses = ["--listen", node.public, "--internal-listen", node.internal]
    processes.start(name, STEADYMESH, *service.get("command", ["serve"]), *addresses,
                    **{**service["environment"], **env})
    processes.until(f"{name} is ready", 20, f"{node.operations}/readyz")
    return node


def start_alone(processes, hook):
    """The server, its demo's rig and a player."""
    token, token_hash = make_token()
    key = "MDEyMzQ1Njc4OTAxMjM0NTY3ODkwMTIzNDU2Nzg5MDE="
    node = start_node(
        processes, "steadymesh",
        STEADYMESH_AUTH__TOKENS=f'[{{name="test", hash="{token_hash}", scopes=["publish", "subscribe"]}}]',
        STEADYMESH_WEBHOOKS__ENDPOINTS=f'[{{name="test", url="{hook}", secret="whsec_{key}"}}]',
        STEADYMESH_RECORDINGS__URL=f"file://{processes.folder / 'recordings'}",
        STEADYMESH_STREAMS__DEFAULTS__RECORD="both")
    rig = compose()["demo"]["command"]
    address = urllib.parse.urlsplit(rig[1])
    streams = f"http://{node.public}/v1/streams"
    # The name by which the demo's rig asks is one of the server's, and others are not.
    expect(get(streams, host=address.netloc)[0] == 401, f"{address.netloc} is refused")
    expect(get(streams, host="rebound.example")[0] == 421, "any name is taken")
    stream = f"http://{node.public}{address.path}"
    rig = [stream if part == rig[1] else part for part in rig]
    processes.start("rig", STEADYMESH, *rig, "--vertices", 1000, STEADYMESH_TOKEN=token)
    asked = {"authorization": f"Bearer {token}"}
    processes.until("frames come out", 60, f"{stream}/frames/latest.drc", **asked)
    processes.start("player", STEADYMESH, "subscribe", stream, STEADYMESH_TOKEN=token)
    return node


def start_scaled(processes):
    """NATS, gateways, a worker, a rig at one gateway and a player at the other."""
    port, monitor = free_port(), free_port()
    processes.start("nats", "nats-server", "--config", DEPLOY / "nats/nats.conf",
                    "--addr", "127.0.0.1", "--port", port, "--http_port", monitor,
                    "--store_dir", processes.folder / "nats")
    processes.until("NATS is ready", 20, f"http://127.0.0.1:{monitor}/healthz")
    bus = {"STEADYMESH_BUS__NATS_URL": f"nats://127.0.0.1:{port}"}
    nodes = [start_node(processes, name, **bus) for name in ("gateway-1", "gateway-2", "worker")]
    near, far = (f"http://{node.public}/v1/streams/{SCALED}" for node in nodes[:2])
    rig = ["publish", near, "--synthetic", "--loop", "--fps", 5, "--vertices", 1000]
    processes.start("rig-scaled", STEADYMESH, *rig)
    processes.until("frames come out of the other gateway", 60, f"{far}/frames/latest.drc")
    processes.start("player-scaled", STEADYMESH, "subscribe", far)
    return nodes


def prometheus_config(folder, nodes):
    """deploy/prometheus/prometheus.yml, in a hurry, with these nodes for those that it looks for."""
    config = read_yaml("prometheus/prometheus.yml")
    config["global"] = {"scrape_interval": "1s", "evaluation_interval": "1s"}
    config["rule_files"] = [str(DEPLOY / "prometheus" / file) for file in config["rule_files"]]
    [job] = config["scrape_configs"]
    [always] = job["static_configs"]
    found = job.pop("dns_sd_configs")[0]["names"]
    job["static_configs"] = [{**always, "targets": [nodes[0].internal]}]
    for node in nodes[1:]:
        expect(node.name in found, f"Prometheus does not look for {node.name}")
        labels = {"__meta_dns_name": node.name}
        job["static_configs"].append({"targets": [node.internal], "labels": labels})
    file = folder / "prometheus.yml"
    file.write_text(yaml.safe_dump(config))
    return file


def start_prometheus(processes, nodes):
    own = f"127.0.0.1:{free_port()}"
    config = prometheus_config(processes.folder, nodes)
    processes.start("prometheus", "prometheus", f"--config.file={config}",
                    f"--storage.tsdb.path={processes.folder / 'data'}",
                    f"--web.listen-address={own}", "--log.level=warn")
    processes.until("Prometheus is ready", 30, f"http://{own}/-/ready")
    return f"http://{own}"


def start_all(processes, hook):
    """Everything; gives Prometheus's address and the nodes."""
    nodes = [start_alone(processes, hook), *start_scaled(processes)]
    return start_prometheus(processes, nodes), nodes
