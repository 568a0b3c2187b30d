"""Tests that every argument with a length takes a text with a unit. A new public argument must be in one of the lists."""

import inspect
import json
import re
import types

import eyebox
import eyebox._settings
import eyebox._types
import eyebox.cluster
import numpy as np
import pytest
from conftest import light_field
from public_names import public

#: Types of arguments that may be lengths.
MAYBE = re.compile(r"\b(Quantity|Range|PupilLike|Pupils|float|SupportsFloat|Any|Mapping)\b")
SETTINGS = re.compile(r"Unpack\[(\w+)\]")


def numbers(text, display=None):
    """Returns a length in meters, or a depth of a display."""
    value, unit = re.fullmatch(r"(-?[\d.]+)(mm|um|D)", text).groups()
    return float(value) * {"mm": 1e-3, "um": 1e-6, "D": display.focal_length**2 if display else 1}[unit]


def texts(text, display=None):
    return text


def live_frame(o, a):
    """Returns the numbers of frames as an application would send them."""
    from eyebox import live

    there = object.__new__(live.Live)
    sent = []
    there._live = types.SimpleNamespace(rows=4, columns=4, channels=1, send=lambda *words: sent.append(words))
    views = there.views(1, 1, a("1mm"))
    there.send(views, np.zeros(views.shape, np.uint8), center=(a("1mm"), a("-2mm")))
    layers = there.layers([a("0.5D"), 0.0])
    return [*sent[0][0][5:6], *sent[0][5], *layers.diopters]


def bench(**given):
    """Returns the description of a bench of slmsuite."""
    import eyebox.slmsuite

    slm = types.SimpleNamespace(shape=(40, 48), bitdepth=1, dtype=np.uint8)
    camera = types.SimpleNamespace(shape=(40, 48), bitdepth=8)
    return eyebox.slmsuite.Bench(slm, camera, **given)


def bench_ranges(o, a):
    def nothing(*_):
        pass

    ranges = (a("-1mm"), a("1mm")), (a("-2mm"), a("2mm")), (a("500um"), a("4mm"))
    made = bench(iris=nothing, iris_range=ranges, focus=nothing, focus_range=(a("-0.01D", o.display), a("1mm")), display=o.display)
    return [*np.ravel(list(made.hello["iris"].values())), *made.hello["focus_mm"]]


def slm_display(o, a):
    import eyebox.slmsuite

    slm = types.SimpleNamespace(shape=(8, 8), bitdepth=8, dtype=np.uint8, pitch_um=(8, 8), wav_um=0.52, wav_design_um=0.52, phase_scaling=1.0)
    return eyebox.slmsuite.display_of(slm, a("400mm")).focal_length


def forward(o, a):
    import torch

    import eyebox.torch

    model = eyebox.torch.ForwardModel(o.display, "green", 8, engine="cpu")
    phases = torch.from_numpy(o.hologram.phases["green"])
    return model(phases, [(a("1mm"), 0, a("4mm"), a("0.01D", o.display))]).numpy()


def calibrated(o, a):
    """Returns the iris of the first shot, and the range of the iris of a bench."""
    shots = []

    def camera(shot):
        shots.append(shot.iris)
        raise KeyboardInterrupt

    hello = {"camera": {"resolution": [40, 48], "bits": 8}, "slm": {"takes": ["phases"]}}
    hello |= {"iris": {"x_mm": [a("-12mm") if a is texts else -12, 12], "y_mm": [-12, 12], "diameter_mm": [1, 20]}}
    with pytest.raises(KeyboardInterrupt):
        eyebox.calibrate(o.display, camera, "green", hello=hello, iris=(a("1mm"), a("-1mm"), a("4mm")))
    return [*shots[0], eyebox._arguments.with_units(hello)["iris"]["x_mm"][0]]


