"""Tests results as tables and data sets, and pictures and tables in notebooks."""

import base64
import io
import re
import sys

import eyebox
import numpy as np
import pytest
from conftest import light_field
from eyebox import _notebook, _tables

PUPILS = [(0, 0, 4e-3, 0), (1e-3, -1e-3, 2e-3, 1e-3)]


@pytest.fixture(scope="module")
def scores(hologram):
    return hologram.score(pupils=PUPILS, engine="cpu")


def test_scores_are_a_list_with_their_pupils(scores):
    assert isinstance(scores, list) and scores[0].psnr > 0 and len(scores) == 2
    assert scores.pupils == [eyebox.Pupil(*pupil) for pupil in PUPILS]


def test_scores_are_a_table_of_pandas(scores):
    pytest.importorskip("pandas")
    table = scores.to_dataframe()
    assert list(table.columns) == ["x", "y", "diameter", "depth", "psnr", "ceiling", "ssim", "against_clear", "jod"]
    assert table["psnr"].tolist() == [score.psnr for score in scores] and table["x"].tolist() == [0, 1e-3]
    assert table["psnr"].dtype == np.float64 and table["against_clear"].isna().all() and table["against_clear"].dtype == np.float64


def test_scores_are_a_data_set_of_xarray(scores):
    pytest.importorskip("xarray")
    data = scores.to_xarray()
    assert dict(data.sizes) == {"pupil": 2} and set(data.coords) == {"x", "y", "diameter", "depth"}
    assert data["ceiling"].values.tolist() == [score.ceiling for score in scores]
    assert data["diameter"].values.tolist() == [4e-3, 2e-3]


def test_holograms_and_scenes_are_data_of_xarray(hologram, display):
    pytest.importorskip("xarray")
    data = hologram.to_xarray()
    assert data["phases"].dims == ("color", "sub_frame", "row", "column") and data["phases"].shape == (1, 8, 40, 48)
    assert (data["phases"].sel(color="green").values == hologram.phases["green"]).all()
    assert data["exposure"].sel(color="green") == hologram.exposures["green"]
    scene = eyebox.Scene(light_field(3, 2, 1), display, "green", view_pitch=2e-3)
    views = scene.to_xarray()
    assert (views.values == scene.views).all() and views["y"].values == pytest.approx([-2e-3, 0, 2e-3])
    assert views["x"].values == pytest.approx([-1e-3, 1e-3])


def test_results_of_a_cluster_are_tables():
    pytest.importorskip("pandas")
    score = {"psnr": 20.0, "ceiling": None, "ssim": 0.5, "against_clear": None}
    rows = _tables.Rows([{"settings": {"steps": 2}, "seconds": 1.5, "scores": [score, score]}, {"settings": {"frames": 4}, "seconds": 2.5, "scores": [score]}])
    table = rows.to_dataframe()
    assert len(table) == 3 and table["pupil"].tolist() == [0, 1, 0] and table["steps"].tolist()[:2] == [2, 2]
    assert table["frames"].isna().tolist() == [True, True, False] and table["ceiling"].dtype == np.float64
    assert "1.5" in rows._repr_html_() and rows == list(rows)


def test_without_pandas_an_error_says_what_is_missing(scores, monkeypatch):
    for module, call in (("pandas", scores.to_dataframe), ("xarray", scores.to_xarray)):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(ImportError, match=f"pip install {module}"):
            call()


def test_a_picture_is_the_light_in_srgb():
    image = pytest.importorskip("matplotlib.image")
    light = np.random.default_rng(3).uniform(-0.1, 1.1, (5, 7, 3))
    light[0, 0] = np.nan
    seen = image.imread(io.BytesIO(_notebook.png(light)), format="png")
    back = eyebox._eyebox.linear_light(256)[np.rint(255 * seen).astype(int)]
    assert seen.shape == (5, 7, 3) and np.abs(back - np.clip(np.nan_to_num(light), 0, 1)).max() < 0.005


def cells(html):
    return re.findall(r"<td>(.*?)</td>", html)


def test_notebooks_show_tables_and_pictures(hologram, display, scores):
    image = pytest.importorskip("matplotlib.image")
    shown = cells(scores._repr_html_())
    assert shown[:4] == ["0", "0", "4", "0"] and shown[4] == f"{scores[0].psnr:.4g}" and shown[7] == "-"
    of_display = display._repr_html_()
    assert "40 x 48" in of_display and f"{display.eyebox * 1e3:.4g} mm" in of_display and display.name in of_display
    scene = eyebox.Scene(light_field(3, 3, 1), display, ["red", "green"], name="<mine>")
    html = scene._repr_html_()
    assert "&lt;mine&gt;" in html and "<mine>" not in html and "3 x 3" in html
    [data] = re.findall(r"data:image/png;base64,([^\"]+)", html)
    seen = image.imread(io.BytesIO(base64.b64decode(data)), format="png")
    levels = eyebox._eyebox.linear_light(256)[np.rint(255 * seen).astype(int)]
    assert seen.shape == (40, 48, 3) and np.abs(levels[..., :2] - scene.views[1, 1]).max() < 0.005 and not seen[..., 2].any()
    assert hologram._repr_png_().startswith(b"\x89PNG")
