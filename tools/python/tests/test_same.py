"""Tests that results are the same as from the command and the library, without needless copies."""

import json
import os
import pathlib
import subprocess

import eyebox
import numpy as np
import pytest
from conftest import coded, named


def command(*arguments):
    program = os.environ.get("EYEBOX")
    if not program or not pathlib.Path(program).exists():
        pytest.skip("EYEBOX names no program")
    return subprocess.run([program, *map(str, arguments)], check=True, capture_output=True).stdout


@pytest.mark.parametrize("color", ["green", None])
def test_the_same_seed_gives_the_commands_bytes(tmp_path, color):
    small = eyebox.Display("small", size=(40, 48))
    own = eyebox.solve("builtin:still-life", small, color=color, frames=2, steps=3, pupils=4, seed=7, engine="cpu")
    own.save(tmp_path / "own.zarr")
    settings = "--display small --size 40x48 --frames 2 --steps 3 --pupils 4 --seed 7 --engine cpu".split()
    colors = ["--color", color] if color else []
    command("solve", "builtin:still-life", *settings, *colors, "-o", tmp_path / "theirs.zarr")
    theirs = eyebox.Hologram.load(tmp_path / "theirs.zarr")
    assert list(own.phases) == list(theirs.phases) and own.exposures == theirs.exposures
    for name, phases in own.phases.items():
        assert phases.tobytes() == theirs.phases[name].tobytes()
    assert eyebox.Hologram.load(tmp_path / "own.zarr").metadata["solve"] == theirs.metadata["solve"]
    for chunk in sorted((tmp_path / "theirs.zarr/phases/c").rglob("*")):
        if chunk.is_file():
            same = tmp_path / "own.zarr" / chunk.relative_to(tmp_path / "theirs.zarr")
            assert same.read_bytes() == chunk.read_bytes()


def test_views_and_photographs_are_the_commands(tmp_path, hologram, display):
    hologram.save(tmp_path / "x.zarr")
    command("render", tmp_path / "x.zarr", "--pupil=2,0,4,1.5", "--engine", "cpu", "-o", tmp_path / "seen.npy")
    seen = hologram.view(x=2e-3, diameter=4e-3, depth=1.5e-3)
    raw = np.load(tmp_path / "seen.npy").reshape(40, 48)
    np.testing.assert_array_equal(raw * np.float32(hologram.exposures["green"]), seen[..., 0])
    wanted = eyebox.photograph("builtin:still-life", 2e-3, 0, 4e-3, 1.5e-3, display=display, color="green")
    psnr = 10 * np.log10(1 / np.mean((wanted - seen) ** 2))
    assert seen.dtype == np.float32 and wanted.shape == (40, 48, 1) and psnr > 10


def test_past_an_obstruction(tmp_path, display, hologram):
    """A picture and a score past marks in the pupil are the same as from the command."""
    at = (2e-3, 0.0, 4e-3, 0.0)
    clear, [whole] = hologram.view(*at, engine="cpu"), hologram.score(pupils=[at], engine="cpu")
    assert whole.against_clear is None
    file, pupils = tmp_path / "h.zarr", tmp_path / "pupils.json"
    hologram.save(file)
    pupils.write_text("[[2, 0, 4, 0]]")
    for name in ("lashes", "floaters", "opacity", "scratches"):
        seen = hologram.view(*at, engine="cpu", obstructed=name)
        [score] = hologram.score(pupils=[at], engine="cpu", obstructed=name)
        assert np.abs(seen - clear).max() > 0.01 and abs(score.psnr - whole.psnr) > 1e-3
        how = ["--jod", "none", "--engine", "cpu", "--json", "--obstructed", name]
        [row] = json.loads(command("eval", "score", file, "--test-pupils", pupils, *how))["pupils"]
        np.testing.assert_allclose([score.psnr, score.against_clear], [row["psnr_db"], row["against_clear_db"]], rtol=1e-6)
    with coded(eyebox.DisplayError, "optics/unknown-obstruction"):
        hologram.view(*at, obstructed="nose")
    with named(TypeError, "obstructed", "3"):
        hologram.score(pupils=[at], obstructed=3)


def test_a_file_keeps_all_of_it(tmp_path, hologram):
    hologram.save(tmp_path / "x.zarr")
    opened = eyebox.Hologram.load(tmp_path / "x.zarr")
    assert opened.phases["green"].tobytes() == hologram.phases["green"].tobytes()
    assert opened.metadata.keys() == hologram.metadata.keys() and opened.metadata["solve"]["seed"] == 7
    assert opened.scene == "builtin:still-life" and opened.stopped is None and opened.exposures == hologram.exposures
    # A loaded hologram has no scene in memory and finds the scene that its file names.
    numbers = lambda scores: [score[:3] for score in scores]
    np.testing.assert_allclose(numbers(opened.score()), numbers(hologram.score()), rtol=1e-6)
    hologram.save(str(tmp_path / "x.npy"))
    assert np.load(tmp_path / "x.npy").tobytes() == hologram.phases["green"].tobytes()


def test_the_slm_receives_what_the_command_writes(tmp_path, hologram, display):
    frames = hologram.encode(display)
    assert frames.dtype == np.uint8 and frames.shape[1:3] == (40, 48) and frames.flags.c_contiguous
    # Eight sub-frames are the eight bits of one video frame.
    assert frames.shape[0] == 1 and len(np.unique(frames)) > 2


def test_it_shows_itself(hologram):
    png = hologram._repr_png_()
    assert png[:8] == b"\x89PNG\r\n\x1a\n" and png is hologram._repr_png_()
    bare = eyebox.Hologram.from_phases(np.zeros((40, 48)), hologram.display, "green")
    assert bare._repr_png_() is None and bare.exposures is None
    assert "8 sub-frames of 40 x 48" in repr(hologram)