def cluster_scores(o, a):
    """Returns the scores of pupils on a worker in this process."""
    import distributed

    o.hologram.save(o.folder / "one.zarr")
    pupils = [(a("1mm"), 0, a("4mm"), a("0.01D", o.display))]
    with distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        how = dict(client=client, engine="cpu")
        scores = eyebox.cluster.evaluate([o.folder / "one.zarr"], o.folder / f"{a.__name__}.json", pupils, **how)
        grid = [dict(frames=8, steps=1, pupils=1, seed=3, diameter=(a("2mm"), a("4mm")))]
        traded = eyebox.cluster.tradeoff("builtin:plane", o.folder / f"{a.__name__}-grid.json", grid, o.display, "green", pupils=pupils, **how)
        out = o.folder / f"{a.__name__}.zarr"
        how |= dict(frames=8, steps=1, pupils=1, seed=3)
        eyebox.cluster.solve_sequence(["builtin:plane"], out, o.display, "green", depth=(0, a("0.01D", o.display)), **how)
    phases = eyebox.Hologram.load(out, 0).phases["green"]
    return [*(one["scores"][0]["psnr"] for one in (scores[0], traded[0])), *phases.ravel()]


def solved(o, a):
    how = dict(color="green", frames=8, steps=2, pupils=2, seed=3, engine="cpu")
    given = dict(diameter=(a("2mm"), a("6mm")), depth=(a("-1mm"), a("0.01D", o.display)), view_pitch=a("1mm"))
    one = eyebox.solve("builtin:plane", o.display, **given, **how)
    settings = eyebox.SolveSettings(diameter=given["diameter"]).replace(depth=given["depth"])
    two = eyebox.solve("builtin:plane", o.display, settings=settings, view_pitch=a("1mm"), **how)
    return np.stack([one.phases["green"], two.phases["green"]])


def planned(o, a):
    made = eyebox.plan("builtin:plane", o.display, "green", view_pitch=a("1mm"), diameter=(a("2mm"), a("6mm")), depth=(0, a("0.01D", o.display)))
    return [*made["settings"]["diameter"], *made["settings"]["depth"]]


def filmed(o, a, monkeypatch):
    """Returns the path that the command receives, in millimeters."""
    paths = []
    monkeypatch.setattr(eyebox._film, "command", lambda *words: paths.append(json.load(open(words[3]))) or {})
    keys = [{"t": 0, "x": a("1mm"), "y": a("-2mm"), "diameter": a("4mm"), "depth": a("1mm")}]
    eyebox.film(o.hologram, keys, "film.y4m")
    [key] = paths[0]["keys"]
    return [key["x_mm"], key["y_mm"], key["diameter_mm"], eyebox._eyebox.quantity(str(key["focus"]), "mm") if isinstance(key["focus"], str) else key["focus"]]


def looked(o, a):
    """Returns a sample as the library receives it."""
    sent = []
    with eyebox.show(o.hologram, o.display, eye="own", focus=a("0.01D", o.display), queue=0, engine="cpu") as session:
        own, session._native = session._native, types.SimpleNamespace(look=lambda *words: sent.append(words))
        session.look(a("1mm"), a("-2mm"), a("4mm"))
        session._native = own
    return sent[0][:3]


def refined(o, a):
    made = o.hologram.refine((a("1mm"), 0, a("4mm"), a("0.01D", o.display)), 2, spread=a("100um"), engine="cpu", seed=3)
    refiner = eyebox.Refiner(o.hologram, engine="cpu", seed=3)
    refiner.aim(a("1mm"), a("0mm"), a("4mm"), a("0.01D", o.display), spread=a("100um"))
    refiner.step(2)
    return np.stack([made.phases["green"], refiner.hologram.phases["green"]])


def layered(o, a):
    layers = np.ones((2, 40, 48, 2), np.float32)
    layers[1, :20, :, 1] = 0
    made = eyebox.Scene.from_layers(layers, [0, a("0.001D", o.display)], o.display, "green", views=2)
    stack = eyebox.Scene.from_focal_stack(layers[..., 0], [a("-0.001D", o.display), a("0.1mm")], a("4mm"), o.display, "green")
    return [*np.ravel(made.depth_range), *np.ravel(stack.depth_range)]


