"""The systemd unit."""

import shutil
import subprocess
import tempfile
from pathlib import Path

from .common import DEPLOY, STEADYMESH, expect, note, run

# What systemd calls exposure, in tenths: below 2.0 of 10.
MOST_EXPOSED = 20


def the_unit_is_sound():
    if not shutil.which("systemd-analyze"):
        note("systemd-analyze is not here: the unit is not checked")
        return
    text = (DEPLOY / "systemd/steadymesh.service").read_text()
    binary = "/usr/local/bin/steadymesh"
    expect(f"ExecStart={binary} serve" in text, f"it does not start {binary}")
    with tempfile.TemporaryDirectory() as folder:
        # Where the binary is on this machine.
        file = Path(folder) / "steadymesh.service"
        file.write_text(text.replace(binary, str(STEADYMESH)))
        command = ["systemd-analyze", "verify", "--man=no", file]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        # Unknown settings are told and forgiven, and so are defects of this machine's own units.
        said = [line for line in done.stderr.splitlines() if "steadymesh" in line]
        expect(done.returncode == 0 and not said, f"systemd-analyze verify\n{done.stderr}")
        run("systemd-analyze", "security", "--offline=true", f"--threshold={MOST_EXPOSED}",
            "--no-pager", file)


CHECKS = [the_unit_is_sound]
