#!/usr/bin/env bash
# Usage: tools/c/install.sh PREFIX [PROFILE]. Builds eyebox for C and installs the header, both libraries, and the files for
# pkg-config and CMake. PREFIX is /usr/local or a folder of your own. PROFILE is a Cargo profile, by default release. With
# EYEBOX_BUILT=FOLDER nothing is built, and the libraries come from that folder.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
[[ ${1:-} ]] || { sed -n '2,4s/^# //p' "$0" >&2; exit 2; }
mkdir -p "$1"
prefix=$(cd "$1" && pwd)
profile=${2:-release}
built=${EYEBOX_BUILT:-}
if [[ ! $built ]]; then
    cargo build --quiet --manifest-path "$here/../../Cargo.toml" --profile "$profile" --package eyebox-c --lib
    built=$(cargo metadata --format-version 1 --no-deps --manifest-path "$here/Cargo.toml" |
        sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
    # The folder of the profile dev is named debug by Cargo.
    [[ $profile != dev ]] || profile=debug
    built=$built/$profile
fi
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml" | head -n 1)
# As build.rs names it: before 1.0, each minor version may change the interface.
interface=${version%%.*}
[[ $interface != 0 ]] || interface=${version%.*}
filled() {
    sed -e "s|@PREFIX@|$prefix|g" -e "s|@VERSION@|$version|g" -e "s|@INTERFACE@|$interface|g" "$here/$1.in" >"$2/$1"
}
lib=$prefix/lib
mkdir -p "$prefix/include" "$lib/pkgconfig" "$lib/cmake/eyebox"
install -m 644 "$here/eyebox.h" "$prefix/include/eyebox.h"
install -m 755 "$built/libeyebox_c.so" "$lib/libeyebox.so.$version"
ln -sf "libeyebox.so.$version" "$lib/libeyebox.so.$interface"
ln -sf "libeyebox.so.$interface" "$lib/libeyebox.so"
install -m 644 "$built/libeyebox_c.a" "$lib/libeyebox.a"
filled eyebox.pc "$lib/pkgconfig"
filled eyebox-static.pc "$lib/pkgconfig"
filled eyebox-config.cmake "$lib/cmake/eyebox"
filled eyebox-config-version.cmake "$lib/cmake/eyebox"
