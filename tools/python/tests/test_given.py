"""Tests scenes from arrays of every kind, which are pictures with depths, focal stacks, layers and data of libraries."""

import eyebox
import numpy as np
import pytest
from conftest import coded, light_field, named

PICTURE = np.random.default_rng(5).random((40, 48, 3), dtype=np.float32)
#: A square in front of the image of the SLM, in meters.
DEPTH = np.zeros((40, 48), np.float32)
DEPTH[12:28, 16:32] = 1e-3


def scene(source, display, **options):
    return eyebox.Scene(source, display, "green", views=3, **options)


def same(one, other):
    np.testing.assert_array_equal(one.views, other.views)
    assert one.view_pitch == other.view_pitch and one.depth_range == other.depth_range


def pfm(path, values):
    with open(path, "wb") as file:
        file.write(b"Pf\n%d %d\n-1.0\n" % values.shape[::-1] + values[::-1].astype("<f4").tobytes())


def test_a_picture_with_depths_is_the_scene_of_its_files(display, tmp_path):
    from eyebox._given import write_tiff

    write_tiff(tmp_path / "picture.tif", PICTURE)
    pfm(tmp_path / "map.pfm", DEPTH)
    files = scene(tmp_path / "picture.tif", display, depth_map=tmp_path / "map.pfm", near="bright", depth=(0, 1e-3))
    for picture, depth_map in [(PICTURE, DEPTH), (tmp_path / "picture.tif", DEPTH), (PICTURE.tolist(), DEPTH.astype(">f8"))]:
        same(scene(picture, display, depth_map=depth_map), files)
    same(scene(PICTURE, display, depth_map=tmp_path / "map.pfm", near="bright", depth=(0, "1mm")), files)
    # Disparities and bytes of any scale have the depths of their ends.
    relative = (DEPTH * 2e5).astype(np.uint8)
    same(scene(PICTURE, display, depth_map=relative, depth=(0, 1e-3)), files)
    same(scene(PICTURE[..., 1], display, depth_map=DEPTH), scene(PICTURE[..., [1, 1, 1]], display, depth_map=DEPTH))


def test_its_hologram_is_scored_against_it(display, tmp_path):
    own = scene(PICTURE, display, depth_map=DEPTH, name="mine")
    made = eyebox.solve(own, display, frames=8, steps=1, pupils=1, engine="cpu")
    made.save(tmp_path / "one.zarr")
    loaded = eyebox.Hologram.load(tmp_path / "one.zarr")
    again = scene(PICTURE.copy(), display, depth_map=DEPTH.copy(), name="mine")
    assert loaded.scene == "mine" and again == own and hash(again) == hash(own)
    assert loaded.score(again, engine="cpu") == made.score(engine="cpu")
    other = DEPTH.copy()
    other[0, 0] = 5e-4
    with coded(eyebox.SceneError, "hologram/other-scene"):
        loaded.score(scene(PICTURE, display, depth_map=other), engine="cpu")
    with pytest.raises(eyebox.SceneError):
        loaded.score(engine="cpu")


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"depth_map": (DEPTH * 1e6).astype(np.uint16)}, "near uint16"),
        ({"depth_map": DEPTH[:20]}, "depth_map 20 40"),
        ({"depth_map": DEPTH * 1e3}, "mm"),
        ({"depth_map": np.full_like(DEPTH, np.nan)}, "depth_map"),
        ({"depth_map": DEPTH.astype(complex)}, "depth_map complex128"),
        ({"depth_map": DEPTH[None, None, None].repeat(3, 0)}, "depth_map (3, 40, 48)"),
        ({"depth_map": "/nowhere.png"}, "/nowhere.png"),
    ],
)
def test_maps_that_make_no_sense(display, wrong, says):
    with named((ValueError, TypeError), *says.split(" ") if "(" not in says else ["depth_map", "(3, 40, 48)"]) as caught:
        scene(PICTURE, display, **wrong)
    assert "eyebox-" not in str(caught.value)


def test_a_focal_stack_is_its_folder(display, tmp_path):
    from eyebox._given import write_tiff

    # Pictures with one depth are equal at every focus.
    pictures = [PICTURE, PICTURE, PICTURE]
    for number, one in enumerate(pictures):
        write_tiff(tmp_path / f"{number}.tif", one)
    (tmp_path / "lightfield.toml").write_text("focus_mm = [-1.0, 0.0, 1.0]\naperture_mm = 4.0\n")
    files = eyebox.Scene(tmp_path, display, "green")
    own = eyebox.Scene.from_focal_stack(pictures, ["-1mm", 0, 1e-3], "4mm", display, "green", name="stack")
    same(own, files)
    assert own.source == "stack" and own == eyebox.Scene.from_focal_stack(pictures, [-1e-3, 0, 1e-3], 4e-3, display, "green", name="stack")
    with named(ValueError, "focus", "2", "3"):
        eyebox.Scene.from_focal_stack(pictures, [0, 1e-3], 4e-3, display, "green")
    with named(ValueError, "pictures[1]"):
        eyebox.Scene.from_focal_stack([PICTURE, light_field(2, 2, 1)], [0, 1e-3], 4e-3, display, "green")


