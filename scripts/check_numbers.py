"""Check every number of README and docs against files in the repository: `make check-numbers`.

A block between `<!-- numbers: NAME -->` and `<!-- end -->` is told by `reported_numbers.TABLES[NAME]`, line by line;
`--write` writes such tables anew. Of a block of prose, `reported_numbers.FACTS[NAME]` tells the numbers that may stand
in it. Outside of blocks and code no number may have the unit of a result, in the pages of CHECKED.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

from reported_numbers import FACTS, TABLES

ROOT = Path(__file__).parents[1]
CHECKED = ("README.md", "docs/*.md")
"""Pages in which every result must stand in a block; in the others, blocks are checked where they are."""
MARKED = (*CHECKED, "docs/guide/*.md")

BLOCK = re.compile(r"<!-- numbers: ([\w, -]+) -->\n(.*?)<!-- end -->", re.DOTALL)
CODE = re.compile(r"^(```|:::).*?^\1$|^    .*?$|`[^`\n]+`|\$\$.*?\$\$|\$[^$\n]+\$|<!--.*?-->", re.DOTALL | re.MULTILINE)
RESULT = re.compile(r"(?!95 %)(?<![\d.])\d+(?:\.\d+)? ?(?:mm|°|%|ms)(?!\w)")
"""A number with the unit of a result; the 95 % region is called so."""
NUMBER = re.compile(r"(?<![\w.])\d+(?:[.,]\d+)*(?![\w.]*\d)")


def main() -> None:
    """Check all pages, or write their tables anew; exit with 1 where something is wrong."""
    wrong = []
    for path in pages(MARKED):
        if "--write" in sys.argv:
            path.write_text(written(path.read_text(encoding="utf-8")), encoding="utf-8")
        wrong += [f"{path.relative_to(ROOT)}: {what}" for what in found_wrong(path)]
    print("\n".join(wrong) or "every number is that of its file")
    sys.exit(1 if wrong else 0)


def pages(patterns: tuple[str, ...]) -> list[Path]:
    """Return the pages of these patterns."""
    return [path for pattern in patterns for path in sorted(ROOT.glob(pattern))]


def found_wrong(path: Path) -> list[str]:
    """Return what is wrong with the numbers of a page, a line each."""
    text = path.read_text(encoding="utf-8")
    wrong = [what for name, body in BLOCK.findall(text) for what in _wrong_in_block(name, body)]
    if path in pages(CHECKED):
        outside = CODE.sub("", BLOCK.sub("", text))
        wrong += [f"{found} stands in no block of numbers" for found in RESULT.findall(outside)]
    return wrong


def written(text: str) -> str:
    """Return a page with its tables as the files of the repository have them."""

    def table(block: re.Match[str]) -> str:
        made = TABLES.get(block[1])
        return f"<!-- numbers: {block[1]} -->\n\n{made()}\n\n<!-- end -->" if made else block[0]

    return BLOCK.sub(table, text)


def _wrong_in_block(name: str, body: str) -> Iterator[str]:
    if name in TABLES:
        if body.strip() != TABLES[name]():
            yield f"block {name} is not what its files say; make check-numbers with --write writes it anew"
        return
    names = name.split(", ")
    if unknown := [one for one in names if one not in FACTS]:
        yield f"block {unknown[0]} is not known to scripts/reported_numbers.py"
        return
    allowed = {number for one in names for number in FACTS[one]()}
    for number in NUMBER.findall(re.sub(r"\[[^]]*\]\([^)]*\)|`[^`]*`", "", body)):
        if number not in allowed:
            yield f"block {name} says {number}; its files say {', '.join(sorted(allowed))}"


if __name__ == "__main__":
    main()
