"""A server process, and everything that is cleaned up after a scenario."""

import os
import pathlib
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import urllib.error
import urllib.request

from .checks import Failed, wait_until

# Below the ports that the system gives to connections of its own.
PORTS = range(22000, 23000)
HALF = pathlib.Path(__file__).resolve().parents[1] / "half.py"


def free_port():
    for port in random.sample(PORTS, len(PORTS)):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
                return port
            except OSError:
                continue
    raise Failed("no port is free")


class Server:
    """`steadymesh serve` on ports of its own."""

    def __init__(self, workshop, settings=None, environment=None, stderr=None, arguments=()):
        self.workshop = workshop
        self.port, self.internal_port = free_port(), free_port()
        self.environment = {
            name: value for name, value in os.environ.items() if not name.startswith("STEADYMESH_")
        }
        for name, value in (settings or {}).items():
            self.environment[f"STEADYMESH_{name.replace('.', '__').upper()}"] = str(value)
        self.environment.update(environment or {})
        self.log = workshop.folder / f"server-{self.port}.log"
        self.stderr = stderr
        self.arguments = arguments
        self.process = None
        self.start()

    def start(self):
        command = [
            *("serve", "--listen", f"127.0.0.1:{self.port}"),
            *("--internal-listen", f"127.0.0.1:{self.internal_port}"),
            *self.arguments,
        ]
        with open(self.stderr or self.log, "ab") as stderr:
            self.process = self.workshop.start(command, self.environment, stderr)
        wait_until(self.is_ready, 20, "the server is ready")

    def is_ready(self):
        if self.process.poll() is not None:
            raise Failed(f"the server ended with {self.process.returncode}")
        try:
            return self.internal("/readyz") == "ready\n"
        except (OSError, urllib.error.URLError):
            return False

    def kill(self):
        """Ends it without a farewell."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def url(self, path):
        return f"http://127.0.0.1:{self.port}{path}"

    def internal(self, path):
        address = f"http://127.0.0.1:{self.internal_port}{path}"
        with urllib.request.urlopen(address, timeout=5) as answer:
            return answer.read().decode()

    def metric(self, series):
        """One series' value; zero if it is not there."""
        for line in self.internal("/metrics").splitlines():
            if line.startswith(series + " "):
                return float(line.rsplit(" ", 1)[1])
        return 0.0

    def resident_mib(self):
        text = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", text)[1]) / 1024


class Workshop:
    """A folder and processes, which end with the scenario."""

    def __init__(self, binary, minutes=None):
        self.binary = binary
        self.minutes = minutes
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="steadymesh-soak-"))
        self.processes = []
        self.mounts = []
        self.stop = threading.Event()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop.set()
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.wait()
        for mount in self.mounts:
            subprocess.run(["umount", mount], check=False)
        shutil.rmtree(self.folder, ignore_errors=True)

    def server(self, **settings):
        return Server(self, **settings)

    def start(self, arguments, environment=None, stderr=None, stdout=subprocess.DEVNULL):
        """Starts the binary."""
        return self.spawn([self.binary, *arguments], environment, stderr, stdout)

    def spawn(self, command, environment=None, stderr=None, stdout=None):
        process = subprocess.Popen(
            [str(part) for part in command],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=stdout,
            stderr=stderr,
        )
        self.processes.append(process)
        return process

    def half(self, kind, server, path):
        """Starts a client that stops in the middle of a frame; gives it and its session."""
        command = [sys.executable, HALF, kind, server.port, path]
        child = self.spawn(command, stdout=subprocess.PIPE)
        said = child.stdout.readline().split()
        if not said or said[0] != b"half":
            raise Failed("a client could not do half of its frame")
        return child, said[1].decode()

    def run(self, *arguments, seconds=120):
        """Runs the binary to its end; gives its exit code and what it said."""
        done = subprocess.run(
            [str(self.binary), *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            timeout=seconds,
            check=False,
        )
        return done.returncode, done.stderr.decode(errors="replace")

    def small_disk(self, kibibytes):
        """A file system of so many bytes; needs root."""
        mount = self.folder / "disk"
        mount.mkdir()
        options = f"size={kibibytes}k"
        subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", mount], check=True)
        self.mounts.append(mount)
        return mount

    def last_words(self):
        """The end of the servers' logs."""
        words = []
        for log in sorted(self.folder.glob("server-*.log")):
            words += [f"  {line}" for line in log.read_text(errors="replace").splitlines()[-15:]]
        return "\n".join(words)
