#!/usr/bin/env bash
# Runs a program with the Mesa driver and the validation layer of a newer Debian, in a chroot that debootstrap fills:
#     tools/newer.sh trixie target/debug/eyebox devices
#     CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUNNER="$PWD/tools/newer.sh sid" cargo test --workspace --test vulkan
# It needs root. The program keeps its folder, its environment and /tmp.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
suite=${1:?a suite of Debian, such as trixie or sid}
shift
folder=${EYEBOX_SUITES:-/var/tmp/eyebox-suites}/$suite
if [[ ! -e $folder.complete ]]; then
    command -v debootstrap >/dev/null || { echo "debootstrap was not found: apt-get install debootstrap" >&2; exit 1; }
    rm -rf "$folder"
    mkdir -p "$folder"
    packages=mesa-vulkan-drivers,vulkan-validationlayers,libvulkan1
    debootstrap --variant=minbase --include="$packages" "$suite" "$folder" http://deb.debian.org/debian >"$folder.log"
    touch "$folder.complete"
fi
target=${CARGO_TARGET_DIR:-$root/target}
# The mounts belong to a mount namespace, so they end with the program. The chroot's own names of the folders exist after
# the first run.
mkdir -p "$folder$root" "$folder$target" "$folder/tmp"
export VK_DRIVER_FILES=/usr/share/vulkan/icd.d/lvp_icd.json
exec unshare --mount bash -euc '
    folder=$1 root=$2 target=$3
    for shared in "$root" "$target" /tmp /proc /dev; do mount --rbind "$shared" "$folder$shared"; done
    shift 3
    here=$PWD
    exec chroot "$folder" sh -c "cd \"\$0\" && exec \"\$@\"" "$here" "$@"
' newer.sh "$folder" "$root" "$target" "$@"
