"""A real server for the live tests, if there is one."""

from __future__ import annotations

import os
import re
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

_ADDRESSES = re.compile(r"API on (http://\S+), operations on (http://\S+)")
_PATIENCE = 30.0


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a server of our own, from the binary that STEADYMESH_BIN names."""
    binary = os.environ.get("STEADYMESH_BIN")
    if not binary:
        pytest.skip("STEADYMESH_BIN does not name a server: the live tests need one")
    log = tmp_path_factory.mktemp("server") / "log"
    settings = {"STEADYMESH_LOG__LEVEL": "info", "STEADYMESH_LOG__FORMAT": "text"}
    inherited = {
        name: one for name, one in os.environ.items() if not name.startswith("STEADYMESH_")
    }
    # The server chooses free ports and says which: no other one can be met by mistake.
    command = [binary, "serve", "--listen", "127.0.0.1:0", "--internal-listen", "127.0.0.1:0"]
    with (
        log.open("wb") as output,
        subprocess.Popen(command, stderr=output, env={**inherited, **settings}) as process,
    ):
        try:
            yield _wait_until_ready(process, log)
        finally:
            process.terminate()
            try:
                process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()


def _wait_until_ready(process: subprocess.Popen[bytes], log: Path) -> str:
    deadline = time.monotonic() + _PATIENCE
    while time.monotonic() < deadline:
        text = log.read_text()
        if process.poll() is not None:
            pytest.fail(f"the server ended with {process.returncode}: {text}")
        found = _ADDRESSES.search(text)
        if found and _is_ready(found[2]):
            return found[1]
        time.sleep(0.02)
    pytest.fail(f"the server is not ready after {_PATIENCE} seconds: {log.read_text()}")


def _is_ready(operations: str) -> bool:
    try:
        with urllib.request.urlopen(f"{operations}/readyz", timeout=5) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False