def scene(o, a):
    depth_map = np.zeros((40, 48), np.uint8)
    depth_map[10:20] = 255
    made = eyebox.Scene(np.ones((40, 48)), o.display, "green", depth_map=depth_map, depth=(0, a("0.01D", o.display)), views=2)
    views = eyebox.Scene(light_field(2, 2, 3), o.display, "green", view_pitch=a("1mm"))
    return [*np.ravel(made.depth_range), views.view_pitch]


def display(o, a):
    made = eyebox.Display("small", pitch_um="8um" if a is texts else 8, focal_length_mm=a("400mm") if a is texts else 400)
    other = made.replace(source={"green": {"image_mm": "500um" if a is texts else 0.5}})
    return [made.pitch, made.focal_length, *other.to_toml().encode()]


PUPIL = ("x", "y", "diameter", "depth")
#: Calls with lengths, and the arguments that they cover. Each gives the same result for numbers and for texts.
LENGTHS = {
    lambda o, a: o.hologram.view(a("1mm"), a("-2mm"), a("4mm"), a("0.01D", o.display)): [f"eyebox.Hologram.view.{one}" for one in PUPIL],
    lambda o, a: o.scene.photograph(a("1mm"), a("-2mm"), a("4mm"), a("0.01D", o.display)): [f"eyebox.Scene.photograph.{one}" for one in PUPIL],
    lambda o, a: eyebox.photograph("builtin:plane", a("1mm"), a("-2mm"), a("4mm"), a("1mm"), display=o.display, color="green"): [
        f"eyebox.photograph.{one}" for one in PUPIL
    ],
    lambda o, a: o.hologram.score(pupils=[(a("1mm"), 0, a("4mm"), a("0.01D", o.display))], engine="cpu")[0].psnr: ["eyebox.Hologram.score.pupils"],
    refined: ["eyebox.Hologram.refine.pupil", "eyebox.Hologram.refine.spread", *(f"eyebox.Refiner.aim.{one}" for one in (*PUPIL, "spread"))],
    scene: ["eyebox.Scene.__init__.view_pitch", "eyebox.Scene.__init__.depth"],
    layered: ["eyebox.Scene.from_layers.depths", "eyebox.Scene.from_focal_stack.focus", "eyebox.Scene.from_focal_stack.aperture"],
    solved: ["eyebox.solve.view_pitch", "eyebox.SolveSettings.__init__.diameter", "eyebox.SolveSettings.__init__.depth"],
    planned: ["eyebox.plan.view_pitch"],
    lambda o, a: np.ravel(eyebox.random_pupils(o.display, 3, 1, diameter=(a("2mm"), a("3mm")), depth=(a("-0.01D", o.display), 0))): [
        "eyebox.random_pupils.diameter",
        "eyebox.random_pupils.depth",
    ],
    lambda o, a: np.ravel(list(eyebox.paper_pupils(o.display, (0, a("0.01D", o.display)), count=1).values())[-1]): ["eyebox.paper_pupils.depth"],
    looked: ["eyebox.Session.look.x", "eyebox.Session.look.y", "eyebox.Session.look.diameter", "eyebox.show.focus"],
    filmed: ["eyebox.film.keys"],
    calibrated: ["eyebox.calibrate.iris", "eyebox.calibrate.hello", "eyebox.solve.hello"],
    cluster_scores: ["eyebox.cluster.evaluate.pupils", "eyebox.cluster.tradeoff.pupils", "eyebox.cluster.tradeoff.grid"],
    lambda o, a: bench(iris=(a("1mm"), a("-1mm"), a("4mm"))).iris: ["eyebox.slmsuite.Bench.__init__.iris"],
    bench_ranges: ["eyebox.slmsuite.Bench.__init__.iris_range", "eyebox.slmsuite.Bench.__init__.focus_range"],
    slm_display: ["eyebox.slmsuite.display_of.focal_length"],
    live_frame: ["eyebox.live.Live.views.view_pitch", "eyebox.live.Live.layers.diopters", "eyebox.live.Live.send.center"],
    forward: ["eyebox.torch.ForwardModel.forward.pupils"],
    display: ["eyebox.slmsuite.display_of.fields"],
}
#: Arguments with other numbers: times, rates, ratios, light, objects of other libraries, and functions.
OTHERS = """
    Hologram.from_phases.phases Hologram.from_phases.exposure Hologram.score.viewing Hologram.score.sub_frame_rate
    Scores.__init__.pupils Session.frame.timeout Session.look.velocity Session.look.age SolveSettings.__init__.seconds
    SolveSettings.__init__.psnr SolveSettings.__init__.efficiency SolveSettings.__init__.stft_filter
    SolveSettings.__init__.evenness SolveSettings.__init__.levels SolveSettings.__init__.joint
    SolveSettings.__init__.contrast calibrate.full_scale cluster.evaluate.client cluster.solve_far_field.client
    cluster.solve_sequence.client cluster.solve_sequence.rate cluster.tradeoff.client command.words film.rate film.blinks
    live.Live.send.content_time live.Live.wait.seconds show.rate show.seconds show.step_time show.encode_time show.speed
    show.latency show.restart slmsuite.Bench.__init__.slm slmsuite.Bench.__init__.camera
    slmsuite.Bench.__init__.exposures slmsuite.display_of.slm slmsuite.levels.slm slmsuite.levels.display
    slmsuite.play.what slmsuite.play.slm slmsuite.play.display slmsuite.play.rate slmsuite.play.seconds
    slmsuite.play.options slmsuite.show.slm slmsuite.show.display slmsuite.show.options
    torch.ForwardModel.__init__.exposure
""".split()
#: Settings with lengths, which `solved` covers, and settings with a time.
SETTING_LENGTHS, SETTING_TIMES = {"diameter", "depth"}, {"seconds"}


