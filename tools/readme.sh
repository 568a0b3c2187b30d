#!/usr/bin/env bash
# Runs the commands that the README, docs/guide.md and the pages in docs/start show, in folders and with a cache of their own, with the program
# $EYEBOX: lines that start with 'eyebox ' in the README and in docs/start, and with 'cargo run --release -- ' in the README and the guide.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
eyebox=${EYEBOX:?set EYEBOX to the program to run them with, such as target/release/eyebox}
eyebox=$(realpath "$eyebox")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
count=0
run_in() { # FOLDER: the commands that come by standard input
    mkdir -p "$1"
    while IFS= read -r command; do
        echo "\$ $command"
        arguments=${command#cargo run --release -- }
        (cd "$1" && XDG_CACHE_HOME="$work/cache" eval "\"\$eyebox\" ${arguments#eyebox }") </dev/null
        count=$((count + 1))
    done
}
run_in "$work/readme" < <(grep -hE '^(cargo run --release --|eyebox) ' "$root/README.md"; grep -h '^cargo run --release -- ' "$root/docs/guide.md")
for page in "$root"/docs/start/*.md; do
    # The path of the eye of the film.
    mkdir -p "$work/$(basename "$page" .md)"
    echo '{"keys": [{"t_s": 0, "x_mm": -4}, {"t_s": 1, "x_mm": 4}]}' >"$work/$(basename "$page" .md)/path.json"
    run_in "$work/$(basename "$page" .md)" < <(grep -h '^eyebox ' "$page")
done
if ((count < 40)); then
    echo "the README, the guide and docs/start show too few commands: expected lines that start with 'eyebox ' or 'cargo run --release -- '" >&2
    exit 1
fi
echo "all $count commands of the README, the guide and docs/start ran"
