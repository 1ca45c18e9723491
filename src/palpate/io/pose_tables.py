"""Tables of times and poses, as robots and people write them: CSV with or without a header.

A row holds a pose as 3 numbers (x, y, theta), 7 (position and quaternion) or 16 (a 4x4 matrix by rows or, as libfranka
writes it, by columns), and may begin with its time. With a header, columns are found by their names in any order, and
names state units: time_ms, `x [mm]`, theta_deg. What neither names nor numbers tell is asked, in one sentence that
names the option.
"""

import logging
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array, Flags, Times
from palpate.checks import METRES, TURNS, other_unit
from palpate.errors import FileError
from palpate.files import column_name, in_file, read_text, table_rows
from palpate.io.table_rows import MISSING, Table, are_even, is_clock, rows_in_order, with_numbers_for_clocks
from palpate.io.time_order import UNKNOWN, are_few
from palpate.types.choices import TableChoices, TimeUnit
from palpate.types.space import MOST_WRONG, STEEPEST

logger = logging.getLogger(__name__)

NANOSECONDS: dict[TimeUnit, int] = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
"""Length of each unit of time [ns]."""
_TIME_WORDS: dict[str, TimeUnit] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanoseconds", "nanosec"), "ns"),
}
_TIME = re.compile(rf"(?:.*_)?(?:time|times|timestamp|timestamps|datetime|stamp|ts|t)(?:_({'|'.join(_TIME_WORDS)}))?")
_PLACE = re.compile(r"(?:.*_)?(?:t|p|pos)?([xyz])(?:_(mm|cm|m|in))?")
_QUATERNION = re.compile(r"(?:.*_)?(?:q|q_rs|quat|quaternion|orientation|rotation|rot)_?([xyzw])")
_TILT = re.compile(r"(?:.*_)?(?:roll|pitch)(?:_(rad|deg|degrees))?")
_ANGLE = re.compile(r"(?:.*_)?(?:theta|yaw|heading)(?:_(rad|deg|degrees))?")
_OTHER = re.compile(
    r"(?:.*_)?(?:vel|velocity|twist|linear|angular|acc|force|torque|wrench|cov|covariance|goal|target)_.*"
)
_COUNT = re.compile(r"(?:.*_)?(?:frame|index|idx|seq|id|number|count|step|row)")
_FLAG = re.compile(
    r"(?:.*_)??(?:(?:valid|tracked|visible)|(lost|occluded|missing|invalid|untracked|not_(?:valid|tracked|visible)))"
)
_FLAGS = {"true": 1.0, "yes": 1.0, "false": 0.0, "no": 0.0, **dict.fromkeys(MISSING, math.nan)}
"""Words of columns that say whether a pose was seen, in lower case; NaN says nothing, as of a pose that was lost."""
_UNIT_WORDS = ("", *_TIME_WORDS, *METRES, "rad", "deg", "degrees")
"""Units of columns; "" for none."""
_NUMBERED = re.compile(r"(.*?)_?(\d\d?)")


@dataclass(frozen=True)
class PoseTable:
    """Poses of a table."""

    time: Times | None
    """(N,) [ns]; None if rows hold no times."""
    poses: Array
    """(N, 3) [m, m, rad], (N, 7) with the quaternion's w last, or (N, 4, 4)."""
    about: str
    """What was found, such as "16 numbers by columns, times in ns"."""
    is_order_known: bool = True
    """False if nothing says where the w of quaternions is: it is taken to be last."""


