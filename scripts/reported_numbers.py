"""The numbers that README and docs report, each from a file in the repository; see `check_numbers`."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import fmean, median
from typing import Any

from palpate.config.settings import NoiseSettings
from palpate.field_docs import field_docs
from palpate.graph.variables import SHARED
from palpate.lab.study.results import ALL, LOST_DEG, LOST_MM, errors_after_knock
from palpate.lab.study.rows import read_rows
from palpate.pipeline.recovery import FAR_DEG, FAR_MM

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "docs/study"
Row = Mapping[str, Any]

MM, DEG = "final_translation_error_mm", "final_rotation_error_deg"
SEEN = {
    "disc": "disc",
    "ellipse": "ellipse",
    "rectangle-edges": "rectangle, edges",
    "rectangle-near-corners": "rectangle, near corners",
    "rectangle-corners": "rectangle, true corners",
}
"""Kinds of contact that the touch model has learned from, and what to call them."""
UNSEEN = "five outlines that the model has not seen"
KINDS = ("disc", "ellipse", "edge", "near-corner", "corner")
READERS = {
    "constant": "constant",
    "linear engineered": "linear, engineered",
    "linear learnt": "linear, learnt",
    "nonlinear learnt": "nonlinear, learnt",
    "descriptor pair": "pairs with a predicted variance",
}
BALLS = {
    "as it is": "as they are",
    "red and blue exchanged": "red and blue exchanged",
    "as it is, calibrated on 5": "as they are, after `palpate calibrate` on five of them",
    "mirrored, calibrated on 5": "mirrored, after the same",
    "red and blue exchanged, calibrated on 5": "red and blue exchanged, after the same",
}


def sequences(name: str) -> list[Row]:
    """Return the rows of a reported study's `sequences.csv`, numbers as such; None where nothing is told."""
    words = {"": None, "True": 1.0, "False": 0.0}
    names = ("recording", "group", "tactile", "smoother")

    def value(key: str, text: str) -> Any:
        return text if key in names else words[text] if text in words else float(text)

    rows = read_rows(STUDY / name / "sequences.csv")
    return [{key: value(key, text) for key, text in row.items()} for row in rows]


def loaded(path: str) -> Any:
    """Return the content of a JSON file of the repository."""
    return json.loads((ROOT / path).read_text(encoding="utf-8"))


def oracle_runs() -> list[Row]:
    """Return the runs on real recordings whose touch comes from ground truth."""
    return loaded("docs/study/real.json")["runs"]


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def final(rows: Sequence[Row]) -> str:
    """Return the final error in the median and, in brackets, the worst."""
    mm, deg = ([row[key] for row in rows if row[key] is not None] for key in (MM, DEG))
    return f"{median(mm):.1f} mm, {median(deg):.1f}° ({max(mm):.0f}, {max(deg):.0f})"


def percent(share: float, digits: int = 0) -> str:
    """Return a share in percent."""
    return f"{100.0 * share:.{digits}f} %"


def mean(rows: Sequence[Row], key: str) -> float:
    """Return the mean over the rows that tell it."""
    return fmean([row[key] for row in rows if row[key] is not None])


def covered(rows: Sequence[Row]) -> str:
    """Return the share of true poses in the 95 % region, in contact and at the end."""
    return f"{percent(mean(rows, 'in_95_contact_share'))}, {percent(mean(rows, 'in_95_final'))}"


def silent(rows: Sequence[Row]) -> str:
    """Return the share of frames that are silently wrong."""
    return percent(mean(rows, "silently_wrong_share"), 1)


def _scored(name: str, rows: Sequence[Row]) -> list[str]:
    return [name, str(len(rows)), final(rows), covered(rows), silent(rows)]


SCORES = ("objects", "sequences", "final error", "in 95 %: contact, end", "silently wrong")


def systematic() -> str:
    """Return the table of pushes of which what is told is wrong all the time."""
    return _by_kind(sequences("systematic"))


def plain() -> str:
    """Return the table of pushes that nothing disturbs."""
    return _by_kind(sequences("plain"))


DRAWS = {
    "systematic": ("with the errors of a set-up", (62801, 52801)),
    "plain": ("without them", (62301, 52301)),
    "knocked": ("shoved", (62101, 52101)),
}
"""Studies, what they are of, and the seeds of the reported draw and of the one before, by the same settings."""


