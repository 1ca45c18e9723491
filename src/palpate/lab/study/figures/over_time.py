"""Figures of what changes over a sequence: errors, consistency and the uncertainty that the tracker states."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.lab.study.figures.methods import colour, dashes, keys, main_method
from palpate.lab.study.figures.samples import Quartiles, Samples, quartiles, share
from palpate.lab.study.figures.sheet import Key, Sheet, Tile, line_style, plain_ticks
from palpate.lab.study.trial import Method, Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Curves = dict[Method, Quartiles]

GREY = "#666666"
_TIME = (
    "A sequence counts from its first contact on, before which nothing moves; a line is drawn where at least half of "
    "the sequences have a value, and may jump where sequences end."
)
_SPREAD = (
    f"Lines are medians over the sequences of a group, shaded areas reach from the first to the third quartile. {_TIME}"
)


def translation_sheet(samples: Samples) -> Sheet | None:
    """Translation error over time."""
    return _quartile_sheet(
        samples,
        lambda trial: trial.translation_error * 1e3,
        "error-translation",
        "Translation error over time",
        "translation error [mm]",
        "How far the object is estimated from where it is, by the online estimate of each frame, on a logarithmic "
        f"axis. {_SPREAD} Medians are shown because a few lost sequences would rule a mean. The paper's Fig. 6.",
        floor=0.1,
    )


def rotation_sheet(samples: Samples) -> Sheet | None:
    """Rotation error over time."""
    return _quartile_sheet(
        samples,
        lambda trial: np.degrees(np.abs(trial.rotation_error)),
        "error-rotation",
        "Rotation error over time",
        "rotation error [°]",
        f"How far the object's yaw is estimated from what it is. {_SPREAD} The paper's Fig. 6.",
        floor=0.05,
    )


def nees_sheet(samples: Samples) -> Sheet | None:
    """NEES over time."""
    low, median, high = _right_nees(0.025, 0.5, 0.975)
    sheet = _quartile_sheet(
        samples,
        lambda trial: trial.nees,
        "nees",
        "Normalised error (NEES) over time",
        "NEES",
        "The squared error in units of the covariance that the tracker states. For a covariance that is right it "
        f"follows a chi-squared distribution of three degrees of freedom: mean 3 (thin line), median {median:.1f}, "
        f"and 95 % of single values between {low:.2f} and {high:.1f} (grey). Above, the tracker is surer "
        f"than it may be; below, it is more careful than it need be. Lines are medians over the "
        f"sequences of a group; the shaded area is the middle half of {main_method(samples.methods)}. {_TIME}",
        floor=0.02,
        main_spread=True,
        before=_mark_consistent,
    )
    key = Key("95 % of a right covariance", "#dddddd", band=True)
    return sheet and replace(sheet, legend=(*sheet.legend, key, Key("its mean", GREY)))


def coverage_sheet(samples: Samples) -> Sheet | None:
    """Interval coverage over time."""
    (limit,) = _right_nees(0.95)

    values = samples.of(lambda trial: trial.nees)
    values = np.where(np.isfinite(values), values <= limit, np.nan)
    tiles = []
    for group in samples.groups:
        curves = {method: 100.0 * share(values[samples.rows(group, method)]) for method in samples.methods}
        if not any(np.isfinite(curve).any() for curve in curves.values()):
            continue

        def draw(axes: "Axes", curves: dict[Method, Array] = curves) -> None:
            axes.axhspan(90.0, 98.0, color="#dddddd", lw=0)
            axes.axhline(95.0, color=GREY, lw=0.8)
            for method, curve in curves.items():
                axes.plot(samples.time, curve, **_line(method, main_method(samples.methods)))
            _time_axis(axes, samples.time)
            axes.set(ylabel="true pose in the 95 % region [%]", ylim=(-3.0, 103.0))

        last = {method: _last(curve) for method, curve in curves.items()}
        tiles.append(Tile(group, _alt("Share of true poses in the 95 % region", group, last, "%"), draw))
    return _sheet(
        tiles,
        "coverage",
        "Share of true poses inside the 95 % region over time",
        "At each instant, the share of sequences whose true pose lies in the region that should hold it with 95 % "
        f"probability (NEES below {limit:.2f}). Right is the thin line at 95 %; grey is 90 to 98 %. "
        f"{_TIME}",
        (*keys(samples.methods), Key("90 to 98 %", "#dddddd", band=True)),
    )


def sigma_sheets(samples: Samples) -> list[Sheet]:
    """Stated uncertainty over time, of translation and of rotation; needs no ground truth."""

    def translation(trial: Trial) -> Array:
        return 1e3 * np.sqrt(trial.covariance[:, 0, 0] + trial.covariance[:, 1, 1])

    def rotation(trial: Trial) -> Array:
        return np.degrees(np.sqrt(trial.covariance[:, 2, 2]))

    touched = samples.of(lambda trial: trial.contact.astype(np.float64))
    contact = {group: share(touched[samples.rows(group)]) for group in samples.groups}
    caption = (
        "The standard deviation that the tracker states, {what}. The strip at the bottom is the darker the more "
        "sequences are in contact: where it is light, the sensor is away and the object rests, and what grows there is "
        f"the drift between contacts. {_SPREAD}"
    )
    sheets = []
    for quantity, name, unit, floor, what in (
        (translation, "translation", "mm", 0.05, "the root of the summed variances along x and y"),
        (rotation, "rotation", "°", 0.02, "of the yaw"),
    ):
        sheet = _quartile_sheet(
            samples,
            quantity,
            f"sigma-{name}",
            f"Stated uncertainty of {name} over time",
            f"standard deviation [{unit}]",
            caption.format(what=what),
            floor=floor,
            after=lambda axes, group: _mark_contact(axes, contact[group], samples.time),
        )
        if sheet:
            sheets.append(replace(sheet, legend=(*sheet.legend, Key("all in contact", "#404040", band=True))))
    return sheets


def _quartile_sheet(
    samples: Samples,
    quantity: Callable[[Trial], Array],
    name: str,
    title: str,
    label: str,
    caption: str,
    *,
    floor: float,
    main_spread: bool = False,
    before: Callable[["Axes"], Any] | None = None,
    after: Callable[["Axes", str], Any] | None = None,
) -> Sheet | None:
    """A picture per group with quartiles of a quantity (N,) of each trial; None where nothing is known of it.

    The axis is logarithmic, the same in all pictures, and ends at `floor`. With `main_spread` the
    spread is shown of the main method only. `before` and `after` draw below and above.
    """
    values, main = samples.of(quantity), main_method(samples.methods)
    panels: dict[str, Curves] = {}
    for group in samples.groups:
        curves = {method: quartiles(values[samples.rows(group, method)]) for method in samples.methods}
        if any(np.isfinite(curve.median).any() for curve in curves.values()):
            panels[group] = curves
    top = max((_largest(curves) for curves in panels.values()), default=0.0)
    limits = (floor, 1.3 * max(top, 10.0 * floor))
    tiles = []
    for group, curves in panels.items():

        def draw(axes: "Axes", group: str = group, curves: Curves = curves) -> None:
            if before:
                before(axes)
            for method, curve in curves.items():
                low, median, high = (np.maximum(line, floor) for line in (curve.low, curve.median, curve.high))
                if method == main or not main_spread:
                    axes.fill_between(samples.time, low, high, color=colour(method), alpha=0.12, lw=0)
                axes.plot(samples.time, median, **_line(method, main))
            axes.set(yscale="log", ylim=limits, ylabel=label)
            plain_ticks(axes.yaxis)
            _time_axis(axes, samples.time)
            if after:
                after(axes, group)

        last = {method: _last(curve.median) for method, curve in curves.items()}
        tiles.append(Tile(group, _alt(title, group, last, label.partition("[")[2].rstrip("]")), draw))
    return _sheet(tiles, name, title, caption, keys(samples.methods))


def _sheet(tiles: Sequence[Tile], name: str, title: str, caption: str, legend: tuple[Key, ...]) -> Sheet | None:
    return Sheet(name, title, caption, tuple(tiles), legend) if tiles else None


def _line(method: Method, main: Method) -> dict[str, Any]:
    width, above = (2.4, 3) if method == main else (1.4, 2)
    return {"color": colour(method), "ls": line_style(dashes(method)), "lw": width, "zorder": above}


def _right_nees(*shares: float) -> list[float]:
    """Values that shares of the NEES of a right covariance lie below: chi-squared, three degrees of freedom."""
    from scipy.special import gammaincinv

    return [2.0 * float(gammaincinv(1.5, share)) for share in shares]


def _mark_consistent(axes: "Axes") -> None:
    axes.axhspan(*_right_nees(0.025, 0.975), color="#dddddd", lw=0)
    axes.axhline(3.0, color=GREY, lw=0.8)


def _mark_contact(axes: "Axes", contact: Array, time: Array) -> None:
    """Show along the bottom how many sequences are in contact."""
    strip = axes.inset_axes((0.0, 0.0, 1.0, 0.045), zorder=4)
    strip.imshow(
        contact[None], extent=(0.0, time[-1] or 1.0, 0.0, 1.0), cmap="Greys", vmin=0.0, vmax=1.3, aspect="auto"
    )
    strip.set(xlim=axes.get_xlim())
    strip.set_axis_off()


def _time_axis(axes: "Axes", time: Array) -> None:
    axes.set(xlabel="time since the start [s]", xlim=(0.0, time[-1] or 1.0))


def _largest(curves: Curves) -> float:
    found = [curve.high[np.isfinite(curve.high)] for curve in curves.values()]
    return max((float(high.max()) for high in found if len(high)), default=0.0)


def _last(line: Array) -> float:
    known = line[np.isfinite(line)]
    return float(known[-1]) if len(known) else np.nan


def _alt(what: str, group: str, last: dict[Method, float], unit: str) -> str:
    ends = ", ".join(f"{method} {value:.2g}" for method, value in last.items() if np.isfinite(value))
    return f"{what}, {group}. It ends at{f' [{unit}]' if unit else ''}: {ends}."
