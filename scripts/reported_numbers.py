"""Tables of results in README and docs, each made from a file of docs/study: `make check-numbers`.

    python scripts/reported_numbers.py            # report every number that its file does not hold
    python scripts/reported_numbers.py --write    # write the tables anew

Between `<!-- numbers: NAME -->` and `<!-- end -->` stands the table TABLES[NAME]. Prose between
`<!-- numbers: from NAME, NAME -->` and `<!-- end -->` has no numbers but those of these tables and of LIMITS.
"""

import csv
import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import fmean, median
from typing import Any

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "docs/*.md", "docs/guide/*.md")
"""Pages whose blocks are checked."""
STRICT = ("README.md", "docs/*.md")
"""Pages in which every number with the unit of a result must stand in a block."""
LIMITS = {"95", "10", "5", "50", "30", "2"}
"""Numbers that define scores: the 95 % region, silently wrong beyond 10 mm or 5°, lost beyond 50 mm or 30°, 2 s."""

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Table:
    """A table of a page."""

    columns: Mapping[str, str]
    """Headings, and the format of a cell, filled from a row."""
    rows: Callable[[], Iterable[Row]]
    """Return the rows, read from files."""

    def __str__(self) -> str:
        lines = [f"| {' | '.join(self.columns)} |", "|" + "---|" * len(self.columns)]
        for row in self.rows():
            cells = [re.sub(r"(?<=\d)%", " %", template.format_map(row)) for template in self.columns.values()]
            lines.append(f"| {' | '.join(re.sub(r'nan%?', '-', cell) for cell in cells)} |")
        return "\n".join(lines)


# Studies: rows from sequences.csv

MM = "final_translation_error_mm"
DEG = "final_rotation_error_deg"
FINAL = {"final error": "{mm:.1f} mm, {deg:.1f}° ({worst_mm:.0f}, {worst_deg:.0f})"}
SCORES = {**FINAL, "in 95 %: contact, end": "{contact:.0%}, {end:.0%}", "silently wrong": "{silent:.1%}"}
OF_OBJECTS = {"objects": "{name}", "sequences": "{count}", **SCORES, "`ambiguous`": "{ambiguous:.0%}"}
SEEN = {
    "disc": "disc",
    "ellipse": "ellipse",
    "rectangle-edges": "rectangle, edges",
    "rectangle-near-corners": "rectangle, near corners",
    "rectangle-corners": "rectangle, true corners",
}
"""Contacts that the touch model was trained on, and their names."""
UNSEEN = "five outlines that the model has not seen"


OUTLINE_POSES = {
    "recordings": "{name}",
    "count": "{recordings}",
    **{
        f"{name} outline": f"{{{key}[rms_mm_median]:.1f}} mm, {{{key}[rms_deg_median]:.1f}}° ({{{key}[in_95]:.0%}})"
        for key, name in (("known", "known"), ("unknown", "unknown"))
    },
    "Gaussian process": "{baseline[rms_mm_median]:.1f} mm, {baseline[rms_deg_median]:.1f}° ({baseline[in_95]:.0%})",
    "sketch": "{sketch[rms_mm_median]:.1f} mm, {sketch[rms_deg_median]:.1f}° ({sketch[in_95]:.0%})",
}
"""Errors of poses with an outline that is known, unknown or a sketch."""
OUTLINE_RECORDINGS = {
    "simulated": "simulated",
    "shoved": "simulated, shoved by something else",
    "MIT": "MIT, real motion",
    "CMU": "CMU, real motion",
}
"""Kinds of recordings that outlines were learnt from."""


def loaded(path: str) -> Any:
    """Return the content of a JSON file of the repository."""
    return json.loads((ROOT / path).read_text(encoding="utf-8"))