def draws() -> str:
    """Return the table of two draws of each study."""
    cells = []
    for name, (told, (reported, before)) in DRAWS.items():
        for seed, rows in ((reported, sequences(name)), (before, sequences(f"earlier/{name}-{before}"))):
            cells.append([told, str(seed), *_scored("", rows)[1:]])
    return table(("recordings", "seed", *SCORES[1:]), cells)


def _by_kind(rows: Sequence[Row]) -> str:
    kinds = [(told, [row for row in rows if row["group"] == group]) for group, told in SEEN.items()]
    unseen = [row for row in rows if row["group"] not in SEEN]
    cells = [[*_scored(*kind), nees(kind[1])] for kind in (*kinds, (UNSEEN, unseen), ("all", rows))]
    return table((*SCORES, "NEES"), cells)


def nees(rows: Sequence[Row]) -> str:
    """Return the NEES of a sequence in the median and in the mean."""
    each = [row["nees_mean"] for row in rows if row["nees_mean"] is not None]
    return f"{median(each):.1f}, {fmean(each):.1f}"


def knocked() -> str:
    """Return the table of pushes in which somebody shoves the object."""
    rows = sequences("knocked")
    groups = [(group, [row for row in rows if row["group"].split("-")[0] == group]) for group in SHOVED]
    cells = [
        [*_scored(name, some), percent(mean(some, "silently_wrong_unfelt_share"), 1)]
        for name, some in (*groups, ("all", rows))
    ]
    return table((*SCORES, "of it before a touch"), cells)


SHOVED = ("disc", "ellipse", "rectangle", "triangle", "t")


def knocked_facts() -> set[str]:
    """Return what is said of how the estimate recovers from shoves."""
    rows = sequences("knocked")
    shares = {
        group: row["learnt"]["recovered_in_2s"]
        for group, row in loaded("docs/study/knocked/results.json")["table"].items()
    }
    soon = {group: f"{100.0 * share:.0f}" for group, share in shares.items() if share is not None}
    corners = {group for group in soon if group.endswith("-corners") and "near" not in group}
    parts = (soon.keys() - corners - {ALL}, corners)
    ends = (pick((soon[group] for group in part), key=float) for part in parts for pick in (min, max))
    return {
        soon[ALL],
        *ends,
        "2",
        "10",
        "5",
        "50",
        "30",
        str(sum(map(int, (row["lost"] for row in rows)))),
        str(len(rows)),
    }


def knocked_silent() -> set[str]:
    """Return the share of silently wrong frames when somebody shoves the object, and what of it touch could tell."""
    rows = sequences("knocked")
    felt = mean(rows, "silently_wrong_share") - mean(rows, "silently_wrong_unfelt_share")
    return {silent(rows).removesuffix(" %"), f"{100.0 * felt:.1f}"}


def coverage_facts() -> set[str]:
    """Return the coverage of final poses in simulation, and what there is on the motion of two fingers."""
    rows = sequences("plain")
    unseen = [row for row in rows if row["group"] not in SEEN]
    rendered, oracle = _real(sequences("rendered"), "recording")["CMU"], _real(oracle_runs(), "file")["CMU"]
    shares = [mean(each, "in_95_final") for each in (rows, unseen, rendered)]
    return {"95", *(f"{100.0 * share:.0f}" for share in (*shares, mean(oracle, "in_95_contact_share")))}


def systematic_facts() -> set[str]:
    """Return the coverage of pushes of which what is told is wrong all the time, seen outlines and unseen ones."""
    rows = sequences("systematic")
    unseen = [row for row in rows if row["group"] not in SEEN]
    keys = ("in_95_contact_share", "in_95_final")
    return {"95", *(f"{100.0 * mean(some, key):.0f}" for some in (rows, unseen) for key in keys)}


def live_facts() -> set[str]:
    """Return what is said of long live sessions: rate, latency, growth, images and drops of each."""
    runs = loaded("docs/study/live.json")
    latencies = {f"{run['latency_ms'][key]:.0f}" for run in runs.values() for key in ("p50", "p99")}
    growths = {f"{run['rss_growth_mb']:.0f}" for run in runs.values()}
    counts = {str(run[key]) for run in runs.values() for key in ("images", "dropped")}
    return {*runs, "99", *latencies, *growths, *counts}


