#!/usr/bin/env bash
# Makes the archives of a release in dist/: x86-64, for Linux with glibc 2.28 or newer and for Windows, with their checksums.
# tools/release.sh [PROFILE] takes the profile `release`, or another. Wants zig as the linker that knows old glibcs (pip install
# cargo-zigbuild ziglang), MinGW's linker (apt-get install gcc-mingw-w64-x86-64), Python and zip; with Wine the program for
# Windows is tried too.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
profile=${1:-release}
glibc=2.28
linux=x86_64-unknown-linux-gnu
windows=x86_64-pc-windows-gnu
for tool in cargo-zigbuild x86_64-w64-mingw32-gcc objdump zip unzip; do
    command -v "$tool" >/dev/null || { echo "$tool was not found: see the head of $0" >&2; exit 1; }
done
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
built=$(cargo metadata --format-version 1 --no-deps | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
dist=$root/dist
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# The licences of what is linked in, from the sources that were compiled.
licences() {
    cargo tree --quiet --package eyebox-tools --edges normal --target "$1" --prefix none --format '{p}|{l}' | sort -u |
        while IFS='|' read -r package licence; do
            read -r name number _ <<<"$package"
            found=("${CARGO_HOME:-$HOME/.cargo}"/registry/src/*/"$name-${number#v}")
            [[ -d ${found[0]} ]] || continue
            printf '\n==== %s %s: %s\n' "$name" "$number" "$licence"
            find "${found[0]}" -maxdepth 1 -type f \( -iname 'licen[cs]e*' -o -iname 'copying*' -o -iname 'notice*' \) \
                -print0 | sort -z | xargs -0 -r cat
        done
}

# What lies beside a program.
fill() {
    mkdir -p "$2"
    cp -r README.md CHANGELOG.md LICENSE-APACHE LICENSE-MIT docs "$2"
    licences "$1" >"$2/THIRD-PARTY-LICENSES.txt"
    local program=$built/$linux/$folder/eyebox
    mkdir "$2/completions"
    for shell in bash zsh fish powershell; do
        "$program" completions "$shell" >"$2/completions/eyebox.$shell"
    done
    "$program" man --out "$2/man"
}

# Cargo calls the folder of the profile `dev` debug.
folder=$profile
[[ $profile != dev ]] || folder=debug
rustup target add "$linux" "$windows" 2>/dev/null
cargo zigbuild --profile "$profile" --target "$linux.$glibc" --package eyebox-tools --bin eyebox
cargo zigbuild --profile "$profile" --target "$linux.$glibc" --package eyebox-openxr
cargo build --profile "$profile" --target "$windows" --package eyebox-tools --bin eyebox

needs=$(objdump -T "$built/$linux/$folder/eyebox" | grep -o 'GLIBC_[0-9.]*' | sort -uV | tail -n 1)
if [[ $(printf '%s\n' "$needs" "GLIBC_$glibc" | sort -V | tail -n 1) != "GLIBC_$glibc" ]]; then
    echo "the program needs $needs, more than $glibc" >&2
    exit 1
fi

name=eyebox-$version
fill "$linux" "$work/$name-x86_64-linux"
fill "$windows" "$work/$name-x86_64-windows"
# Without what a debugger reads, four fifths of it.
strip --strip-debug -o "$work/$name-x86_64-linux/eyebox" "$built/$linux/$folder/eyebox"
# The command finds the OpenXR layer in its own folder.
strip --strip-debug -o "$work/$name-x86_64-linux/libeyebox_openxr.so" "$built/$linux/$folder/libeyebox_openxr.so"
x86_64-w64-mingw32-strip --strip-debug -o "$work/$name-x86_64-windows/eyebox.exe" "$built/$windows/$folder/eyebox.exe"
mkdir -p "$dist"
rm -f "$dist"/*
tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$(git log -1 --format=%ct)" -C "$work" \
    -czf "$dist/$name-x86_64-linux.tar.gz" "$name-x86_64-linux"
(cd "$work" && zip -qrX "$dist/$name-x86_64-windows.zip" "$name-x86_64-windows")
(cd "$dist" && sha256sum -- *.tar.gz *.zip >SHA256SUMS)

# What was packed runs.
mkdir "$work/tried"
cd "$work/tried"
(cd "$dist" && sha256sum --quiet --check SHA256SUMS)
tar -xzf "$dist/$name-x86_64-linux.tar.gz"
unzip -q "$dist/$name-x86_64-windows.zip"
"$name-x86_64-linux/eyebox" demo --engine cpu --size 64 --out demo

if PATH=$PATH:/usr/lib/wine command -v wine64 >/dev/null; then
    EYEBOX=$name-x86_64-windows/eyebox.exe "$root/tools/windows.sh"
fi
echo "of the system's C library it needs $needs"
cat "$dist/SHA256SUMS"
