"""Writes the golden messages from README.md's layout alone, without the Rust code."""

import json
import pathlib
import struct

HERE = pathlib.Path(__file__).parent

envelope = struct.pack("<H", 1)  # version
envelope += struct.pack("<BQ", 1, 7)  # seq
envelope += struct.pack("<BQ", 1, 1_700_000_000_000_000)  # capture_time_us
envelope += struct.pack("<II", 3, 1)  # vertex_count, face_count
envelope += struct.pack("<BBB", 0, 1, 0)  # normals, colors, texture coordinates
frame = b"SMF1" + struct.pack("<I", len(envelope)) + envelope
frame += struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
frame += bytes([255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255])
frame += struct.pack("<3I", 0, 1, 2)
(HERE / "native_frame.bin").write_bytes(frame)

metrics = {
    "seq": 41,
    "capture_time_us": None,
    "tracking": "paper",
    "reference_seq": 40,
    "input": {"vertices": 20672, "faces": 39421, "bytes": 1305760,
              "welded_vertices": 929, "removed_faces": 7},
    "output": {"vertices": 2043, "faces": 4000, "bytes": 5},
    "registration": None,
    "surface_distance": None,
    "vertex_distance": None,
    "current_to_output": None,
    "bbox_diagonal": 21.25,
    "stage_us": {"parse": 1, "repair": 2, "register": 3, "simplify": 4, "measure": 5, "encode": 6},
    "latency_us": 21,
    "a_field_of_a_later_version": True,
}
text = json.dumps(metrics).encode()
mesh = b"DRACO"
message = b"SMDF" + struct.pack("<HHII", 1, 0, len(text), len(mesh)) + text + mesh
(HERE / "delivered_frame.bin").write_bytes(message)

envelope = struct.pack("<H", 1)  # version
envelope += struct.pack("<BQ", 1, 7)  # seq
envelope += struct.pack("<B", 0)  # no capture_time_us
obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
envelope += struct.pack("<I", len(obj))
image = b"\x89PNG"
bundle = b"SMB1" + struct.pack("<I", len(envelope)) + envelope + obj + image
(HERE / "bundle.bin").write_bytes(bundle)

metrics["texture"] = {"id": "00112233445566778899aabbccddeeff", "media_type": "image/png",
                      "bytes": 4, "width": 2048, "height": 1024, "encoded": False}
text = json.dumps(metrics).encode()
message = b"SMDF" + struct.pack("<HHII", 1, 1, len(text), len(mesh)) + text + mesh + image
(HERE / "delivered_frame_with_image.bin").write_bytes(message)
