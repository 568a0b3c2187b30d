"""Collects the pages of the site in a folder for mdBook (run `assemble.py ROOT EYEBOX OUT`).

The pages are the documents, the front pages of the repository, and pages that are made from the source. EYEBOX is the
command, whose help becomes a page."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import files
from latex2mathml.converter import convert

# Pages outside of docs/ with their places on the site.
OUTSIDE = {"README.md": "introduction.md", "ARCHITECTURE.md": "architecture.md", "CHANGELOG.md": "changelog.md"}
RUST = """# Rust

The crate `eyebox` is the library, with all functions of the command ([documentation](../rust/eyebox/index.html)). The
crate [eyebox-live-input](../rust/eyebox_live_input/index.html) sends frames from another process, and needs no other
crate of eyebox. Example programs are in the repository's `runtime/eyebox/examples`.
"""
REPOSITORY = "https://github.com/eyebox/eyebox/blob/main/"


def mathematics(text):
    """Converts equations to MathML, which browsers show without a script or a font."""

    def block(found):
        return "\n" + convert(found.group(1).strip(), display="block") + "\n"

    return re.sub(r"^```math\n(.*?)^```$", block, text, flags=re.M | re.S)


def links(text, root, page):
    """Converts links to links within the site. Links to other files lead to the repository."""

    def link(found):
        target, hash_mark, anchor = found.group(2).partition("#")
        if not target or re.match(r"[a-z]+:", target):
            return found.group(0)
        path = Path(root, page).parent.joinpath(target).resolve().relative_to(Path(root).resolve()).as_posix()
        depth = "../" * (len(Path(page).relative_to("docs").parts) - 1) if page.startswith("docs/") else ""
        if path in OUTSIDE:
            new = depth + OUTSIDE[path]
        elif path.startswith("docs/"):
            new = depth + path.removeprefix("docs/")
        else:
            new = REPOSITORY + path
        return f"{found.group(1)}({new}{hash_mark}{anchor})"

    return re.sub(r"(\[[^\[\]]*(?:\[[^\]]*\])?[^\[\]]*\])\(([^)\s]+)\)", link, text)


def commands(eyebox):
    """Returns a page with the help of each command, as the terminal shows it."""

    def ask(*arguments):
        result = subprocess.run([eyebox, "help", *arguments], capture_output=True, text=True, check=True, env={"COLUMNS": "110"})
        return result.stdout.rstrip()

    def below(text):
        """Returns the commands that a help text lists."""
        _, heading, rest = text.partition("\nCommands:\n")
        names = re.findall(r"^  ([a-z]+) ", rest.split("Options:")[0], re.M) if heading else []
        return [name for name in names if name != "help"]

    front = ask()
    out = ["# Commands\n", "The output of `eyebox help COMMAND`. `eyebox man` writes it as manual pages.\n"]
    out.append(f"```text\n{front}\n```\n")
    for name in below(front):
        text = ask(name)
        out.append(f"\n## {name}\n\n```text\n{text}\n```\n")
        out += [f"\n### {name} {sub}\n\n```text\n{ask(name, sub)}\n```\n" for sub in below(text)]
    return "\n".join(out)


def main(root, eyebox, out):
    root, out = Path(root), Path(out)
    if out.exists():
        shutil.rmtree(out)
    shutil.copytree(root / "docs", out)
    pages = [p.relative_to(root).as_posix() for p in (root / "docs").rglob("*.md")]
    for page in [*pages, *OUTSIDE]:
        text = mathematics(links((root / page).read_text(), root, page))
        (out / OUTSIDE.get(page, page.removeprefix("docs/"))).write_text(text)
    # The table of contents has links to pages that are made here, so its links are not converted.
    shutil.copy(root / "docs/SUMMARY.md", out)
    (out / "reference").mkdir()
    (out / "reference/commands.md").write_text(commands(eyebox))
    (out / "reference/files.md").write_text(files.page(root))
    (out / "reference/rust.md").write_text(RUST)


if __name__ == "__main__":
    main(*sys.argv[1:])
