"""Tests the build back end with its documents, its wheels for other machines, and builds without cargo."""

import base64
import csv
import hashlib
import importlib.util
import io
import pathlib
import shutil
import subprocess
import sys
import zipfile

import eyebox
import pytest

ROOT = pathlib.Path(__file__).parents[3]
BACKEND = ROOT / "tools" / "python" / "build" / "backend.py"
spec = importlib.util.spec_from_file_location("backend", BACKEND)
backend = importlib.util.module_from_spec(spec)
spec.loader.exec_module(backend)


def wheel(folder, platform, module):
    """Makes a wheel as maturin does, with the bytes of a module."""
    path = folder / f"eyebox-0.1.0-cp310-abi3-{platform}.whl"
    files = {"eyebox/_eyebox.abi3.so": module, "eyebox-0.1.0.dist-info/WHEEL": b"Wheel-Version: 1.0\n"}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
        archive.writestr("eyebox-0.1.0.dist-info/RECORD", "".join(f"{name},,\n" for name in files))
    return path


def contents(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def native(tmp_path_factory):
    if shutil.which("cargo") is None:
        pytest.skip("there is no cargo")
    module = pathlib.Path(eyebox._eyebox.__file__).read_bytes()
    made = wheel(tmp_path_factory.mktemp("native"), "manylinux_2_28_x86_64", module)
    backend.complete(made)
    return made


def test_a_wheel_has_the_documents_of_the_command(native):
    files = contents(native)
    documents = {name.partition(".data/data/")[2] for name in files if ".data/data/" in name}
    assert set(backend.COMPLETIONS.values()) < documents and "share/man/man1/eyebox-solve.1" in documents
    assert b"serde" in files["eyebox-0.1.0.dist-info/licenses/THIRD-PARTY-LICENSES.txt"]
    # The record has the digest and the size of each added file.
    rows = {name: (digest, size) for name, digest, size in csv.reader(io.StringIO(files["eyebox-0.1.0.dist-info/RECORD"].decode()))}
    assert set(rows) == set(files)
    for name in files:
        if ".data/" in name or "THIRD" in name:
            digest = base64.urlsafe_b64encode(hashlib.sha256(files[name]).digest()).rstrip(b"=").decode()
            assert rows[name] == (f"sha256={digest}", str(len(files[name]))), name


def test_a_wheel_for_another_machine_has_the_documents_of_this_one(native, tmp_path):
    """The module in it cannot be loaded here, and the licenses are of its own crates."""
    arm = wheel(tmp_path, "manylinux_2_28_aarch64", b"another machine")
    backend.complete(arm, "aarch64-unknown-linux-gnu", native)
    windows = wheel(tmp_path, "win_amd64", b"another system")
    backend.complete(windows, "x86_64-pc-windows-gnu")
    of = [{name: data for name, data in contents(path).items() if ".data/data/" in name} for path in (native, arm, windows)]
    assert of[0] == of[1] and of[0] and not of[2]
    licenses = [contents(path)["eyebox-0.1.0.dist-info/licenses/THIRD-PARTY-LICENSES.txt"] for path in (arm, windows)]
    assert b"windows-sys" in licenses[1] and b"windows-sys" not in licenses[0]


def test_without_cargo_the_build_names_it(tmp_path):
    """The process that starts the build has an empty PATH."""
    run = f"import sys; sys.path.insert(0, {str(BACKEND.parent)!r}); import backend; backend.get_requires_for_build_wheel()"
    ran = subprocess.run([sys.executable, "-c", run], env={"PATH": str(tmp_path)}, capture_output=True, text=True)
    assert ran.returncode == 1 and "cargo" in ran.stderr and "https://rustup.rs" in ran.stderr and "Traceback" not in ran.stderr
