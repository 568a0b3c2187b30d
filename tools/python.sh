#!/usr/bin/env bash
# Tests the Python package, or builds its wheels into dist/.
# tools/python.sh lays out the package with the module of the workspace's build, and runs its tests and notebooks.
# tools/python.sh wheel [PROFILE] builds the wheel for Linux on x86-64 and a source distribution, by the profile `release` or
# another. It checks both, and runs the tests with the wheel, the long ones too.
# tools/python.sh wheels [PROFILE] also builds the wheels for Linux on AArch64 and for Windows, and runs them under QEMU and Wine.
# Linux needs glibc 2.28 or newer. Packages for Python are installed into $target/python.
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

# Builds a wheel for a target of Rust, with its documents: wheel PROFILE TARGET OPTIONS
wheel() {
    local profile=$1 target=$2 made
    rustup target add "$target" 2>/dev/null || true
    made=$(mktemp -d)
    PATH=$place/build/bin:$PATH maturin build --profile "$profile" --target "$target" --out "$made" "${@:3}"
    if [[ $target == "$(rustc -vV | sed -n 's/^host: //p')" ]]; then
        "$place/build/bin/python" tools/python/build/backend.py "$made"/*.whl
    else
        local like=()
        # Shells and the manual of Linux.
        [[ $target != *linux* ]] || like=(--like dist/eyebox-*_x86_64.whl)
        "$place/build/bin/python" tools/python/build/backend.py "$made"/*.whl --target "$target" "${like[@]}"
    fi
    mv "$made"/*.whl dist/
    rmdir "$made"
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

packages=(numpy pytest tqdm matplotlib "dask[distributed]" dask-jobqueue scipy h5py zarr tifffile pandas xarray pylsl)
more=(slmsuite mypy pyright)

case $what in
module)
    # Of the whole workspace, whose tests have built all but this: by itself it would want its dependencies otherwise.
    cargo build --quiet --workspace
    environment tests "${packages[@]}"
    optional tests "${more[@]}"
    rm -rf "$place/site"
    mkdir -p "$place/site"
    cp -rL tools/python/eyebox "$place/site/eyebox"
    rm -f "$place/site/eyebox/"*.so
    cp "$target/debug/lib_eyebox.so" "$place/site/eyebox/_eyebox.abi3.so"
    python=$place/tests/bin/python
    export PYTHONPATH=$place/site
    ;;
wheel | wheels)
    profile=${2:-release}
    manylinux=(--zig --compatibility manylinux_2_28)
    environment build maturin ziglang auditwheel
    # PyTorch, JAX and the client of Pupil Labs are large, so they are only here.
    environment wheel "${packages[@]}" torch jax pupil-labs-realtime-api
    optional wheel "${more[@]}"
    python=$place/wheel/bin/python
    mkdir -p dist
    rm -f dist/eyebox-*.whl dist/eyebox-*.tar.gz
    wheel "$profile" x86_64-unknown-linux-gnu "${manylinux[@]}"
    if [[ $what == wheels ]]; then
        wheel "$profile" aarch64-unknown-linux-gnu "${manylinux[@]}"
        wheel "$profile" x86_64-pc-windows-gnu
        tools/python/foreign.sh dist/eyebox-*_aarch64.whl dist/eyebox-*-win_amd64.whl
    fi
    PATH=$place/build/bin:$PATH PYTHONPATH=tools/python/build "$place/build/bin/python" -c 'import backend; backend.build_sdist("dist")'
    "$place/build/bin/python" -m auditwheel show dist/eyebox-*_x86_64.whl
    "$python" -m pip install --quiet --force-reinstall --no-deps dist/eyebox-*_x86_64.whl
    export EYEBOX_PYTHON_LONG=1
    ;;
*)
    echo "tools/python.sh $what: there are module (the default), wheel and wheels" >&2
    exit 2
    ;;
esac

export EYEBOX=${EYEBOX:-$target/debug/eyebox}
"$python" -m pytest --quiet -p no:cacheprovider tools/python/tests
