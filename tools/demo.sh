#!/usr/bin/env bash
# Sets the machine up if needed, builds, and runs the demo. Arguments go to it: tools/demo.sh --size 256 --out pictures
# EYEBOX=PROGRAM takes a program that is built already.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

# The demo needs no Vulkan: the CPU engine is there always.
"$root/tools/setup.sh" || echo "demo: continuing without; the CPU engine needs nothing of it" >&2
if [[ -z ${EYEBOX:-} ]]; then
    echo "demo: building (the first time takes two or three minutes)" >&2
    cargo build --profile demo --manifest-path "$root/Cargo.toml" --package eyebox-tools --bin eyebox
    EYEBOX=$(cargo metadata --format-version 1 --no-deps --manifest-path "$root/Cargo.toml" |
        sed 's/.*"target_directory":"\([^"]*\)".*/\1/')/demo/eyebox
fi
echo "demo: running" >&2
exec "$EYEBOX" demo "$@"