def read_cells(path: Path) -> Table:
    """Return a table with any header, in comments (#) or not.

    Raises FileError if it holds no rows, rows of different lengths, or more or fewer names than columns.
    """
    text = re.sub(r"\Asep=.", "", read_text(path)).lstrip()
    first_line = text.partition("\n")[0]
    rows = table_rows(text, path, first_line if "," in first_line else "")
    header: list[str] = []
    is_comment = False
    while rows and (rows[0][1][0].startswith(("#", "%")) or not any(map(_is_value, filter(None, rows[0][1])))):
        above = header
        _, header = rows.pop(0)
        if len(above) == len(header) and all(cell.strip("[]()") in _UNIT_WORDS for cell in header):
            header = [f"{name} {unit}" for name, unit in zip(above, header, strict=True)]
        is_comment = header[0].startswith(("#", "%"))
        if is_comment:
            header = [cell for cell in (cell.lstrip("#% ") for cell in header) if cell]
    rows = _without_total([(line, row) for line, row in rows if not row[0].startswith("#")], path)
    if not rows:
        raise FileError(f"{path}: holds no rows of numbers")
    width = len(rows[0][1])
    _check_width(path, rows)
    if header[width - 1 :] in ([], [""]) and not any(row[-1] for _, row in rows):  # rows end with a separator
        width -= 1
    if header[width:] == [""]:
        header = header[:width]
    if len(header) != width and len(header) > 1 and not is_comment:
        raise FileError(f"{path}: found {width} columns below the {len(header)} names {', '.join(header)[:200]}")
    names = [_with_short_unit(column_name(cell)) for cell in header] if len(header) == width else []  # else a remark
    table = Table(path, names, [line for line, _ in rows], [row[:width] for _, row in rows])
    return _with_whole_stamps(with_numbers_for_clocks(table, names_time))


def _check_width(path: Path, rows: list[tuple[int, list[str]]]) -> None:
    """Raise FileError that names the line if rows are of different lengths."""
    width = len(rows[0][1])
    for line, row in rows:
        if len(row) == width:
            continue
        if len(rows[-1][1]) != width:  # what is above the numbers was taken for the first of them
            raise FileError(
                f"{path}: line {line}: found {len(row)} columns below {width}, and {len(rows[-1][1])} in the last row: "
                "the export of a motion capture with several rows of names? Allowed is one row of names above the "
                "numbers, such as time, x, y, z, qx, qy, qz, qw"
            )
        raise FileError(f"{path}: line {line}: found {len(row)} columns, expected {width} as above it")


def _with_short_unit(name: str) -> str:
    """Return a column's name with its unit as `_PLACE`, `_ANGLE` and `_TIME` have it: x_mm for x_in_millimetres."""
    name = re.sub(r"_(milli|centi|)met(?:er|re)s?$", lambda match: f"_{match[1][:1]}m", name)
    return re.sub(rf"_in_(?=({'|'.join(filter(None, _UNIT_WORDS))})$)", "_", name)


def names_time(name: str) -> bool:
    """Return true for the name of a column of times, as `column_name` writes it."""
    return _TIME.fullmatch(name) is not None


def _without_total(rows: list[tuple[int, list[str]]], path: Path) -> list[tuple[int, list[str]]]:
    """Return rows without a last one that was cut off or, unlike those above it, begins with a word, such as Total.

    A warning tells.
    """
    if len(rows) < 3:
        return rows
    line, row = rows[-1]
    is_cut = len(row) < len(rows[-2][1])
    has_word = not _is_value(row[0]) and all(_is_value(other[0]) for _, other in rows[:-1])
    if not (is_cut or has_word):
        return rows
    logger.warning("%s: line %d, %r, is no row like those above it and is left out", path, line, ",".join(row)[:80])
    return rows[:-1]


def _is_value(word: str) -> bool:
    """Return true for a number, or a time as ISO 8601 writes it."""
    return _is_number(word) or is_clock(word)


def _with_whole_stamps(table: Table) -> Table:
    """Return a table in which stamps of ROS that are two columns, seconds and nanoseconds, are one, of nanoseconds."""
    for index, name in enumerate(table.names):
        match = re.fullmatch(r"(|.*_)(?:nsecs?|nanosecs?|nanoseconds)", name)
        seconds = [] if match is None else [match[1] + word for word in ("secs", "sec", "seconds")]
        found = [table.names.index(other) for other in seconds if other in table.names]
        if match is None or len(found) != 1:
            continue
        whole = found[0]
        cells = [list(row) for row in table.cells]
        for row in cells:
            if row[whole].isdecimal() and row[index].isdecimal():
                row[whole] = str(int(row[whole]) * 10**9 + int(row[index]))
        names = list(table.names)
        names[whole] = f"{match[1]}stamp_ns"
        names[index] = f"part_of_{names[whole]}"
        return table._replace(names=names, cells=cells)
    return table


def _is_number(word: str) -> bool:
    try:
        float(word or "nan")
    except ValueError:
        return False
    return True


