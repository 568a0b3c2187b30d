#!/usr/bin/env bash
# Runs a command on a Vulkan device that poses as a discrete GPU, which is lavapipe behind tests/posing/driver.c:
#     tools/posing.sh target/debug/eyebox devices
#     tools/posing.sh cargo test --workspace --test vulkan -- --include-ignored steps::
# EYEBOX_POSING_LIMITS sets smaller limits. The driver's first comment has their names.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
folder=${CARGO_TARGET_DIR:-$root/target}/posing
mkdir -p "$folder"
# Each file is replaced at once, because a command of an earlier call may still run.
new=$folder/new.$$
cc -std=c11 -O1 -Wall -Wextra -shared -fPIC -fvisibility=hidden "$root/tests/posing/driver.c" -o "$new" -ldl -lpthread
mv "$new" "$folder/libposing.so"
cat >"$new" <<'MANIFEST'
{"file_format_version": "1.0.0", "ICD": {"library_path": "./libposing.so", "api_version": "1.2.0"}}
MANIFEST
mv "$new" "$folder/posing.json"
# Loaders before 1.3.207 read the second variable.
export VK_DRIVER_FILES=$folder/posing.json VK_ICD_FILENAMES=$folder/posing.json
exec "$@"