def test_layers_are_views_of_their_places(display):
    """A near layer moves against the display by its depth, and covers the layer behind it."""
    layers = np.zeros((2, 40, 48, 2), np.float32)
    layers[0, ..., 0], layers[0, ..., 1] = 0.25, 1
    layers[1, 12:28, 16:32] = 1
    made = eyebox.Scene.from_layers(layers, [0, "1mm"], display, "green", views=3)
    assert made.shape == (3, 3, 40, 48, 1) and made.depth_range == (0, 1e-3)
    assert made.view_pitch == pytest.approx(display.eyebox / 3)
    np.testing.assert_array_equal(np.unique(made.views[1, 1]), np.float32([0.25, 1]))
    step = made.view_pitch * 1e-3 / (display.focal_length * display.pitch)
    middle = lambda view: np.average(np.arange(48), weights=(view[..., 0] - 0.25).sum(axis=0))  # noqa: E731
    assert middle(made.views[1, 2]) - middle(made.views[1, 1]) == pytest.approx(-step, abs=0.05)
    # The order of the layers does not matter, and neither do integers.
    same(eyebox.Scene.from_layers(layers[::-1], [1e-3, 0], display, "green", views=3), made)
    whole = eyebox.Scene.from_layers(np.round(layers * 255).astype(np.uint8), [0, 1e-3], display, "green", views=3)
    assert whole.shape == made.shape and whole.views.max() == 1
    for wrong, depths, says in [(layers[..., :1], [0, 1e-3], "layers"), (layers, [0], "depths"), (layers * 2, [0, 1e-3], "layers")]:
        with pytest.raises(ValueError) as caught:
            eyebox.Scene.from_layers(wrong, depths, display, "green")
        assert caught.value.argument == says


def test_views_are_synthesized_on_request(display):
    # A near square moves by more than a pixel from view to view against the picture behind it.
    layers = np.ones((2, 40, 48, 2), np.float32)
    layers[0, ..., 0], layers[1, ..., 1] = PICTURE[..., 1], DEPTH > 0
    views = eyebox.Scene.from_layers(layers, [0, 1e-3], display, "green", views=3).views[..., 0]
    own = eyebox.Scene(views, display, "green")
    same(eyebox.Scene(views, display, "green", view_synthesis="cells"), own)
    between = eyebox.Scene(views, display, "green", view_synthesis="between")
    assert between.shape[0] * between.shape[1] > own.shape[0] * own.shape[1]
    with named(ValueError, "view_synthesis", "sharp") as caught:
        eyebox.Scene(views, display, "green", view_synthesis="sharp")
    assert caught.value.argument == "view_synthesis"


VIEWS = light_field(2, 3, 3)


def of_h5py(folder):
    h5py = pytest.importorskip("h5py")
    return h5py.File(folder / "views.h5", "w").create_dataset("views", data=VIEWS)


def of_zarr(folder):
    zarr = pytest.importorskip("zarr")
    made = zarr.create_array(store=str(folder / "views.zarr"), shape=VIEWS.shape, dtype=VIEWS.dtype)
    made[...] = VIEWS
    return made


def of_xarray(_):
    return pytest.importorskip("xarray").DataArray(VIEWS, dims=("v", "u", "y", "x"))


def of_dask(_):
    return pytest.importorskip("dask.array").from_array(VIEWS, chunks=(1, 1, 40, 48))


@pytest.mark.parametrize("make", [of_h5py, of_zarr, of_xarray, of_dask])
def test_data_of_other_libraries_is_an_array(display, make, tmp_path):
    same(eyebox.Scene(make(tmp_path), display, "green"), eyebox.Scene(VIEWS, display, "green"))