def read_times(path: Path, choices: TableChoices) -> tuple[Times, list[str]]:
    """Return the times (N,) [ns] of images in a table, and their files; no files if it has times alone.

    Columns are found by the names time and file or, without a header, by what they hold. Raises FileError.
    """
    table = read_cells(path)
    with in_file(path):
        columns = range(len(table.cells[0]))
        texts = [index for index in columns if not all(map(_is_number, table.column(index)))]
        if table.names:
            time, unit = _time_column(table)
        else:
            numeric = [index for index in columns if index not in texts]
            time, unit = (numeric[0], None) if len(numeric) == 1 else (None, None)
        named = [index for index in texts if not table.names or re.search("file|image|name|path", table.names[index])]
        if time is None or len(named) > 1:
            raise FileError(f"found {table.columns}; expected one named time and, if images are not in order, one file")
        stamps, _ = _times(table, time, choices.time_unit or unit)
        if not named:
            return stamps, []
        order = rows_in_order(path, table.cells, stamps)
        return stamps[order], [table.cells[index][named[0]] for index in order]


def read_pose_table(path: Path, choices: TableChoices) -> PoseTable:
    """Return the poses of a table with their times. Raises FileError, which asks for what nothing tells."""
    table = read_cells(path)
    with in_file(path):
        time, unit = _time_column(table)
        found = _named(table) if table.names else _unnamed(table, time, choices)
        poses = _in_metres(found.numbers, choices.poses_unit or found.unit)
        poses[~_seen(table)] = np.nan
        if time is None:
            return PoseTable(None, poses, f"{found.layout}, no times", found.is_order_known)
        stamps, unit = _times(table, time, choices.time_unit or unit)
        order = rows_in_order(path, [(pose.tobytes(),) for pose in poses], stamps)  # as bytes, in which NaN equals NaN
        return PoseTable(stamps[order], poses[order], f"{found.layout}, times in {unit}", found.is_order_known)


def poses_of_numbers(path: Path, names: Sequence[str], numbers: Array, choices: TableChoices) -> PoseTable:
    """Return the poses in numbers (N, columns) whose names are known, or are none, without times. Raises FileError."""
    cells = [[repr(number) for number in row] for row in numbers.tolist()]
    table = Table(path, [column_name(name) for name in names], list(range(len(cells))), cells)
    with in_file(path):
        found = _named(table) if table.names else _unnamed(table, None, choices)
        poses = _in_metres(found.numbers, choices.poses_unit or found.unit)
        poses[~_seen(table)] = np.nan
        return PoseTable(None, poses, found.layout, found.is_order_known)


class _Found(NamedTuple):
    """Poses as a table has them."""

    numbers: Array
    """(N, 3), (N, 7) with w last, or (N, 4, 4)."""
    layout: str
    """In words."""
    unit: str | None = None
    """Unit of positions that a name states."""
    is_order_known: bool = True
    """False if nothing says where the w of quaternions is."""


def _unnamed(table: Table, time: int | None, choices: TableChoices) -> _Found:
    """Return poses without names of columns."""
    numbers = table.numbers(range(0 if time is None else 1, len(table.cells[0])))
    if numbers.shape[1] == 16:
        return _matrices(numbers, table)
    if numbers.shape[1] == 3:
        _check_radians(numbers[:, 2])
        return _Found(numbers, "x, y, theta")
    if choices.quaternion == "wxyz":
        return _Found(numbers[:, [0, 1, 2, 4, 5, 6, 3]], "7 numbers, w first")
    return _Found(numbers, "7 numbers, w last", is_order_known=choices.quaternion is not None)


