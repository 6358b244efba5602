"""Frames to send."""

import math
import struct


def ply(rings=20, segments=30, phase=0.0):
    """A sphere of about 2 * rings * segments faces that breathes, as a binary PLY."""
    vertices, faces = [], []
    radius = 1.0 + 0.05 * math.sin(phase)
    for ring in range(rings + 1):
        polar = math.pi * ring / rings
        for segment in range(segments):
            azimuth = 2 * math.pi * segment / segments
            # The poles are spread a little, so that no face is degenerate.
            across = radius * max(math.sin(polar), 0.01)
            point = across * math.cos(azimuth), across * math.sin(azimuth), math.cos(polar)
            vertices.append(struct.pack("<3f", *point))
    for ring in range(rings):
        for segment in range(segments):
            a = ring * segments + segment
            b = ring * segments + (segment + 1) % segments
            c, d = a + segments, b + segments
            faces.append(struct.pack("<B3I", 3, a, c, b))
            faces.append(struct.pack("<B3I", 3, b, c, d))
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\n"
        "property list uchar uint vertex_indices\nend_header\n"
    )
    return head.encode() + b"".join(vertices) + b"".join(faces)


def rig_frames(count=10, **size):
    """Frames in motion, to be sent in turns."""
    return [ply(phase=2 * math.pi * index / count, **size) for index in range(count)]