def large_facts() -> set[str]:
    """Return size, frames and memory of tracking a large file."""
    found = loaded("docs/study/large.json")
    return {str(found["frames"]), *(f"{found[key]:.0f}" for key in ("gigabytes", "pss_mb", "rss_mb"))}


def limits() -> set[str]:
    """Return from where an estimate is wrong, and a sequence lost."""
    return {"95", *(f"{limit:.0f}" for limit in (FAR_MM, FAR_DEG, LOST_MM, LOST_DEG))}


def ways() -> str:
    """Return the table of the ways of `--tactile`."""
    rows = sequences("ways")
    cells = []
    for way in dict.fromkeys(row["tactile"] for row in rows):
        of_way = [row for row in rows if row["tactile"] == way]
        cells.append(
            [f"`{way}`", final(of_way), covered(of_way), silent(of_way), f"{sum(row['lost'] for row in of_way):.0f}"]
        )
    return table(("touch", *SCORES[2:], "lost"), cells)


MINI = {"disc": "disc", "rectangle-edges": "rectangle, edges", "ellipse": "ellipse"}
SET_UPS = {"ideal": "exact set-up", "real": "its errors drawn"}
"""Folders of recordings, and what they are of."""


def mini() -> str:
    """Return the table of pushes by a simulated GelSight Mini."""
    cells = []
    for name, errors in SET_UPS.items():
        rows = sequences(f"gelsight_mini/{name}")
        for group, told in MINI.items():
            cells.append(_scored(f"{told}; {errors}", [row for row in rows if row["group"] == group]))
    return table(("objects; set-up", *SCORES[1:]), cells)


def mini_facts() -> set[str]:
    """Return what is said of the model of the GelSight Mini."""
    told = loaded("docs/study/gelsight_mini/touch_model.json")["honesty"]
    return {"95", f"{told['place']['median_mm']:.1f}", f"{told['direction']['median_deg']:.1f}"}


def press_facts() -> set[str]:
    """Return how far a model from presses is off."""
    found = loaded("docs/study/presses.json")
    shares = {f"{100.0 * found[key]:.0f}" for key in ("in_68_share", "in_95_share")}
    counts = {str(found[key]) for key in ("presses", "judged")}
    return {"68", "95", *shares, *counts, f"{found['rms_deg']:.1f}", f"{found['median_deg']:.1f}"}


def direction_scale_facts() -> set[str]:
    """Return what directions of one unit have in common."""
    found = loaded("docs/study/direction_scale.json")
    pressed = [value for value in found.values() if isinstance(value, dict)]
    degrees = ("offset_mean_deg", "offset_deviation_deg", "about_line_deg", "stated_deg")
    told = {f"{one[key]:.1f}" for one in pressed for key in degrees}
    return {str(found["units"]), *told, *(f"{100.0 * one['scale_deviation']:.0f}" for one in pressed)}


def place_bias_facts() -> set[str]:
    """Return what places of one unit have in common."""
    found = loaded("docs/study/place_bias.json")
    pressed = [value for value in found.values() if isinstance(value, dict)]
    scales = {f"{one['scale_mean']:.2f}" for one in pressed}
    return {str(found["units"]), *scales, *(f"{one['offset_mm_deviation']:.1f}" for one in pressed)}


def after_shoves_facts() -> set[str]:
    """Return what two seconds of contact tell after a shove."""
    found = loaded("docs/study/after_shoves.json")
    told = {f"{100.0 * found['near_share']:.0f}", f"{found['sigma_mm']:.0f}", str(found["shoves"])}
    return {*told, f"{FAR_MM:.0f}", f"{FAR_DEG:.0f}"}


def press_scale_facts() -> set[str]:
    """Return how far the scale of objects is that of a ball, which many calibrate on."""
    found = loaded("docs/study/direction_scale.json")
    objects = [value for name, value in found.items() if isinstance(value, dict) and name != "ball"]
    means = {f"{one['scale_over_ball_mean']:.2f}" for one in objects}
    return {str(found["units"]), *means, *(f"{100.0 * one['scale_over_ball_deviation']:.0f}" for one in objects)}


