#!/usr/bin/env bash
# Sets the machine up if needed, builds, and runs the demo. Arguments go to it: tools/demo.sh --size 256 --out pictures
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

# The demo needs no Vulkan: the CPU engine is there always.
"$root/tools/setup.sh" || echo "demo: going on without; the CPU engine needs nothing of it" >&2
echo "demo: building (the first time takes a few minutes)" >&2
cargo build --release --quiet --manifest-path "$root/Cargo.toml" -p eyebox-tools
echo "demo: running" >&2
exec cargo run --release --quiet --manifest-path "$root/Cargo.toml" -- demo "$@"
