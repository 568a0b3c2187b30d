"""Builds the package by maturin, and adds the documents of the command to the wheel.

It is the build backend of pyproject.toml. A wheel also has completions for shells, pages of the manual, and the
licenses of the crates that are linked in.

``backend.py WHEEL`` adds them to a wheel of maturin. If this machine cannot run the wheel, ``--target`` is its target of
Rust. ``--like OTHER`` then takes the completions and the manual from another wheel.
"""

import argparse
import base64
import gzip
import hashlib
import os
import pathlib
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile

ROOT = pathlib.Path(__file__).resolve().parents[3]
NO_CARGO = "eyebox is built with Rust 1.91 or later, and cargo is not on the PATH: install it from https://rustup.rs"

#: Places of completions below the prefix of the installation.
COMPLETIONS = {
    "bash": "share/bash-completion/completions/eyebox",
    "zsh": "share/zsh/site-functions/_eyebox",
    "fish": "share/fish/vendor_completions.d/eyebox.fish",
}


def _maturin():
    # The backend of maturin would install a Rust toolchain of its own if there is none. The user decides that.
    if shutil.which("cargo") is None:
        sys.exit(NO_CARGO)
    import maturin

    return maturin


def get_requires_for_build_wheel(config_settings=None):
    if shutil.which("cargo") is None:
        sys.exit(NO_CARGO)
    return []


get_requires_for_build_editable = get_requires_for_build_wheel


def get_requires_for_build_sdist(config_settings=None):
    return get_requires_for_build_wheel(config_settings)


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    return _maturin().prepare_metadata_for_build_wheel(metadata_directory, config_settings)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    return _maturin().build_editable(wheel_directory, config_settings, metadata_directory)


def build_sdist(sdist_directory, config_settings=None):
    name = _maturin().build_sdist(sdist_directory, config_settings)
    lock(pathlib.Path(sdist_directory) / name)
    return name


def lock(sdist):
    """Removes crates from the lock file of a source distribution that it does not have, so that ``--locked`` builds it."""
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(sdist) as archive:
            archive.extractall(folder, filter="data")
            entries = archive.getmembers()
        [root] = pathlib.Path(folder).iterdir()
        metadata = ["cargo", "metadata", "--format-version", "1"]
        # The first call removes crates and keeps the versions of the others. The second one checks the result.
        for words in ([], ["--locked"]):
            subprocess.run([*metadata, *words], cwd=root, check=True, stdout=subprocess.DEVNULL)
        draft = sdist.with_suffix(".part")
        # No time of the machine is in the file, so that builds of the same sources are the same.
        with open(draft, "wb") as file, gzip.GzipFile("", "wb", fileobj=file, mtime=0) as packed:
            with tarfile.open(fileobj=packed, mode="w") as archive:
                for entry in entries:
                    path = pathlib.Path(folder) / entry.name
                    if not entry.isfile():
                        archive.addfile(entry)
                        continue
                    entry.size = path.stat().st_size
                    with open(path, "rb") as data:
                        archive.addfile(entry, data)
        draft.replace(sdist)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    name = _maturin().build_wheel(wheel_directory, config_settings, metadata_directory)
    target = os.environ.get("CARGO_BUILD_TARGET")
    complete(pathlib.Path(wheel_directory) / name, None if target == _host() else target)
    return name


def _host():
    """Returns the target of Rust for this machine."""
    about = subprocess.run(["rustc", "-vV"], check=True, capture_output=True, text=True).stdout
    return next(line.split()[1] for line in about.splitlines() if line.startswith("host:"))


def complete(wheel, target=None, like=None):
    """Adds completions, the manual and the licenses of crates to a wheel.

    A wheel for the ``target`` of another machine has the completions and the manual of the wheel ``like``. Without it,
    the module in the wheel makes them.
    """
    distribution = "-".join(wheel.name.split("-")[:2])
    with tempfile.TemporaryDirectory() as folder:
        added = dict(_documents(wheel, pathlib.Path(folder)) if target is None else _documents_of(like))
    files = {f"{distribution}.data/data/{place}": data for place, data in added.items()}
    files[f"{distribution}.dist-info/licenses/THIRD-PARTY-LICENSES.txt"] = licenses(target)
    _add(wheel, f"{distribution}.dist-info/RECORD", files)


