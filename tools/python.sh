#!/usr/bin/env bash
# Tests the Python package. tools/python.sh lays the package out with the module that the workspace's build has made, and runs its
# tests and notebooks; tools/python.sh wheel [PROFILE] builds the wheel for every Linux with glibc 2.28 or newer into dist/, by the profile
# `release` or another. It adds the documents of the command to the wheel, makes a source distribution, checks the wheel, and runs
# the tests with it, the long ones too. What Python needs comes into $target/python.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
what=${1:-module}
target=$(cargo metadata --format-version 1 --no-deps | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
place=$target/python

if ! python3 -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
    echo "Python 3.10 or newer is missing: apt-get install python3 python3-venv" >&2
    exit 1
fi

# An environment of the package's own: environment NAME PACKAGES
environment() {
    local at=$place/$1 wanted
    shift
    wanted=$(python3 --version; printf '%s\n' "$@")
    if [[ ! -e $at/has || $(cat "$at/has") != "$wanted" ]]; then
        rm -rf "$at"
        python3 -m venv "$at"
        "$at/bin/python" -m pip install --quiet --disable-pip-version-check "$@"
        printf '%s\n' "$wanted" >"$at/has"
    fi
}

# Packages without which tests are skipped: optional NAME PACKAGES
optional() {
    local at=$place/$1 package
    shift
    for package; do
        if ! "$at/bin/python" -m pip show --quiet "$package" 2>/dev/null &&
            ! "$at/bin/python" -m pip install --quiet --disable-pip-version-check "$package"; then
            echo "$package cannot be installed: its tests are skipped" >&2
        fi
    done
}

case $what in
module)
    # Of the whole workspace, whose tests have built all but this: by itself it would want its dependencies otherwise.
    cargo build --quiet --workspace
    environment tests numpy pytest tqdm matplotlib "dask[distributed]" scipy h5py pylsl
    optional tests slmsuite pandas xarray mypy pyright zarr tifffile
    rm -rf "$place/site"
    mkdir -p "$place/site"
    cp -rL tools/python/eyebox "$place/site/eyebox"
    rm -f "$place/site/eyebox/"*.so
    cp "$target/debug/lib_eyebox.so" "$place/site/eyebox/_eyebox.abi3.so"
    python=$place/tests/bin/python
    export PYTHONPATH=$place/site
    ;;
wheel)
    # PyTorch, JAX and the client of Pupil Labs are large, so they are only here.
    environment wheel maturin ziglang auditwheel numpy pytest tqdm matplotlib "dask[distributed]" scipy h5py torch jax \
        pylsl pupil-labs-realtime-api
    optional wheel slmsuite pandas xarray mypy pyright zarr tifffile
    python=$place/wheel/bin/python
    rm -f dist/eyebox-*.whl dist/eyebox-*.tar.gz
    PATH=$place/wheel/bin:$PATH maturin build --profile "${2:-release}" --zig --compatibility manylinux_2_28 --out dist
    "$python" tools/python/build/backend.py dist/eyebox-*.whl
    PATH=$place/wheel/bin:$PATH PYTHONPATH=tools/python/build "$python" -c 'import backend; backend.build_sdist("dist")'
    "$python" -m auditwheel show dist/eyebox-*.whl
    "$python" -m pip install --quiet --force-reinstall --no-deps dist/eyebox-*.whl
    export EYEBOX_PYTHON_LONG=1
    ;;
*)
    echo "tools/python.sh $what: there is module (as by default) and wheel" >&2
    exit 2
    ;;
esac

export EYEBOX=${EYEBOX:-$target/debug/eyebox}
"$python" -m pytest --quiet -p no:cacheprovider tools/python/tests
