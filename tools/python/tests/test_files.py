"""Tests phases and views in the files of NumPy, MATLAB and HDF5."""

import eyebox
import numpy as np
import pytest
from conftest import light_field, named

RNG = np.random.default_rng(5)
#: Phases as (sub-frame, row, column), and the same phases in MATLAB's order.
PHASES = RNG.uniform(-3, 3, (4, 40, 48)).astype(np.float32)
LAST = np.moveaxis(PHASES, 0, 2)
VIEWS = light_field(3, 5, 5)


def npz(path, **arrays):
    np.savez(path, **arrays)


def mat(path, **arrays):
    pytest.importorskip("scipy.io").savemat(path, arrays)


def h5(path, **arrays):
    with pytest.importorskip("h5py").File(path, "w") as file:
        for name, array in arrays.items():
            file[name] = array


def mat73(path, **arrays):
    """Writes a file as MATLAB 7.3 does, with HDF5 after 512 bytes of MATLAB and with axes in reverse order."""
    with pytest.importorskip("h5py").File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            file[name] = np.ascontiguousarray(array.T)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")


def same(path, display, want=PHASES, **options):
    made = eyebox.Hologram.from_phases(path, display, "green", exposure=1.0, **options)
    turn = np.mod(made.phases["green"] - want + np.pi, 2 * np.pi) - np.pi
    return made.shape == want.shape and np.abs(turn).max() < 1e-5


#: Files of phases, each with its name, its writer, its arrays and options.
PHASE_FILES = {
    "npz": ("x.npz", npz, dict(phases=PHASES), {}),
    "npz beside other numbers": ("x.npz", npz, dict(phases=PHASES, wavelength=np.array(520e-9), steps=np.arange(3)), {}),
    "npz, one of several": ("x.npz", npz, dict(a=PHASES, b=PHASES[::-1]), dict(variable="a")),
    "npz of float64": ("x.npz", npz, dict(phases=PHASES.astype(float)), {}),
    "npy": ("x.npy", lambda path, a: np.save(path, a), dict(a=PHASES), {}),
    "mat": ("x.mat", mat, dict(phases=LAST), {}),
    "mat as Python wrote it": ("x.mat", mat, dict(phases=PHASES), {}),
    "mat beside texts": ("x.mat", mat, dict(phases=LAST, author="somebody", wavelength=520e-9), {}),
    "mat 7.3": ("x.mat", mat73, dict(phases=LAST), {}),
    "mat 7.3, one of several": ("x.mat", mat73, dict(a=LAST, b=-LAST), dict(variable="a")),
    "h5": ("x.h5", h5, dict(phases=PHASES), {}),
    "hdf5 in a group": ("x.hdf5", h5, {"solved/phases": PHASES, "pitch": 8e-6}, {}),
    "hdf5, one of several": ("x.hdf5", h5, {"a/p": PHASES, "b/p": -PHASES}, dict(variable="a/p")),
    "an h5 named mat": ("x.mat", mat73, dict(green=LAST), {}),
}


@pytest.mark.parametrize("case", PHASE_FILES)
def test_phases_in_a_file_are_those_of_its_array(tmp_path, display, case):
    name, write, arrays, options = PHASE_FILES[case]
    write(tmp_path / name, **arrays)
    if "green" in arrays:
        made = eyebox.Hologram.from_phases(tmp_path / name, display, exposure=1.0)
        assert made.shape == PHASES.shape and list(made.phases) == ["green"]
        return
    assert same(tmp_path / name, display, **options)


@pytest.mark.parametrize("write", [npz, mat, mat73, h5])
def test_colors_are_arrays_by_their_names(tmp_path, write):
    paper = eyebox.Display("paper", size=(40, 48))
    arrays = {color: (LAST if write in (mat, mat73) else PHASES) + at for at, color in enumerate(("blue", "red", "green"))}
    path = tmp_path / {npz: "x.npz", h5: "x.h5"}.get(write, "x.mat")
    write(path, **arrays)
    made = eyebox.Hologram.from_phases(path, paper, exposure=1.0)
    assert made.colors == ["red", "green", "blue"]
    for at, color in enumerate(("blue", "red", "green")):
        turn = np.mod(made.phases[color] - PHASES - at + np.pi, 2 * np.pi) - np.pi
        assert np.abs(turn).max() < 1e-5


