"""`palpate tune`: noise settings learnt from recordings with ground truth."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from palpate.cli.options import NOISE, Json, RecordingsFolder, Smoother, Touch, Workers, arg

if TYPE_CHECKING:
    from palpate.lab.tune.tuning import Judgement, Tuning


def tune(
    folder: RecordingsFolder,
    /,
    *,
    out: Annotated[Path, arg("FILE")],
    touch: Touch = Touch(tactile="learnt"),
    smoother: Smoother = "fixed-lag",
    parameters: Annotated[tuple[str, ...], arg("NAME...", "those that count with this touch")] = (),
    start: Annotated[str, arg(NOISE)] = "palpate",
    evaluations: Annotated[int, arg("N")] = 100,
    work: Workers = Workers(),
    json: Json = False,
) -> int:
    """Learn noise settings from recordings with ground truth; a fourth of them is held out to judge the result.

    Each folder of recordings is a kind, and all kinds count the same.

    Example: palpate tune recordings --out noise.json --workers 2

    Args:
        folder: Folder of recordings in any known format; folders in it are searched too.
        out: File of the settings (.json), for --noise of other commands.
        touch: Measurements of touch; auto is learnt where there are images, else oracle.
        smoother: Solver of the graph.
        parameters: Settings to learn, such as contact.deviation.
        start: Settings to start from; the file of a tuning continues it.
        evaluations: Number of times that all recordings are tracked.
        work: Processes that share the work.
        json: Print one JSON object.
    """
    import time

    from palpate.cli.console import complain, print_json, progress_bar
    from palpate.config import TrackerSettings, noise_of, write_noise
    from palpate.errors import SettingError
    from palpate.files import held_folder
    from palpate.lab.study.recordings import find_recordings
    from palpate.lab.tune.parameters import check_parameters
    from palpate.lab.tune.recorded_touch import record_touch_of_files
    from palpate.lab.tune.tuning import held_out
    from palpate.lab.tune.tuning import tune as tune_settings

    begin = time.perf_counter()
    if work.dask:
        raise SettingError("--dask: tuning runs on this machine; use --workers")
    settings = TrackerSettings(tactile=touch.tactile, smoother=smoother, noise=noise_of(start))
    check_parameters(settings, parameters, evaluations)
    model, calibration = touch.load()
    _check_out(out, start)
    with held_folder(out.parent, out.name):
        files = find_recordings(folder)
        with progress_bar("reading touch", len(files)) as progress:
            recorded, left_out = record_touch_of_files(files, touch.tactile, model, work.workers, progress, calibration)
        for error in left_out.values():
            complain(f"left out: {error}")
        is_out = dict(zip(recorded, held_out([each.kind for each in recorded.values()]), strict=True))
        about = {
            "tactile": touch.tactile,
            "model": model and model.hash,
            "calibration": calibration and calibration.hash,
            "smoother": smoother,
            "start": start,
            "recordings": [name for name in recorded if not is_out[name]],
            "held_out": [name for name in recorded if is_out[name]],
            "sources": {name: each.recording.source for name, each in recorded.items()},
        }

        def keep(tuning: "Tuning") -> None:
            show(tuning.evaluations, f"{tuning.before.score:.3f} -> {tuning.after.score:.3f}")
            write_noise(tuning.settings.noise, out, about | _found(tuning), overwrite=True)

        with progress_bar("tuning", evaluations) as show:
            tuning = tune_settings(list(recorded.values()), settings, parameters, evaluations, work.workers, keep)
        tuned = about | _found(tuning)
        write_noise(tuning.settings.noise, out, tuned, overwrite=True)
    wall_s = time.perf_counter() - begin
    if json:
        missing = [{"file": str(files[name]), "error": error} for name, error in left_out.items()]
        noise = asdict(tuning.settings.noise)
        print_json({"out": str(out), "noise": noise, **tuned, "left_out": missing, "wall_s": wall_s})
    else:
        _show(tuning, out, wall_s)
    return 3 if left_out else 0


def _check_out(out: Path, start: str) -> None:
    """Raise FileError before the work unless the file is new, or the one to continue."""
    from palpate.errors import FileError

    if out.exists() and not (out.is_file() and Path(start).exists() and out.samefile(start)):
        raise FileError(f"{out}: already exists; name another file, or continue it with --start {out}")
    if not out.parent.is_dir():
        raise FileError(f"{out}: the folder {out.parent} does not exist")


def _found(tuning: "Tuning") -> dict[str, Any]:
    """Return a tuning as plain data."""
    import palpate

    before, after = tuning.held_out or (None, None)
    return {
        "palpate": palpate.__version__,
        "evaluations": tuning.evaluations,
        "parameters": {name: {"before": old, "after": new} for name, (old, new) in tuning.values.items()},
        "before": asdict(tuning.before),
        "after": asdict(tuning.after),
        "held_out_before": before and asdict(before),
        "held_out_after": after and asdict(after),
    }


def _show(tuning: "Tuning", out: Path, wall_s: float) -> None:
    from palpate.cli.console import number, percent, print_line, print_table

    def cells(judgement: "Judgement") -> list[str]:
        numbers = (judgement.score, judgement.translation_rmse_mm, judgement.rotation_rmse_deg)
        return [*(number(each, 2) for each in numbers), percent(judgement.inside_95), str(judgement.given_up)]

    rows = [(name, f"{old:.4g}", f"{new:.4g}") for name, (old, new) in tuning.values.items()]
    print_table(f"{tuning.settings.tactile}, {tuning.settings.smoother}", ("setting", "before", "after"), rows, (1, 2))
    sides = {"tuned on": (tuning.before, tuning.after)} | ({"held out": tuning.held_out} if tuning.held_out else {})
    kinds = {
        f"{side}: {kind}": (before.kinds[kind], after.kinds[kind])
        for side, (before, after) in sides.items()
        for kind in before.kinds
    }
    rows = [
        (name, str(judgement.recordings), when, *cells(judgement))
        for name, pair in (sides | kinds).items()
        for when, judgement in zip(("before", "after"), pair, strict=True)
    ]
    columns = ("", "recordings", "", "score", "RMSE mm", "RMSE deg", "% in 95 %", "given up")
    print_table("the score is a negative log likelihood: lower is better; RMSE: median", columns, rows, range(3, 8))
    print_line(f"settings: {out}   {tuning.evaluations} evaluations, {wall_s:.0f} s")
