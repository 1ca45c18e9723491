"""Tables of studies as CSV files, which spreadsheets open too."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.errors import FileError
from palpate.files import read_csv, whole_file

_FORMULA = ("=", "+", "-", "@", "\t", "\r", "'")


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a table, whole or not at all, such that no program for tables takes a name in it for a formula."""
    with (
        whole_file(path, overwrite=True) as part,
        part.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file,
    ):
        writer = csv.DictWriter(file, list(dict.fromkeys(key for row in rows for key in row)))
        writer.writeheader()
        writer.writerows({key: _as_cell(value) for key, value in row.items()} for row in rows)


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table, by its columns, with names as they were. Raises FileError."""
    columns, *rows = read_csv(path) or [[]]
    for number, row in enumerate(rows, 2):
        if len(row) != len(columns):
            raise FileError(f"{path}: row {number} has {len(row)} cells, expected {len(columns)} as in the first")
    return [{column: text.removeprefix("'") for column, text in zip(columns, row, strict=True)} for row in rows]


def _as_cell(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value
