"""Reads fields of structs and names of enums, with their documentation, from the Rust source."""

import re
from pathlib import Path

FIELD = re.compile(r"^    (?:pub(?:\([a-z]+\))? )?(?:r#)?([a-z_0-9]+): (.+),$")
VARIANT = re.compile(r"^    ([A-Z][A-Za-z0-9]*)\b(.*)$")


# Types that are read in more than one form, or from a table with a `kind`.
WORDS = {
    "TwoPi": "number, or a number for each color",
    "Level": "number, or 3 x 3 numbers",
    "Spread": "`[q, sigma]`",
    "Storage": "`\"fp32\"`, `\"fp16\"`",
    "Levels": "phases in radians, or `true` for the display's phases",
    "Optimizer": "`{ kind = \"projection\", gain, momentum, overlap_power }` or `{ kind = \"adam\", rate, amplitude }`",
    "Strategy": "`{ kind = \"projection\", gain, settled, settling, momentum, overlap_power }` or `{ kind = \"adam\", rate }`",
    "SlotText": "a number of the report, below",
}


class Missing(Exception):
    """A struct or an enum that the source does not have, or a field without documentation."""


def body(text, kind, name):
    """Returns the attributes before `kind name` and the lines between its braces."""
    found = re.search(rf"((?:^[#/][^\n]*\n)*)^(?:pub(?:\([a-z]+\))? )?{kind} {name} \{{\n(.*?)^\}}", text, re.M | re.S)
    return (found.group(1), found.group(2).splitlines()) if found else None


def fields(text, name):
    """Returns (key, type, documentation, True if optional) of each field of a struct, in order."""
    found = body(text, "struct", name)
    if found is None:
        raise Missing(f"struct {name}")
    attributes, lines = found
    all_optional = "default" in " ".join(re.findall(r"serde\(([^\n]*)\)\]", attributes))
    rows, said, serde = [], [], ""
    for line in lines:
        stripped = line.strip()
        if stripped.startswith("///"):
            said.append(stripped[3:].strip())
        elif stripped.startswith("#["):
            serde += stripped
        elif match := FIELD.match(line):
            key, kind = match.groups()
            if form := re.search(r'with = "([A-Z]\w+)"', serde):
                kind = form.group(1)
            renamed = re.search(r'rename = "([^"]+)"', serde)
            optional = all_optional or kind.startswith("Option<") or re.search(r"\bdefault\b", serde) is not None
            if "skip)" not in serde:
                rows.append((renamed.group(1) if renamed else key, kind, " ".join(said), optional))
            said, serde = [], ""
        elif stripped and not stripped.startswith("//"):
            said, serde = [], ""
    return rows


def names(sources, enum):
    """Returns the names of the variants of an enum in files, or None if no source has it."""
    for text in sources:
        found = body(text, "enum", enum)
        if found is None or "Deserialize" not in found[0]:
            continue
        attributes, lines = found
        style = re.search(r'rename_all = "([a-z_-]+)"', attributes)
        if "untagged" in attributes or "tag =" in attributes or style is None:
            return None
        result, serde = [], ""
        for line in lines:
            if line.strip().startswith("#["):
                serde += line
            elif match := VARIANT.match(line):
                renamed = re.search(r'rename = "([^"]+)"', serde)
                words = re.findall(r"[A-Z][a-z0-9]*", match.group(1))
                joined = {"lowercase": "", "snake_case": "_", "kebab-case": "-"}.get(style.group(1), "")
                plain = match.group(1).lower() if joined == "" else joined.join(w.lower() for w in words)
                if "skip" not in serde:
                    result.append(renamed.group(1) if renamed else plain)
                serde = ""
        return result
    return None


def plain(kind, sources):
    """Describes a Rust type for the author of a file."""
    simple = {
        "String": "text", "PathBuf": "a file", "bool": "true or false", "f64": "number", "f32": "number", "Color": "a color",
        "u8": "whole number", "u16": "whole number", "u32": "whole number", "u64": "whole number", "usize": "whole number",
        "i8": "whole number", "i32": "whole number", "i64": "whole number",
    }
    if kind in simple:
        return simple[kind]
    if match := re.fullmatch(r"Option<(.+)>", kind):
        return plain(match.group(1), sources)
    if match := re.fullmatch(r"Vec<(.+)>", kind):
        return "list of: " + plain(match.group(1), sources)
    if match := re.fullmatch(r"\[(.+); (\d+)\]", kind):
        return f"{match.group(2)} of: {plain(match.group(1), sources)}"
    if match := re.fullmatch(r"BTreeMap<([A-Za-z0-9]+), (.+)>", kind):
        key = {"Color": "color", "u32": "index", "usize": "index"}.get(match.group(1), match.group(1).lower())
        return f"{plain(match.group(2), sources)} for each {key}"
    if kind in WORDS:
        return WORDS[kind]
    variants = names(sources, kind)
    return ", ".join(f"`\"{v}\"`" for v in variants) if variants else "see below"


def sources(root):
    """Returns all source files of the library as text."""
    return [p.read_text() for p in sorted(Path(root, "runtime").rglob("*.rs"))]
