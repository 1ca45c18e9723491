"""The report page of a study: its tables and figures in one file that needs no other."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.errors import FileError
from palpate.files import whole_file
from palpate.lab.study.figures import main_method, methods_of, study_figures
from palpate.lab.study.results import ALL
from palpate.lab.study.trial import Trial
from palpate.viewer.page import picture_uri, rendered_page


def write_report(folder: Path, results: dict[str, Any], trials: Sequence[Trial]) -> None:
    """Write figures/*.png and report.html to a folder; `results` is the content of `results.json`."""
    figures = study_figures(trials, results["recordings"])
    try:
        (folder / "figures").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{error.filename}: cannot be written ({error.strerror})") from error
    for figure in figures:
        with whole_file(folder / "figures" / f"{figure.name}.png", overwrite=True) as part:
            part.write_bytes(figure.png)
    methods = methods_of(trials)
    groups = [group for group in results["table"] if group != ALL]
    page = rendered_page(
        Path(__file__).with_name("report.html.j2"),
        **{**results, "settings": dict(_flat(results["settings"]))},
        all=ALL,
        groups=[ALL, *groups] if len(groups) > 1 else groups,
        methods=[str(method) for method in methods],
        main=str(main_method(methods)) if methods else None,
        figures=[(figure, picture_uri(figure.png)) for figure in figures],
        origins=_origins(results["recordings"]),
    )
    with whole_file(folder / "report.html", overwrite=True) as part:
        part.write_text(page, encoding="utf-8")


def _origins(recordings: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the sources that the recordings of each group state; those that differ in numbers only stand once."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for facts in recordings.values():
        groups.setdefault(facts["group"], []).append(facts)
    return [
        {
            "group": group,
            "recordings": len(members),
            "minutes": sum(facts["seconds"] for facts in members) / 60.0,
            "images": sum(facts["images"] for facts in members),
            "truth": sum(facts["truth"] for facts in members),
            "sources": list(
                {re.sub(r"\d+", "0", facts["source"]): facts["source"] for facts in members[::-1]}.values()
            )[::-1],
        }
        for group, members in sorted(groups.items())
    ]


def _flat(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield settings within settings as `noise.contact`."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
