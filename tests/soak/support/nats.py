"""A NATS server of a scenario's own."""

import shutil
import socket
import subprocess

from .checks import skip, wait_until
from .server import free_port


class Nats:
    """`nats-server` with its logs in a folder of its own."""

    def __init__(self, workshop):
        if not shutil.which("nats-server"):
            skip("nats-server is not installed")
        self.workshop, self.port = workshop, free_port()
        self.url = f"nats://127.0.0.1:{self.port}"
        self.process = None
        self.start()

    def start(self):
        folder = self.workshop.folder / f"nats-{self.port}"
        command = ["nats-server", "--addr", "127.0.0.1", "--port", self.port]
        self.process = self.workshop.spawn(
            [*command, "--jetstream", "--store_dir", folder],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        wait_until(self.listens, 10, "nats-server listens")

    def listens(self):
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def kill(self):
        self.process.kill()
        self.process.wait()