SET_UP_ERRORS = {
    "none": "none",
    "mounting": "mounting",
    "outline": "outline",
    "late": "late images",
    "first_pose": "first pose",
    "all": "all four",
    "outline, taken for exact": "outline, taken for exact",
    "all, outline taken for exact": "all four, outline taken for exact",
}
"""Cases in their order, and how they are called."""


def set_up_errors() -> str:
    """Return the table of what each error of a set-up costs by itself."""
    cases = loaded("docs/study/set_up_errors.json")["cases"]
    rows = [
        [
            told,
            f"{cases[name]['contact_mm']:.1f} mm",
            f"{cases[name]['final_mm']:.1f} mm, {cases[name]['final_deg']:.1f}°",
            f"{percent(cases[name]['contact_inside_95'])}, {percent(cases[name]['final_inside_95'])}",
        ]
        for name, told in SET_UP_ERRORS.items()
    ]
    return table(("error", "mean error in contact", "final error", "in 95 %: contact, end"), rows)


TOUCH = {"oracle": "true relative yaw", "none": "none"}
"""What is felt of pushes by two fingers, and how it is called."""


def two_fingers() -> str:
    """Return the table of simulated pushes by two fingers."""
    found = loaded("docs/study/two_fingers.json")
    rows = [
        [
            told,
            str(found["recordings"]),
            f"{of['final_mm_median']:.1f} mm, {of['final_deg_median']:.1f}° ({of['final_mm_worst']:.0f} mm)",
            f"{percent(of['inside_contact_mean'])}, {percent(of['inside_final_mean'])}",
            f"{100 * of['silent_mean']:.1f} %",
        ]
        for told, of in ((told, found["touch"][name]) for name, told in TOUCH.items())
    ]
    return table(("touch", "recordings", "final error", "in 95 %: contact, end", "silently wrong"), rows)


def paper_system() -> str:
    """Return the table of the paper's own system beside palpate's, without and with the errors of a set-up."""
    found = loaded("docs/study/paper_system.json")
    rows = [
        [
            f"{name}; {told}",
            str(row["sequences"]),
            f"{row['final_mm']['median']:.1f} mm, {row['final_deg']['median']:.1f}° "
            f"({row['final_mm']['worst']:.0f}, {row['final_deg']['worst']:.0f})",
            f"{percent(row['in_95_contact'])}, {percent(row['in_95_final'])}",
            str(row["lost"]),
            str(row["indeterminate_frames"]),
        ]
        for set_up, told in SET_UPS.items()
        for name, row in found[set_up].items()
    ]
    head = ("system; set-up", "sequences", "final error", "in 95 %: contact, end", "lost", "frames that iSAM2 refused")
    return table(head, rows)


def wear_facts() -> set[str]:
    """Return how much of an untouched gel changes, worn or not."""
    shares = loaded("docs/study/wear.json")["shares"]
    return {f"{100.0 * share:.0f}" for one in shares.values() for share in one.values()} | {"7", "14"}


def colours_facts() -> set[str]:
    """Return of how many gels something is said of their colours."""
    study = loaded("docs/study/colours.json")
    return {str(number) for each in (study["published"], study["simulated, usual"]) for number in each.values()}


def untouched_facts() -> set[str]:
    """Return how well networks read directions that see the untouched gel and that do not."""
    study = loaded("docs/study/untouched.json")
    keys = ("median_deg", "median_after_offset_deg", "real_rms_about_line_deg", "real_slope")
    ways = (way for way in study.values() if isinstance(way, dict))
    return {str(study["units_judged_by"]), *(f"{value:.2f}" for way in ways for key in keys for value in way[key])}


def reading_facts() -> set[str]:
    """Return what images of units that no network has seen tell."""
    found = loaded("docs/study/reading.json")
    missed = found["missed_frames"] / found["frames_of_contact"]
    degrees = {f"{found[f'{outlines}_direction_deg']:.2f}" for outlines in ("seen", "unseen")}
    return degrees | {str(found["recordings"]), f"{found['contact_f1']:.3f}", f"{100.0 * missed:.1f}"}


def begun_facts() -> set[str]:
    """Return how recordings are tracked that begin in contact, and with the untouched gel given."""
    found = loaded("docs/study/begun_in_contact.json")
    return {str(found["recordings"])} | {f"{value:.1f}" for key, value in found.items() if key != "recordings"}


