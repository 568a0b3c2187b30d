#!/usr/bin/env python3
"""Checks the language of this project: docs, help texts, messages, comments and docstrings.

    EYEBOX=target/debug/eyebox tools/prose.py          fail if a count rises above tools/prose.toml, or a reference is dead
    EYEBOX=target/debug/eyebox tools/prose.py --write  store the counts of today
    tools/prose.py --list R9 docs/live.md              print each place that a rule counts (any part of an area's name)

Counts are kept per area (a page, or the comments or messages of a crate) and rule. RULES has the rules.
"""

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STORE = ROOT / "tools" / "prose.toml"
FRAGMENTS = r"(?:What|Whether|Of|Those|Its|As|So|That of|Nothing|None|Nobody)\b"
BANNED = r"""\b(?:photographs?|photographed|unsteered|(?<!pupil-)steered|anew|heed(?:s|ed)?|mend(?:s|ed)?|whoever|told|tells|believe[sd]?|heard|
hears|promise[sd]?|aphorism|stands?|beside|parts? (?:from|company)|goes on|go on|drafts?|twice as (?:many|much)|lies in|lie in)\b"""
BRITISH = r"""\b(?:colour|centre|grey|behaviour|neighbour|favour|honour|labour|catalogue|metre|millimetre|micrometre|nanometre|
optimis|normalis|quantis|equalis|initialis|synchronis|organis|recognis|minimis|maximis|summaris|visualis|analys(?:e|ing)\b|travell|labell|
modell|cancell)\w*"""
RULES = {  # (what it counts, expression, flags)
    "R1": ("a clause in the place of a noun",
           r"(?:^|[.;:,(] |\b(?:of|by|to|that|in) )(?:what|whoever|who) (?:is|are|was|were|comes?|would|can|lies|stands|has|an?|the|it|they)\b", re.I),
    "R2": ("'where' for if or when", r"(?:^|[.;:,(] )where (?:it|they|there|the|an?|no|nothing)\b", re.I),
    "R3": ("', for' for because", r", for (?:the|it|they|there|no|such|nothing)\b", 0),
    "R4": ("'so many' for a number", r"\bso (?:many|much|few|long|far|wide|large)\b(?! as| that)", re.I),
    "R5": ("a sentence that begins with a preposition", r"(?:^|[.;] )(?:Of|By|To|Through|Beside|Over|From|With) (?:an?|the|what)\b", 0),
    "R6": ("'in the place of'", r"\bin (?:the )?place of\b", re.I),
    "R7": ("'that of', 'those which'", r"\b(?:that|those) (?:of|that|which)\b", 0),
    "R8": ("a passive of telling", r"\b(?:is|are|was|be) (?:told|said|asked|looked|had|heard|believed|known)\b", 0),
    "R9": ("a semicolon", r";(?=\s)", 0),
    "R10": ("a colon in mid-sentence", r"\w: [a-z]", 0),
    "R13": ("a word of the old dialect", re.sub(r"\n", "", BANNED), re.I),
    "R14": ("British spelling", re.sub(r"\n", "", BRITISH), re.I),
}
COMPILED = {name: re.compile(pattern, flags) for name, (_, pattern, flags) in RULES.items()}
RULES |= {
    "R11": ("a sentence of more than 35 words, a line of more than 120 columns, a cell of more than 160 characters", None, 0),
    "R12": ("a date, a commit or an excuse in prose", None, 0),
    "F": ("a comment that begins with a fragment", None, 0),
    "S": ("a doc comment of three words or fewer", None, 0),
}
DIARY = re.compile(r"\b20\d\d-\d\d-\d\d\b|\b[0-9a-f]{7,10}\b(?<=[a-f]\w)(?=.*\d)|\bmachine [A-D]\b|\bbusy\b|\bwas (?:asked|tried)\b")
CODE = re.compile(r"`[^`]*`")


def words(text):
    return len(re.findall(r"[\w'-]+", text))


def sentences(text):
    return re.split(r"(?<=[.!?])\s+(?=[A-Z`\"(\[])", re.sub(r"\s+", " ", text).strip())


def markdown(text):
    """Returns the paragraphs of a page without code, tables' rules and targets of links, and its table cells."""
    text = re.sub(r"^(`{3,}|~{3,}).*?^\1\s*$", "", text, flags=re.M | re.S)
    text = re.sub(r"<!--.*?-->|<[^>\n]+>", "", text, flags=re.S)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    paragraphs, cells = [], []
    for block in re.split(r"\n\s*\n|\n(?=[-*#|] ?|\d+\. )", text):
        if block.lstrip().startswith("|"):
            cells += [cell.strip() for cell in block.strip().strip("|").split("|") if not re.fullmatch(r"[\s:-]*", cell)]
        elif not block.startswith("    "):
            paragraphs.append(re.sub(r"^[#>*\-\d. ]+", "", block.strip()))
    return [p for p in paragraphs if p], cells


