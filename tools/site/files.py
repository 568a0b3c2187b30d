"""Makes the reference of the files that users write, from the structs that read them."""

import re
from pathlib import Path

import rust_source

# Entries are (heading, description, tables), and tables are (name in the file, source, struct).
FILES = [
    (
        "A display file",
        "TOML, for `--display FILE.toml`, begun with `eyebox display new`. See [displays](../displays.md).",
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
            ("[device]", "optics/device.rs", "Device"),
        ],
    ),
    (
        "lightfield.toml",
        "TOML, in a folder of views. It has their positions and depths. [Scenes](../scenes.md) has more.",
        [("", "scene/read/settings.rs", "Toml")],
    ),
    (
        "Settings of a solve",
        "TOML, for `--settings FILE.toml` and for `eyebox_solve` of the C interface. Holograms and results store the same "
        "keys as JSON. Lengths are in meters. [Settings](../settings.md) has more.",
        [("", "solve/solve/settings.rs", "Settings")],
    ),
    (
        "Settings of a refinement",
        "The table `refine` of `--settings FILE.toml`, and the settings of refiners in the C interface.",
        [("", "solve/solve/refine_settings.rs", "RefineSettings")],
    ),
    (
        "A HID tracker's description",
        "TOML, for `--device-file`. It has the places of the numbers in a report. [Trackers](../trackers.md) has more.",
        [
            ("", "tracking/trackers/hid/device_file.rs", "File"),
            ("[left], [right], [combined]", "tracking/trackers/hid/device_file.rs", "PlaceText"),
            ("each number", "tracking/trackers/hid/device_file.rs", "SlotText"),
        ],
    ),
    (
        "A tracker's calibration",
        "TOML, for `--calibration FILE.toml`. `eyebox tracker calibrate` writes it.",
        [("", "tracking/gaze/calibration.rs", "Calibration"), ("[left], [right], [combined]", "tracking/gaze/calibration.rs", "FitText")],
    ),
]


def documented(text, root):
    """Returns documentation in which a leading `[Type::field]` is replaced by the text of that field."""
    found = re.match(r"\[`(\w+)::(\w+)`\](.*)", text)
    if found:
        for source in rust_source.sources(root):
            if rust_source.body(source, "struct", found.group(1)):
                for key, _, said, _ in rust_source.fields(source, found.group(1)):
                    if key == found.group(2):
                        rest = found.group(3).lstrip(":;. ")
                        return said + (f" In files: {rest}" if rest else "")
    # Links of the source's own documentation have no target here.
    return re.sub(r"\[(`[^`\[\]]+`)\](\([^)]*\))?|\[([^\]`]+)\]\([^)]*\)", lambda m: m.group(1) or m.group(3), text)


def page(root):
    """Returns the page as Markdown."""
    every = rust_source.sources(root)
    out = ["# Files that you write\n", "These tables come from the source that reads the files. Other keys are refused.\n"]
    for heading, what, tables in FILES:
        out.append(f"\n## {heading}\n\n{what}\n")
        for name, path, struct in tables:
            if name:
                out.append(f"\n### `{name}`\n")
            out.append("\n| key | value | meaning |\n|---|---|---|")
            for key, kind, said, optional in rust_source.fields(Path(root, "runtime", path).read_text(), struct):
                if not said:
                    raise rust_source.Missing(f"documentation of {struct}::{key} in runtime/{path}")
                value = rust_source.plain(kind, every)
                must = "" if optional else ", required"
                out.append(f"| `{key}` | {value}{must} | {documented(said, root)} |".replace("\n", " "))
            out.append("")
    return "\n".join(out)
