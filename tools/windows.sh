#!/usr/bin/env bash
# Builds the command and tests for Windows and runs them under Wine, on the CPU: tools/windows.sh
# tools/windows.sh command: the command, and the CPU engine against float64, without the library's own tests; EYEBOX=PROGRAM.exe:
# that program alone. tools/setup.sh windows installs what it wants.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
program=${EYEBOX:+$(realpath "$EYEBOX")}
cd "$root"
target=x86_64-pc-windows-gnu

export PATH=$PATH:/usr/lib/wine # Where Debian has it.
wine=$(command -v wine64 || command -v wine || true)
if [[ -z $wine ]]; then
    echo "Wine was not found: tools/setup.sh windows" >&2
    exit 1
fi
work=$(mktemp -d)
export WINEPREFIX=$work/wine WINEDEBUG=-all
# Its server goes on after the last program: it has to end before its folder goes.
trap 'wineserver -k || true; wineserver -w || true; rm -rf "$work"' EXIT
# No desktop, and no questions for what a browser would need.
export WINEDLLOVERRIDES="mscoree,mshtml=" DISPLAY=
# Debian's Wine 8 lacks the one function by which Rust asks Windows for random numbers.
mkdir "$work/library"
x86_64-w64-mingw32-gcc -shared -x c - -o "$work/library/bcryptprimitives.dll" <<'END'
#include <windows.h>
#include <ntsecapi.h>
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE data, SIZE_T length) { return RtlGenRandom(data, length); }
END
export WINEPATH=Z:${work//\//\\}\\library
run() {
    echo "+ $*"
    "$wine" "$@"
}

# Half the time to build, and enough to run at 64 x 64. What is built for this machine itself stays as it is.
export CARGO_PROFILE_DEV_OPT_LEVEL=0
if [[ -z $program ]]; then
    rustup target add "$target" 2>/dev/null || true
    # At once: what the two share is built once.
    tests=$(cargo build --quiet --target "$target" --package eyebox-tools --package eyebox-tests --bin eyebox --test library \
        --message-format json-render-diagnostics | sed -n 's/.*"executable":"\([^"]*library-[^"]*\.exe\)".*/\1/p')
    built=$(cargo metadata --format-version 1 --no-deps | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
    program=$built/$target/debug/eyebox.exe
fi

here=$work/here
mkdir "$here"
cd "$here"
run "$program" --version
run "$program" demo --engine cpu --size 64 --out demo
run "$program" solve builtin:still-life --engine cpu --size 64x64 --color green --steps 2 -o still-life.zarr
# Once more: what stands there is replaced.
run "$program" solve builtin:still-life --engine cpu --size 64x64 --color green --steps 2 -o still-life.zarr
run "$program" render still-life.zarr --engine cpu --pupil=4,0,4,1.5 -o seen.png
run "$program" encode still-life.zarr --display grey8 --size 64x64 -o frames
for made in demo/still-life.zarr/zarr.json still-life.zarr/zarr.json seen.png frames; do
    [[ -e $made ]] || { echo "$made was not made" >&2; exit 1; }
done
if compgen -G '.eyebox-*' >/dev/null; then
    echo "a draft stayed behind:" .eyebox-* >&2
    exit 1
fi
cd "$root"
[[ -z ${EYEBOX:-} ]] || exit 0
# Wine has no Vulkan without a display.
run "$tests" --quiet reference:: far_field:: --skip both_engines
[[ ${1:-} != command ]] || exit 0

export CARGO_TARGET_X86_64_PC_WINDOWS_GNU_RUNNER=$wine
library() { cargo test --quiet --target "$target" --lib "$@"; }
library --package eyebox-base --package eyebox-lab --package eyebox-optics --package eyebox-present --package eyebox-scene
library --package eyebox-compute -- engine::cpu plan::
library --package eyebox-solve -- encode:: encoded:: evaluate:: hologram:: produce:: quality:: reconstruction::
library --package eyebox-tracking -- gaze::
library --package eyebox-session -- preview::