def comments(text, doc):
    """Returns comments of Rust, GLSL or C as runs of lines with the same mark, without code blocks."""
    found, run, fenced = [], [], False
    for line in [*text.splitlines(), ""]:
        match = re.match(r"\s*(///|//!)(?!/) ?(.*)", line) if doc else re.match(r"\s*//(?![/!]) ?(.*)", line)
        part = match.group(match.lastindex) if match else None
        if part is not None and part.startswith("```"):
            fenced, part = not fenced, ""
        if part and not fenced and not part.startswith(("|", "#", "    ")):
            run.append(part)
        elif run:
            found.append(re.sub(r"\[([^\]]*)\](?:\([^)]*\))?", r"\1", " ".join(run)))
            run = []
    return found


def messages(text):
    """Returns strings that read like sentences, without strings of tests."""
    text = re.sub(r"(?m)^\s*//.*$", "", text.split("#[cfg(test)]\nmod tests {")[0])
    # The quotation mark as a character begins no string.
    text = text.replace("'\"'", "' '")
    strings = re.findall(r'"((?:[^"\\]|\\.)*)"', text, re.S)
    joined = (re.sub(r"\\\n\s*", "", s).replace("\\n", " ") for s in strings)
    return [re.sub(r"\{[^}]*\}", "x", s) for s in joined if words(s) >= 4 and re.search(r"[a-z] [a-z]", s)]


def docstrings(text):
    tree = ast.parse(text)
    kinds = (ast.Module, ast.FunctionDef, ast.ClassDef)
    return [d for d in (ast.get_docstring(node) for node in ast.walk(tree) if isinstance(node, kinds)) if d]


def tracked():
    """Returns the files of the project. In a copy without git, these are all files that no build has made."""
    git = ["git", "ls-files", "-co", "--exclude-standard"]
    listed = subprocess.run(git, cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode == 0:
        return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]
    made = {"target", "dist", "wheels", "demo", "__pycache__"}
    files = (path.relative_to(ROOT) for path in ROOT.rglob("*") if path.is_file())
    return [str(p) for p in files if not any(part in made or part.startswith(".") for part in p.parts)]


def is_test(name):
    return re.search(r"(^|/)tests?(/|\.rs$)|_tests?\.rs$|/benches/", name) is not None


def areas(help_texts):
    """Returns the texts of each area as (text, is a comment, is a doc comment)."""
    found = {}

    def add(area, texts, comment=False, doc=False):
        found.setdefault(area, []).extend((text, comment, doc) for text in texts)

    for name in tracked():
        path = ROOT / name
        crate = "/".join(name.split("/")[:2])
        if name.endswith(".md"):
            paragraphs, cells = markdown(path.read_text())
            add(name, paragraphs + cells)
        elif name.endswith((".rs", ".comp", ".glsl", ".h", ".c", ".cpp")) and not name.startswith("target"):
            text = path.read_text()
            add(f"{crate} comments", comments(text, False), comment=True)
            add(f"{crate} comments", comments(text, True), comment=True, doc=True)
            if name.endswith(".rs") and not is_test(name):
                add(f"{crate} messages", messages(text))
        elif name.endswith(".py"):
            add(f"{crate} docstrings", docstrings(path.read_text()))
        elif name.endswith(".ipynb"):
            cells = json.loads(path.read_text())["cells"]
            add(name, [p for c in cells if c["cell_type"] == "markdown" for p in markdown("".join(c["source"]))[0]])
    for command, text in help_texts.items():
        options = re.split(r"\n\s*\n|\n(?=\s+-)|\n(?=  [a-z]+ +[A-Z])", text.split("\nExamples:")[0])
        add("help", [re.sub(r"^\s*-\S.*\n", "", option) for option in options if words(option) > 2])
    return found


def places(text, comment, doc):
    """Yields pairs of a rule and a place that it counts in a text."""
    plain = CODE.sub("x", re.sub(r"\s+", " ", text))
    for rule, pattern in COMPILED.items():
        yield from ((rule, m.group(0)) for m in pattern.finditer(plain))
    yield from (("R11", s) for s in sentences(plain) if words(s) > 35)
    yield from (("R12", m.group(0)) for m in DIARY.finditer(plain))
    if comment and re.match(FRAGMENTS, plain):
        yield "F", plain[:60]
    if doc and words(plain) <= 3:
        yield "S", plain


def help_of(program):
    """Returns the help of each command by its name, such as `eval score`. The program's own help is under ''."""
    if not program:
        return {}

    def ask(*words):
        text = subprocess.run([program, "help", *words], capture_output=True, text=True, check=True).stdout
        _, heading, rest = text.partition("\nCommands:\n")
        names = re.findall(r"^  ([a-z]+)(?:\s|$)", rest.split("\n\n")[0], re.M) if heading else []
        found = {" ".join(words): text}
        for name in names:
            if name != "help":
                found |= ask(*words, name)
        return found

    return ask()


