#!/usr/bin/env bash
# Runs the commands that the README and docs/guide.md show, in a folder and with a cache of their own, with the program $EYEBOX:
# lines that start with 'eyebox ' in the README, and with 'cargo run --release -- ' in both.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
eyebox=${EYEBOX:?set EYEBOX to the program to run them with, such as target/release/eyebox}
eyebox=$(realpath "$eyebox")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
count=0
while IFS= read -r command; do
    echo "\$ $command"
    arguments=${command#cargo run --release -- }
    (cd "$work" && XDG_CACHE_HOME="$work/cache" eval "\"\$eyebox\" ${arguments#eyebox }") </dev/null
    count=$((count + 1))
done < <(grep -hE '^(cargo run --release --|eyebox) ' "$root/README.md"; grep -h '^cargo run --release -- ' "$root/docs/guide.md")
if ((count < 10)); then
    echo "the README and the guide show too few commands: expected lines that start with 'eyebox ' or 'cargo run --release -- '" >&2
    exit 1
fi
echo "all $count commands of the README and the guide ran"
