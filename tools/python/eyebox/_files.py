"""Reads arrays from files of NumPy (.npy, .npz), MATLAB (.mat), HDF5 (.h5, .hdf5) and Zarr, and from pictures."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Callable

import numpy as np
from numpy.typing import NDArray

from . import _arguments, _eyebox

if TYPE_CHECKING:
    from ._types import Path

HDF5 = b"\x89HDF\r\n\x1a\n"
ENDINGS = (".npy", ".npz", ".mat", ".h5", ".hdf5")
COLORS = ("red", "green", "blue")


def is_arrays(path: Any) -> bool:
    """Returns whether a file has the extension of arrays that Python reads."""
    return _arguments.is_path(path) and os.fsdecode(path).lower().endswith(ENDINGS) and not os.path.isdir(path)


class Arrays:
    """The arrays of a file by their names. Each array is read on demand.

    Attributes
    ----------
    matlab : bool
        True if the axes are in MATLAB's order, with sub-frames and views last.
    """

    def __init__(self, path: Any, what: str) -> None:
        self.path = _arguments.path(path, what)
        with open(self.path, "rb") as file:
            head = file.read(128)
        self.matlab = False
        self.read: Callable[[str], Any]
        self.shapes: dict[str, tuple[int, ...]]
        if head.startswith(b"\x93NUMPY"):
            whole = self._numpy()
            self.shapes, self.read = {"": whole.shape}, lambda name: whole
        elif head.startswith(b"PK"):
            self._npz()
        elif self._is_hdf5():
            self._hdf5()
        elif head.startswith(b"MATLAB 5.0"):
            self._mat()
        else:
            raise ValueError(f"{self.path}: no NumPy, MATLAB or HDF5 file by its first bytes: save it again, or give its array")

    def _numpy(self) -> Any:
        try:
            return np.load(self.path, allow_pickle=False)
        except Exception as error:
            raise ValueError(f"{self.path}: damaged, or an array of Python's objects ({error}): save numbers") from error

    def _is_hdf5(self) -> bool:
        # A user block may come first, as in files of MATLAB 7.3.
        with open(self.path, "rb") as file:
            for at in (0, 512, 1024, 2048):
                file.seek(at)
                if file.read(8) == HDF5:
                    return True
        return False

    def _npz(self) -> None:
        stored = self._numpy()
        self.read = stored.__getitem__
        self.shapes = {}
        for name in stored.files:
            try:
                array = stored[name]
            except Exception as error:
                raise ValueError(f"{self.path}: {name!r} is damaged or holds Python's objects ({error}): save numbers") from error
            if array.dtype.kind in "fiub":
                self.shapes[name] = array.shape

    def _mat(self) -> None:
        try:
            from scipy.io import loadmat, whosmat
        except ImportError:
            raise ImportError(f"{self.path}: MATLAB's files need SciPy: pip install scipy") from None
        try:
            numbers = ("single", "double", "uint8", "uint16", "logical")
            self.shapes = {name: shape for name, shape, kind in whosmat(self.path) if kind in numbers}
        except Exception as error:
            raise ValueError(f"{self.path}: damaged ({error}): save it again") from error
        self.read = lambda name: loadmat(self.path, variable_names=[name])[name]
        self.matlab = True

    def _hdf5(self) -> None:
        try:
            import h5py
        except ImportError:
            raise ImportError(f"{self.path}: HDF5 files, such as MATLAB's of version 7.3, need h5py: pip install h5py") from None
        self.matlab = self.path.lower().endswith(".mat")
        # MATLAB writes its axes in reverse order.
        order = -1 if self.matlab else 1
        self.shapes = {}

        def note(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub" and not name.startswith("#"):
                self.shapes[name] = item.shape[::order]

        def read(name: str) -> Any:
            with h5py.File(self.path, "r") as file:
                array = file[name][()]
            return array.T if self.matlab else array

        try:
            with h5py.File(self.path, "r") as file:
                file.visititems(note)
        except OSError as error:
            raise ValueError(f"{self.path}: damaged ({error}): save it again") from error
        self.read = read

    def choose(self, variable: str | None, axes: tuple[int, ...], right: str) -> str:
        """Returns the name of the only array whose number of axes is in ``axes``, or checks a given name."""
        fit = [name for name, shape in self.shapes.items() if len(shape) in axes and 0 not in shape and max(shape) > 1]
        if variable is None and len(fit) == 1:
            return fit[0]
        there = ", ".join(f"{name} {shape}" for name, shape in self.shapes.items()) or "none of numbers"
        if variable is None:
            raise ValueError(
                f"{self.path}: {len(fit)} of its arrays may be {right}: give variable=NAME; it has {there}"
                if fit
                else f"{self.path}: no array of {right}; it has {there}"
            )
        if variable not in self.shapes:
            raise ValueError(f"{self.path}: no array is named {variable!r}; it has {there}")
        return variable


def read(path: Path, variable: str | None = None) -> NDArray[Any]:
    """Reads an array from a file, with its stored values.

    Parameters
    ----------
    path : path
        .npy, .npz, .mat (needs SciPy, or h5py for version 7.3), .h5 or .hdf5 (needs h5py), .zarr (needs zarr), or a
        picture (PNG, JPEG, TIFF, BMP, PPM, EXR). A TIFF of several pages, and of integers of 32 bits, needs tifffile.
    variable : str, optional
        Name of the array in a file with several arrays.

    Returns
    -------
    numpy.ndarray
        Array with the axes of the file. A picture is (row, column) or (row, column, channel), as uint8, uint16 or
        float32.

    Raises
    ------
    ValueError
        If the file is damaged, or has several arrays and ``variable`` is not given.
    ImportError
        If a package for this kind of file is missing. The message names the package.
    """
    named = _arguments.path(path, "path")
    ending = os.path.splitext(named.rstrip("/"))[1].lower()
    if ending == ".zarr":
        return _zarr(named, variable)
    if ending in ENDINGS:
        arrays = Arrays(named, "path")
        whole = arrays.read(arrays.choose(variable, tuple(range(1, 33)), "one array"))
        return np.asarray(whole)
    if variable is not None:
        raise _arguments.wrong(TypeError, "variable", f"names an array in a file of several: {named} is a picture")
    if ending in (".tif", ".tiff") and (pages := _tiff_pages(named)) is not None:
        return pages
    stored = _eyebox.read_picture(named)
    return stored[..., 0] if stored.shape[2] == 1 else stored


def _zarr(path: str, variable: str | None) -> NDArray[Any]:
    try:
        import zarr
    except ImportError:
        raise ImportError(f"{path}: Zarr arrays need zarr: pip install zarr") from None
    if not os.path.isdir(path):
        raise FileNotFoundError(f"{path}: there is no such folder")
    opened: Any = zarr.open(path, mode="r")
    if hasattr(opened, "shape"):
        return np.asarray(opened[...])
    there = {name: item.shape for name, item in opened.members() if hasattr(item, "shape")}
    if variable is None and len(there) == 1:
        [variable] = there
    if variable not in there:
        names = ", ".join(f"{name} {shape}" for name, shape in there.items()) or "none"
        said = "no array is named " + repr(variable) if variable is not None else f"{len(there)} arrays: give variable=NAME"
        raise ValueError(f"{path}: {said}; it has {names}")
    return np.asarray(opened[variable][...])


def _tiff_pages(path: str) -> NDArray[Any] | None:
    """Reads a TIFF by tifffile, or returns None if it is not installed."""
    try:
        import tifffile
    except ImportError:
        return None
    try:
        return np.asarray(tifffile.imread(path))
    except FileNotFoundError:
        raise
    except Exception as error:
        raise ValueError(f"{path}: damaged ({error}): save it again") from error


def views(path: Any, variable: str | None) -> Any:
    """Reads the array of a light field."""
    arrays = Arrays(path, "scene")
    right = "views, (view row, view column, row, column[, 3])"
    return arrays.read(arrays.choose(variable, (4, 5), right))


def phases(path: Any, variable: str | None, size: tuple[int, int]) -> Any:
    """Reads phases (sub-frame, row, column) for a display of this size.

    Returns an array, or a dict by the names of colors.
    """
    if os.path.splitext(os.fsdecode(path))[1].lower() in (".tif", ".tiff"):
        return read(path, variable)
    arrays = Arrays(path, "phases")
    named = [name for name in COLORS if name in arrays.shapes]
    if variable is None and named:
        return {name: _sub_frames_first(arrays, name, size) for name in named}
    right = "phases, (sub-frame, row, column) or (row, column)"
    return _sub_frames_first(arrays, arrays.choose(variable, (2, 3), right), size)


def _sub_frames_first(arrays: Arrays, name: str, size: tuple[int, int]) -> Any:
    """Reads an array and moves its sub-frames to the first axis.

    MATLAB writes sub-frames last, and Python writes them first. The size of the display shows the order.
    """
    array, shape = arrays.read(name), arrays.shapes[name]
    if not arrays.matlab or len(shape) != 3:
        return array
    first, last = shape[1:] == size, shape[:2] == size
    if first and last:
        raise ValueError(
            f"{arrays.path}: {name} has the shape {shape}, whose sub-frames may be the first axis or the last: "
            "give the array, (sub-frame, row, column), instead of the file"
        )
    return np.moveaxis(array, 2, 0) if last else array