def sequences(study: str) -> list[Row]:
    """Return the rows of a reported study, with numbers for texts; None where a cell is empty."""
    words = {"": None, "True": 1.0, "False": 0.0}
    texts = ("recording", "group", "tactile", "smoother", "final_status", "final_reason")
    with (ROOT / f"docs/study/{study}/sequences.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))

    def value(key: str, text: str) -> Any:
        if key in texts:
            return text
        return words[text] if text in words else float(text)

    return [{key: value(key, text) for key, text in row.items()} for row in rows]


def scored(name: str, rows: Sequence[Row]) -> Row:
    """Return the scores of runs: medians and worst of final errors, means of shares."""

    def known(key: str) -> list[float]:
        return [row[key] for row in rows if row.get(key) is not None]

    def mean(key: str) -> float:
        return fmean(known(key) or [float("nan")])

    return {
        "name": name,
        "count": len(rows),
        "mm": median(known(MM)),
        "deg": median(known(DEG)),
        "worst_mm": max(known(MM)),
        "worst_deg": max(known(DEG)),
        "contact": mean("in_95_contact_share"),
        "end": mean("in_95_final"),
        "silent": mean("silently_wrong_share"),
        "ambiguous": mean("ambiguous_share"),
        "nees": f"{median(known('nees_mean')):.1f}, {mean('nees_mean'):.1f}",
        "lost": f"{sum(known('lost')):.0f}",
    }


def by_contact(study: str) -> Iterator[Row]:
    """Yield a row for each contact that the model was trained on, for the outlines it has not seen, and for all."""
    rows = sequences(study)
    for group, name in SEEN.items():
        yield scored(name, [row for row in rows if row["group"] == group])
    yield scored(UNSEEN, [row for row in rows if row["group"] not in SEEN])
    yield scored("all", rows)


def by_object(study: str) -> Iterator[Row]:
    """Yield a row for each object, and for all."""
    rows = sequences(study)
    for name in dict.fromkeys(row["group"].partition("-")[0] for row in rows):
        yield scored(name, [row for row in rows if row["group"].partition("-")[0] == name])
    yield scored("all", rows)


def ways() -> Iterator[Row]:
    """Yield a row for each way of touch."""
    rows = sequences("ways")
    for way in ("none", "learnt", "oracle"):
        yield scored(f"`{way}`", [row for row in rows if row["tactile"] == way])


# Real recordings


def oracle_runs() -> list[Row]:
    """Return the runs on real recordings with touch from ground truth."""
    return [{**run, "recording": Path(run["file"]).name} for run in loaded("docs/study/real.json")["runs"]]


def by_source(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return runs on real motion by their source."""
    cmu = [row for row in rows if row["recording"].startswith("bigrect")]
    mit = [row for row in rows if row not in cmu]
    knocked = {row["recording"].split(".")[0] for row in oracle_runs() if row["knocks"]}
    return {
        "MIT, not knocked": [row for row in mit if row["recording"].split(".")[0] not in knocked],
        "MIT, knocked by hand": [row for row in mit if row["recording"].split(".")[0] in knocked],
        "CMU": cmu,
    }


def real_motion() -> Iterator[Row]:
    """Yield a row for each source of real motion and kind of touch."""
    for touch, rows in (("rendered touch", sequences("rendered")), ("true relative yaw", oracle_runs())):
        for source, runs in by_source(rows).items():
            yield scored(f"{source}; {touch}", runs)
    ways = {"learnt": "rendered touch of both fingers", "none": "the same fingers without images"}
    for way, name in ways.items():
        row = loaded("docs/study/hand_replays.json")[way]
        yield {
            "name": f"CMU; {name}",
            "count": row["recordings"],
            "mm": row["final_mm_median"],
            "deg": row["final_deg_median"],
            "worst_mm": row["final_mm_worst"],
            "worst_deg": row["final_deg_worst"],
            "contact": row["inside_contact_mean"],
            "end": row["inside_final_mean"],
            "silent": row["silent_mean"],
        }


def real_runs() -> Iterator[Row]:
    """Yield a row for each real MIT run."""
    for run in oracle_runs():
        if not run["recording"].startswith("bigrect"):
            after = ["?" if error is None else f"{error:.0f}" for error in run["mm_after_knocks"]]
            yield {
                **run,
                "after": f"{', '.join(after)} mm" if after else "-",
                "name": run["recording"].removesuffix(".json.gz"),
                "end": "in" if run["in_95_final"] else "out",
                "known": run["scored_frames"] / run["frames"],
                "said": ", ".join(f"{status} {count}" for status, count in run["statuses"].items()),
            }


def expected() -> Iterator[Row]:
    """Yield the rows of README's table."""
    yield scored("simulated pushes, with the errors of a real set-up", sequences("systematic"))
    yield scored("without them", sequences("plain"))
    yield scored("without them, shoved by somebody", sequences("knocked"))
    yield scored("real motion (MIT, CMU), touch images rendered", sequences("rendered"))
    oracle = by_source(oracle_runs())
    yield scored("real pushes by a round tip (MIT), yaw from ground truth", oracle["MIT, not knocked"])
    yield scored("the same, knocked by hand", oracle["MIT, knocked by hand"])
    yield scored("real pushes by two fingers (CMU), yaw from ground truth", oracle["CMU"])


# Tables of one file


def of_json(path: str, names: Mapping[str, str], *within: str) -> Callable[[], Iterator[Row]]:
    """Return the rows of a JSON file: by keys, and the names they have in the table, inside of keys `within`."""

    def rows() -> Iterator[Row]:
        content = loaded(path)
        for key in within:
            content = content[key]
        for key, name in names.items():
            if key in content:
                yield {"name": name, **content[key]}

    return rows


def disturbance_rates() -> Iterator[Row]:
    """Return the rows of docs/study/disturbance_rate.json: each rate of each kind of recordings."""
    for kind, rates in loaded("docs/study/disturbance_rate.json")["kinds"].items():
        for rate, scores in rates.items():
            yield {"kind": kind, "rate": rate, **scores}


def of_units(part: str, names: Mapping[str, str], cell: str) -> Callable[[], Iterator[Row]]:
    """Return rows of docs/study/units.json: a unit, or units together, and a cell for each count of presses."""

    def rows() -> Iterator[Row]:
        content = loaded("docs/study/units.json")[part]
        for key, name in names.items():
            cells = {
                f"after_{count}": "refused"
                if "refused" in found and "n" not in found and "units" not in found
                else cell.format_map(found)
                for count, found in content[key].items()
            }
            yield {"name": name, **cells}

    return rows


def tails() -> Iterator[Row]:
    """Yield a row for each study that two versions were compared on."""
    names = {"systematic": "with errors of a set-up", "plain": "without", "knocked": "with shoves", "mini": "of a Mini"}
    for study, row in loaded("docs/study/tails.json").items():
        yield {**row, "name": names[study], "rmse": row["new less old"]["rmse_mm"]}


def step_times() -> Iterator[Row]:
    """Yield a row for each case of the benchmark of steps."""
    names = {
        "one-answer": "image in, estimate out, one hypothesis",
        "eight-answers": "the same with two to nine hypotheses",
        "more-answers": "the same with up to forty",
        "from-jpeg": "the same from JPEG on",
        "rest": "the object rests",
        "graph": "the graph alone",
        "gtsam-native": "a plain window in GTSAM, factors in C++",
        "reference": "the paper's graph in iSAM2, factors in Python",
    }
    cases = loaded("benchmarks/baseline.json")["cases"]
    yield from ({**case, "name": names[case["name"]]} for case in cases if case["name"] in names)


def speed() -> Iterator[Row]:
    """Yield a row for each number of a version beside that of another one."""
    names = {
        "one-answer_p50_ms": "one hypothesis, in contact [ms]",
        "one-answer_p99_ms": "the same, 99th percentile [ms]",
        "rest_p50_ms": "the object rests [ms]",
        "rest_p99_ms": "the same, 99th percentile [ms]",
        "eight-answers_p50_ms": "several hypotheses [ms]",
        "eight-answers_p99_ms": "the same, 99th percentile [ms]",
        "answers_in_eight": "their mean number",
        "graph_p50_ms": "the graph alone, without images [ms]",
        "first-image_mb": "memory at the first image [MB]",
        "start_s": "start to the first estimate [s]",
        "first-ever-start_s": "the same, before anything is compiled [s]",
        "two-threads": "speed of two trackers in two threads [of one]",
        "two-processes": "the same in two processes",
    }
    content = loaded("docs/study/speed.json")
    found = {row["name"]: row for row in (*content["cases"], *content["more_rounds"])}
    yield from ({**found[key], "name": name} for key, name in names.items() if key in found)


def long_runs() -> Iterator[Row]:
    """Yield a row for each run of a hundred thousand frames."""
    for name, run in loaded("docs/study/long.json").items():
        ends = [f"{run['p50_ms'][k]:.1f} ({run['p95_ms'][k]:.0f}) ms, {run['rss_mb'][k]:.0f} MB" for k in (0, -1)]
        yield {**run, "name": name, "first": ends[0], "last": ends[1], "inside": fmean(run["inside_95"])}


def paper_losses() -> list[Row]:
    """Return Table II of `palpate paper`, thousandths, with the published values in brackets where there are any."""
    found = loaded("docs/study/paper.json")
    rows: list[Row] = []
    for model, losses in found["table2"].items():
        published = found["published_table2"].get(model)
        shown = {name: f"{1e3 * loss:.2f}" for name, loss in losses.items()}
        if published:
            shown = {name: f"{loss} ({1e3 * published[name]:.1f})" for name, loss in shown.items()}
        rows.append({"model": model, **shown})
    return rows


def paper_pushes() -> list[Row]:
    """Return the loss of a constant over all pushes of `palpate paper`, thousandths, beside the published one."""
    found = loaded("docs/study/paper.json")
    rows: list[Row] = []
    for name, row in found["pushes"].items():
        published = found["published_table2"]["const"][name]
        thousandths = {key: 1e3 * row[key] for key in ("const", "low", "high")}
        rows.append({**thousandths, "object": name, "sequences": row["sequences"], "published": 1e3 * published})
    return rows


def paper_tracking() -> list[Row]:
    """Return the final errors of `palpate paper` by object and kind of touch, medians with 95 % intervals."""
    rows: list[Row] = []
    for name, by_mode in loaded("docs/study/paper.json")["tracking"].items():
        for mode, row in by_mode.items():
            cells = {unit: "{median:.1f} [{low:.1f}, {high:.1f}]".format(**row[unit]) for unit in ("mm", "deg")}
            rows.append({**row, **cells, "touch": mode, "object": name})
    return rows


def paper_order() -> list[Row]:
    """Return the share of bootstrap draws in which the rectangle's medians stand in the paper's order."""
    return [loaded("docs/study/paper.json")["order"]["rect"]["in order"]]


def paper_constant() -> list[Row]:
    """Return the loss of a constant over pushes without images, thousandths, by object and seed."""
    found = loaded("docs/study/paper_pushes.json")["constant"]
    return [{**row, "object": name, "mean": fmean(row["seeds"])} for name, row in found.items()]


def paper_without_images() -> list[Row]:
    """Return final errors and the turning that is followed, by setting of the rectangle's pushes."""
    return loaded("docs/study/paper_pushes.json")["tracked"]


OF_PUSHES = {
    "pushes": "{pushes}",
    "within 3 mm at the end": "{within_3_mm}",
    "final error, median (worst)": "{final_mm_median:.1f} mm ({final_mm_worst:.0f})",
    "in 95 %: contact, end": "{in_95_contact:.0%}, {in_95_final:.0%}",
    "silently wrong": "{silent:.1%}",
}

TABLES: dict[str, Table] = {
    "install": Table(
        {"packages": "{packages}", "size": "{megabytes:.0f} MB", "purpose": "{purpose}"},
        lambda: loaded("docs/study/install.json"),
    ),
    "paper": Table(
        {"model": "{model}", **{name: f"{{{name}}}" for name in ("disc", "rect", "ellip", "combined")}}, paper_losses
    ),
    "paper-pushes": Table(
        {
            "object": "{object}",
            "const": "{const:.1f} [{low:.1f}, {high:.1f}]",
            "published": "{published:.1f}",
            "sequences": "{sequences}",
        },
        paper_pushes,
    ),
    "paper-tracking": Table(
        {
            "object": "{object}",
            "touch": "{touch}",
            "final error [mm]": "{mm}",
            "final error [deg]": "{deg}",
            "lost": "{lost} of {sequences}",
            "in 95 %": "{in_95_share:.0%}",
        },
        paper_tracking,
    ),
    "paper-constant": Table(
        {
            "object": "{object}",
            "mean of seeds": "{mean:.1f}",
            "seeds 1, 2, 3": "{seeds[0]:.1f}, {seeds[1]:.1f}, {seeds[2]:.1f}",
            "published": "{published:.1f}",
        },
        paper_constant,
    ),
    "paper-without-images": Table(
        {
            "pushes": "{pushes}",
            "number, seed": "{count}, {seed}",
            "turning [deg]": "{turn_deg:.1f}",
            **{f"{mode} [mm, deg]": f"{{{mode}[0]:.0f}}, {{{mode}[1]:.1f}}" for mode in ("none", "const", "oracle")},
            "turn followed: none, const": "{followed[0]:.2f}, {followed[1]:.2f}",
            "none > const: mm, deg": "{share[0]:.0%}, {share[1]:.0%}",
        },
        paper_without_images,
    ),
    "paper-order": Table({"in order, translation": "{mm:.0%}", "rotation": "{deg:.0%}"}, paper_order),
    "expected": Table({"": "{name}", "runs": "{count}", **SCORES}, expected),
    **{
        name: Table({**OF_OBJECTS, "NEES": "{nees}"}, lambda name=name: by_contact(name))
        for name in ("systematic", "plain")
    },
    "knocked": Table(
        {
            **OF_OBJECTS,
            "lost": "{lost}",
        },
        partial(by_object, "knocked"),
    ),
    "tails": Table(
        {
            "recordings": "{recordings} {name}",
            "RMSE before, now": "{old[rmse_mm]:.1f}, {new[rmse_mm]:.1f} mm",
            "of each, paired": "{rmse[mean]:+.2f} ± {rmse[standard_error]:.2f} mm",
            "lost": "{old[lost]}, {new[lost]}",
            "`ambiguous`": "{old[ambiguous]:.1%}, {new[ambiguous]:.1%}",
            "in 95 %, in contact": "{old[inside_contact]:.1%}, {new[inside_contact]:.1%}",
            "silently wrong": "{old[silent]:.1%}, {new[silent]:.1%}",
            "nats": "{old[nats_median]:.1f}, {new[nats_median]:.1f}",
        },
        tails,
    ),
    "speed": Table({"": "{name}", "before": "{old:.2f}", "now": "{new:.2f}", "ratio": "{ratio:.2f}"}, speed),
    "recent_steps": Table(
        {
            "recordings": "{recordings} {name}",
            "RMSE before, now": "{rmse_mm[before]:.2f}, {rmse_mm[now]:.2f} mm",
            "of each, paired": "{rmse_mm[difference]:+.2f} ± {rmse_mm[standard_error]:.2f} mm",
            "in 95 %, in contact": "{inside[before]:.1f}, {inside[now]:.1f} %",
            "of each, paired ": "{inside[difference]:+.2f} ± {inside[standard_error]:.2f} %",
            "`ambiguous`": "{ambiguous[before]:.1f}, {ambiguous[now]:.1f} %",
            "silently wrong": "{silent[before]:.1f}, {silent[now]:.1f} %",
            "lost": "{lost[before]}, {lost[now]}",
        },
        of_json(
            "docs/study/recent_steps.json",
            {"setup": "with errors of the set-up", "knocked": "shoved"},
            "runs",
        ),
    ),
    "recent_limits": Table(
        {
            "all are linearised again from": "{name}",
            "steps linearised, one hypothesis": "{linearised[one]:.2f}",
            "several": "{linearised[several]:.2f}",
            "BigPertubations": "{inside[BigPertubations]:.0f} %",
            "nudged, eight runs": "{nudged}",
            "DoublesBigPerturbations": "{inside[DoublesBigPerturbations]:.0f} %",
        },
        of_json(
            "docs/study/recent_steps.json",
            {"0": "any change", "2e-4": "0.2 mm or mrad", "5e-4": "0.5 mm or mrad, as now", "2e-3": "2 mm or mrad"},
            "limits",
        ),
    ),
    "rim": Table(
        {
            "contact": "{name}",
            "RMSE": "{rmse_mm:.1f} mm",
            "final error": "{final_median_mm:.1f} mm",
            "frames missed, false": "{missed_share:.1%}, {false_share:.1%}",
        },
        of_json("docs/study/rim.json", {"contact seen": "from images", "contact told": "given in each frame"}),
    ),
    "turned_frames": Table(
        {
            "turn": "{name}",
            "named rightly": "{right}",
            "asked about": "{asked}",
            "wrong advice": "{wrong}",
            "silent": "{silent}",
        },
        of_json(
            "docs/study/turned_frames.json",
            {"0": "none", "20": "20 degrees", "45": "45 degrees", "180": "half a turn"},
        ),
    ),
    "marks": Table(
        {
            "gel": "{name}",
            "RMSE": "{rmse_mm:.1f} mm",
            "final error": "{final_median_mm:.1f} mm",
            "lost": "{lost}",
            "false frames of contact": "{false_contact_frames}",
            "directions more than 8° wrong that claim 10° or less": "{wrong_direction_share:.2%}",
        },
        of_json("docs/study/marks.json", {"without": "without a mark", "with": "with a mark in or before a contact"}),
    ),
    "ways": Table({"touch": "{name}", "sequences": "{count}", **SCORES, "lost": "{lost}"}, ways),
    "mini": Table({"objects": "{name}", "sequences": "{count}", **SCORES}, partial(by_object, "gelsight_mini")),
    "real-motion": Table({"motion; touch": "{name}", "runs": "{count}", **SCORES}, real_motion),
    "real-runs": Table(
        {
            "run": "{name}",
            "knocks": "{knocks}",
            "a second after each": "{after}",
            "final error": f"{{{MM}:.1f}} mm, {{{DEG}:.1f}}°",
            "in 95 %: contact, end": "{in_95_contact_share:.0%}, {end}",
            "truth known": "{known:.0%}",
            "statuses": "{said}",
        },
        real_runs,
    ),
    "near-ties": Table(
        {
            "MIT's pushes; expected slide": "{name}",
            "runs": "{runs}",
            "final error": "{final_median_mm:.1f} mm ({final_worst_mm:.0f})",
            "lost": "{lost}",
            "within 10 mm a second after a knock": "{found} of {knocks}",
            "in 95 %, in contact": "{inside_contact:.1%}",
            "silently wrong": "{silent:.1%}",
        },
        of_json(
            "docs/study/near_ties.json",
            {
                f"{kind}, {share}": f"{kind}; {share}"
                for kind in ("not knocked", "knocked by hand")
                for share in ("0.0", "0.15")
            },
            "rows",
        ),
    ),
    "set-up-errors": Table(
        {
            "error": "{name}",
            "mean error in contact": "{contact_mm:.1f} mm",
            "final error": "{final_mm:.1f} mm, {final_deg:.1f}°",
            "in 95 %: contact, end": "{contact_inside_95:.0%}, {final_inside_95:.0%}",
        },
        of_json(
            "docs/study/set_up_errors.json",
            {name: name for name in ("none", "mounting", "outline")}
            | {"late": "late images", "first_pose": "first pose", "all": "all four"}
            | {"outline, taken for exact": "outline, taken for exact"}
            | {"all, outline taken for exact": "all four, outline taken for exact"},
            "cases",
        ),
    ),
    "outline-attempt": Table(
        {
            "outline": "{name}",
            "explorations": "{explorations}",
            "pose error": "{mm:.1f} mm, {deg:.1f}°",
            "in 95 %": "{in_95:.0%}",
            "touched points": "{touched}",
        },
        of_json(
            "docs/study/outline_attempt.json",
            {
                "known_7": "known",
                "mean_5": "5 mm about the true one",
                "mean_20": "20 mm about the true one",
                "mean_20_exact": "the same, directions without error",
                "sketch": "5 mm about a sketch that is 5 mm off",
                "sketch_20": "the same, directions count a quarter",
                "wrong": "that sketch, taken as known",
            },
            "tuning",
        ),
    ),
    "outline-batch": Table(
        {
            "outline": "{name}",
            "explorations": "{explorations}",
            "pose error": "{mm:.1f} mm, {deg:.1f}°",
            "in 95 %": "{in_95:.0%}",
        },
        of_json(
            "docs/study/outline_attempt.json",
            {
                "known": "known, the tracker",
                "whole": "unknown, as a whole",
                "from_truth": "the same, started at the true path",
                "by_contact": "unknown, contact by contact, five of them",
                "whole_5": "as a whole, the same five",
                "form": "form known to a fifth of the prior, the same five",
                "first_known": "known, first contact alone",
                "first_batch": "unknown, first contact alone",
            },
            "batch",
        ),
    ),
    "outline-tuning": Table(
        {
            "rows": "{name}",
            "explorations": "{explorations}",
            "pose error": "{mm:.1f} mm, {deg:.1f}°",
            "in 95 %": "{in_95:.0%}",
        },
        of_json(
            "docs/study/outline_attempt.json",
            {
                "redrawn": "drawn anew by their weights",
                "kept": "not drawn anew",
                "none_straight": "not drawn anew, none expects straight sides",
                "all_straight": "all expect them",
                "half_straight": "half expect them",
                "three": "the same, three observations count as one",
                "six": "six observations count as one",
            },
            "third",
        ),
    ),
    "outline-base": Table(
        {
            "curve": "{name}",
            "pose error": "{mm:.1f} mm, {deg:.1f}°",
            "in 95 %": "{in_95:.0%}",
            "T alone": "{t_mm:.1f} mm ({t_in_95:.0%})",
            "in the band": "{band:.0%}",
        },
        of_json(
            "docs/study/outline_attempt.json",
            {
                "unknown_before": "unknown, as rough as polygons",
                "unknown_arms": "unknown, twice as rough; the band holds the set-up's error",
                "sketch_before": "sketch, drawn by harmonics, which also are its error, by their order",
                "sketch_bends": "the same, its error alike up to the fourth harmonic",
                "sketch_exact": "drawn exactly; the band holds the set-up's error",
            },
            "base",
        ),
    ),
    "outline-causes": Table(
        {
            "unknown outline": "{name}",
            "explorations": "{explorations}",
            "pose error": "{mm:.1f} mm, {deg:.1f}°",
            "of each, paired": "{change}",
            "touched points": "{touched_mm:.1f} mm",
        },
        of_json(
            "docs/study/outline_attempt.json",
            {
                "now": "as it is",
                "directions": "directions of touch without error",
                "motion": "true motion of the object",
                "friction": "friction known: its radius, centre and grip",
                "friction_unchanging": "the same, alike in all contacts",
                "center": "centre of friction known",
                "grip": "grip known",
                "steps": "tried: the object moves in steps of 2 mm, not with each frame",
                "together": "tried: the same, and a prior in which centre of friction and curve move together",
                "together_sharp": "tried: the same, three observations count as one",
                "together_frames": "tried: that prior alone",
                "harmonics": "tried: 48 harmonics, T alone",
            },
            "causes",
        ),
    ),
    "disturbance-rate": Table(
        {
            "recordings": "{kind}",
            "rate [1/s]": "{rate}",
            "error": "{rms_mm_median:.1f} mm",
            "mean error, paired with the default": "{change_mm[mean]:+.1f} ± {change_mm[standard_error]:.1f} mm",
            "in 95 %, in contact": "{in_95:.0%}",
            "sure, in contact": "{sure_share:.0%}",
            "`ambiguous`": "{ambiguous_share:.0%}",
        },
        disturbance_rates,
    ),
    "outline-image-causes": Table(
        {
            "sensor": "{name}",
            "explorations": "{explorations}",
            "directions of images": "{images}",
            "drawn directions": "{drawn}",
            "of each, paired": "{change}",
        },
        of_json(
            "docs/study/outline_attempt.json",
            {"digit": "DIGIT", "mini": "GelSight Mini, a flat pad"},
            "image_causes",
        ),
    ),
    "outline-small-tips": Table(
        {
            "a tip of 5 mm, the curve is": "{name}",
            "explorations": "{explorations}",
            "unknown outline, median, mean": "{mm:.1f} mm, {mean_mm:.1f} mm",
            "in 95 %": "{in_95:.0%}",
            "sketch": "{sketch_mm:.1f} mm ({sketch_in_95:.0%})",
        },
        of_json(
            "docs/study/outline_attempt.json",
            {"own": "that of its centre", "cm2": "2 cm outside of the outline"},
            "small_tips",
        ),
    ),
    "outline-sixty": Table(
        {
            "unknown outline": "{name}",
            "explorations": "{explorations}",
            "pose error": "{mm:.1f} mm, {deg:.1f}°",
            "in 95 %": "{in_95:.0%}",
            "in the band": "{band:.0%}",
        },
        of_json(
            "docs/study/outline_attempt.json",
            {
                "before": "before these changes",
                "none": "with them",
                "smooth": "the same, as rough as polygons",
                "shoves": "with them, and shoves looked for, too",
            },
            "sixty",
        ),
    ),
    "outline-shoves": Table(
        {
            "a side that is met elsewhere counts as": "{name}",
            "explorations": "{explorations}",
            "pose error": "{mm:.1f} mm, {deg:.1f}°",
            "in 95 %": "{in_95:.0%}",
            "in the band": "{band:.0%}",
        },
        of_json(
            "docs/study/outline_attempt.json",
            {
                "unknown_form": "another form; unknown outline, shoved",
                "unknown_shove": "a shove; unknown outline, shoved",
                "sketch_form": "another form; sketch, shoved",
                "sketch_shove": "a shove; sketch, shoved",
                "unknown_base_form": "another form; unknown outline, nothing shoves",
                "unknown_base_shove": "a shove; unknown outline, nothing shoves",
            },
            "shoves",
        ),
    ),
    "outline-hypotheses": Table(
        {
            "shoves": "{name}",
            "nothing shoves, paired": "{nothing_shoves[rms_mm][difference]:+.1f} ± "
            "{nothing_shoves[rms_mm][standard_error]:.1f} mm, {nothing_shoves[rms_deg][difference]:+.1f} ± "
            "{nothing_shoves[rms_deg][standard_error]:.1f}°",
            "in 95 %": "{nothing_shoves[in_95][now]:.0f} %",
            "shoved": "{shoved[rms_mm][before]:.1f}, {shoved[rms_mm][now]:.1f} mm",
            "paired": "{shoved[rms_mm][difference]:+.1f} ± {shoved[rms_mm][standard_error]:.1f} mm",
            "in 95 %, before and now": "{shoved[in_95][before]:.0f}, {shoved[in_95][now]:.0f} %",
        },
        of_json(
            "docs/study/outline_hypotheses.json",
            {
                "six": "unknown outline, prior 5 %, one Gaussian a copy, six observations as one in all weights",
                "six_two": "the same, two as one in a family",
                "twelve_two": "prior 2 %, twelve as one in weights of families, two in a family",
                "rising": "prior 5 %, rising with the shoves of a row",
                "surprises": "the same, copies at large innovations as well",
                "between_5": "prior 5 %, half of the variance between the copies",
                "between_2": "the same, prior 2 %, as it is",
                "alone": "none, but twelve as one in all weights",
                "sketch_rising": "sketch, prior 5 %, rising with the shoves of a row",
                "sketch_surprises": "the same, copies at large innovations as well",
                "sketch_between_2": "prior 2 %, half of the variance between the copies, as it is",
            },
            "tuning",
        ),
    ),
    "outline-hypotheses-fresh": Table(
        {
            "recordings": "{name}",
            "count": "{recordings}",
            "pose error before, now": "{rms_mm[before]:.1f}, {rms_mm[now]:.1f} mm",
            "of each, paired": "{rms_mm[difference]:+.1f} ± {rms_mm[standard_error]:.1f} mm",
            "yaw, paired": "{rms_deg[difference]:+.1f} ± {rms_deg[standard_error]:.1f}°",
            "in 95 %, before and now": "{in_95[before]:.0f}, {in_95[now]:.0f} %",
            "in the band, before and now": "{all_in_95[before]:.0f}, {all_in_95[now]:.0f} %",
        },
        of_json(
            "docs/study/outline_hypotheses.json",
            {
                "unknown": "unknown outline, nothing shoves",
                "unknown_shoved": "unknown outline, shoved",
                "sketch": "sketch, nothing shoves",
                "sketch_shoved": "sketch, shoved",
                "mit": "MIT, unknown outline",
                "cmu_shoves": "CMU, unknown outline, with such copies",
                "cmu": "CMU, unknown outline, as it is: without, as touch measures contact alone",
            },
            "fresh",
        ),
    ),
    "outline-within": Table(
        {
            "a shove within a contact": "{name}",
            "recordings": "{recordings}",
            "pose error as it is, with it": "{rms_mm[before]:.1f}, {rms_mm[now]:.1f} mm",
            "of each, paired": "{rms_mm[difference]:+.1f} ± {rms_mm[standard_error]:.1f} mm",
            "yaw, paired": "{rms_deg[difference]:+.1f} ± {rms_deg[standard_error]:.1f}°",
            "in 95 %, paired": "{in_95[difference]:+.1f} ± {in_95[standard_error]:.1f} %",
            "in the band, paired": "{all_in_95[difference]:+.1f} ± {all_in_95[standard_error]:.1f} %",
        },
        of_json(
            "docs/study/outline_attempt.json",
            {
                f"{key}_{data}": f"{name}; {of_data}"
                for key, name in {
                    "copies": "copies at each observation, prior 0.5 %",
                    "copies_2": "the same, prior 2 %",
                    "mixture_beside_limit": "a mixture within each row, beside the limit of innovations",
                    "mixture_02": "a mixture within each row, prior 0.2 %",
                    "mixture": "prior 1 %",
                    "mixture_half": "prior 1 %, half as far",
                    "mixture_3": "prior 3 %",
                    "mixture_10": "prior 10 %",
                    "mixture_within": "prior 1 %, not at a contact's first observation",
                    "rule": "the rule of before, besides the copies",
                    "rule_alone": "that rule alone",
                }.items()
                for data, of_data in {
                    "mit_sketch": "MIT, sketch",
                    "mit_unknown": "MIT, unknown",
                    "shoved_sketch": "shoved, sketch",
                    "shoved_unknown": "shoved, unknown",
                    "sketch": "nothing shoves, sketch",
                    "unknown": "nothing shoves, unknown",
                }.items()
            },
            "within",
        ),
    ),
    "outline-study": Table(
        OUTLINE_POSES,
        of_json(
            "docs/study/unknown_outline.json",
            OUTLINE_RECORDINGS,
            "together",
        ),
    ),
    "outline-before": Table(
        {
            "outline": "{name}",
            "recordings": "{recordings}",
            "pose error before, now": "{rms_mm[before]:.1f}, {rms_mm[now]:.1f} mm",
            "of each, paired": "{rms_mm[difference]:+.1f} ± {rms_mm[standard_error]:.1f} mm",
            "yaw, paired": "{rms_deg[difference]:+.1f} ± {rms_deg[standard_error]:.1f}°",
            "in 95 %, paired": "{in_95[difference]:+.1f} ± {in_95[standard_error]:.1f} %",
            "in the band, paired": "{all_in_95[difference]:+.1f} ± {all_in_95[standard_error]:.1f} %",
        },
        of_json(
            "docs/study/unknown_outline_before.json",
            {
                "simulated_unknown": "unknown",
                "simulated_sketch": "sketch",
                "shoved_unknown": "unknown, shoved by something else",
                "shoved_sketch": "sketch, shoved by something else",
                "mit_unknown": "unknown, MIT's real motion",
                "mit_sketch": "sketch, MIT's real motion",
                "cmu_unknown": "unknown, CMU's real motion",
                "cmu_sketch": "sketch, CMU's real motion",
                "images": "unknown, with images of a DIGIT",
                "images_flat": "unknown, with images of a GelSight Mini",
            },
            "runs",
        ),
    ),
    "outline-study-forms": Table(
        OUTLINE_POSES,
        of_json(
            "docs/study/unknown_outline.json",
            {
                "triangle": "triangle",
                "hexagon": "hexagon",
                "rounded-square": "rounded square",
                "t": "T",
                "butterfly": "butterfly",
            },
            "by_outline",
        ),
    ),
    "outline-images": Table(
        {
            "sensor": "{name}",
            "count": "{recordings}",
            "known outline": "{known[rms_mm_median]:.1f} mm, {known[rms_deg_median]:.1f}° ({known[in_95]:.0%})",
            "unknown outline": "{unknown[rms_mm_median]:.1f} mm, {unknown[rms_deg_median]:.1f}° ({unknown[in_95]:.0%})",
            "touched points": "{unknown[touched_rms_mm_median]:.1f} mm",
            "in the band": "{unknown[touched_in_95]:.0%}",
            "all points in it": "{unknown[all_in_95]:.0%}",
        },
        of_json(
            "docs/study/unknown_images.json",
            {"DIGIT": "DIGIT", "GelSight Mini": "GelSight Mini, a flat pad"},
            "together",
        ),
    ),
    "outline-pads": Table(
        {
            "touch": "{name}",
            "explorations": "{recordings}",
            "pose error": "{mm:.1f} mm, {deg:.1f}°",
            "in 95 %": "{in_95:.0%}",
        },
        of_json(
            "docs/study/outline_pads.json",
            {
                "none": "flat pad, contact alone",
                "places_normal": "places, touched along the normal where they are on the flat",
                "places": "places, corners and sides that lean",
                "near": "the same with directions, the curve not farther outside",
                "both": "the same, farther outside by 20 mm",
                "round_single": "round tip, variances as of one frame",
                "round": "round tip, variances of all frames since the last observation",
            },
            "pads",
        ),
    ),
    "outline-sizes": Table(
        {
            "sizes that are stated": "{name}",
            "files": "{recordings}",
            "the band holds": "{least:.0%} to {largest:.0%}",
        },
        of_json(
            "docs/study/outline_pads.json",
            {
                "mean_default": "50 to 200 mm, by default; origin half the mean size behind the contact",
                "mean_near": "30 to 100 mm; the same",
                "default": "50 to 200 mm; half the least size",
                "near": "30 to 100 mm; the same, as it is",
            },
            "sizes",
        ),
    ),
    "outline-study-bands": Table(
        {
            "recordings": "{name}",
            "touched points": "{unknown[touched_rms_mm_median]:.1f} mm",
            "in the band": "{unknown[touched_in_95]:.0%}",
            "all points in it": "{unknown[all_in_95]:.0%}",
            "Gaussian process, touched points": "{baseline[touched_rms_mm_median]:.1f} mm",
            "Gaussian process, in the band": "{baseline[touched_in_95]:.0%}",
            "Gaussian process, all points": "{baseline[all_in_95]:.0%}",
            "sketch, touched points": "{sketch[touched_rms_mm_median]:.1f} mm",
            "sketch, in the band": "{sketch[touched_in_95]:.0%}",
            "sketch, all points": "{sketch[all_in_95]:.0%}",
        },
        of_json(
            "docs/study/unknown_outline.json",
            OUTLINE_RECORDINGS,
            "together",
        ),
    ),
    "outline-study-clicked": Table(
        {
            "outline": "{name}",
            "touched points": "{touched_rms_mm_median:.1f} mm",
            "in the band": "{touched_in_95:.0%}",
            "all points": "{all_rms_mm_median:.1f} mm",
            "all points in it": "{all_in_95:.0%}",
        },
        of_json(
            "docs/study/unknown_outline.json",
            {"unknown": "palpate", "baseline": "Gaussian process"},
            "clicked",
            "together",
        ),
    ),
    "two-fingers": Table(
        {
            "touch": "{name}",
            "final error": "{final_mm_median:.1f} mm, {final_deg_median:.1f}° ({final_mm_worst:.0f} mm)",
            "in 95 %: contact, end": "{inside_contact_mean:.0%}, {inside_final_mean:.0%}",
            "silently wrong": "{silent_mean:.1%}",
        },
        of_json("docs/study/two_fingers.json", {"oracle": "true relative yaw", "none": "none"}, "touch"),
    ),
    "fingers": Table(
        {
            "pushes": "{name}",
            "recordings": "{recordings}",
            "final error": "{final_mm_median:.1f} mm, {final_deg_median:.1f}° ({final_mm_worst:.0f} mm)",
            "lost": "{lost}",
            "in 95 %: contact, end": "{inside_contact_mean:.0%}, {inside_final_mean:.0%}",
            "`ambiguous`": "{ambiguous_mean:.1%}",
            "`uncertain`": "{uncertain_mean:.0%}",
        },
        of_json(
            "docs/study/fingers.json",
            {"ideal": "ideal", "set_up": "with errors of a set-up", "pinch": "pinches, with errors of a set-up"},
        ),
    ),
    "finger-mounts": Table(
        {
            "recordings": "{name}",
            "number": "{recordings}",
            "final error": "{before[final_mm_median]:.1f}, {now[final_mm_median]:.1f} mm",
            "of yaw": "{before[final_deg_median]:.1f}, {now[final_deg_median]:.1f}°",
            "in 95 %, in contact": "{before[inside_contact_mean]:.1%}, {now[inside_contact_mean]:.1%}",
            "at the end": "{before[inside_final_mean]:.0%}, {now[inside_final_mean]:.0%}",
            "`ambiguous`": "{before[ambiguous_mean]:.0%}, {now[ambiguous_mean]:.0%}",
            "lost": "{before[lost]}, {now[lost]}",
        },
        of_json(
            "docs/study/finger_mounts.json",
            {"set_up": "pushes with errors of a set-up", "pinch": "pinches with errors of a set-up"},
        ),
    ),
    "fingers-unknown": Table(
        {"recordings": "{recordings}", "found": "{found_share:.0%}", "honest": "{honest_share:.0%}"},
        of_json("docs/study/fingers.json", {"unknown_start": ""}),
    ),
    "balls": Table(
        {
            "images": "{name}",
            "correlation": "{correlation:.3f}",
            "measured over true": "{slope:.2f}",
            "error": "{rms_after_offset_deg:.1f}°",
            "about the line": "{rms_about_line_deg:.2f}°",
            "between two presses": "{pairs_rms_deg:.1f}°",
            "in 68 %, 95 %": "{in_68_share:.0%}, {in_95_share:.0%}",
        },
        of_json(
            "docs/study/real_gel.json",
            {
                "as it is": "as they are",
                "as it is, its scale known": "as they are, with the scale of this unit",
                "red and blue exchanged": "red and blue exchanged",
                "as it is, calibrated on 5": "as they are, after `palpate calibrate` on five of them",
                "mirrored, calibrated on 5": "mirrored, after the same",
                "red and blue exchanged, calibrated on 5": "red and blue exchanged, after the same",
            },
        ),
    ),
    "real-mini": Table(
        {
            "on a real GelSight Mini": "{name}",
            "presses": "{n}",
            "place off, median (worst)": "{median_mm:.1f} mm ({worst_mm:.1f})",
            "measured over true": "{slope:.2f}",
            "in 95 %": "{in_95_share:.0%}",
        },
        of_json(
            "docs/study/real_mini.json",
            {"balls": "balls", "edges": "upright edges", "dots": "balls, another gel with dots"},
        ),
    ),
    "real-units": Table(
        {
            "real unit; error of": "{name}",
            "no press": "{after_0}",
            "3 presses": "{after_3}",
            "5 presses": "{after_5}",
            "10 presses": "{after_10}",
        },
        of_units(
            "real",
            {
                "GelSight Mini": "GelSight Mini, balls; place",
                "gel with dots": "gel with dots, balls; place",
                "taxim, GelSight": "GelSight of taxim, balls; place",
                "taxim, Mini": "GelSight Mini of taxim, balls; place",
                "DIGIT, balls": "DIGIT, balls; direction",
                "DIGIT, printer": "DIGIT, a printer's ball; change of direction",
            },
            "{median:.2f} ({second_worst:.1f}, {worst:.1f}); {slope:.2f}; {in_95:.0%}",
        ),
    ),
    "drawn-units": Table(
        {
            "drawn units; error of": "{name}",
            "no press": "{after_0}",
            "3 presses": "{after_3}",
            "5 presses": "{after_5}",
            "10 presses": "{after_10}",
        },
        of_units(
            "pooled",
            {
                "flat, balls": "12 flat pads, balls; place",
                "flat, sides": "12 flat pads, sides and corners; place",
                "domes, balls": "12 domes, balls; direction",
                "domes, sides": "12 domes, sides; direction",
            },
            "{median:.2f} ({worst_unit:.1f}, {worst:.1f}); {slope:.2f}; {in_95:.0%}",
        ),
    ),
    "unit-pushes": Table(
        {"DIGITs": "{name}", **OF_PUSHES},
        of_json(
            "docs/study/unit_pushes.json",
            {
                "plain": "without a fault",
                "dead LED": "with a dead LED",
                "dots": "with dots",
                "half the view": "whose images show half of the pad",
                "turned": "with images turned by 180 degrees",
                "mirrored": "with mirrored images",
            },
            "kinds",
        ),
    ),
    "unit-set-up": Table(
        {"set-up": "{name}", **OF_PUSHES},
        of_json(
            "docs/study/unit_set_up.json",
            {"errors": "with the errors of a real one", "exact": "exact"},
            "kinds",
        ),
    ),
    "touch-model": Table(
        {
            "model": "{name}",
            "units": "{recordings[judged_by]}",
            "direction": "{honesty[direction][median_deg]:.1f}°",
            "offset of a unit": "{direction_offset_of_units_deg:.1f}°",
            "in 95 %": "{honesty[direction][coverage][0.95]:.0%}",
            "turn": "{honesty[turn][median_deg]:.1f}°",
        },
        lambda: [
            {"name": "DIGIT", **loaded("docs/study/touch_model.json")},
            {"name": "GelSight Mini", **loaded("docs/study/gelsight_mini/touch_model.json")},
        ],
    ),
    "better-touch": Table(
        {
            "noise of directions and turns": "{name}",
            "error: set-up errors, ideal": "{set_up_errors[rmse_median_mm]:.1f}, {ideal[rmse_median_mm]:.1f} mm",
            "final error": "{set_up_errors[final_mm]:.1f}, {ideal[final_mm]:.1f} mm",
            "in 95 %": "{set_up_errors[in_95_contact_share]:.0%}, {ideal[in_95_contact_share]:.0%}",
            "nats": "{set_up_errors[nats]:.1f}, {ideal[nats]:.1f}",
            "medians": "{set_up_errors[nats_median]:.1f}, {ideal[nats_median]:.1f}",
        },
        of_json(
            "docs/study/choices.json",
            {f"{sigma} degrees, coloured": f"{sigma}°" for sigma in (2, 1, 0.5, 0.2)},
            "better_touch",
        ),
    ),
    "step-times": Table(
        {
            "a step": "{name}",
            "median": "{median_ms:.1f} ms",
            "95th percentile": "{p95_ms:.1f} ms",
            "99th percentile": "{p99_ms:.1f} ms",
        },
        step_times,
    ),
    "long-runs": Table(
        {
            "": "{name}",
            "frames": "{frames}",
            "contacts": "{contacts}",
            "first tenth: step, memory": "{first}",
            "last tenth: step, memory": "{last}",
            "in 95 %": "{inside:.0%}",
        },
        long_runs,
    ),
    "unknown-start": Table(
        {
            "recordings": "{recordings}",
            "found": "{found_share:.0%}",
            "found if the first pose is given": "{found_if_told_share:.0%}",
            "in 95 % or `ambiguous`": "{honest_share:.0%}",
        },
        lambda: [loaded("docs/study/unknown_start.json")],
    ),
}

# Pages

BLOCK = re.compile(r"<!-- numbers: ([\w, -]+) -->\n(.*?)<!-- end -->", re.DOTALL)
CODE = re.compile(r"^(```|:::).*?^\1$|^    .*?$|`[^`\n]+`|\$\$.*?\$\$|\$[^$\n]+\$|<!--.*?-->", re.DOTALL | re.MULTILINE)
RESULT = re.compile(r"(?<![\d.])((\d+(?:\.\d+)?) ?(?:mm|°|%|ms))(?!\w)")
"""A number with the unit of a result, and the number alone."""
NUMBER = re.compile(r"(?<![\w.])\d+(?:[.,]\d+)*(?![\w.]*\d)")


def main() -> None:
    """Check all pages, after writing their tables with --write; exit with 1 where a number is wrong."""
    wrong = []
    for path in pages(PAGES):
        if "--write" in sys.argv:
            path.write_text(written(path.read_text(encoding="utf-8")), encoding="utf-8")
        wrong += [f"{path.relative_to(ROOT)}: {complaint}" for complaint in complaints(path)]
    print("\n".join(wrong) or "every number is that of its file")
    sys.exit(1 if wrong else 0)


def pages(patterns: Sequence[str]) -> list[Path]:
    """Return the pages of these patterns."""
    return [path for pattern in patterns for path in sorted(ROOT.glob(pattern))]


def complaints(path: Path) -> Iterator[str]:
    """Yield a line for each wrong number of a page."""
    text = path.read_text(encoding="utf-8")
    for name, body in BLOCK.findall(text):
        of_prose = name.startswith("from ")
        names = name.removeprefix("from ").split(", ")
        unknown = [name for name in names if name not in TABLES]
        if unknown:
            yield f"block {unknown[0]} is not in scripts/reported_numbers.py"
        elif of_prose:
            allowed = LIMITS.union(*(NUMBER.findall(str(TABLES[each])) for each in names))
            numbers = NUMBER.findall(re.sub(r"\[[^]]*\]\([^)]*\)|`[^`]*`", "", body))
            yield from (f"block {name!r} says {number}" for number in numbers if number not in allowed)
        elif body.strip() != str(TABLES[name]):
            yield f"table {name} differs from its file; --write writes it anew"
    if path in pages(STRICT):
        results = RESULT.findall(CODE.sub("", BLOCK.sub("", text)))
        yield from (f"{found} stands in no block of numbers" for found, number in results if number not in LIMITS)


def written(text: str) -> str:
    """Return a page with its tables as the files have them."""

    def anew(block: re.Match[str]) -> str:
        return f"<!-- numbers: {block[1]} -->\n\n{TABLES[block[1]]}\n\n<!-- end -->" if block[1] in TABLES else block[0]

    return BLOCK.sub(anew, text)


if __name__ == "__main__":
    main()