def _named(table: Table) -> _Found:
    """Return poses by the names of columns. Raises FileError."""
    groups = _groups_of_16(table)
    places = _by_letter(table, _PLACE, "xyz")
    quaternions = _by_letter(table, _QUATERNION, "xyzw")
    angles = _matching(table, _ANGLE)
    if len(groups) == 1 or "o_t_ee" in groups:
        name = "o_t_ee" if "o_t_ee" in groups else next(iter(groups))
        return _matrices(table.numbers(groups[name]), table)
    if len(quaternions) == 4 and len(places) == 3:
        indices = [*(places[letter] for letter in "xyz"), *(quaternions[letter] for letter in "xyzw")]
        return _Found(table.numbers(indices), "position and quaternion by names", _unit_of(table, places, "xyz"))
    if len(angles) == 1 and {"x", "y"} <= set(places):
        _check_upright(table)
        poses = table.numbers([places["x"], places["y"], *angles])
        if (_ANGLE.fullmatch(table.names[angles[0]]) or [""])[1] in ("deg", "degrees"):
            poses[:, 2] = np.radians(poses[:, 2])
        _check_radians(poses[:, 2])
        return _Found(poses, "x, y, theta by names", _unit_of(table, places, "xy"))
    allowed = "x, y, z, qx, qy, qz, qw; x, y, theta; or 16 numbered columns, such as O_T_EE[0] to O_T_EE[15]"
    raise FileError(f"found the columns {table.columns}; expected one time and {allowed}, each once")


def _seen(table: Table) -> Flags:
    """Return flags of rows (N,) without those that a column flags as lost, such as of motion capture; a warning tells.

    Programs repeat the last pose in these, or write zeros.
    """
    seen = np.ones(len(table.cells), np.bool_)
    for index in _matching(table, _FLAG):
        name = table.names[index]
        words = table.column(index)
        match = _FLAG.fullmatch(name)
        flags = np.array([_flag(word) for word in words])
        odd = ~np.isin(flags, (0.0, 1.0)) & ~np.isnan(flags)
        if odd.any() or np.isnan(flags).all():
            found = words[int(np.argmax(odd))][:20]
            allowed = "allowed are 0 and 1, true and false, or yes and no"
            logger.warning("%s: column %s is not used: found %r, %s", table.path, name, found, allowed)
            continue
        is_good = flags == (0.0 if match and match[1] else 1.0)
        if not is_good.all():
            count = np.count_nonzero(~is_good)
            logger.warning("%s: %d of %d poses are unknown by column %s", table.path, count, len(words), name)
        seen &= is_good
    return seen


def _flag(word: str) -> float:
    """Return 1 or 0, NaN for a cell that holds nothing, and another number for one that is no flag."""
    known = _FLAGS.get(word.lower())
    if known is not None:
        return known
    return float(word) if _is_number(word) else math.inf


def _check_radians(angles: Array) -> None:
    """Raise FileError if angles (N,), more than a few of them, are probably degrees."""
    known = np.abs(angles[np.isfinite(angles)])
    largest = float(known.max(initial=0.0))
    if largest > TURNS and np.mean(known > TURNS) > MOST_WRONG:
        raise FileError(f"angles reach {largest:.4g} rad: are these degrees? Name the columns time, x, y, theta_deg")


def _matching(table: Table, pattern: re.Pattern[str]) -> list[int]:
    """Return the columns whose name fits, without those of velocities, forces and the like."""
    return [i for i, name in enumerate(table.names) if pattern.fullmatch(name) and not _OTHER.fullmatch(name)]


def _by_letter(table: Table, pattern: re.Pattern[str], letters: str) -> dict[str, int]:
    """Return the column of each letter that exactly one name has; positions are no quaternions."""
    found: dict[str, list[int]] = {letter: [] for letter in letters}
    for index in _matching(table, pattern):
        name = table.names[index]
        match = pattern.fullmatch(name)
        if match and not (pattern is _PLACE and _QUATERNION.fullmatch(name)):
            found[match[1]].append(index)
    return {letter: columns[0] for letter, columns in found.items() if len(columns) == 1}


def _unit_of(table: Table, places: dict[str, int], letters: str) -> str | None:
    """Return the unit in the names of positions, None if they have none. Raises FileError if they differ."""
    matches = [_PLACE.fullmatch(table.names[places[letter]]) for letter in letters]
    units = {match[2] for match in matches if match}
    if len(units) > 1:
        words = ", ".join(table.names[places[letter]] for letter in letters)
        raise FileError(f"found positions {words}; allowed is one unit in all of their names, or none")
    return units.pop() if units else None


