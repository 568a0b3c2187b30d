#!/usr/bin/env bash
# Usage: tools/c/install.sh PREFIX [PROFILE]. Builds eyebox for C and installs the header, both libraries and eyebox.pc.
# PREFIX is /usr/local or a folder of your own. PROFILE is a Cargo profile, by default release.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
[[ ${1:-} ]] || { sed -n '2,3s/^# //p' "$0" >&2; exit 2; }
mkdir -p "$1"
prefix=$(cd "$1" && pwd)
profile=${2:-release}
cargo build --quiet --manifest-path "$here/../../Cargo.toml" --profile "$profile" --package eyebox-c --lib
built=$(cargo metadata --format-version 1 --no-deps --manifest-path "$here/Cargo.toml" |
    sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
# The folder of the profile dev is named debug by Cargo.
[[ $profile != dev ]] || profile=debug
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml" | head -n 1)
mkdir -p "$prefix/include" "$prefix/lib/pkgconfig"
install -m 644 "$here/eyebox.h" "$prefix/include/eyebox.h"
install -m 755 "$built/$profile/libeyebox_c.so" "$prefix/lib/libeyebox_c.so"
install -m 644 "$built/$profile/libeyebox_c.a" "$prefix/lib/libeyebox_c.a"
sed -e "s|@PREFIX@|$prefix|" -e "s|@VERSION@|$version|" "$here/eyebox.pc.in" >"$prefix/lib/pkgconfig/eyebox.pc"
