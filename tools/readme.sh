#!/usr/bin/env bash
# Runs the commands of the README, docs/guide.md, docs/start and docs/tutorials with the program $EYEBOX. Each page has a folder of its
# own, and all pages share one cache. The commands are the lines that start with 'eyebox ' in the README, docs/start and docs/tutorials,
# and with 'cargo run --release -- ' in the README and the guide. A tutorial also has lines that start with 'python3 ' or 'echo ', and
# blocks of Python and TOML whose first line is a comment with a file name. They are written to these files first.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
eyebox=${EYEBOX:?set EYEBOX to the program to run them with, such as target/release/eyebox}
eyebox=$(realpath "$eyebox")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# Programs of the tutorials start eyebox and Python by their names.
mkdir "$work/bin"
ln -s "$eyebox" "$work/bin/eyebox"
numpy=
for python in "${PYTHON:-python3}" "${CARGO_TARGET_DIR:-$root/target}/python/tests/bin/python"; do
    # Its full path, because by the name 'python3' the file below would start itself.
    if executable=$("$python" -c 'import numpy, sys; print(sys.executable)' 2>/dev/null); then
        # No link, because an environment finds its packages by the place of its Python.
        printf '#!/bin/sh\nexec %q "$@"\n' "$executable" >"$work/bin/python3"
        chmod +x "$work/bin/python3"
        numpy=yes
        break
    fi
done
export PATH="$work/bin:$PATH" XDG_CACHE_HOME="$work/cache"
count=0
run_in() { # FOLDER: the commands that come by standard input
    mkdir -p "$1"
    while IFS= read -r command; do
        echo "\$ $command"
        (cd "$1" && eval "${command/#cargo run --release -- /eyebox }") </dev/null
        count=$((count + 1))
    done
}
write_files() { # PAGE FOLDER: the blocks of the page that name a file
    awk -v folder="$2" '
        /^```/ { file = ""; first = ($0 == "```python" || $0 == "```toml"); next }
        first { first = 0; if ($0 ~ /^# [a-z_]+[.](py|toml)/) { file = $2; sub(/:$/, "", file); file = folder "/" file } }
        file { print > file }' "$1"
}
run_in "$work/readme" < <(grep -hE '^(cargo run --release --|eyebox) ' "$root/README.md"; grep -h '^cargo run --release -- ' "$root/docs/guide.md")
for page in "$root"/docs/start/*.md; do
    # The path of the eye of the film.
    mkdir -p "$work/$(basename "$page" .md)"
    echo '{"keys": [{"t_s": 0, "x_mm": -4}, {"t_s": 1, "x_mm": 4}]}' >"$work/$(basename "$page" .md)/path.json"
    run_in "$work/$(basename "$page" .md)" < <(grep -h '^eyebox ' "$page")
done
for page in "$root"/docs/tutorials/*.md; do
    if [[ ! $numpy ]] && grep -q '^import numpy' "$page"; then
        echo "${page#"$root/"} is left out: its programs need NumPy, which neither python3 nor the tests of the Python package have"
        continue
    fi
    folder=$work/tutorials/$(basename "$page" .md)
    mkdir -p "$folder"
    write_files "$page" "$folder"
    run_in "$folder" < <(grep -hE '^(eyebox|python3|echo) ' "$page")
done
if ((count < 40)); then
    echo "the README, the guide, docs/start and docs/tutorials show too few commands: expected lines that start with 'eyebox ' or" \
        "'cargo run --release -- '" >&2
    exit 1
fi
echo "all $count commands of the README, the guide, docs/start and docs/tutorials ran"