def _documents(wheel, folder):
    """Returns completions and pages of the manual with their places. The module in the wheel makes them."""
    with zipfile.ZipFile(wheel) as archive:
        [module] = [name for name in archive.namelist() if name.startswith("eyebox/_eyebox.") and name.endswith((".so", ".pyd"))]
        archive.extract(module, folder)
    run = "import _eyebox, sys; sys.exit(_eyebox.command(['eyebox', *sys.argv[1:]]))"

    # The module needs no NumPy for that, and the build has none.
    def command(*words):
        environment = {**os.environ, "PYTHONPATH": str(folder / "eyebox")}
        return subprocess.run([sys.executable, "-c", run, *words], env=environment, check=True, stdout=subprocess.PIPE).stdout

    for shell, place in COMPLETIONS.items():
        yield place, command("completions", shell)
    command("man", "--out", str(folder / "man"))
    for page in sorted((folder / "man").iterdir()):
        yield f"share/man/man1/{page.name}", page.read_bytes()


def _documents_of(wheel):
    """Returns completions and pages of the manual of another wheel with their places, or none without a wheel."""
    if wheel is None:
        return
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            _, data, place = name.partition(".data/data/")
            if data:
                yield place, archive.read(name)


def licenses(target=None):
    """Returns the licenses of the crates that are linked in, from the sources that were compiled."""
    words = ["cargo", "tree", "--quiet", "--locked", "--package", "eyebox-python", "--edges", "normal"]
    words += ["--target", target or _host()]
    tree = subprocess.run(
        [*words, "--prefix", "none", "--format", "{p}|{l}"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
    home = pathlib.Path(os.environ.get("CARGO_HOME", pathlib.Path.home() / ".cargo"))
    # Many crates have the same text, which is written once.
    crates = {}
    for line in sorted(set(tree.splitlines())):
        package, _, license = line.replace(" (*)", "").partition("|")
        name, version, *_ = package.split()
        found = sorted(home.glob(f"registry/src/*/{name}-{version.removeprefix('v')}"))
        if not found:
            continue
        texts = [path for path in found[0].iterdir() if path.is_file() and path.name.lower().startswith(("licen", "copying", "notice"))]
        for path in sorted(texts):
            text = path.read_text(encoding="utf-8", errors="replace").strip()
            crates.setdefault(text, []).append(f"{name} {version}: {license}")
    return "".join(f"==== {chr(10).join(names)}\n\n{text}\n\n" for text, names in crates.items()).encode()


def _add(wheel, record, files):
    """Adds files to a wheel and to its record."""

    def row(name, data):
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        return f"{name},sha256={digest},{len(data)}\n"

    draft = wheel.with_suffix(".part")
    with zipfile.ZipFile(wheel) as old, zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as new:
        for entry in old.infolist():
            if entry.filename != record:
                new.writestr(entry, old.read(entry))
        rows = [line for line in old.read(record).decode().splitlines(keepends=True) if not line.startswith(record)]
        # Builds of the same sources are the same, byte by byte.
        time = old.getinfo(record).date_time
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, time)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            new.writestr(entry, data)
            rows.append(row(name, data))
        entry = zipfile.ZipInfo(record, time)
        entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
        new.writestr(entry, "".join([*rows, f"{record},,\n"]))
    draft.replace(wheel)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel", type=pathlib.Path)
    parser.add_argument("--target", help="target of Rust, if this machine cannot run the wheel")
    parser.add_argument("--like", type=pathlib.Path, help="wheel with the completions and the manual")
    given = parser.parse_args()
    complete(given.wheel, given.target, given.like)


if __name__ == "__main__":
    main()
