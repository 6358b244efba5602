"""Meshes for the tests."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from steadymesh import native

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float32)
FACE = np.array([[0, 1, 2]], dtype=np.uint32)


def sphere(rings: int = 24, radius: float = 1.0) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """A closed sphere around the origin."""
    columns = 2 * rings
    polar = np.linspace(0.0, np.pi, rings + 1)[1:-1]
    around = np.arange(columns) * (2.0 * np.pi / columns)
    grid_polar, grid_around = np.meshgrid(polar, around, indexing="ij")
    ring = np.stack(
        [
            np.sin(grid_polar) * np.cos(grid_around),
            np.sin(grid_polar) * np.sin(grid_around),
            np.cos(grid_polar),
        ],
        axis=-1,
    ).reshape(-1, 3)
    vertices = radius * np.concatenate([ring, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    top, bottom = len(vertices) - 2, len(vertices) - 1
    faces = []
    for column in range(columns):
        beside = (column + 1) % columns
        faces.append([top, column, beside])
        last = (rings - 2) * columns
        faces.append([bottom, last + beside, last + column])
        for row in range(rings - 2):
            corner, below = row * columns, (row + 1) * columns
            faces.append([corner + column, below + column, below + beside])
            faces.append([corner + column, below + beside, corner + beside])
    return vertices.astype(np.float32), np.array(faces, dtype=np.uint32)


def ply(vertices: npt.NDArray[Any], faces: npt.NDArray[Any]) -> bytes:
    """The mesh as a PLY file, in text."""
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar uint vertex_indices\nend_header\n"
    )
    lines = [" ".join(str(value) for value in row) for row in vertices.tolist()]
    lines += ["3 " + " ".join(str(value) for value in row) for row in faces.tolist()]
    return (head + "\n".join(lines) + "\n").encode()


def delivered(seq: int, drc: bytes = b"DRACO") -> bytes:
    """A delivered frame with next to no metrics."""
    return native.encode_delivered({"seq": seq}, drc)