def unknown_start_facts() -> set[str]:
    """Return what is said of objects of which nothing is known at first: what counts as found, and how many are."""
    study = loaded("docs/study/unknown_start.json")
    shares = {f"{100.0 * study[key]:.0f}" for key in ("found_share", "honest_share", "found_if_told_share")}
    return {"60", "5", "3", "95", str(study["recordings"]), *shares}


def half_turn_facts() -> set[str]:
    """Return how many pushes there are with images that lie turned, how many of these are found, and how soon."""
    study = loaded("docs/study/half_turn.json")
    assert study["as it is"]["share"] == 0.0
    ways = (study[name] for name in ("turned by half a turn", "mirrored"))
    found = {text for way in ways for text in (f"{100.0 * way['share']:.0f}", f"{way['median_s']:.1f}")}
    return {str(study["recordings"]), "66101", *found}


def slip_facts() -> set[str]:
    """Return what images tell of sliding."""
    scores = [value for value in loaded("docs/study/slip.json").values() if isinstance(value, dict)]
    return {f"{one['auc']:.2f}" for one in scores} | {f"{100.0 * one['slip_r2']:.0f}" for one in scores}


def readers() -> str:
    """Return the table of what models read from pairs of images."""
    squares = loaded("docs/study/touch_model.json")["mean_square_of_sine"]
    rows = [[told, *(f"{1e3 * squares[name][kind]:.1f}" for kind in KINDS)] for name, told in READERS.items()]
    return table(("", "disc", "ellipse", "edge", "near corner", "true corner"), rows)


def reader_facts() -> set[str]:
    """Return how far off directions are."""
    found = loaded("docs/study/touch_model.json")
    corner = found["mean_square_of_sine"]
    share = corner["descriptor pair"]["corner"] / corner["constant"]["corner"]
    return {
        f"{found['honesty']['direction']['median_deg']:.1f}",
        f"{found['direction_offset_of_units_deg']:.1f}",
        f"{100 * share:.0f}",
    }


def ideal_corner_facts() -> set[str]:
    """Return how well an ideal observer could read the turn of a corner and of an edge."""
    found = loaded("docs/study/ideal_corner.json")
    corner, edge = found["corner"]["median_deg"], found["edge"]["median_deg"]
    return {str(found["units"]), f"{found['turn_deg']:.0f}", f"{corner:.1f}", f"{edge:.2f}", "300"}


def balls() -> str:
    """Return the table of presses on a real gel."""
    found = loaded("docs/study/real_gel.json")
    rows = [
        [
            told,
            f"{found[name]['correlation']:.3f}",
            f"{found[name]['slope']:.2f}",
            f"{found[name]['rms_after_offset_deg']:.1f}°",
            f"{found[name]['rms_about_line_deg']:.2f}°",
            f"{found[name]['pairs_rms_deg']:.1f}°",
            f"{percent(found[name]['in_68_share'])}, {percent(found[name]['in_95_share'])}",
        ]
        for name, told in BALLS.items()
    ]
    head = ("images", "correlation", "told over true", "off", "about the line", "between two presses", "in 68 %, 95 %")
    return table(head, rows)


def ball_facts() -> set[str]:
    """Return what is said of presses on a real gel, and how far a constant model is off between two of them."""
    found = loaded("docs/study/real_gel.json")
    facts = {"95", *(f"{slope:.2f}" for slope in found.pop("flanks").values())}
    for row in found.values():
        facts |= {f"{row['constant_pairs_rms_deg']:.0f}", f"{row['rms_after_offset_deg']:.1f}"}
        facts |= {f"{100.0 * row['in_95_share']:.0f}", f"{abs(row['offset_deg']):.1f}"}
    return facts


def press_view_facts() -> set[str]:
    """Return what is said of how the images of simulated units lie, as presses tell it."""
    found = loaded("docs/study/press_views.json")
    facts = {str(found["units"]), f"{found['said_to_deg']:.0f}"}
    for way in (way for way in found.values() if isinstance(way, dict)):
        parts = ("left_right", "up_down", "colours", "colours_usual")
        facts |= {*(f"{100.0 * way[f'{part}_share']:.0f}" for part in parts), f"{way['rms_median_deg']:.1f}"}
    return facts


