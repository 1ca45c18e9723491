"""How methods and groups look and in what order they come, the same in all figures."""

from collections.abc import Iterable, Sequence

from palpate.lab.study.figures.sheet import Key
from palpate.lab.study.trial import Method, Trial

# Okabe and Ito's colours, which people with any colour vision tell apart; grey instead of their yellow, which is too
# pale for lines on white. The order is that of the tables: from nothing to everything that touch may say.
COLOURS = {
    "none": "#000000",
    "constant": "#999999",
    "learnt-linear": "#E69F00",
    "learnt-pairs": "#56B4E9",
    "learnt-turn": "#CC79A7",
    "learnt-direction": "#D55E00",
    "learnt": "#0072B2",
    "oracle": "#009E73",
}
"""Colour of each `touch.modes.Tactile`."""
DASHES: dict[str, tuple[float, ...]] = {
    "fixed-lag": (),
    "isam2": (4.0, 1.5),
    "batch": (1.0, 1.2),
    "particle-filter": (5.0, 1.5, 1.0, 1.5),
}
"""Dashes of each smoother."""
MAIN = Method("learnt", "fixed-lag")
"""What is shown where there is room for one method only, if it is there."""
_FIRST_GROUPS = ("disc", "ellipse", "rectangle-edges", "rectangle-near-corners", "rectangle-corners")


def methods_of(trials: Sequence[Trial]) -> list[Method]:
    """The methods of trials, in the order of tables and legends."""
    return in_order(trial.method for trial in trials)


def in_order(methods: Iterable[Method]) -> list[Method]:
    """Methods, each once, by smoother and then by what touch says."""

    def place(method: Method) -> tuple[int, int, str]:
        return _place(method.smoother, DASHES), _place(method.tactile, COLOURS), str(method)

    return sorted(set(methods), key=place)


def groups_of(trials: Sequence[Trial]) -> list[str]:
    """The groups of trials: the classes that touch was learnt on first, then the others by name."""

    def place(group: str) -> tuple[int, str]:
        return _place(group, _FIRST_GROUPS), group

    return sorted({trial.group for trial in trials}, key=place)


def main_method(methods: Sequence[Method]) -> Method:
    """MAIN, or where it is not there the one that touch tells most."""
    if MAIN in methods:
        return MAIN
    return max(methods, key=lambda method: (-_place(method.smoother, DASHES), _place(method.tactile, COLOURS)))


def colour(method: Method) -> str:
    """#rrggbb of a method: by what touch says."""
    return COLOURS.get(method.tactile, "#999999")


def dashes(method: Method) -> tuple[float, ...]:
    """Dashes of a method's line: by its smoother."""
    return DASHES.get(method.smoother, (2.0, 2.0))


def keys(methods: Sequence[Method], marker: bool = False) -> tuple[Key, ...]:
    """The legend of methods."""
    return tuple(Key(str(method), colour(method), dashes(method), marker) for method in methods)


def _place(name: str, names: Iterable[str]) -> int:
    known = list(names)
    return known.index(name) if name in known else len(known)