VIEW_FILES = {
    "npz, one of several": ("x.npz", npz, dict(a=VIEWS, b=1 - VIEWS), dict(variable="a")),
    "mat": ("x.mat", mat, dict(LF=VIEWS), {}),
    "mat 7.3": ("x.mat", mat73, dict(LF=VIEWS), {}),
    "mat in colour": ("x.mat", mat, dict(LF=np.stack([VIEWS, VIEWS, VIEWS], -1)), {}),
    "mat 7.3 in colour": ("x.mat", mat73, dict(LF=np.stack([0 * VIEWS, VIEWS, VIEWS], -1)), {}),
    "mat beside a disparity": ("x.mat", mat, dict(LF=VIEWS, disparity=np.ones((40, 48))), {}),
    "h5": ("x.h5", h5, dict(LF=VIEWS), {}),
    "h5 in a group": ("x.h5", h5, {"scene/LF": VIEWS, "scene/GT_DEPTH": np.ones((40, 48))}, {}),
    "hdf5, one of several": ("x.hdf5", h5, {"a": VIEWS, "b": 1 - VIEWS}, dict(variable="a")),
    "h5 in 8 bits": ("x.h5", h5, dict(LF=np.round(255 * VIEWS).astype(np.uint8)), {}),
    "h5 in float64": ("x.h5", h5, dict(LF=VIEWS.astype(float)), {}),
}


@pytest.mark.parametrize("case", VIEW_FILES)
def test_views_in_a_file_are_those_of_its_array(tmp_path, display, case):
    name, write, arrays, options = VIEW_FILES[case]
    write(tmp_path / name, **arrays)
    scene = eyebox.Scene(tmp_path / name, display, "green", **options)
    first = next(iter(array for array in arrays.values() if array.ndim > 3))
    want = eyebox.Scene(first, display, "green")
    np.testing.assert_array_equal(scene.views, want.views)
    assert scene.source == str(tmp_path / name)


def text(path, **_):
    path.write_text("no file of arrays")


REFUSED = {
    "several": ("x.npz", npz, dict(a=PHASES, b=PHASES), {}, ValueError, "variable", "a", "b"),
    "none": ("x.npz", npz, dict(a=np.arange(3)), {}, ValueError, "a", "(3,)"),
    "another name": ("x.npz", npz, dict(a=PHASES), dict(variable="b"), ValueError, "'b'", "a"),
    "objects": ("x.npz", npz, dict(a=np.array([[object()]])), {}, ValueError, "x.npz"),
    "another size": ("x.npz", npz, dict(a=PHASES[:, 1:]), {}, ValueError, "39", "48"),
    "sub-frames last": ("x.npz", npz, dict(a=LAST), {}, ValueError, "40, 48, 4"),
    "integers": ("x.npz", npz, dict(a=np.ones((4, 40, 48), int)), {}, TypeError, "int64"),
    "text": ("x.npz", text, {}, {}, ValueError, "x.npz"),
    "text as mat": ("x.mat", text, {}, {}, ValueError, "x.mat"),
    "text as h5": ("x.h5", text, {}, {}, ValueError, "x.h5"),
    "cut off": ("x.h5", lambda path, **_: path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(40)), {}, {}, ValueError, "x.h5"),
    "cut off as npz": ("x.npz", lambda path, **_: path.write_bytes(b"PK\3\4" + bytes(40)), {}, {}, ValueError, "x.npz"),
    "not there": ("y.mat", lambda path, **_: None, {}, {}, FileNotFoundError, "y.mat"),
    "variable of an array": (None, None, {}, dict(variable="a"), TypeError, "variable"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_holds_no_phases_is_refused(tmp_path, display, case):
    name, write, arrays, options, kind, *words = REFUSED[case]
    path = PHASES
    if name:
        path = tmp_path / name
        write(path, **arrays)
    with named(kind, *words):
        eyebox.Hologram.from_phases(path, display, "green", exposure=1.0, **options)


def test_a_cube_in_matlab_is_asked_for(tmp_path):
    """The sub-frames of a cube may be the first axis or the last."""
    small = eyebox.Display("small", size=(32, 32))
    cube = RNG.uniform(-3, 3, (32, 32, 32))
    mat(tmp_path / "x.mat", phases=cube)
    with named(ValueError, "x.mat", "(32, 32, 32)"):
        eyebox.Hologram.from_phases(tmp_path / "x.mat", small, "green", exposure=1.0)
    # The remedy of the message works.
    array = pytest.importorskip("scipy.io").loadmat(tmp_path / "x.mat")["phases"]
    assert eyebox.Hologram.from_phases(array, small, "green", exposure=1.0).frames == 32


@pytest.mark.parametrize(("name", "missing", "says"), [("x.mat", "scipy.io", "pip install scipy"), ("x.h5", "h5py", "pip install h5py")])
def test_a_library_that_is_missing_is_named(tmp_path, display, monkeypatch, name, missing, says):
    (mat if name == "x.mat" else h5)(tmp_path / name, phases=PHASES)
    monkeypatch.setitem(__import__("sys").modules, missing, None)
    with named(ImportError, says):
        eyebox.Hologram.from_phases(tmp_path / name, display, "green", exposure=1.0)