def _real(rows: Sequence[Row], key: str) -> dict[str, list[Row]]:
    cmu = [row for row in rows if Path(row[key]).name.startswith("bigrect")]
    mit = [row for row in rows if row not in cmu]
    return {
        "MIT, not knocked": [row for row in mit if not row["knocks"]],
        "MIT, knocked by hand": [row for row in mit if row["knocks"]],
        "CMU": cmu,
    }


def real_motion() -> str:
    """Return the table of runs on the motion of real pushes."""
    told = {
        "rendered touch": _real(sequences("rendered"), "recording"),
        "true relative yaw": _real(oracle_runs(), "file"),
    }
    rows = [_scored(f"{group}; {touch}", runs) for touch, groups in told.items() for group, runs in groups.items()]
    return table(("motion; touch", "runs", *SCORES[2:]), rows)


def real_runs() -> str:
    """Return the table of each of the real MIT runs, none left out."""
    rows = [
        [
            Path(run["file"]).name.removesuffix(".json.gz"),
            f"{run['knocks']:.0f}",
            f"{run[MM]:.1f} mm, {run[DEG]:.1f}°",
            f"{percent(run['in_95_contact_share'])}, {'in' if run['in_95_final'] else 'out'}",
            percent(run["scored_frames"] / run["frames"]),
            ", ".join(f"{status} {count}" for status, count in run["statuses"].items()),
        ]
        for run in oracle_runs()
        if run["file"].startswith("mit")
    ]
    return table(("run", "knocks", "final error", "in 95 %: contact, end", "truth known", "statuses"), rows)


def rendered_facts() -> set[str]:
    """Return how many real runs there are, and that there is a 95 % region."""
    return {"95", str(len(oracle_runs()))}


def real_facts() -> set[str]:
    """Return what is said of single real runs."""
    runs = oracle_runs()
    facts = {f"{run[key]:.0f}" for run in runs for key in (MM, DEG)}
    return facts | {f"{100 * run['scored_frames'] / run['frames']:.0f}" for run in runs} | {"95"}


def _real_knocked() -> list[Row]:
    return _real(oracle_runs(), "file")["MIT, knocked by hand"]


def real_knocks() -> str:
    """Return the table of errors over time after the knocks of real runs."""
    runs = _real_knocked()
    medians = errors_after_knock(runs)
    errors = {after: [mm for run in runs for mm in run["knock_error_mm"][after] if mm is not None] for after in medians}
    rows = [
        ["median error", *(f"{mm:.1f} mm" for mm in medians.values())],
        ["worst", *(f"{max(known):.0f} mm" for known in errors.values())],
        ["knocks with truth then", *(str(len(known)) for known in errors.values())],
    ]
    return table(("after a knock", *(f"{after} s" for after in medians)), rows)


def real_knock_facts() -> set[str]:
    """Return how many knocks of real runs there are, and from how many of them the estimate recovers, and how soon."""
    seconds = [each for run in _real_knocked() for each in run["knock_recovery_s"]]
    taken = [each for each in seconds if each is not None]
    soon = [each for each in taken if each <= REAL_SOON]
    limits = {f"{limit:g}" for limit in (FAR_MM, FAR_DEG, REAL_SOON)}
    return limits | {str(len(each)) for each in (seconds, taken, soon)}


REAL_SOON = 1.5
"""[s] within which a real push should be found again."""


def expected() -> str:
    """Return README's table of what to expect."""
    rendered, oracle = _real(sequences("rendered"), "recording"), _real(oracle_runs(), "file")
    rows = {
        "simulated pushes, with the errors of a real set-up": sequences("systematic"),
        "without them": sequences("plain"),
        "without them, shoved by somebody": sequences("knocked"),
        "real motion (MIT, CMU), touch images rendered": [row for runs in rendered.values() for row in runs],
        "real pushes by a round tip (MIT), yaw from ground truth": oracle["MIT, not knocked"],
        "the same, knocked by hand": oracle["MIT, knocked by hand"],
        "real pushes by two fingers (CMU), yaw from ground truth": oracle["CMU"],
    }
    return table(("", "runs", *SCORES[2:]), [_scored(*row) for row in rows.items()])