def slug(heading):
    return re.sub(r"[^\w\- ]", "", CODE.sub(lambda m: m.group(0)[1:-1], heading).lower()).strip().replace(" ", "-")


def dead(help_texts):
    """Yields references of documents to missing files, headings, options or sections."""
    names = [name for name in tracked() if name.endswith(".md")]
    text = {name: (ROOT / name).read_text() for name in names}
    anchors = {name: {slug(h) for h in re.findall(r"^#+ (.*)$", t, re.M)} | set(re.findall(r'id="([^"]+)"', t)) for name, t in text.items()}
    options = set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]+", " ".join(help_texts.values()))) | {"--help", "--version"}
    pages = "\n".join(page for name, page in text.items() if name.startswith("docs/optics/"))
    optics = set(re.findall(r"^## (\d+[a-z]?)\.?", pages, re.M))
    for name in names:
        if name == "CHANGELOG.md":
            continue
        prose = re.sub(r"^```.*?^```", "", text[name], flags=re.M | re.S)
        for target in re.findall(r"\]\(([^)\s]+)\)", prose):
            file, _, anchor = target.partition("#")
            if re.match(r"[a-z]+:", target):
                continue
            path = (ROOT / name).parent / file if file else ROOT / name
            if not path.exists() and not file.startswith(("reference/", "../reference/")) and name != "docs/SUMMARY.md":
                yield f"{name}: {target} is not there"
            key = os.path.relpath(path, ROOT)
            if anchor and key in anchors and anchor not in anchors[key]:
                yield f"{name}: {target} has no such heading"
        for command in re.findall(r"\beyebox (?:[a-z]+ )?[^`\n]*", text[name]) if help_texts else ():
            word = re.match(r"eyebox ([a-z]+)\b", command)
            if word and word.group(1) in help_texts:
                unknown = set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]+", command)) - options
                yield from (f"{name}: no command has {option}" for option in sorted(unknown))
        for path in re.findall(r"`((?:runtime|kernels|spirv|tests|tools|docs)/[\w./-]+)`", prose):
            if "NAME" not in path and not list(ROOT.glob(path.rstrip("/") + "*")):
                yield f"{name}: `{path}` is not there"
        for number in re.findall(r"OPTICS (\d+)", prose):
            if optics and not any(heading.startswith(number) for heading in optics):
                yield f"{name}: OPTICS {number} is no section of docs/optics"


def stored():
    found, area = {}, None
    for line in STORE.read_text().splitlines() if STORE.exists() else ():
        if match := re.fullmatch(r'\["(.*)"\]', line):
            area = found.setdefault(match.group(1), {})
        elif match := re.fullmatch(r"(\w+) = (\d+)", line):
            area[match.group(1)] = int(match.group(2))
    return found


def main():
    help_texts = help_of(os.environ.get("EYEBOX"))
    found, listed = {}, sys.argv[2:] if sys.argv[1:2] == ["--list"] else None
    for area, texts in areas(help_texts).items():
        counts = found.setdefault(area, {"words": 0})
        for text, comment, doc in texts:
            counts["words"] += words(text)
            for rule, place in places(text, comment, doc):
                counts[rule] = counts.get(rule, 0) + 1
                if listed and rule == listed[0] and (len(listed) < 2 or listed[1] in area):
                    print(f"{area}: {place}: {re.sub(chr(10), ' ', text)[:160]}")
    if sys.argv[1:2] == ["--write"]:
        old = stored()
        lines = ["# Counts of tools/prose.py, by area and rule. They may only fall: tools/prose.py --write stores what is there now.\n"]
        for area, counts in sorted((old | found).items() if not help_texts else found.items()):
            counted = sorted((rule, n) for rule, n in counts.items() if rule != "words")
            lines.append("\n".join([f'["{area}"]', *(f"{rule} = {n}" for rule, n in counted)]) + "\n")
        STORE.write_text("\n".join(lines))
    total = sum(counts["words"] for counts in found.values())
    for rule, (about, *_) in sorted(RULES.items()) if not listed else ():
        count = sum(counts.get(rule, 0) for counts in found.values())
        print(f"{rule:3} {count:6} {1000 * count / total:6.1f} per 1000 words: {about}")
    before = stored()
    risen = [f"{area}: {rule} {before.get(area, {}).get(rule, 0)} -> {n}: {RULES[rule][0]}"
             for area, counts in found.items() for rule, n in counts.items() if rule != "words" and n > before.get(area, {}).get(rule, 0)]
    wrong = risen + list(dead(help_texts))
    print("\n".join(wrong), file=sys.stderr)
    return 1 if wrong and not listed else 0


if __name__ == "__main__":
    sys.exit(main())
