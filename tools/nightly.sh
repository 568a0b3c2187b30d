#!/usr/bin/env bash
# What takes too long for every change: the release build, with link-time optimisation, and with it the README's commands, the
# tests that have a long form, and fuzzing. Seconds of fuzzing for each subject: tools/nightly.sh 600 (the default).
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
seconds=${1:-600}

stage() { printf '\n== %s (after %d s)\n' "$*" "$SECONDS"; }

stage "set-up"
tools/setup.sh

stage "the release build, with the benchmarks"
cargo build --release --workspace --bins
cargo build --release -p eyebox-tests --benches

stage "the README's commands"
target=$(cargo metadata --format-version 1 --no-deps | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
EYEBOX=$target/release/eyebox tools/readme.sh

stage "what a plan leaves out"
EYEBOX=$target/release/eyebox tools/savings.sh

stage "Windows: lints, and under Wine"
tools/setup.sh windows
rustup target add x86_64-pc-windows-gnu 2>/dev/null || true
cargo clippy --target x86_64-pc-windows-gnu --package eyebox-tools --bins --quiet -- -D warnings
tools/windows.sh

stage "the Python package as wheels, with its long tests"
EYEBOX=$target/release/eyebox tools/python.sh wheels

stage "tests, at the ends of every range and for ten minutes of playing"
EYEBOX_LINK=full EYEBOX_EXTREMES=full EYEBOX_SOAK=full EYEBOX_MUTATIONS=10000 EYEBOX_KILLS=200 cargo test --release --workspace

# The transforms must not depend on the size of a subgroup: 4 and 16 lanes instead of this machine's 8.
for width in 128 512; do
    stage "shaders with vectors of $width bits"
    LP_NATIVE_VECTOR_WIDTH=$width cargo test --release --workspace --test vulkan -- fft::
done

stage "tests of the Vulkan engine on a device that poses as a discrete GPU"
tools/posing.sh cargo test --release --workspace --test vulkan -- --include-ignored
tools/posing.sh cargo test --release --workspace --lib -- splats_tests relief_tests own::tests

# These are the least limits that eyebox accepts, fewer workgroups than every GPU has, and a small window of its memory.
# A pass of a transform has a workgroup along y for each butterfly of a line, at most 120 in these tests.
stage "the same device with small limits"
EYEBOX_POSING_LIMITS="maxComputeSharedMemorySize=16384 maxComputeWorkGroupInvocations=128
    maxComputeWorkGroupSize[0]=128 maxComputeWorkGroupSize[1]=128 maxPerStageDescriptorStorageBuffers=7
    maxComputeWorkGroupCount[0]=2048 maxComputeWorkGroupCount[1]=128 maxComputeWorkGroupCount[2]=64
    maxMemoryAllocationSize=134217728 windowHeap=33554432" \
    tools/posing.sh cargo test --release --workspace --test vulkan -- --include-ignored --skip every_subgroup_size \
    posing:: kernels:: shared:: splats:: views:: flight:: fused:: steps::

# Newer layers track accesses of shaders only on request, and their texts differ. Their drivers are newer, too.
for suite in trixie sid; do
    stage "the validation layer and the driver of Debian $suite"
    newer="$root/tools/newer.sh $suite"
    export CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUNNER=$newer
    cargo test --release --workspace --lib -- a_hazard_is_heard a_kernel_runs_is_timed splats_tests relief_tests device_views_tests own::tests
    cargo test --release --workspace --test vulkan -- kernels:: fused:: flight:: shared:: splats:: views:: \
        --skip every_subgroup_size
    unset CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUNNER
done

# The layer of Debian 12 says nothing, and that of sid ends by a fault.
stage "GPU-assisted validation"
CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUNNER="$root/tools/newer.sh trixie" VK_LAYER_GPUAV_ENABLE=1 \
    cargo test --release --workspace --lib -- --ignored an_access_beyond_a_range_is_heard
work=$(mktemp -d)
for storage in fp32 fp16; do
    VK_INSTANCE_LAYERS=VK_LAYER_KHRONOS_validation VK_LAYER_GPUAV_ENABLE=1 tools/newer.sh trixie "$target/release/eyebox" \
        solve builtin:still-life --size 64x96 --pupils 4 --steps 3 --set storage=$storage --engine vulkan --force \
        -o "$work/$storage.zarr" 2>&1 | tee "$work/log"
    if grep -q 'Validation Error' "$work/log"; then exit 1; fi
done
rm -r "$work"

stage "the program for devices: its size, first light and memory, and the unit that starts it"
CARGO_PROFILE_DEVICE_STRIP=none cargo build --profile device --package eyebox-tools --bin eyebox --no-default-features
tools/device.py "$target/device/eyebox"
EYEBOX_BINARY=$target/device/eyebox cargo test --release --workspace --test command -- on_a_device::

stage "aarch64 under qemu-user, and its archive"
tools/setup.sh aarch64
tools/aarch64.sh test
tools/aarch64.sh

stage "what a compiler for real devices makes of every pipeline"
cargo test --release --workspace --lib -- --include-ignored --nocapture nothing_spills

stage "twenty thousand cases, and ten minutes each of a full disk, a slow one, a busy machine and a mad tracker"
EYEBOX_ATTACK_CASES=20000 EYEBOX_ATTACK_SEED=$(date +%j) EYEBOX_SOAK_MINUTES=10 cargo test --release --workspace --test attack -- \
    --nocapture --test-threads 1

stage "advisories, licences and sources of dependencies"
if cargo deny --version >/dev/null 2>&1; then
    cargo deny check
else
    echo "cargo-deny is missing: cargo install cargo-deny --locked" >&2
fi

stage "fuzzing"
EYEBOX_FUZZ_SECONDS=$seconds cargo test --release --workspace --test library -- fuzz::
stage "done"