def step_times() -> str:
    """Return the table of how long a step takes."""
    names = {
        "learnt": "image in, estimate out, `learnt`",
        "graph": "the graph alone",
        "fixed-lag-450": "the graph with 30 pairs of images a step",
        "bank-16": "16 smoothers at once",
        "isam2-450": "iSAM2 with 30 pairs",
        "reference-450": "the same graph with Python factors in GTSAM",
    }
    cases = {case["name"]: case for case in loaded("benchmarks/baseline.json")["cases"]}
    rows = [
        [told, *(f"{cases[name][key]:.1f} ms" for key in ("median_ms", "p95_ms", "p99_ms"))]
        for name, told in names.items()
    ]
    return table(("a step", "median", "95th percentile", "99th percentile"), rows)


def long_runs() -> str:
    """Return the table of a hundred thousand frames through one tracker."""
    rows = []
    for name, run in loaded("docs/study/long.json").items():
        ends = [f"{run['p50_ms'][k]:.1f} ({run['p95_ms'][k]:.0f}) ms, {run['rss_mb'][k]:.0f} MB" for k in (0, -1)]
        inside = [percent(share) for share in (run["inside_95"][0], fmean(run["inside_95"]), run["inside_95"][-1])]
        doubted = percent(run["statuses"].get("ambiguous", 0) / run["frames"])
        frames = f"{run['frames']:,}".replace(",", " ")
        rows.append([name, frames, str(run["contacts"]), *ends, ", ".join(inside), doubted])
    columns = ("first tenth: step, memory", "last tenth: step, memory", "in 95 %: first tenth, all, last tenth")
    return table(("", "frames", "contacts", *columns, "`ambiguous`"), rows)


def step_facts() -> set[str]:
    """Return the times of a step with `learnt`: median and 95th percentile, and the latter in a shoved sequence."""
    case = next(case for case in loaded("benchmarks/baseline.json")["cases"] if case["name"] == "learnt")
    shoved = median(row["step_ms_p95"] for row in sequences("knocked"))
    return {f"{case['median_ms']:.1f}", f"{case['p95_ms']:.1f}", f"{shoved:.1f}", "95"}


def settings_of(group: str) -> str:
    """Return the table of a factor's settings: name, default and what it is."""
    settings = getattr(NoiseSettings(), group)
    told = field_docs(type(settings))
    rows = [[f"`{name}`", _written(getattr(settings, name)), " ".join(told[name].split())] for name in told]
    return table(("setting", "default", "what"), rows)


def unknowns() -> str:
    """Return the table of the unknowns that last: what they are, in which unit, and what is believed beforehand."""
    rows = [[f"`{one.name}`", one.scope, one.unit, one.meaning, _written(one.prior)] for one in SHARED]
    return table(("unknown", "of", "unit", "what", "prior: mean, standard deviation"), rows)


def _written(value: Any) -> str:
    numbers = value if isinstance(value, tuple) else (value,)
    return ", ".join("none" if number is None else f"{number:g}" for number in numbers)


def faults() -> str:
    """Return the table of the fault bench."""
    rows = read_rows(STUDY / "faults.csv")
    cells = [
        [
            row["fault"],
            *(f"{float(row[key]):.1f}" for key in ("final_mm", "times_clean")),
            *(_whole(row[key]) for key in ("inside_percent", "told_percent", "silent_percent", "refused_percent")),
        ]
        for row in rows
    ]
    columns = ("final error [mm]", "times clean", "in 95 % [%]", "told in 1 s [%]", "silently wrong [%]", "refused [%]")
    return table(("fault", *columns), cells)


def faults_facts() -> set[str]:
    """Return how many runs and rows there are, and how many of these end well, say so or are silently wrong."""
    rows = read_rows(STUDY / "faults.csv")
    broken = [row for row in rows if row["fault"] != "none"]
    others = [row for row in broken if not float(row["times_clean"]) <= WELL]
    told = [row for row in others if float(row["told_percent"]) >= 95.0 and not float(row["inside_percent"]) < 85.0]
    silent = [row for row in rows if float(row["silent_percent"]) > 0.0]
    counts = [sum(int(row["runs"]) for row in rows), len(broken), len(broken) - len(others), len(told), len(others)]
    stated = {"12", "9994", "9995", "95", "85", "20", "10", "15", f"{WELL:g}"}
    return {*stated, *map(str, (*counts, len(silent)))}


