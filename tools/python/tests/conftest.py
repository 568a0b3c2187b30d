"""What the tests share."""

import os

import eyebox
import pytest

#: Minutes instead of seconds.
LONG = bool(os.environ.get("EYEBOX_PYTHON_LONG"))


@pytest.fixture(scope="session")
def display():
    return eyebox.Display("planes8", size=(40, 48))


@pytest.fixture(scope="session")
def hologram(display):
    return eyebox.solve("builtin:still-life", display, color="green", frames=8, steps=3, pupils=4, seed=7, engine="cpu")
