"""The mapping of frozen nouns: read-only, and it can be pickled and copied."""

from collections.abc import Iterator, Mapping
from typing import Generic, TypeVar

K = TypeVar("K")
V_co = TypeVar("V_co", covariant=True)


class FrozenMapping(Mapping[K, V_co], Generic[K, V_co]):
    """A read-only copy of a mapping.

    Python's own view, `types.MappingProxyType`, can be neither pickled nor deep-copied.

    Examples
    --------
    >>> facts = FrozenMapping({"walls": 4})
    >>> facts["walls"], facts == {"walls": 4}
    (4, True)
    >>> facts["walls"] = 5
    Traceback (most recent call last):
    TypeError: 'FrozenMapping' object does not support item assignment
    """

    __slots__ = ("_content",)

    def __init__(self, content: Mapping[K, V_co] = {}, /) -> None:
        self._content = dict(content)

    def __getitem__(self, key: K) -> V_co:
        return self._content[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._content)

    def __len__(self) -> int:
        return len(self._content)

    def __repr__(self) -> str:
        return repr(self._content)

    def __reduce__(self) -> tuple[type, tuple[dict[K, V_co]]]:
        return type(self), (self._content,)
