"""Checks and fixtures that the tests share."""

import os
import re

import eyebox
import numpy as np
import pytest

#: True for tests that take minutes instead of seconds.
LONG = bool(os.environ.get("EYEBOX_PYTHON_LONG"))


def coded(kind, *codes):
    """Expects an exception of eyebox with one of these codes."""

    def check(error):
        assert error.code in codes, error
        return True

    return pytest.raises(kind, check=check)


def named(kind, *words):
    """Expects an exception that names these arguments, values, files and numbers, in any wording."""

    def check(error):
        missing = [word for word in words if not re.search(rf"(?<!\w){re.escape(word)}(?!\w)", str(error))]
        assert not missing, f"{missing} in {error!r}"
        return True

    return pytest.raises(kind, check=check)


def light_field(rows, columns, seed, *colors):
    """Makes views (view row, view column, 40, 48, colors) of a random picture, which moves by a pixel per view."""
    picture = np.random.default_rng(seed).random((40 + rows, 48 + columns, *colors), dtype=np.float32)
    return np.array([[picture[r : r + 40, c : c + 48] for c in range(columns)] for r in range(rows)])


@pytest.fixture(scope="session")
def display():
    return eyebox.Display("planes8", size=(40, 48))


@pytest.fixture(scope="session")
def hologram(display):
    return eyebox.solve("builtin:still-life", display, color="green", frames=8, steps=3, pupils=4, seed=7, engine="cpu")
