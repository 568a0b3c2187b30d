"""The reference of the files that people write, from the structs that read them."""

import re
from pathlib import Path

import rust_source

# (heading, what the file is, its tables: (how the table is called in the file, source, struct))
FILES = [
    (
        "A display file",
        "TOML, `--display FILE.toml`; begun by `eyebox display new`. What each key means at length: [displays](../displays.md).",
        [
            ("", "optics/display.rs", "File"),
            ("[encoding]", "optics/encoding.rs", "Encoding"),
            ("[[encoding.map]]", "optics/encoding.rs", "Place"),
            ("[[encoding.correction]]", "optics/encoding.rs", "Correction"),
            ("[[encoding.grating]]", "optics/encoding.rs", "Grating"),
            ("[model.COLOR]", "optics/model.rs", "ModelTerms"),
            ("[source.COLOR]", "optics/source.rs", "SourceTerms"),
            ("modes of a source", "optics/source.rs", "GivenMode"),
            ("[mask]", "optics/mask.rs", "Mask"),
            ("[[sources]]", "optics/switched.rs", "SwitchedSource"),
            ("[picture]", "optics/picture.rs", "Picture"),
            ("[picture.COLOR]", "optics/picture.rs", "PictureWarp"),
            ("[prescription]", "optics/prescription.rs", "Prescription"),
            ("[viewing]", "optics/viewing.rs", "Viewing"),
        ],
    ),
    (
        "lightfield.toml",
        "In a folder of views: how they stand and how deep they are. More: [scenes](../scenes.md).",
        [("", "scene/read/settings.rs", "Toml")],
    ),
    (
        "Settings of a solve",
        "TOML, `--settings FILE.toml`, the text that `eyebox_solve` of the C interface takes, and what holograms and results keep as JSON. Lengths are meters. More: [settings](../settings.md).",
        [("", "solve/solve/settings.rs", "Settings")],
    ),
    (
        "Settings of a refinement",
        "The table `refine` of `--settings FILE.toml`, and the text that refiners of the C interface take.",
        [("", "solve/solve/refine_settings.rs", "RefineSettings")],
    ),
    (
        "A HID tracker's description",
        "TOML, `--device-file`: where the numbers stand in a report. More: [trackers](../trackers.md).",
        [
            ("", "tracking/trackers/hid/device_file.rs", "File"),
            ("[left], [right], [combined]", "tracking/trackers/hid/device_file.rs", "PlaceText"),
            ("each number", "tracking/trackers/hid/device_file.rs", "SlotText"),
        ],
    ),
    (
        "A tracker's calibration",
        "TOML, `--calibration FILE.toml`, written by `eyebox tracker calibrate`.",
        [("", "tracking/gaze/calibration.rs", "Calibration"), ("[left], [right], [combined]", "tracking/gaze/calibration.rs", "FitText")],
    ),
]


def documented(text, root):
    """Documentation where `[Type::field]` stands for what that field says."""
    found = re.match(r"\[`(\w+)::(\w+)`\](.*)", text)
    if found:
        for source in rust_source.sources(root):
            if rust_source.body(source, "struct", found.group(1)):
                for key, _, said, _ in rust_source.fields(source, found.group(1)):
                    if key == found.group(2):
                        rest = found.group(3).lstrip(":;. ")
                        return said + (f" In files: {rest}" if rest else "")
    # Links of the source's own documentation lead nowhere here.
    return re.sub(r"\[(`[^`\[\]]+`)\](\([^)]*\))?|\[([^\]`]+)\]\([^)]*\)", lambda m: m.group(1) or m.group(3), text)


def page(root):
    """The page, as Markdown."""
    every = rust_source.sources(root)
    out = ["# Files that you write\n", "Made from the source that reads them; a key that is not here is refused.\n"]
    for heading, what, tables in FILES:
        out.append(f"\n## {heading}\n\n{what}\n")
        for name, path, struct in tables:
            if name:
                out.append(f"\n### `{name}`\n")
            out.append("\n| key | value | meaning |\n|---|---|---|")
            for key, kind, said, optional in rust_source.fields(Path(root, "runtime", path).read_text(), struct):
                if not said:
                    raise rust_source.Missing(f"a word about {struct}::{key} in runtime/{path}")
                value = rust_source.plain(kind, every)
                must = "" if optional else "; required"
                out.append(f"| `{key}` | {value}{must} | {documented(said, root)} |".replace("\n", " "))
            out.append("")
    return "\n".join(out)