@pytest.fixture(scope="module")
def objects(display, hologram, tmp_path_factory):
    scene = eyebox.Scene("builtin:still-life", display, "green", views=3)
    return types.SimpleNamespace(display=display, hologram=hologram, scene=scene, folder=tmp_path_factory.mktemp("lengths"))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("call", LENGTHS, ids=lambda call: LENGTHS[call][0].removeprefix("eyebox."))
def test_a_text_with_a_unit_is_a_length(call, objects, monkeypatch):
    for module in ("torch", "live"):
        if f"eyebox.{module}." in LENGTHS[call][0]:
            pytest.importorskip(f"eyebox.{module}", exc_type=ImportError)
    if call is cluster_scores:
        pytest.importorskip("distributed")
    more = (monkeypatch,) if call is filmed else ()
    found = [np.asarray(call(objects, form, *more), float) for form in (numbers, texts)]
    np.testing.assert_allclose(*found, rtol=1e-5, atol=1e-5)


def test_every_argument_is_in_a_list():
    listed = {name for names in LENGTHS.values() for name in names} | {f"eyebox.{name}" for name in OTHERS}
    found = set()
    for name, value in public().items():
        if inspect.isclass(value):
            continue
        for parameter in inspect.signature(value).parameters.values():
            annotation = str(parameter.annotation)
            of_settings = SETTINGS.search(annotation)
            if of_settings and of_settings[1] != "DisplayFields":
                _check_settings(of_settings[1])
            elif not of_settings and MAYBE.search(annotation) and ("Callable" not in annotation or "Quantity" in annotation):
                found.add(f"{name}.{parameter.name}")
    assert not found - listed, "an argument that no test gives a length as a text"
    missing = {name for name in listed - found if not name.startswith(("eyebox.torch.", "eyebox.live."))}
    assert not missing, "an argument that is no more"


def _check_settings(kind):
    fields = {key: str(value) for key, value in getattr(eyebox._settings, kind).__annotations__.items()}
    lengths = {key for key, value in fields.items() if re.search(r"\b(Quantity|Range)\b", value)}
    assert lengths <= SETTING_LENGTHS | SETTING_TIMES, lengths


def test_every_key_of_a_display_with_a_quantity_states_its_unit():
    keys = {key for key, value in eyebox._types.DisplayFields.__annotations__.items() if "Quantity" in str(value)}
    assert len(keys) == 4 and all(eyebox._arguments._unit(key) for key in keys)
