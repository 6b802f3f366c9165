"""Nouns as bytes, for workers in other processes.

Nouns hold read-only views of dictionaries, which pickle does not know.
"""

import io
import pickle
from types import MappingProxyType
from typing import Any


class _Packer(pickle.Pickler):
    """Packs read-only views of dictionaries as what they show."""

    def reducer_override(self, thing: object) -> Any:  # noqa: ANN401 - pickle's own contract
        """Return how to make a view again; everything else is pickle's business."""
        if isinstance(thing, MappingProxyType):
            return _view, (dict(thing),)
        return NotImplemented


def _view(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


def packed(thing: object) -> bytes:
    """Return an object as bytes.

    Raises
    ------
    pickle.PicklingError, AttributeError, TypeError
        If something in it cannot be sent, such as a function made in another one.
    """
    stream = io.BytesIO()
    _Packer(stream, protocol=pickle.HIGHEST_PROTOCOL).dump(thing)
    return stream.getvalue()


def unpacked(data: bytes) -> Any:  # noqa: ANN401 - whatever was packed
    """Return the object of `packed`; only for bytes from a worker or a run of one's own."""
    return pickle.loads(data)  # noqa: S301
