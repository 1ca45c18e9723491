"""`palpate tune`: how much each factor is to be believed, learned from recordings with ground truth."""

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.options import (
    NOISE,
    JsonOption,
    ModelOption,
    RecordingsFolder,
    SmootherOption,
    TactileChoice,
    UnitOption,
    WorkersOption,
    check_model,
)

if TYPE_CHECKING:
    from palpate.lab.tune.tuning import Judgement, Tuning
    from palpate.touch.calibration import DirectionCorrection


def tune(
    folder: RecordingsFolder,
    /,
    *,
    out: Annotated[Path, tyro.conf.arg(metavar="FILE", help="File of the settings (.json), for --noise of others.")],
    tactile: Annotated[
        TactileChoice,
        tyro.conf.arg(
            help="What touch says, as palpate track has it; auto is learnt where there are images and the oracle where "
            "there are none, for real and simulated recordings together."
        ),
    ] = "learnt",
    model: ModelOption = None,
    calibration: UnitOption = None,
    smoother: SmootherOption = "fixed-lag",
    parameters: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="NAME...",
            help="Settings to learn, and pressure, which is c [m] of one object.",
            help_behavior_hint="(default: those that count with this touch)",
        ),
    ] = (),
    start: Annotated[
        str,
        tyro.conf.arg(
            metavar=NOISE,
            help="Settings to begin with; the file of a tuning goes on with it.",
        ),
    ] = "palpate",
    evaluations: Annotated[int, tyro.conf.arg(metavar="N", help="How often all recordings are tracked.")] = 100,
    workers: WorkersOption = 1,
    json: JsonOption = False,
) -> int:
    """Learn the noise settings from recordings with ground truth; a fourth of them is kept to judge by.

    Recordings in folders of their own are kinds: all kinds count the same, however many recordings there are of each,
    and the 95 % region of none is let hold too little.

    Example: palpate tune recordings --out noise.json --workers 2
    """
    import time

    from palpate.cli.console import complain, print_json, progress_bar
    from palpate.config import TrackerSettings, noise_of, write_noise
    from palpate.files import only_writer
    from palpate.lab.study.recordings import find_recordings
    from palpate.lab.tune.parameters import check_parameters
    from palpate.lab.tune.recorded_touch import record_touch_of_files
    from palpate.lab.tune.tuning import held_out
    from palpate.lab.tune.tuning import tune as tune_settings
    from palpate.touch.calibration import correction_of, load_calibration
    from palpate.touch.model import TouchModel

    begin = time.perf_counter()
    check_model(model, ["learnt" if tactile == "auto" else tactile])
    settings = TrackerSettings(tactile=tactile, smoother=smoother, noise=noise_of(start))
    check_parameters(settings, parameters, evaluations)
    _check_out(out, start)
    with only_writer(out):
        files = find_recordings(folder)
        touch_model = TouchModel(model) if model else None
        unit = load_calibration(calibration) if calibration else None
        _check_open(parameters, calibration, correction_of(unit))
        with progress_bar("reading touch", len(files)) as progress:
            recorded, left_out = record_touch_of_files(files, tactile, touch_model, workers, progress, unit)
        for why in left_out.values():
            complain(f"left out: {why}")
        is_out = dict(zip(recorded, held_out([one.kind for one in recorded.values()]), strict=True))
        about = {
            "tactile": tactile,
            "model": None if touch_model is None else touch_model.hash,
            "calibration": None if unit is None else unit.hash,
            "smoother": smoother,
            "start": start,
            "recordings": [name for name in recorded if not is_out[name]],
            "held_out": [name for name in recorded if is_out[name]],
            "sources": {name: one.recording.source for name, one in recorded.items()},
        }
        written = None

        def keep(tuning: "Tuning") -> None:
            nonlocal written
            show(tuning.evaluations, f"{tuning.before.score:.3f} -> {tuning.after.score:.3f}")
            if tuning.settings != written:
                write_noise(tuning.settings.noise, out, {**about, **_found(tuning)}, overwrite=True)
                written = tuning.settings

        with progress_bar("tuning", evaluations) as show:
            tuning = tune_settings(list(recorded.values()), settings, parameters, evaluations, workers, keep)
        tuned = {**about, **_found(tuning)}
        write_noise(tuning.settings.noise, out, tuned, overwrite=True)
    wall_s = time.perf_counter() - begin
    if json:
        missing = [{"file": str(files[name]), "error": why} for name, why in left_out.items()]
        print_json(
            {"out": str(out), "noise": asdict(tuning.settings.noise), **tuned, "left_out": missing, "wall_s": wall_s}
        )
    else:
        _show(tuning, out, wall_s)
    return 3 if left_out else 0


