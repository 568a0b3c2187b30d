"""Tests that the types of settings have every setting of the library, and seeds from generators."""

import dataclasses
import re
import typing

import eyebox
import numpy as np
import pytest
from conftest import coded, light_field, named
from eyebox import _eyebox, _settings, _types

#: Tables of commands, which the library stores and does not use, and the settings of refinements.
TABLES = {"camera", "compare", "gaze", "show", "tiles", "viewing", "refine"}
#: Settings that are arguments of their own in a solve.
ARGUMENTS = {"frames", "steps", "pupils", "seed"}


def known(call):
    """Returns the names that an error about an unknown name lists."""
    with pytest.raises(ValueError) as caught:
        call()
    return set(re.findall(r"[a-z_]+", re.split(r"The settings are|expected one of", str(caught.value))[1]))


def fields(kind):
    return {field.name for field in dataclasses.fields(kind)}


def test_every_setting_of_the_library_has_a_type(display, hologram):
    library = known(lambda: eyebox.solve("builtin:plane", display, color="green", stpes=1)) - TABLES
    assert fields(eyebox.SolveSettings) == library
    assert set(_settings.AllFields.__annotations__) == library
    assert set(_settings.SolveFields.__annotations__) == library - ARGUMENTS - {"views"}
    steering = known(lambda: eyebox.Refiner(hologram, gian=1))
    # The library lists no key that is omitted by default, and accepts it.
    eyebox.Refiner(hologram, engine="cpu", storage="fp16")
    assert set(_settings.RefineFields.__annotations__) == steering - {"restart"} | {"storage"}
    keys = known(lambda: eyebox.Display("small", pich_um=1))
    assert set(_types.DisplayFields.__annotations__) == keys - {"name"}


def names(annotation):
    """Returns the names in a union of literals and other types."""
    if typing.get_origin(annotation) is typing.Literal:
        return {value for value in typing.get_args(annotation) if isinstance(value, str)}
    return set().union(*map(names, typing.get_args(annotation))) if typing.get_args(annotation) else set()


def test_every_name_of_a_type_is_one_of_the_library(display):
    """The library accepts each name that a type lists, and refuses another one with the same list."""
    small = eyebox.Display("small", size=(16, 16))
    how = {"first_phases": "random", "steps": 0, "frames": 1, "pupils": 1, "engine": "cpu"}
    scene = eyebox.Scene("builtin:plane", small, "green", views=2)
    for name, annotation in typing.get_type_hints(_settings.SolveFields).items():
        for value in names(annotation) - {"table"}:
            eyebox.solve(scene, small, **{**how, name: value})


def test_printed_settings_are_those_that_were_given(display):
    given = eyebox.SolveSettings(
        frames=2, steps=1, pupils=3, seed=9, method="lf2fs", diameter=("2mm", 6e-3), depth=("-1mm", "1mm"), seconds="1h",
        efficiency=0.5, diameters="uniform", sequence="random", evenness=0.25, patches=5, storage="fp32", window=2,
    )  # fmt: skip
    made = eyebox.solve("builtin:plane", display, color="green", settings=given, engine="cpu")
    printed = made.metadata["solve"]
    want = {**given.given(), "diameter": [2e-3, 6e-3], "depth": [-1e-3, 1e-3], "seconds": 3600.0, "window": "two"}
    assert {name: printed[name] for name in want} == want
    # Arguments replace settings.
    other = eyebox.solve("builtin:plane", display, color="green", settings=given, seed=4, patches=3, engine="cpu").metadata["solve"]
    assert {name for name in printed if printed[name] != other[name]} == {"seed", "patches"}
    with named(TypeError, "settings"):
        eyebox.solve("builtin:plane", display, settings={"steps": 3})
    with pytest.raises(TypeError):
        eyebox.SolveSettings(stpes=3)
    assert given.replace(steps=2) == dataclasses.replace(given, steps=2) and given.steps == 1


