"""Tests that the programs of docs/python.md run."""

import importlib.util
import pathlib
import re
import threading

import eyebox
import numpy as np
import pytest
from conftest import light_field

PAGE = (pathlib.Path(__file__).parents[3] / "docs" / "python.md").read_text(encoding="utf-8")
DAY = PAGE.index("## Tasks of a day")
END = PAGE.index("## More than one machine")
PROGRAM = re.compile(r"^```python\n(.*?)^```", re.M | re.S)
#: Number and program of each task.
TASKS = re.findall(r"^(\d+)\. [^`]*?^```python\n(.*?)^```", PAGE[DAY:END], re.M | re.S)


def run(program, names, what):
    exec(compile(program, f"docs/python.md, {what}", "exec"), names)
    return names


def needs(program):
    for module in ("torch", "PIL", "dask_jobqueue", "distributed", "pandas", "scipy"):
        uses = {"distributed": "eyebox.cluster", "pandas": "to_dataframe", "scipy": ".mat"}.get(module, module)
        if uses in program and importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Makes the files that the tasks read."""
    monkeypatch.chdir(tmp_path)
    views = light_field(3, 3, 5)
    np.save("views.npy", views)
    np.save("film.npy", np.stack([views] * 3))
    depth = np.zeros((64, 64), np.float32)
    depth[20:44, 20:44] = 5e-4
    np.save("depth.npy", depth)
    rng = np.random.default_rng(3)
    if importlib.util.find_spec("PIL") is not None:
        from PIL import Image

        for name in ("picture", "text", "stack-0", "stack-1", "stack-2"):
            Image.fromarray(rng.integers(0, 255, (64, 64), dtype=np.uint8)).save(f"{name}.png")
    if importlib.util.find_spec("scipy") is not None:
        from scipy.io import savemat

        savemat("mine.mat", {"phases": rng.uniform(-3, 3, (64, 64, 8)).astype(np.float32)})


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("number", "program"), TASKS, ids=[f"task {number}" for number, _ in TASKS])
def test_a_task_of_a_day(number, program, files):
    needs(program)
    if "eyebox.read(" in program:
        pytest.importorskip("PIL")
    assert len(program.strip().splitlines()) <= 12
    names = run(PROGRAM.search(PAGE, DAY)[1], {"eyebox": eyebox, "np": np}, "the display")
    run(program, names, f"task {number}")


def test_there_are_fifteen_tasks():
    assert [int(number) for number, _ in TASKS] == list(range(1, 16))


def programs():
    """Returns the other programs of the page."""
    return [found[1] for text in (PAGE[:DAY], PAGE[END:]) for found in PROGRAM.finditer(text)]


def test_the_other_programs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = eyebox.Display("planes8", size=(64, 64))
    (tmp_path / "bench.toml").write_text(small.to_toml())
    names = {"my_tracker": lambda: (1e-3, 0.0, 4e-3)}
    ran = 0
    for number, program in enumerate(programs()):
        if "torch" in program and importlib.util.find_spec("torch") is None:
            continue
        if "dask_jobqueue" in program:
            continue
        program = program.replace("10_000", "3").replace("> 1000:", "> 20:")
        if "import torch" in program:
            names["targets"] = 0
        if "eyebox.live" in program:
            _live(program, names, small)
        else:
            run(program, names, f"program {number}")
        ran += 1
    assert ran >= 4


def test_the_program_for_slurm_runs_with_local_jobs(tmp_path, monkeypatch):
    """The script of docs/python.md runs with jobs of dask-jobqueue on this machine, because CI has no Slurm."""
    dask_jobqueue = pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    from dask_jobqueue.local import LocalCluster

    [program] = [program for program in programs() if "SLURMCluster" in program]
    scenes = []
    for number in range(4):
        scenes.append(tmp_path / f"{number:04}.npy")
        np.save(scenes[-1], light_field(2, 2, number))
    jobs = []

    def local(*, walltime, **how):
        assert walltime == "02:00:00" and how["cores"] == 1
        cluster = LocalCluster(**how, log_directory=str(tmp_path), local_directory=str(tmp_path), scheduler_options={"dashboard": False})
        jobs.append(cluster)
        return cluster

    monkeypatch.setattr(dask_jobqueue, "SLURMCluster", local)
    for here, there in [
        ('[f"/scratch/film/{frame:04}" for frame in range(1000)]', repr([str(path) for path in scenes])),
        ('"/scratch/film.zarr"', repr(str(tmp_path / "film.zarr"))),
        ('"holoeye-pluto-2.1"', 'eyebox.Display("small", size=(40, 48))'),
        ("maximum_jobs=100", "maximum_jobs=2"),
        ("steps=60", "steps=2"),
    ]:
        assert here in program, here
        program = program.replace(here, there)
    run(program, {}, "Slurm")
    assert eyebox.Hologram.load(tmp_path / "film.zarr", 3).frames == 8 and len(jobs) == 1
    assert jobs[0].status.name == "closed"


def _live(program, names, display):
    """Runs an application while a session shows its frames."""
    sent = []

    def render(request):
        sent.append(request)
        return np.zeros((64, 64, 3), np.float32), np.zeros((64, 64), np.float32)

    name = "docs"
    with eyebox.show(f"live:{name}", display, color=["red", "green", "blue"], engine="cpu", queue=0) as session:
        failed = []

        def application():
            try:
                run(program.replace('"demo"', f'"{name}"'), {**names, "render": render}, "live")
            except Exception as error:
                failed.append(error)

        thread = threading.Thread(target=application, daemon=True)
        thread.start()
        while len(sent) < 3 and thread.is_alive():
            thread.join(0.05)
        session.stop()
        thread.join(30)
    assert len(sent) >= 3 and not thread.is_alive(), failed
    assert all(type(error).__name__ == "Gone" for error in failed), failed