def _check_out(out: Path, start: str) -> None:
    """Before the work: FileError unless the file is new, or the one to go on from."""
    from palpate.errors import FileError

    if out.exists() and not (out.is_file() and Path(start).exists() and out.samefile(start)):
        raise FileError(f"{out}: already exists; take another file, or --start {out} to go on from it")
    if not out.parent.is_dir():
        raise FileError(f"{out}: the folder {out.parent} does not exist")


def _check_open(parameters: Iterable[str], file: Path | None, correction: "DirectionCorrection") -> None:
    """SettingError on a parameter that the calibration in a file says instead."""
    from palpate.errors import SettingError

    measured = {"priors.direction_bias": correction.offset_sigma, "priors.direction_scale": correction.scale_sigma}
    for name in parameters:
        if measured.get(name) is not None:
            raise SettingError(f"parameter {name!r} is measured in {file}; it cannot be tuned besides")


def _found(tuning: "Tuning") -> dict[str, Any]:
    """What a tuning found, as plain data for JSON."""
    import palpate

    sides = tuning.held_out
    return {
        "palpate": palpate.__version__,
        "evaluations": tuning.evaluations,
        "parameters": {name: {"before": old, "after": new} for name, (old, new) in tuning.values.items()},
        "before": asdict(tuning.before),
        "after": asdict(tuning.after),
        "held_out_before": None if sides is None else asdict(sides[0]),
        "held_out_after": None if sides is None else asdict(sides[1]),
    }


def _show(tuning: "Tuning", out: Path, wall_s: float) -> None:
    from palpate.cli.console import print_line, print_table

    rows = [(name, f"{old:.4g}", f"{new:.4g}") for name, (old, new) in tuning.values.items()]
    print_table(f"{tuning.settings.tactile}, {tuning.settings.smoother}", ("setting", "before", "after"), rows, (1, 2))
    scored = [("tuned on", tuning.before, tuning.after)]
    if tuning.held_out:
        scored.append(("held out", *tuning.held_out))
    for which, before, after in [*scored]:
        scored += [(f"{which}: {kind}", before.kinds[kind], after.kinds[kind]) for kind in before.kinds]
    rows = [
        (which, str(judgement.recordings), when, *_cells(judgement))
        for which, *sides in scored
        for when, judgement in zip(("before", "after"), sides, strict=True)
    ]
    columns = ("", "recordings", "", "score", "RMSE mm", "RMSE deg", "in 95 %", "given up")
    print_table(
        "the score is a negative log likelihood: lower is better; RMSE in the median", columns, rows, range(3, 8)
    )
    if "pressure" in tuning.values:
        print_line(f"c is no noise: palpate track --noise {out} --pressure {tuning.settings.pressure}")
    print_line(f"settings: {out}   {tuning.evaluations} evaluations, {wall_s:.0f} s")


def _cells(judgement: "Judgement") -> Iterable[str]:
    from palpate.cli.console import number

    yield number(judgement.score, 2)
    yield number(judgement.translation_rmse_mm, 2)
    yield number(judgement.rotation_rmse_deg, 2)
    yield "-" if judgement.inside_95 is None else f"{judgement.inside_95:.0%}"
    yield str(judgement.given_up)