def test_a_generator_gives_the_seed(display, hologram):
    how = dict(color="green", frames=1, steps=1, pupils=2, engine="cpu")
    solve = lambda **more: eyebox.solve("builtin:plane", display, **how, **more)  # noqa: E731
    first, second = np.random.default_rng(5), np.random.default_rng(5)
    one, two, three = solve(rng=first), solve(rng=second), solve(rng=first)
    assert one == two and one != three
    assert one.metadata["solve"]["seed"] == int(np.random.default_rng(5).integers(0, 1 << 32, dtype=np.uint64))
    assert solve(rng=7) == solve(seed=7) and solve(rng=np.random.RandomState(3)) == solve(rng=np.random.RandomState(3))
    with named(TypeError, "rng", "seed"):
        solve(rng=7, seed=7)
    with named(TypeError, "rng", "dice"):
        solve(rng="dice")
    refined = [hologram.refine((1e-3, 0, 4e-3, 0), steps=1, engine="cpu", rng=np.random.default_rng(at)) for at in (1, 1, 2)]
    assert refined[0] == refined[1] and refined[0] != refined[2]
    assert hologram.refine((1e-3, 0, 4e-3, 0), steps=1, engine="cpu", rng=3) == hologram.refine((1e-3, 0, 4e-3, 0), steps=1, engine="cpu", seed=3)


def test_errors_have_the_name_of_their_argument(display, hologram):
    for name, call in {
        "diameter": lambda: hologram.view(diameter="wide"),
        "depth": lambda: hologram.view(depth=object()),
        "pupils": lambda: hologram.score(pupils=3),
        "display": lambda: hologram.encode(3),
        "color": lambda: eyebox.Scene("builtin:plane", display, 3),
        "scene": lambda: eyebox.solve(object(), display),
        "steps": lambda: eyebox.Refiner(hologram).step("many"),
        "callback": lambda: eyebox.solve("builtin:plane", display, callback=3),
        "size": lambda: eyebox.Display("small", size="large"),
        "clock": lambda: eyebox.show(hologram, display, clock="sand"),
        "variable": lambda: eyebox.Scene("builtin:plane", display, variable="a"),
        "views": lambda: eyebox.Scene(np.zeros((4, 4)), display, views=3),
        "engine": lambda: hologram.view(engine=3),
        "obstructed": lambda: hologram.view(obstructed=3),
    }.items():
        with pytest.raises((TypeError, ValueError)) as caught:
            call()
        assert getattr(caught.value, "argument", None) == name and str(caught.value).startswith(name), name


def test_another_scene_is_an_error_of_the_scene(display, hologram, tmp_path):
    """Another scene, a missing one and a changed one are the SceneErrors that the docstring of score states."""
    with coded(eyebox.SceneError, "hologram/other-scene"):
        hologram.score("builtin:plane", engine="cpu")
    file = tmp_path / "views.npy"
    np.save(file, light_field(2, 2, 1))
    eyebox.solve(file, display, color="green", frames=1, steps=0, engine="cpu").save(tmp_path / "one.zarr")
    made = eyebox.Hologram.load(tmp_path / "one.zarr")
    assert made.score(engine="cpu")
    np.save(file, light_field(2, 2, 3))
    with pytest.raises(eyebox.SceneError):
        made.score(engine="cpu")
    file.unlink()
    with pytest.raises(eyebox.SceneError):
        made.score(engine="cpu")


def test_live_errors_are_errors_of_eyebox():
    import importlib.util
    import pathlib

    live = pytest.importorskip("eyebox.live", exc_type=ImportError)
    assert issubclass(live.LiveError, eyebox.EyeboxError) and issubclass(live.Gone, live.LiveError)
    with pytest.raises(eyebox.EyeboxError):
        live.Live("not a name")
    with named(TypeError, "name"):
        live.Live(3)
    # The file also works alone, without the package.
    path = pathlib.Path(__file__).parents[3] / "tools" / "live-input" / "eyebox_live.py"
    spec = importlib.util.spec_from_file_location("eyebox_live", path)
    alone = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(alone)
    assert alone.LiveError.__bases__ == (Exception,) and alone.LiveError is not live.LiveError
    assert _eyebox.EyeboxError in live.LiveError.__mro__
