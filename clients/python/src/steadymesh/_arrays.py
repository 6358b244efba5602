"""Checks a mesh that somebody else has made, and brings it into the form of the wire."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import InvalidMeshError

MAX_COUNT = 2**32 - 1
"""The most vertices or faces: counts are u32."""


def float_rows(name: str, values: Any, columns: int, rows: int | None) -> npt.NDArray[Any]:
    """``values`` as little-endian float32 of shape (rows, columns), all of them finite."""
    array = _rows(name, values, (columns,), rows)
    if array.dtype.kind not in "fiu":
        raise InvalidMeshError(f"{name} must be numbers, not {array.dtype}")
    with np.errstate(over="ignore"):
        converted = np.ascontiguousarray(array, dtype="<f4")
    if not np.isfinite(converted).all():
        row = int(np.argwhere(~np.isfinite(converted))[0, 0])
        raise InvalidMeshError(f"{name}[{row}] is {array[row]}, which float32 has no number for")
    return converted


def color_rows(values: Any, rows: int) -> npt.NDArray[np.uint8]:
    """``values`` as uint8 of shape (rows, 4); without an alpha, all is opaque."""
    array = _rows("colors", values, (3, 4), rows)
    if array.dtype != np.uint8:
        hint = ": multiply by 255 and convert" if array.dtype.kind == "f" else ""
        raise InvalidMeshError(f"colors must be uint8 from 0 to 255, not {array.dtype}{hint}")
    if array.shape[1] == 4:
        return np.ascontiguousarray(array)
    opaque = np.full((rows, 4), 255, dtype=np.uint8)
    opaque[:, :3] = array
    return opaque


def face_rows(values: Any, vertex_count: int) -> npt.NDArray[Any]:
    """``values`` as little-endian uint32 of shape (faces, 3), each below ``vertex_count``."""
    array = _rows("faces", values, (3,), None)
    if array.size == 0:
        return np.empty((0, 3), dtype="<u4")
    if array.dtype.kind not in "iu":
        raise InvalidMeshError(f"faces must be integers, not {array.dtype}")
    lowest, highest = int(array.min()), int(array.max())
    if lowest < 0 or vertex_count <= highest:
        wrong = lowest if lowest < 0 else highest
        row = int(np.argwhere(array == wrong)[0, 0])
        raise InvalidMeshError(
            f"faces[{row}] is {array[row].tolist()}, but vertices are numbered from 0 and there "
            f"are {vertex_count}"
        )
    return np.ascontiguousarray(array, dtype="<u4")


def stamp(name: str, value: int | None) -> int | None:
    """A frame's number or time: None, or an integer of 64 bits."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise InvalidMeshError(f"{name} must be an integer, not {value!r}")
    if not 0 <= value < 2**64:
        raise InvalidMeshError(f"{name} is {value}, outside of 0 to 2^64 - 1")
    return int(value)


def _rows(name: str, values: Any, columns: tuple[int, ...], rows: int | None) -> npt.NDArray[Any]:
    """``values`` as an array of the right shape, whatever is in it."""
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InvalidMeshError(f"{name} is not a rectangular array: {error}") from error
    width = " or ".join(str(column) for column in columns)
    if array.ndim != 2 or array.shape[1] not in columns:
        if array.size == 0 and rows in (None, 0):
            return np.empty((0, columns[-1]), dtype=array.dtype)
        raise InvalidMeshError(
            f"{name} must have the shape ({'n' if rows is None else rows}, {width}), "
            f"not {array.shape}"
        )
    if rows is not None and len(array) != rows:
        raise InvalidMeshError(f"{len(array)} {name} for {rows} vertices: one each is needed")
    if len(array) > MAX_COUNT:
        raise InvalidMeshError(f"{len(array)} {name} are more than a frame can have")
    return array
