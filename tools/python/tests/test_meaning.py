"""Tests the meaning of numbers in full scale, units and unknown depths. Wrong ones are refused with a valid remedy."""

import struct
import warnings
import zlib

import eyebox
import numpy as np
import pytest

VIEWS = np.tile(np.linspace(0, 1, 48, dtype=np.float32), (3, 3, 40, 1))


def scene(source, display, **options):
    return eyebox.Scene(source, display, "green", **options)


@pytest.mark.parametrize("white", [100, 255, 1023, 4095, 65535])
def test_floats_of_another_full_scale_are_refused(display, white):
    with pytest.raises(eyebox.SceneError):
        scene(VIEWS * white, display)
    right = scene(VIEWS * white / white, display)
    np.testing.assert_allclose(right.views[..., 0], VIEWS, atol=1e-6)


@pytest.mark.parametrize("white", [511, 1023, 4095, 16383])
def test_words_of_fewer_bits_are_refused(display, white):
    words = np.round(VIEWS * white).astype(np.uint16)
    with pytest.raises(eyebox.SceneError):
        scene(words, display)
    right = scene((words * (65535 / white)).astype(np.uint16), display).views
    np.testing.assert_allclose(right.max(), 1, atol=0.01)


def test_stretched_bytes_and_dark_floats_are_read(display):
    dark = np.round(VIEWS * 60).astype(np.uint8)
    words, same = scene(dark.astype(np.uint16) * 257, display), scene(dark, display)
    np.testing.assert_allclose(words.views, same.views, atol=1e-6)
    np.testing.assert_allclose(scene(VIEWS * 0.1, display).views[..., 0], VIEWS * 0.1, atol=1e-6)


def test_highlights_and_rounding_errors_are_said(display):
    views = VIEWS.copy()
    views[1, 1, 5, 7], views[0, 0, 9, 9] = 30, -1e-6
    with pytest.warns(UserWarning) as said:
        light = scene(views, display).views[..., 0]
    assert len(said) == 2
    assert light[1, 1, 5, 7] == 1 and light[0, 0, 9, 9] == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene(VIEWS, display)


def test_a_black_scene_has_no_psnr(display):
    black = scene(np.zeros((3, 3, 40, 48), np.float32), display)
    hologram = eyebox.Hologram.from_phases(np.full((1, *display.resolution), 0.5, np.float32), display, "green")
    assert hologram.score(black, [(0, 0, 4e-3, 0)])[0].psnr is None
    assert hologram.score(scene(VIEWS, display), [(0, 0, 4e-3, 0)])[0].psnr is not None


@pytest.mark.parametrize("pitch", [2.2, 0.5, 2.2e-6, 2200])
def test_view_pitches_in_another_unit_are_refused(display, pitch):
    with pytest.raises(eyebox.EyeboxError):
        scene(VIEWS, display, view_pitch=pitch)
    with pytest.raises(eyebox.EyeboxError):
        scene("builtin:plane", display, view_pitch=pitch)
    assert scene(VIEWS, display, view_pitch=2.2e-3).view_pitch == 2.2e-3


@pytest.mark.parametrize("depth", [1.0, -3.0, 14.0])
def test_depths_in_another_unit_are_refused(display, depth):
    hologram = eyebox.solve("builtin:plane", display, "green", frames=1, steps=1, engine="cpu")
    with pytest.raises(eyebox.EyeboxError):
        hologram.view(depth=depth)
    with pytest.raises(eyebox.EyeboxError):
        scene(VIEWS, display).photograph(depth=depth)
    assert hologram.view(depth=depth * 1e-3).shape[2] == 1


@pytest.mark.parametrize("phases", ["large", "levels", "degrees"])
def test_phases_that_are_no_radians_are_refused(display, phases):
    ramp = np.linspace(0, 1, np.prod(display.resolution)).reshape(1, *display.resolution)
    given, radians = {
        "large": (ramp * 1e9, np.angle(np.exp(1j * ramp * 1e9))),
        "levels": (np.round(ramp * 255), ramp * 2 * np.pi),
        "degrees": (np.round(ramp * 360), ramp * 2 * np.pi),
    }[phases]
    with pytest.raises(eyebox.EyeboxError):
        eyebox.Hologram.from_phases(given, display, "green")
    eyebox.Hologram.from_phases(radians, display, "green")


def png16(path, values):
    """Writes gray 16-bit values as a PNG."""
    rows, columns = values.shape
    raw = b"".join(b"\0" + row.astype(">u2").tobytes() for row in values)
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", columns, rows, 16, 0, 0, 0, 0)), (b"IDAT", zlib.compress(raw)), (b"IEND", b"")]
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, value in chunks:
            file.write(struct.pack(">I", len(value)) + kind + value + struct.pack(">I", zlib.crc32(kind + value)))


def test_a_depth_map_says_which_values_are_near(display, tmp_path):
    png16(tmp_path / "photo.png", np.linspace(0, 65535, 40 * 48).reshape(40, 48))
    png16(tmp_path / "tum.png", np.tile(np.linspace(3500, 36000, 48), (40, 1)))
    options = {"depth_map": tmp_path / "tum.png", "views": 3, "depth": (-3e-4, 3e-4)}
    with pytest.raises(eyebox.SceneError):
        scene(tmp_path / "photo.png", display, **options)
    small = scene(tmp_path / "photo.png", display, near="small", **options)
    large = scene(tmp_path / "photo.png", display, near="large", **options)
    assert small.shape == large.shape and (small.views != large.views).any()
    with pytest.raises(ValueError):
        scene(tmp_path / "photo.png", display, near="far", **options)
