"""Tests that no write into arrays of the package changes a hologram, a scene or a display, by any protocol."""

import ctypes
import mmap

import eyebox
import numpy as np
import pytest
from conftest import light_field


def by_pointer(array):
    """Writes as libraries do that use only the pointer."""
    at = array.__array_interface__["data"][0]
    ctypes.memset(at, 0x3F, array.nbytes)


def by_dlpack(array):
    """Writes as torch.from_dlpack does, by the pointer of the capsule and without regard to its flags."""

    class Tensor(ctypes.Structure):
        _fields_ = [("data", ctypes.c_void_p), ("device", ctypes.c_int32 * 2), ("ndim", ctypes.c_int32), ("dtype", ctypes.c_int32)]

    try:
        capsule = array.__dlpack__()
        name, skip = b"dltensor", 0
    except (BufferError, ValueError):
        # The newer protocol exports read-only memory. It begins with a version, a manager, a deleter and flags.
        capsule = array.__dlpack__(max_version=(1, 0))
        name, skip = b"dltensor_versioned", 8 + 8 + 8 + 8
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    tensor = Tensor.from_address(get(capsule, name) + skip)
    ctypes.memset(tensor.data, 0x3F, array.nbytes)


def by_torch_from_dlpack(array):
    pytest.importorskip("torch").from_dlpack(array).fill_(0.75)


def by_torch_as_tensor(array):
    pytest.importorskip("torch").as_tensor(array).fill_(0.75)


def by_torch_from_numpy(array):
    pytest.importorskip("torch").from_numpy(array).fill_(0.75)


def by_numpy(array):
    np.asarray(array)[...] = 0.75


def by_flags(array):
    array.setflags(write=True)
    array[...] = 0.75


def by_base(array):
    base = array
    while isinstance(base, np.ndarray) and base.base is not None:
        base = base.base
    memoryview(base).cast("B")[:4] = b"\x3f\x3f\x3f\x3f"


def by_memoryview(array):
    memoryview(array)[0, 0, 0] = 0.75


def by_buffer(array):
    ctypes.c_char.from_buffer(array).value = b"\x3f"


def by_strides(array):
    np.lib.stride_tricks.as_strided(array, writeable=True)[...] = 0.75


def by_interface(array):
    class Writable:
        __array_interface__ = {**array.__array_interface__, "data": (array.__array_interface__["data"][0], False)}

    np.asarray(Writable())[...] = 0.75


WRITERS = [by_pointer, by_dlpack, by_torch_from_dlpack, by_torch_as_tensor, by_torch_from_numpy, by_numpy, by_flags, by_base]
WRITERS += [by_memoryview, by_buffer, by_strides, by_interface]


def digest(hologram, scene):
    """Returns all visible data of a hologram and a scene."""
    phases = [array.tobytes() for array in hologram.phases.values()]
    views = [array.tobytes() for array in hologram.phases_view.values()]
    seen = hologram.view(engine="cpu").tobytes(), hologram.score(scene, engine="cpu"), hologram.encode(hologram.display).tobytes()
    return phases, views, seen, hologram.metadata, hologram.exposures, scene.views.tobytes(), scene.photograph(engine="cpu").tobytes()


ARRAYS = {
    "phases": lambda hologram, scene: hologram.phases["green"],
    "phases_view": lambda hologram, scene: hologram.phases_view["green"],
    "view": lambda hologram, scene: hologram.view(engine="cpu"),
    "encode": lambda hologram, scene: hologram.encode(hologram.display),
    "views": lambda hologram, scene: scene.views,
    "photograph": lambda hologram, scene: scene.photograph(engine="cpu"),
}


@pytest.mark.parametrize("writer", WRITERS, ids=lambda writer: writer.__name__)
@pytest.mark.parametrize("what", ARRAYS)
def test_what_is_written_changes_nothing(display, hologram, what, writer):
    scene = eyebox.Scene("builtin:still-life", display, "green")
    before = digest(hologram, scene)
    array = ARRAYS[what](hologram, scene)
    try:
        writer(array)
    except (ValueError, BufferError, TypeError, RuntimeError):
        pass
    assert digest(hologram, scene) == before


@pytest.mark.parametrize("writer", WRITERS, ids=lambda writer: writer.__name__)
def test_what_is_written_into_what_was_given_changes_nothing(display, writer):
    phases = np.random.default_rng(1).uniform(-3, 3, (1, 40, 48)).astype(np.float32)
    light = light_field(3, 3, 2)
    hologram = eyebox.Hologram.from_phases(phases, display, "green", exposure=1.0)
    scene = eyebox.Scene(light, display, "green")
    before = hologram.phases["green"].tobytes(), scene.views.tobytes()
    for array in (phases, light):
        try:
            writer(array)
        except (ValueError, BufferError, TypeError, RuntimeError, NotImplementedError):
            pass
    assert (hologram.phases["green"].tobytes(), scene.views.tobytes()) == before


def test_video_frames_are_the_callers(hologram, display):
    with eyebox.show(hologram, display, clock="simulated") as session:
        first = session.frame()
        kept = first.pixels.copy()
        second = session.frame()
        second.pixels[...] = 7
        assert (first.pixels == kept).all()
        frames = [session.frame() for _ in range(4)]
    assert all((frame.pixels != 7).any() for frame in frames)


def test_phases_are_copies_and_views_are_read_only(hologram):
    own, view = hologram.phases["green"], hologram.phases_view["green"]
    assert own.flags.writeable and not view.flags.writeable and own.shape == view.shape == hologram.shape == (8, 40, 48)
    assert own.dtype == view.dtype == np.float32 and own.flags.c_contiguous and view.flags.c_contiguous
    own[0, 0, 0] = 3
    assert hologram.phases["green"][0, 0, 0] != 3
    with pytest.raises(ValueError):
        view[0, 0, 0] = 3
    assert view[0, 0, 0] != 3
    # A view has no memory of its own before the first write, and it outlives its hologram.
    base = view
    while isinstance(base, np.ndarray):
        base = base.base
    assert isinstance(base, (mmap.mmap, memoryview))
    made = eyebox.Hologram.from_phases(np.full((40, 48), 0.25, np.float32), hologram.display, "green")
    kept = made.phases_view["green"]
    del made
    assert (kept == 0.25).all()


def test_an_optimizer_of_ones_own_leaves_the_hologram(display):
    """Phases of a hologram can be the start of another optimizer."""
    hologram = eyebox.solve("builtin:still-life", display, color="green", frames=2, steps=12, pupils=8, engine="cpu")
    before = hologram.score(engine="cpu")
    for own in (hologram.phases["green"], hologram.phases_view["green"]):
        phases = np.from_dlpack(own) if own.flags.writeable else np.array(own)
        for _ in range(3):
            phases += 0.3
    assert hologram.score(engine="cpu") == before
