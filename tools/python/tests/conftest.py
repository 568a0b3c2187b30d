"""What the tests share."""

import os
import re

import eyebox
import numpy as np
import pytest

#: Minutes instead of seconds.
LONG = bool(os.environ.get("EYEBOX_PYTHON_LONG"))


def coded(kind, *codes):
    """Expects an exception of eyebox's with one of these codes."""

    def check(error):
        assert error.code in codes, error
        return True

    return pytest.raises(kind, check=check)


def named(kind, *words):
    """Expects an exception that names these arguments, values, files and numbers. How it puts them is free."""

    def check(error):
        missing = [word for word in words if not re.search(rf"(?<!\w){re.escape(word)}(?!\w)", str(error))]
        assert not missing, f"{missing} in {error!r}"
        return True

    return pytest.raises(kind, check=check)


def light_field(rows, columns, seed, *colors):
    """Views of one random picture, which moves by a pixel from view to view: (view row, view column, 40, 48) and colors."""
    picture = np.random.default_rng(seed).random((40 + rows, 48 + columns, *colors), dtype=np.float32)
    return np.array([[picture[r : r + 40, c : c + 48] for c in range(columns)] for r in range(rows)])


@pytest.fixture(scope="session")
def display():
    return eyebox.Display("planes8", size=(40, 48))


@pytest.fixture(scope="session")
def hologram(display):
    return eyebox.solve("builtin:still-life", display, color="green", frames=8, steps=3, pupils=4, seed=7, engine="cpu")
