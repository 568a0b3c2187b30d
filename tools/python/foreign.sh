#!/usr/bin/env bash
# Runs wheels for other machines than this one: tools/python/foreign.sh WHEEL...
# A wheel for Linux on AArch64 runs under QEMU with Debian's Python, and a wheel for Windows runs under Wine. Each wheel is
# installed beside NumPy, and tools/python/tests/foreign_check.py then solves, loads and calls the command with it. Without QEMU or
# Wine a wheel is only inspected. The folder $target/python keeps both Pythons.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
target=$(cd "$root" && cargo metadata --format-version 1 --no-deps | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
place=$target/python
version=3.11

# Installs a wheel and NumPy for another machine into a folder: site FOLDER WHEEL NUMPY PLATFORM...
site() {
    local at=$1 wheel=$2 numpy=$3 platform=() name
    for name in "${@:4}"; do
        platform+=(--platform "$name")
    done
    rm -rf "$at"
    python3 -m pip install --quiet --disable-pip-version-check --target "$at" --only-binary :all: --implementation cp \
        --python-version "$version" "${platform[@]}" "$numpy" "$wheel"
}

# Debian's Python for AArch64 with its libraries, in a folder of its own.
aarch64_python() {
    local at=$place/aarch64
    [[ ! -e $at/root/usr/bin/python$version ]] || return 0
    mkdir -p "$at"/{state/lists/partial,cache/archives/partial,packages,root}
    : >"$at/state/status"
    cat >"$at/apt.conf" <<END
APT::Architecture "arm64";
APT::Architectures "arm64";
APT::Sandbox::User "root";
Dir::State "$at/state";
Dir::State::status "$at/state/status";
Dir::Cache "$at/cache";
END
    (
        cd "$at/packages"
        export APT_CONFIG=$at/apt.conf
        apt-get -qq update
        apt-get -qq download "python$version-minimal" "libpython$version-minimal" "libpython$version-stdlib" libc6 libgcc-s1 \
            libstdc++6 zlib1g libexpat1 libssl3 libffi8 libbz2-1.0 liblzma5 libuuid1 libsqlite3-0
        for package in *.deb; do
            dpkg -x "$package" "$at/root"
        done
    )
}

aarch64() {
    if ! command -v qemu-aarch64 >/dev/null || ! command -v dpkg >/dev/null; then
        echo "$1: not run, because it needs Debian and QEMU (apt-get install qemu-user)" >&2
        return
    fi
    aarch64_python
    site "$place/aarch64/site" "$1" numpy manylinux_2_28_aarch64 manylinux_2_27_aarch64 manylinux2014_aarch64
    (
        cd "$(mktemp -d)"
        PYTHONPATH=$place/aarch64/site qemu-aarch64 -L "$place/aarch64/root" "$place/aarch64/root/usr/bin/python$version" \
            "$root/tools/python/tests/foreign_check.py"
    )
}

# Python for Windows from packages of PyPI. The wheel of Panda3D has the library and the modules of CPython, because programs
# are made with it. The modules in Python are those of this machine. The program and the stable library are made here.
windows_python() {
    local at=$place/windows home
    [[ ! -e $at/python/python.exe ]] || return 0
    rm -rf "$at"
    mkdir -p "$at/python/DLLs"
    home=$(python3 -c 'import sys, sysconfig; print(sysconfig.get_path("stdlib") if sys.version_info[:2] == (3, 11) else "")')
    if [[ -z $home ]]; then
        echo "Python $version is missing: its modules are those of Python for Windows" >&2
        return 1
    fi
    python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary :all: --platform win_amd64 \
        --python-version "$version" --dest "$at" panda3d==1.10.16
    unzip -qj "$at"/panda3d-*.whl 'deploy_libs/python311.dll' 'deploy_libs/VCRUNTIME140*.dll' -d "$at/python"
    unzip -qj "$at"/panda3d-*.whl 'deploy_libs/*.pyd' 'deploy_libs/lib*.dll' -d "$at/python/DLLs"
    cp -r "$home" "$at/python/Lib"
    rm -rf "$at/python/Lib/site-packages" "$at/python/Lib/lib-dynload" "$at/python/Lib/test"
    # The stable library of CPython forwards each function to the library of its version.
    (
        echo 'LIBRARY "python3.dll"'
        echo EXPORTS
        x86_64-w64-mingw32-objdump -p "$at/python/python311.dll" |
            sed -n '/Ordinal\/Name Pointer/,/^$/s/.*\] \(+base\[ *[0-9]*\] *[0-9a-f]* \)\?\(_\?Py[A-Za-z0-9_]*\)$/\2/p' |
            while read -r name; do echo "    $name = python311.$name"; done
    ) >"$at/python3.def"
    echo >"$at/none.c"
    x86_64-w64-mingw32-gcc -shared -nostdlib -Wl,--entry=0 "$at/none.c" "$at/python3.def" -o "$at/python/python3.dll"
    cat >"$at/python.c" <<'END'
#include <windows.h>
int wmain(int count, wchar_t **words) {
    HMODULE library = LoadLibraryW(L"python311.dll");
    int (*run)(int, wchar_t **) = library ? (int (*)(int, wchar_t **))GetProcAddress(library, "Py_Main") : 0;
    return run ? run(count, words) : 9;
}
END
    x86_64-w64-mingw32-gcc -municode "$at/python.c" -o "$at/python/python.exe"
}

windows() {
    export PATH=$PATH:/usr/lib/wine # Where Debian has it.
    local wine work
    wine=$(command -v wine64 || command -v wine || true)
    if [[ -z $wine ]] || ! command -v x86_64-w64-mingw32-gcc >/dev/null; then
        echo "$1: not run, because it needs Wine and MinGW (tools/setup.sh windows)" >&2
        return
    fi
    windows_python
    # Wine 8 lacks functions of complex numbers that NumPy 2 calls.
    site "$place/windows/site" "$1" numpy==1.26.4 win_amd64
    work=$(mktemp -d)
    (
        export WINEPREFIX=$work/wine WINEDEBUG=-all WINEDLLOVERRIDES="mscoree,mshtml=" DISPLAY=
        trap 'wineserver -k || true; wineserver -w || true; rm -rf "$work"' EXIT
        mkdir "$work/here"
        # Debian's Wine 8 lacks the one function by which Rust asks Windows for random numbers. Python looks for libraries of
        # modules beside itself, and not on the path.
        x86_64-w64-mingw32-gcc -shared -x c - -o "$place/windows/python/bcryptprimitives.dll" <<'END'
#include <windows.h>
#include <ntsecapi.h>
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE data, SIZE_T length) { return RtlGenRandom(data, length); }
END
        local python=Z:${place//\//\\}\\windows
        export PYTHONPATH="$python\\site" PYTHONHOME="$python\\python"
        cd "$work/here"
        # Python refuses standard files that Wine has not as pipes.
        "$wine" "$place/windows/python/python.exe" "Z:${root//\//\\}\\tools\\python\\tests\\foreign_check.py" </dev/null 2>&1 | cat
    )
}

for wheel; do
    wheel=$(realpath "$wheel")
    echo "+ $(basename "$wheel")"
    case $wheel in
    *_aarch64.whl) aarch64 "$wheel" ;;
    *-win_amd64.whl) windows "$wheel" ;;
    *) echo "$wheel: it is not for another machine" >&2; exit 1 ;;
    esac
done