def _check_upright(table: Table) -> None:
    """Raise FileError if columns of roll or pitch say that a pose is more than its yaw."""
    for index in _matching(table, _TILT):
        angles = table.numbers([index])[:, 0]
        match = _TILT.fullmatch(table.names[index])
        is_degrees = match is not None and match[1] in ("deg", "degrees")
        angles = np.radians(angles) if is_degrees else angles
        largest = float(np.abs(angles[np.isfinite(angles)]).max(initial=0.0))
        if largest > math.radians(STEEPEST):
            raise FileError(
                f"{table.names[index]} reaches {math.degrees(largest):.0f} degrees, so that yaw alone is not the pose: "
                "give positions and quaternions, or 4x4 matrices"
            )


def _groups_of_16(table: Table) -> dict[str, list[int]]:
    """Return the columns of each 16 names that differ only in their number: 0 to 15, 1 to 16, 00 to 33 or 11 to 44."""
    members: dict[str, dict[str, int]] = {}
    for index, name in enumerate(table.names):
        match = _NUMBERED.fullmatch(re.sub(r"(\d)_(\d)$", r"\1\2", name))
        if match:
            members.setdefault(match[1], {})[match[2]] = index
    orders = [
        [str(k) for k in range(16)],
        [str(k) for k in range(1, 17)],
        [f"{k:02d}" for k in range(16)],
        [f"{row}{column}" for row in range(4) for column in range(4)],
        [f"{row}{column}" for row in range(1, 5) for column in range(1, 5)],
    ]
    return {
        prefix: [numbered[number] for number in order]
        for prefix, numbered in members.items()
        for order in orders
        if set(numbered) == set(order)
    }


def _matrices(numbers: Array, table: Table) -> _Found:
    """Return 16 numbers a row as matrices, by rows or by columns as their 0, 0, 0, 1 shows. Raises FileError."""
    matrices = numbers.reshape(-1, 4, 4)
    is_known = np.isfinite(numbers).all(axis=1)
    last = np.array([0.0, 0.0, 0.0, 1.0])
    by_rows: Flags = np.asarray(np.isclose(matrices[:, 3], last, atol=1e-6).all(axis=1))
    by_columns: Flags = np.asarray(np.isclose(matrices[:, :, 3], last, atol=1e-6).all(axis=1))
    least = (1.0 - MOST_WRONG) * is_known.sum()  # a few, such as zeros, cost themselves
    if by_rows[is_known].sum() >= max(least, by_columns[is_known].sum()):
        return _Found(matrices, "16 numbers by rows")
    if by_columns[is_known].sum() >= least:
        return _Found(matrices.transpose(0, 2, 1), "16 numbers by columns")
    line = table.lines[int(np.argmax(is_known & ~(by_rows if by_rows.sum() > by_columns.sum() else by_columns)))]
    raise FileError(f"line {line}: the 16 numbers are no 4x4 matrix by rows or by columns, with its 0, 0, 0, 1")


def _in_metres(poses: Array, unit: str | None) -> Array:
    """Return poses with positions [m] from those in a unit, None if nothing states one.

    Raises FileError, which asks for the unit, if none is stated and the positions span too much.
    """
    poses = poses.copy()
    position = poses[:, :3, 3] if poses.ndim == 3 else poses[:, : 2 if poses.shape[1] == 3 else 3]
    known = position[np.isfinite(position).all(axis=1)]
    known = known[np.abs(known - np.median(known, axis=0)).max(axis=1).argsort()]
    known = known[: math.ceil((1.0 - MOST_WRONG) * len(known))]  # a few that are far off cost themselves
    span = float(np.ptp(known, axis=0).max()) if len(known) else 0.0
    farthest = float(np.abs(known).max()) if len(known) else 0.0
    longest_push = 1.5  # [m] a longer one, or one far from the origin, may well be in another unit
    if unit is None and (span > longest_push or farthest > 10.0):
        question = other_unit(span, 0.02, longest_push) or ": in which unit?"
        found = f"positions span {span:.4g} and reach {farthest:.4g}"
        raise FileError(f"{found}{question} Give --poses-unit m, cm, mm or in")
    position *= METRES[unit or "m"]  # a view, so that poses change
    return poses


