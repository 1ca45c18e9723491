"""The report of a study: its figures, and one page that holds them, to be opened anywhere."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.errors import FileError
from palpate.files import whole_file
from palpate.lab.study.comparison import MM_PER_DEG, SAME_DEG, SAME_MM
from palpate.lab.study.figures import Key, Sheet, render, study_sheets
from palpate.lab.study.figures.methods import groups_of, main_method, methods_of
from palpate.lab.study.results import ALL
from palpate.lab.study.trial import Trial
from palpate.pipeline.metrics import AFTER, FAR_DEG, FAR_MM
from palpate.web_page import picture_uri, rendered_page

TEMPLATE = Path(__file__).with_name("report.html.j2")
_SOURCES = 3
"""Kinds of sources of a group that are shown."""


@dataclass(frozen=True)
class Picture:
    """A picture on the page."""

    alt: str
    """What it shows."""
    data: str
    """A PNG as a data URI."""


@dataclass(frozen=True)
class Figure:
    """A figure on the page."""

    name: str
    """Of its file in figures/, without the ending."""
    title: str
    """What it is about."""
    caption: str
    """What to see in it."""
    legend: tuple[Key, ...]
    """What lines and dots stand for."""
    pictures: tuple[Picture, ...]
    """One beside the other as there is room."""
    small: bool
    """Whether four pictures fit beside each other on a wide page, not three."""


def write_report(folder: Path, results: dict[str, Any], trials: Sequence[Trial]) -> None:
    """Write figures/*.png and report.html to a folder; FileError where that is not possible.

    `results` is the content of `results.json`. The page needs no other file.
    """
    try:
        (folder / "figures").mkdir(parents=True, exist_ok=True)
        figures = [_figure(sheet, folder / "figures") for sheet in study_sheets(trials, results)]
        with whole_file(folder / "report.html", overwrite=True) as part:
            part.write_text(_page(results, trials, figures), encoding="utf-8")
    except OSError as error:
        raise FileError(f"{error.filename or folder}: cannot be written ({error.strerror})") from error


def _figure(sheet: Sheet, folder: Path) -> Figure:
    whole, pictures = render(sheet)
    with whole_file(folder / f"{sheet.name}.png", overwrite=True) as part:
        part.write_bytes(whole)
    shown = tuple(Picture(tile.alt, picture_uri(data)) for tile, data in zip(sheet.tiles, pictures, strict=True))
    return Figure(sheet.name, sheet.title, sheet.caption, sheet.legend, shown, sheet.width < 4.0)


def _page(results: Mapping[str, Any], trials: Sequence[Trial], figures: Sequence[Figure]) -> str:
    methods = methods_of(trials)
    table = results["table"]
    groups = [group for group in groups_of(trials) if group in table]
    return rendered_page(
        TEMPLATE,
        **{"against": None, **results, "settings": {name: _plain(value) for name, value in _flat(results["settings"])}},
        same=(SAME_MM, SAME_DEG, MM_PER_DEG),
        far=(f"{FAR_MM:g} mm", f"{FAR_DEG:g}°"),
        after=[f"{time:g}" for time in AFTER],
        all=ALL,
        groups=[ALL, *groups] if len(groups) > 1 else groups,
        methods=[str(method) for method in methods],
        main=str(main_method(methods)) if methods else None,
        figures=figures,
        origins=_origins(results["recordings"]),
    )


def _origins(recordings: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What the recordings of each group say about where they come from."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for facts in recordings.values():
        groups.setdefault(facts["group"], []).append(facts)
    found = []
    for group, members in sorted(groups.items()):
        # Sources that differ in numbers only, such as the seed, are of one kind.
        kinds = {re.sub(r"\d+", "0", facts["source"]): facts["source"] for facts in reversed(members)}
        sources = list(kinds.values())[::-1]
        found.append(
            {
                "group": group,
                "recordings": len(members),
                "minutes": sum(facts["seconds"] for facts in members) / 60.0,
                "images": sum(facts["images"] for facts in members),
                "truth": sum(facts["truth"] for facts in members),
                "sources": sources[:_SOURCES],
                "more": len(sources) - _SOURCES if len(sources) > _SOURCES else 0,
            }
        )
    return found


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _flat(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Settings within settings as `noise.contact`."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value