WELL = 1.5
"""Times the error without a fault up to which a row ends well."""


def _whole(number: str) -> str:
    return "-" if number == "nan" else f"{float(number):.0f}"


def kills() -> str:
    """Return the table of commands that were killed at random times."""
    columns = ("killed", "went on to the same end", "went on", "neighbours told")
    rows = loaded("docs/study/kills.json")
    return table(
        ("command", *columns, "failed"),
        [[f"`{name}`", *(str(row.get(key, 0)) for key in columns), str(_failed(row))] for name, row in rows.items()],
    )


def _failed(row: Row) -> int:
    return sum(count for key, count in row.items() if key.startswith("FAILED"))


def fuzz() -> str:
    """Return the table of readers on changed files."""
    rows = loaded("docs/study/fuzz.json")
    return table(
        ("reader", "files", "read", "refused", "faults", "most memory", "slowest file"),
        [
            [
                f"`{name}`",
                *(f"{row[key]:,}".replace(",", " ") for key in ("files", "read", "refused", "faults")),
                f"{row['memory_mb']} MB",
                f"{row['slowest_s']:.2f} s",
            ]
            for name, row in rows.items()
        ],
    )


def matrix() -> str:
    """Return the table of versions that the tests were run with."""
    told = ("numpy", "scipy", "numba", "gtsam", "h5py", "onnxruntime")
    rows = [
        [
            name.replace("-direct", ""),
            ", ".join(f"{each} {cell['versions'][each]}" for each in told) if "versions" in cell else "",
            str(cell.get("tests", 0)),
            cell["outcome"],
        ]
        for name, cell in loaded("docs/study/matrix.json").items()
    ]
    return table(("Python, versions", "among them", "tests", "outcome"), rows)


def live_kills() -> set[str]:
    """Return how many live sessions were killed, how many messages they had recorded and how often one was lost."""
    return {f"{count}" for count in loaded("docs/study/kills_live.json").values()}


TABLES: dict[str, Callable[[], str]] = {
    "unknowns": unknowns,
    **{f"settings-of-{group.replace('_', '-')}": partial(settings_of, group) for group in field_docs(NoiseSettings)},
    "systematic": systematic,
    "set-up-errors": set_up_errors,
    "plain": plain,
    "knocked": knocked,
    "draws": draws,
    "ways": ways,
    "paper-system": paper_system,
    "mini": mini,
    "readers": readers,
    "balls": balls,
    "real-motion": real_motion,
    "real-runs": real_runs,
    "real-knocks": real_knocks,
    "two-fingers": two_fingers,
    "expected": expected,
    "step-times": step_times,
    "faults": faults,
    "long-runs": long_runs,
    "kills": kills,
    "fuzz": fuzz,
    "matrix": matrix,
}
"""Blocks that are written by this file."""
FACTS: dict[str, Callable[[], set[str]]] = {
    "limits": limits,
    "knocked-facts": knocked_facts,
    "knocked-silent": knocked_silent,
    "coverage-facts": coverage_facts,
    "systematic-facts": systematic_facts,
    "live-facts": live_facts,
    "faults-facts": faults_facts,
    "live-kills": live_kills,
    "large-facts": large_facts,
    "reader-facts": reader_facts,
    "ball-facts": ball_facts,
    "press-view-facts": press_view_facts,
    "mini-facts": mini_facts,
    "press-facts": press_facts,
    "direction-scale-facts": direction_scale_facts,
    "place-bias-facts": place_bias_facts,
    "press-scale-facts": press_scale_facts,
    "after-shoves-facts": after_shoves_facts,
    "ideal-corner-facts": ideal_corner_facts,
    "slip-facts": slip_facts,
    "reading-facts": reading_facts,
    "begun-facts": begun_facts,
    "unknown-start-facts": unknown_start_facts,
    "half-turn-facts": half_turn_facts,
    "wear-facts": wear_facts,
    "colours-facts": colours_facts,
    "untouched-facts": untouched_facts,
    "real-facts": real_facts,
    "real-knock-facts": real_knock_facts,
    "rendered-facts": rendered_facts,
    "step-facts": step_facts,
}
"""Numbers that may stand in blocks of prose."""
