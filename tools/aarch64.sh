#!/usr/bin/env bash
# Builds the command for Linux on aarch64, such as a Jetson or a Raspberry Pi 4 or newer with a 64-bit system:
#     tools/aarch64.sh [PROFILE]       an archive in dist/, of the profile `release` or another
#     tools/aarch64.sh test            tests of the library and of the command under qemu-user
# tools/setup.sh aarch64 installs the linker and qemu-user.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
target=aarch64-unknown-linux-gnu
cross=aarch64-linux-gnu
for tool in $cross-gcc $cross-strip $cross-objdump qemu-aarch64; do
    command -v "$tool" >/dev/null || { echo "$tool was not found: tools/setup.sh aarch64" >&2; exit 1; }
done
rustup target add "$target" 2>/dev/null || true
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=$cross-gcc
# Debian's cross compiler has the libraries of the system there.
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64 -L /usr/$cross"
profile=${1:-release}
built=$(cargo metadata --format-version 1 --no-deps | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')

# A script that runs the command. Tests of this machine start it like the command.
wrapper() {
    local script=$built/$target/eyebox-under-qemu
    # Some tests empty the path.
    printf '#!/bin/sh\nexec %s -L /usr/%s %s "$@"\n' "$(command -v qemu-aarch64)" "$cross" "$1" >"$script"
    chmod +x "$script"
    echo "$script"
}

run() {
    echo "+ eyebox $*"
    qemu-aarch64 -L "/usr/$cross" "$program" "$@"
}

# Computes, shows and reads back in the current folder.
commands() {
    run --version
    run solve builtin:still-life --engine cpu --size 64x64 --color green --steps 2 -o still-life.zarr
    local show=(show still-life.zarr --display grey8 --size 64x64 --engine cpu --clock simulated --duration 0.2)
    run "${show[@]}" --output raw:shown.raw
    local all=(still-life.zarr/zarr.json shown.raw)
    # The smaller command has no others.
    if [[ $profile != device ]]; then
        run demo --engine cpu --size 64 --out demo
        run render still-life.zarr --engine cpu --pupil=4,0,4,1.5 -o seen.png
        run encode still-life.zarr --display grey8 --size 64x64 -o frames
        run "${show[@]}" --record shown
        all+=(demo/still-life.zarr/zarr.json seen.png frames shown)
    fi
    for made in "${all[@]}"; do
        [[ -e $made ]] || { echo "$made was not made" >&2; exit 1; }
    done
}

library() { cargo test --quiet --target "$target" --lib "$@"; }

if [[ ${1:-} == test ]]; then
    cargo build --target "$target" --package eyebox-tools --bin eyebox
    # qemu-user has no Vulkan driver, and Xvfb of another processor cannot be loaded. Tests of both are left out.
    library --package eyebox-kernels
    library --package eyebox-base
    library --package eyebox-optics
    library --package eyebox-scene
    library --package eyebox-compute -- engine::cpu plan::
    library --package eyebox-tracking
    library --package eyebox-solve --features image-formats -- encode:: encoded:: evaluate:: hologram:: reconstruction:: solve::tests
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    program=$built/$target/debug/eyebox
    (cd "$work" && commands)
    EYEBOX_BINARY=$(wrapper "$built/$target/debug/eyebox")
    export EYEBOX_BINARY
    cargo test --quiet --package eyebox-tools --test golden
    cargo test --quiet --package eyebox-tools --test command -- basics:: files::
    exit 0
fi

folder=$profile
[[ $profile != dev ]] || folder=debug
features=()
# The profile for devices goes with the smaller command.
[[ $profile != device ]] || features=(--no-default-features)
cargo build --profile "$profile" --target "$target" --package eyebox-tools --bin eyebox "${features[@]}"
program=$built/$target/$folder/eyebox
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
name=eyebox-$version-aarch64-linux
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p dist "$work/$name"
cp -r README.md CHANGELOG.md LICENSE-APACHE LICENSE-MIT docs tools/eyebox-show.service "$work/$name"
"$cross-strip" -o "$work/$name/eyebox" "$program"
archive=$root/dist/$name.tar.gz
tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$(git log -1 --format=%ct)" -C "$work" \
    -czf "$archive" "$name"
# The packed program runs.
mkdir "$work/tried"
tar -xzf "$archive" -C "$work/tried"
cd "$work/tried"
program=$work/tried/$name/eyebox
commands
needs=$("$cross-objdump" -T "$program" | grep -o 'GLIBC_[0-9.]*' | sort -uV | tail -n 1)
echo "$archive: $(stat -c %s "$program") bytes of program, which needs $needs"
