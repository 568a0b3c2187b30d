#!/usr/bin/env bash
# What a plan leaves out costs nothing: scenes are solved as planned and with each saving undone, and all are scored through
# the same pupils. Colours and views that are left out may cost 0.05 dB; the other lines are for reading. EYEBOX is the
# command: EYEBOX=target/release/eyebox tools/savings.sh
set -euo pipefail
eyebox=${EYEBOX:?"the command to run, such as target/release/eyebox"}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# The number of a key of a JSON object.
number() { sed "s/.*\"$1\":\([-0-9.e]*\).*/\1/"; }

failed=0
for scene in builtin:plane "builtin:still-life?span=0.1" builtin:still-life; do
    planned=
    for kept in none colors views padding window all; do
        full=()
        [[ $kept == none ]] || full=(--set "full=$kept")
        rm -rf "$work/hologram.zarr"
        said=$("$eyebox" solve "$scene" --size 256x256 --color green --json -o "$work/hologram.zarr" "${full[@]}")
        decibels=$("$eyebox" eval score "$work/hologram.zarr" "$scene" | sed -n 's/^PSNR .*: mean \([-0-9.]*\),.*/\1/p')
        printf '%-28s full: %-8s %6.2f dB, %5.1f s, %4d MiB\n' "$scene" "$kept" "$decibels" \
            "$(number seconds <<<"$said")" "$(number peak_memory_mib <<<"$said")"
        planned=${planned:-$decibels}
        if [[ $kept == colors || $kept == views ]] && awk "BEGIN { exit !($decibels - $planned > 0.05) }"; then
            echo "leaving out $kept costs more than 0.05 dB" >&2
            failed=1
        fi
    done
done
exit $failed
