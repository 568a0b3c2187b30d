#!/usr/bin/env bash
# Sets the machine up if needed, then runs every check: formatting, lints, documentation, tests, and the commands that
# the README shows.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"

stage() { printf '\n== %s\n' "$*"; }

stage "set-up"
tools/setup.sh
for component in fmt clippy; do
    if ! cargo "$component" --version >/dev/null 2>&1; then
        echo "cargo $component is missing: rustup component add rustfmt clippy" >&2
        exit 1
    fi
done

stage "formatting"
cargo fmt --all --check

stage "lints"
cargo clippy --workspace --all-targets --quiet -- -D warnings

stage "documentation"
# The command's pages are checked, then the library's take their place: both are called eyebox.
export RUSTDOCFLAGS="-D warnings"
cargo doc --package eyebox-tools --bins --no-deps --quiet
cargo doc --workspace --no-deps --quiet

stage "tests"
cargo test --workspace

# The transforms must not depend on the size of a subgroup: 4 and 16 lanes instead of this machine's 8.
for width in 128 512; do
    stage "shaders with vectors of $width bits"
    LP_NATIVE_VECTOR_WIDTH=$width cargo test --package eyebox-tests --test vulkan fft::
done

stage "the README's commands"
cargo build --release --quiet -p eyebox-tools
eyebox=$(cargo metadata --format-version 1 --no-deps | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')/release/eyebox
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
count=0
while IFS= read -r command; do
    echo "\$ $command"
    # In a folder and with a cache of their own, as they are written but for what builds them.
    (cd "$work" && XDG_CACHE_HOME="$work/cache" eval "\"\$eyebox\" ${command#cargo run --release -- }") </dev/null
    count=$((count + 1))
done < <(grep '^cargo run --release -- ' README.md)
if ((count == 0)); then
    echo "the README shows no command: expected lines that start with 'cargo run --release -- '" >&2
    exit 1
fi
echo "all $count commands of the README ran"