def test_pictures_of_pillow(display, tmp_path):
    image = pytest.importorskip("PIL.Image")
    levels = np.round(PICTURE * 255).astype(np.uint8)
    shown = image.fromarray(levels)
    whole = eyebox.Scene(levels, display, "green")
    same(eyebox.Scene(shown, display, "green"), whole)
    shown.putalpha(255)
    same(eyebox.Scene(shown, display, "green"), whole)
    shown.putalpha(0)
    assert eyebox.Scene(shown, display, "green").views.max() == 0
    # A palette stores indices instead of colors.
    few = image.fromarray(levels // 200 * 200).convert("P", palette=image.Palette.ADAPTIVE, colors=16)
    same(eyebox.Scene(few, display, "green"), eyebox.Scene(np.asarray(few.convert("RGB")), display, "green"))
    gray = image.fromarray(levels[..., 1])
    same(scene(gray, display, depth_map=image.fromarray(DEPTH)), scene(levels[..., 1], display, depth_map=DEPTH))
    with named(TypeError, "scene", "int32"):
        eyebox.Scene(gray.convert("I"), display, "green")


@pytest.mark.parametrize("dtype", [np.int32, np.int64, np.uint32, np.int16, np.int8, ">i4"])
def test_integers_without_a_full_scale_are_refused_with_a_remedy(display, dtype):
    levels = np.round(VIEWS * 100).astype(dtype)
    with named(TypeError, "scene", str(levels.dtype.newbyteorder("=")), "255"):
        eyebox.Scene(levels, display, "green")
    assert eyebox.Scene(levels / 255, display, "green").views.max() < 0.4
    with named(TypeError, "phases", "256"):
        eyebox.Hologram.from_phases(np.zeros((40, 48), dtype), display, "green")


@pytest.mark.parametrize("dtype", [">u2", "<u2", ">f4", ">f8", ">f2"])
def test_any_byte_order(display, dtype):
    levels = np.round(VIEWS * 65535).astype(np.uint16) if "u" in dtype else VIEWS.astype(dtype).astype(np.float32)
    same(eyebox.Scene(levels.astype(dtype), display, "green"), eyebox.Scene(levels, display, "green"))


def test_masked_values_are_no_light(display):
    masked = np.ma.masked_greater(VIEWS, 0.5)
    with named(ValueError, "scene", "filled"):
        eyebox.Scene(masked, display, "green")
    eyebox.Scene(masked.filled(0), display, "green", order="as-named")


def test_any_file_is_read(tmp_path):
    from eyebox._given import write_tiff

    np.save(tmp_path / "a.npy", VIEWS)
    np.savez(tmp_path / "a.npz", views=VIEWS, other=VIEWS[0])
    np.testing.assert_array_equal(eyebox.read(tmp_path / "a.npy"), VIEWS)
    np.testing.assert_array_equal(eyebox.read(tmp_path / "a.npz", "other"), VIEWS[0])
    with named(ValueError, "views", "other"):
        eyebox.read(tmp_path / "a.npz")
    write_tiff(tmp_path / "a.tif", PICTURE)
    np.testing.assert_array_equal(eyebox.read(tmp_path / "a.tif"), PICTURE)
    write_tiff(tmp_path / "gray.tif", PICTURE[..., :1])
    np.testing.assert_array_equal(eyebox.read(tmp_path / "gray.tif"), PICTURE[..., 0])
    (tmp_path / "a.ppm").write_bytes(b"P5 3 2 255\n" + bytes(range(6)))
    np.testing.assert_array_equal(eyebox.read(tmp_path / "a.ppm"), np.arange(6, dtype=np.uint8).reshape(2, 3))
    with pytest.raises(eyebox.EyeboxError):
        eyebox.read(tmp_path / "nothing.png")
    with named(TypeError, "variable"):
        eyebox.read(tmp_path / "a.ppm", "x")


@pytest.mark.parametrize("ending", ["mat", "h5", "zarr", "tif"])
def test_files_of_optional_packages_are_read(tmp_path, ending):
    file = tmp_path / f"views.{ending}"
    if ending == "mat":
        pytest.importorskip("scipy.io").savemat(file, {"views": VIEWS})
    elif ending == "h5":
        with pytest.importorskip("h5py").File(file, "w") as made:
            made["deep/views"] = VIEWS
    elif ending == "zarr":
        of_zarr(tmp_path)
    else:
        pytest.importorskip("tifffile").imwrite(file, VIEWS[0])
    np.testing.assert_array_equal(eyebox.read(file), VIEWS[0] if ending == "tif" else VIEWS)


def test_a_package_that_is_missing_is_named(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "zarr", None)
    with named(ImportError, "zarr"):
        eyebox.read(tmp_path / "x.zarr")


def test_scenes_say_what_was_measured(display):
    depths = scene(PICTURE, display, depth_map=DEPTH)
    found = depths.measure()
    assert found.trust == "stated" and found.depth_range == (0, pytest.approx(1e-3))
    assert found.depth_map.shape == (40, 48) and found.depth_map[20, 24] == pytest.approx(1e-3, abs=3e-4)
    assert abs(found.depth_map[4, 4]) < 3e-4 and found.brightest["green"] <= 1 and found.views_needed >= 1
    flat = eyebox.Scene(np.full((3, 3, 40, 48), 0.5), display, "green").measure()
    assert flat.trust != "stated" and flat.mean["green"] == pytest.approx(0.5)
    sheet = depths.contact_sheet(90)
    assert sheet.ndim == 3 and max(sheet.shape[:2]) <= 90 and sheet.shape[2] == 1


def test_displays_of_one_color():
    green = eyebox.Display("paper", size=(64, 64), color="green")
    assert list(green.wavelengths) == ["green"] and green.eyebox > eyebox.Display("paper", size=(64, 64)).eyebox
    assert list(eyebox.Display("paper", color=["red", "green"]).wavelengths) == ["red", "green"]
    for name in eyebox.presets():
        first = next(iter(eyebox.Display(name).wavelengths))
        assert list(eyebox.Display(name, color=first).wavelengths) == [first]
    with named(ValueError, "color", "'pink'", "red"):
        eyebox.Display("paper", color="pink")
