"""Writes NetCDF-3 files with 64-bit offsets; SciPy takes longer to import than most motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple


class Stored(NamedTuple):
    """A variable of a file."""

    name: str
    dims: tuple[str, ...]
    kind: int  # INT or DOUBLE
    data: bytes  # big-endian
    texts: Mapping[str, str]  # attributes


INT, DOUBLE = 4, 6
_TEXT, _DIMENSIONS, _VARIABLES, _ATTRIBUTES = 2, 10, 11, 12


def netcdf(
    texts: Mapping[str, str], lengths: Mapping[str, int], variables: Sequence[Stored]
) -> bytes:
    """Content of a file with attributes, dimensions of these lengths, and variables."""
    number = {dim: k for k, dim in enumerate(lengths)}
    sizes = [_padded(dim.encode()) + _word(length) for dim, length in lengths.items()]
    start = b"CDF\2" + _word(0) + _list(_DIMENSIONS, sizes) + _attributes(texts)
    heads = [
        _padded(v.name.encode())
        + _word(len(v.dims))
        + b"".join(_word(number[dim]) for dim in v.dims)
        + _attributes(v.texts)
        + _word(v.kind)
        + _word(min(len(v.data), 2**32 - 1))
        for v in variables
    ]
    # the offset of its data, of eight bytes, follows the head of a variable
    place = len(start) + len(_list(_VARIABLES, heads)) + 8 * len(heads)
    for k, v in enumerate(variables):
        heads[k] += place.to_bytes(8, "big")
        place += len(v.data)
    return start + _list(_VARIABLES, heads) + b"".join(v.data for v in variables)


def _word(number: int) -> bytes:
    return number.to_bytes(4, "big")


def _padded(content: bytes) -> bytes:
    return _word(len(content)) + content + bytes(-len(content) % 4)


def _list(tag: int, items: Sequence[bytes]) -> bytes:
    return _word(tag if items else 0) + _word(len(items)) + b"".join(items)


def _attributes(texts: Mapping[str, str]) -> bytes:
    # some readers refuse an empty text
    each = texts.items()
    return _list(
        _ATTRIBUTES,
        [_padded(name.encode()) + _word(_TEXT) + _padded(t.encode() or b"\0") for name, t in each],
    )
