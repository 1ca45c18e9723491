"""Figures of how far off a sequence ends: by group and method, and against how far the contact has slid."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.lab.study.figures.methods import colour, dashes, groups_of, in_order, methods_of
from palpate.lab.study.figures.sheet import Key, Sheet, Tile, line_style, plain_ticks
from palpate.lab.study.results import ALL
from palpate.lab.study.trial import Method, Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

TRANSLATION, ROTATION, SLID = "final_translation_error_mm", "final_rotation_error_deg", "slid_mm"
_FLOOR = {TRANSLATION: 0.1, ROTATION: 0.02, SLID: 0.1}
"""Smaller values are drawn here: what lies below is of no interest, and zero has no logarithm."""


def box_sheet(trials: Sequence[Trial], field: str) -> Sheet | None:
    """Box plots of a final error, TRANSLATION or ROTATION, by group and method; None where none is known."""
    scored = [trial for trial in trials if trial.summary.get(field) is not None]
    if not scored:
        return None
    methods, groups = methods_of(scored), groups_of(scored)
    what, unit = ("translation", "mm") if field == TRANSLATION else ("rotation", "°")
    floor = _FLOOR[field]
    limits = (floor / 1.3, 1.5 * max(_values(scored, field, floor).max(), 10.0 * floor))
    tiles = []
    for group in [ALL, *groups] if len(groups) > 1 else groups:
        of_group = [trial for trial in scored if group in (ALL, trial.group)]
        values = {method: _values([t for t in of_group if t.method == method], field, floor) for method in methods}

        def draw(axes: "Axes", values: dict[Method, Array] = values) -> None:
            _draw_boxes(axes, values)
            axes.set(xscale="log", xlim=limits, xlabel=f"final {what} error [{unit}]")
            plain_ticks(axes.xaxis)

        count = max(len(found) for found in values.values())
        medians = ", ".join(f"{method} {np.median(found):.2g}" for method, found in values.items() if len(found))
        alt = f"Final {what} error, {group}, {count} sequences. Medians [{unit}]: {medians}."
        tiles.append(Tile(f"{group} ({count})", alt, draw))
    return Sheet(
        f"final-{what}",
        f"Final {what} error",
        f"The {what} error of the online estimate at the last frame with ground truth. The line in a box is the "
        "median, the box holds the middle half of the sequences, the whiskers reach from 5 to 95 %, and dots are the "
        f"sequences beyond. The number of sequences stands in brackets; errors below {floor:g} {unit} are drawn there. "
        "The paper's Fig. 7.",
        tuple(tiles),
        height=1.15 + 0.24 * len(methods),
        left=0.2 + 0.078 * max(len(str(method)) for method in methods),
    )


def slid_sheet(trials: Sequence[Trial]) -> Sheet | None:
    """Final translation error against the way that the contact has slid; None where no slip is known."""
    known = [t for t in trials if t.summary.get(SLID) is not None and t.summary.get(TRANSLATION) is not None]
    if not known:
        return None
    left_out = {trial.recording for trial in trials} - {trial.recording for trial in known}
    note = f" Recordings that do not tell how far they slid are left out: {len(left_out)}." if left_out else ""
    return _scatter_sheet(
        [(t.method, t.summary[SLID], t.summary[TRANSLATION]) for t in known],
        "slid",
        "Final translation error against the way slid",
        "Each dot is a sequence. To the right, how far contacts have slid along the sensor in all, to and fro added; "
        "up, the final translation error. On the thin line the error is as large as the way slid; below it, "
        f"slip does not add up or is felt.{note}",
        ("way slid [mm]", "final translation error [mm]"),
        (_FLOOR[SLID], _FLOOR[TRANSLATION]),
    )


def against_sheets(trials: Sequence[Trial], against: Mapping[str, Any]) -> list[Sheet]:
    """Final errors against those of another study: `against` is `comparison.compare`'s."""
    methods = {str(method): method for method in methods_of(trials)}
    sheets = []
    for key, field, what, unit in (
        ("final_mm", TRANSLATION, "translation", "mm"),
        ("final_deg", ROTATION, "rotation", "°"),
    ):
        points = [
            (methods[each["method"]], each["before"][key], each["after"][key])
            for each in against["sequences"]
            if each["method"] in methods
        ]
        if points:
            sheet = _scatter_sheet(
                points,
                f"against-{what}",
                f"Final {what} error, before and after",
                f"Each dot is a sequence that both studies scored: to the right its error in {against['folder']}, up "
                "its error in this study. Below the thin line it became better.",
                (f"before [{unit}]", f"after [{unit}]"),
                (_FLOOR[field], _FLOOR[field]),
            )
            sheets.append(sheet)
    return sheets


def _scatter_sheet(
    points: Sequence[tuple[Method, float, float]],
    name: str,
    title: str,
    caption: str,
    labels: tuple[str, str],
    floors: tuple[float, float],
) -> Sheet:
    """A picture per method of values (x, y) on logarithmic axes with the line where they are equal."""
    methods = in_order(method for method, _, _ in points)
    values = {method: np.array([(x, y) for found, x, y in points if found == method], np.float64) for method in methods}
    values = {method: np.maximum(found, floors) for method, found in values.items()}
    top = 1.5 * max(float(found.max()) for found in values.values())
    tiles = []
    for method, found in values.items():

        def draw(axes: "Axes", method: Method = method, found: Array = found) -> None:
            ends = (min(floors), top)
            axes.plot(ends, ends, color="#666666", lw=0.8)
            axes.plot(*found.T, "o", color=colour(method), ms=4.0, alpha=0.55, mew=0.0)
            axes.set(xscale="log", yscale="log", xlabel=labels[0], ylabel=labels[1])
            axes.set(xlim=(floors[0] / 1.2, top), ylim=(floors[1] / 1.2, top))
            plain_ticks(axes.xaxis)
            plain_ticks(axes.yaxis)

        x, y = np.median(found, axis=0)
        alt = f"{title}, {method}: {len(found)} sequences, medians {x:.2g} ({labels[0]}) and {y:.2g} ({labels[1]})."
        tiles.append(Tile(f"{method} ({len(found)})", alt, draw))
    return Sheet(name, title, caption, tuple(tiles), (Key("equal", "#666666"),), height=3.5)


def _draw_boxes(axes: "Axes", values: dict[Method, Array]) -> None:
    shown = {place: (method, found) for place, (method, found) in enumerate(values.items()) if len(found)}
    boxes = axes.boxplot(
        [found for _, found in shown.values()],
        positions=list(shown),
        whis=(5.0, 95.0),
        widths=0.62,
        orientation="horizontal",
        patch_artist=True,
        manage_ticks=False,
        medianprops={"lw": 2.0},
        flierprops={"marker": ".", "ms": 4.0, "mew": 0.0},
    )
    for index, (method, _) in enumerate(shown.values()):
        style = {"color": colour(method), "ls": line_style(dashes(method))}
        boxes["boxes"][index].set(facecolor=f"{colour(method)}38", edgecolor=style["color"], ls=style["ls"])
        boxes["medians"][index].set_color(style["color"])
        boxes["fliers"][index].set(markerfacecolor=style["color"])
        for line in (*boxes["whiskers"][2 * index : 2 * index + 2], *boxes["caps"][2 * index : 2 * index + 2]):
            line.set_color(style["color"])
    axes.set_yticks(range(len(values)), [str(method) for method in values], fontsize=9)
    axes.set_ylim(len(values) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")


def _values(trials: Sequence[Trial], field: str, floor: float) -> Array:
    return np.maximum(np.array([trial.summary[field] for trial in trials], np.float64), floor)
