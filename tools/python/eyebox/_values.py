"""Objects that never change, so that a copy is the object itself, and objects that are equal by their content."""

from __future__ import annotations

from typing import Any, TypeVar

_Object = TypeVar("_Object", bound="Unchanging")


class Unchanging:
    """An object that never changes. Its copies are the object itself."""

    __slots__ = ()

    def __copy__(self: _Object) -> _Object:
        return self

    def __deepcopy__(self: _Object, _: Any) -> _Object:
        return self


class OfContent(Unchanging):
    """An object that equals another one of its class with the same shape and the same digest of its content."""

    __slots__ = ()

    @property
    def shape(self) -> tuple[int, ...]:
        raise NotImplementedError

    def _content(self) -> bytes:
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return False
        return self is other or (self.shape == other.shape and self._content() == other._content())

    def __hash__(self) -> int:
        return hash(self._content())
