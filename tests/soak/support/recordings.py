"""Reads recordings from their files, by docs/recordings.md alone."""

import json
import struct
import zlib

from .checks import check


def segment(path):
    """A segment's frames, as (entry, body), and its gaps; checks everything that can be checked."""
    data = path.read_bytes()
    check(data[:6] == b"SMSG\x01\x00" and data[-4:] == b"GSMS", f"{path.name} is no segment")
    length, crc = struct.unpack("<II", data[-12:-4])
    footer = data[-12 - length : -12]
    check(zlib.crc32(footer) == crc, f"the footer of {path.name} is damaged")
    listed = json.loads(footer)
    frames = []
    for entry in listed["frames"]:
        body = data[entry["offset"] : entry["offset"] + entry["bytes"]]
        check(zlib.crc32(body) == entry["crc32"], f"{path.name}: frame {entry['seq']} is damaged")
        frames.append((entry, body))
    return frames, listed.get("gaps", [])


def track(folder):
    """All frames of a track, and all gaps. The index may be behind the segments, not ahead."""
    segments = {int(path.name[:8]): path for path in folder.glob("*.segment")}
    listed = []
    for page in sorted(folder.glob("*.index.json")):
        listed += json.loads(page.read_text())["segments"]
    for entry in listed:
        path = segments.get(entry["ordinal"])
        check(path, f"the index is ahead of the data: segment {entry['ordinal']} is not there")
        check(path.stat().st_size == entry["length"], f"{path.name} is not as long as listed")
    frames, gaps = [], []
    for _, path in sorted(segments.items()):
        there, missing = segment(path)
        frames += there
        gaps += missing
    seqs = [entry["seq"] for entry, _ in frames]
    check(seqs == sorted(set(seqs)), f"the frames of {folder} are not in order")
    behind = len(segments) - len(listed)
    check(behind <= 1, f"the index of {folder} is {behind} segments behind")
    return frames, gaps