def _time_column(table: Table) -> tuple[int | None, TimeUnit | None]:
    """Return the column of times, None if there is none, and the unit in its name.

    Stamps of messages come before other times. Raises FileError on a number of columns without names that is no pose.
    """
    if not table.names:
        width = len(table.cells[0])
        if width not in (3, 7, 16, 4, 8, 17):
            raise FileError(f"found {table.columns}; expected 3, 7 or 16 numbers a row, or a time and these")
        return (0, None) if width in (4, 8, 17) else (None, None)
    found = _matching(table, _TIME)
    stamps = [index for index in found if "stamp" in table.names[index]]
    chosen = next(iter(stamps or found), None)
    unknown = [name for name in table.names if re.match("(time|timestamp|stamp)(_|$)", name)]
    if chosen is None and unknown:
        raise FileError(f"times are named {unknown[0]}; known units are s, ms, us and ns, as in time_ms")
    if chosen is None:
        _check_no_other_time(table)
        return None, None
    match = _TIME.fullmatch(table.names[chosen])
    return chosen, _TIME_WORDS[match[1]] if match and match[1] else None


def _check_no_other_time(table: Table) -> None:
    """Raise FileError if a column whose name says nothing rises in even steps, as times do, and does not count rows."""
    known = (_PLACE, _QUATERNION, _ANGLE, _TILT, _OTHER, _COUNT)
    for index, name in enumerate(table.names):
        if any(pattern.fullmatch(name) for pattern in known) or len(table.cells) < 3:
            continue
        if not all(_is_number(word) for word in table.column(index)):
            continue
        steps = np.diff(table.numbers([index])[:, 0])
        if (steps > 0.0).all() and not (steps == 1.0).all() and are_even(steps):
            raise FileError(
                f"no column is named time, and {name or 'one without a name'!r} rises from row to row: name it time if "
                "it holds the times, else leave it out"
            )


def _times(table: Table, column: int, unit: TimeUnit | None) -> tuple[Times, TimeUnit]:
    """Return times (N,) [ns], of which a few may be UNKNOWN, and their unit.

    Raises FileError, which asks for the unit if nothing tells.
    """
    words = table.column(column)
    values = table.numbers([column], "a number or a time such as 2026-11-29T08:15:30.25Z")[:, 0]
    is_known = np.isfinite(values)
    if not is_known.any() or not are_few(int((~is_known).sum()), len(values)):
        index = int(np.argmin(is_known))
        raise FileError(f"line {table.lines[index]}: time is {words[index]!r}, expected a number")
    unit = unit or time_unit(values[is_known])
    size = NANOSECONDS[unit]
    farthest = float(np.abs(values[is_known]).max())
    if farthest * size >= 2**62:
        raise FileError(f"times reach {farthest:.10g} {unit}, past any clock; give --time-unit")
    stamps = np.full(len(values), UNKNOWN)
    for index in np.flatnonzero(is_known):
        word = words[index]
        is_exact = word.lstrip("+-").isdecimal()  # also beyond what a float holds
        stamps[index] = int(word) * size if is_exact else round(values[index] * size)
    return stamps, unit


def time_unit(values: Array) -> TimeUnit:
    """Return the unit in which times (N,) are plausible, by their steps and, of a calendar clock, by their size.

    Raises FileError, which names the option, if none or several are.
    """
    steps = np.abs(np.diff(values))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    likely: list[TimeUnit] = []
    for unit, size in NANOSECONDS.items():
        if not step or 2e5 <= step * size <= 2e9:  # 0.2 ms to 2 s
            likely.append(unit)
    of_calendar: list[TimeUnit] = [unit for unit in likely if is_of_calendar(values, unit)]
    if len(of_calendar) == 1:
        return of_calendar[0]
    if len(likely) == 1:
        return likely[0]
    question = f"are these {' or '.join(likely)}?" if likely and step else "in which unit?"
    found = f"times are, in the median, {step:g} from one to the next"
    raise FileError(f"{found}: {question} Give --time-unit s, ms, us or ns")


def is_of_calendar(values: Array, unit: TimeUnit) -> bool:
    """Return true if times (N,) in a unit, all but a few, are of the years 2001 to 2096."""
    nanoseconds = values * NANOSECONDS[unit]
    return bool(np.mean((nanoseconds >= 1e18) & (nanoseconds <= 4e18)) >= 1.0 - MOST_WRONG)
