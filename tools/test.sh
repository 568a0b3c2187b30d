#!/usr/bin/env bash
# Sets the machine up if needed, then runs every check: formatting, lints, documentation, the smallest build, tests, and the
# commands that the README shows. What takes longer is in tools/nightly.sh.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"

stage() { printf '\n== %s (after %d s)\n' "$*" "$SECONDS"; }

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
if grep -rnE '^(<<<<<<<|>>>>>>>)' --include='*.md' --include='*.toml' --include='*.sh' . --exclude-dir=target; then
    echo "what a merge has left (above) has to go" >&2
    exit 1
fi

stage "lints"
cargo clippy --workspace --all-targets --quiet -- -D warnings

stage "the library without its features, and the command for devices"
cargo clippy --package eyebox --no-default-features --quiet -- -D warnings
cargo clippy --package eyebox-tools --bins --no-default-features --quiet -- -D warnings

# It runs under Wine in tools/nightly.sh.
stage "lints for Windows"
rustup target add x86_64-pc-windows-gnu 2>/dev/null || true
cargo clippy --target x86_64-pc-windows-gnu --package eyebox-tools --bins --quiet -- -D warnings
cargo clippy --target x86_64-pc-windows-gnu --package eyebox-python --lib --quiet -- -D warnings

stage "documentation"
# The command's pages are checked, then the library's take their place: both are called eyebox.
export RUSTDOCFLAGS="-D warnings"
cargo doc --package eyebox-tools --bins --no-deps --quiet
cargo doc --workspace --no-deps --quiet

stage "tests"
# Many tests wait for somebody: a clock, a process, a window.
export RUST_TEST_THREADS=${RUST_TEST_THREADS:-$((2 * $(nproc)))}
cargo test --workspace --no-run
# Generated cases run beside the other tests, because they wait more than they compute. Their number is fixed: the same cases
# run on every machine. tools/nightly.sh runs ten times as many.
generated=whatever_comes_the_command_ends_well
attack=$(mktemp)
EYEBOX_ATTACK_CASES=${EYEBOX_ATTACK_CASES:-2000} cargo test --workspace --test attack -- --nocapture "$generated" >"$attack" 2>&1 &
cargo test --workspace --no-fail-fast -- --skip "$generated" || failed=$?
wait $! || failed=$?
cat "$attack"
rm "$attack"
if [[ ${failed:-} ]]; then
    exit "$failed"
fi

# Memory that nobody wrote, staging and fused lists have no effect on lavapipe itself. `kernels` shows reads of unwritten
# memory, kernel by kernel. `shared` and `views` use the kinds of memory, and the others take whole steps with fused
# lists. Long tests of large sizes are left to tools/nightly.sh, which runs all of tests/vulkan there.
stage "tests of the Vulkan engine on a device that poses as a discrete GPU"
tools/posing.sh cargo test --workspace --test vulkan -- --include-ignored \
    posing:: kernels:: shared:: splats:: views:: source:: steps::both_engines \
    --skip with_halves --skip every_method --skip every_subgroup_size --skip large --skip window_forward --skip window_inverse

stage "the Python package"
tools/python.sh

stage "a program outside of the workspace"
# Of the workspace's versions, in its folder: what it has built is built no second time.
cp Cargo.lock tests/embed/Cargo.lock
target=$(cargo metadata --format-version 1 --no-deps | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
cargo run --quiet --manifest-path tests/embed/Cargo.toml --target-dir "$target"

stage "the language of documents, help, messages and comments"
EYEBOX=$target/debug/eyebox tools/prose.py
tools/measurements.py --check
tools/drawings.py --check

stage "the README's commands"
# With the program that the tests have built.
EYEBOX=$target/debug/eyebox tools/readme.sh
stage "the documents as a site"
tools/setup.sh site || echo "continuing without: its pages are not opened" >&2
EYEBOX=$target/debug/eyebox tools/site.sh
stage "done"
