"""`palpate evaluate`, `paper`, `train` and `tune`: studies of many recordings, and what is learnt from them."""

import shlex
import sys
from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import palpate
from palpate.cli.console import Report, complain, progress_bar
from palpate.cli.options import NOISE, Estimator, Orientation, RecordingsFolder, SensorUnit, Touch, Workers, arg
from palpate.errors import FileError, SettingError
from palpate.files import in_file, new_file
from palpate.types.choices import Tactile
from palpate_lab import required

if TYPE_CHECKING:
    from palpate_lab.tune.tuning import Tuning

SHOWN = (
    *("final_mm", "final_deg", "contact_inside_95", "final_inside_95", "silently_wrong", "nats", "ambiguous"),
    *("knocks", "lost", "sequences"),
)
"""Columns of the table that is printed, by their keys in `results.json`."""
SHOWN_WITHOUT_TRUTH = ("final_sigma_mm", "final_sigma_deg", "good", "ambiguous")
"""Columns where no recording has ground truth."""


def evaluate(
    folder: RecordingsFolder,
    /,
    *,
    out: Annotated[Path, arg("REPORT")],
    tactile: Annotated[tuple[Tactile, ...], arg("MODE...")] = ("none", "learnt", "oracle"),
    unit: SensorUnit = SensorUnit(),
    orientation: Orientation = "",
    estimator: Estimator = Estimator(),
    work: Workers = Workers(),
    worst: Annotated[int, arg("N")] = 0,
    resume: bool = False,
) -> Report:
    """Track many recordings by many methods; write tables and figures.

    Example: palpate evaluate recordings --out report --workers 2

    Args:
        out: Folder of the report.
        tactile: Sources of touch measurements, as in palpate track.
        worst: Draw so many of the worst trials, as palpate track does, into the folder worst of the report.
        resume: Continue a study: keep the trials that exist.
    """
    from palpate_lab.study.figures import write_figures
    from palpate_lab.study.recordings import find_recordings
    from palpate_lab.study.results import ALL, results_of, write_results
    from palpate_lab.study.study import StudySettings, run_study
    from palpate_lab.study.worst import draw_worst, worst_of

    if worst < 0:
        raise SettingError(f"worst is {worst}; allowed is 0 or more")
    ways = tuple(dict.fromkeys(tactile))
    settings = StudySettings(ways, estimator.settings("none"), *unit.load(*ways), orientation)
    files = find_recordings(folder, leave_out=out)
    with progress_bar("tracking", len(files) * len(ways)) as progress:
        study = run_study(files, out, settings, work.workers, work.dask, resume, progress)
    for name, error in dict.fromkeys((name, error) for (name, _), error in study.failed.items()):
        complain(f"{folder}/{name}: {error}")
    if study.skipped and not (study.trials or study.failed):
        (name, _), reason = next(iter(study.skipped.items()))
        raise SettingError(f"{folder}: no recording can be tracked by these methods; the first: {name} {reason}")
    command = shlex.join(("palpate", *sys.argv[1:]))
    results = results_of(study, settings, folder, work.workers, command)
    write_results(out, results, study.trials)
    if study.trials:
        with progress_bar("drawing figures"):
            write_figures(out / "figures", study.trials)
    drawn: list[Path] = []
    if worst:
        chosen = worst_of(study.trials, worst)
        with progress_bar("drawing the worst", len(chosen)) as progress:
            drawn = draw_worst(chosen, files, settings, out / "worst", progress)
    data = {"report": str(out), **{key: results[key] for key in ("study", "table", "failed")}}
    counts = {key: results["study"][key] for key in ("trials", "kept", "skipped", "failed", "wall_s")}
    reasons = Counter(skipped["reason"] for skipped in results["skipped"])
    rows = {method: {key: row[key] for key in SHOWN} for method, row in results["table"].get(ALL, {}).items()}
    has_truth = any(row["sequences"] for row in rows.values())
    if not has_truth:
        rows = {method: {key: results["table"][ALL][method][key] for key in SHOWN_WITHOUT_TRUTH} for method in rows}
    shown = {"report": str(out), **counts, "reasons": dict(reasons), ALL: rows}
    return Report("study", data, shown, notes=[str(path) for path in drawn], code=3 if study.failed else 0)


def compare(
    first: Annotated[Path, arg("RUNS_A")],
    second: Annotated[Path, arg("RUNS_B")],
    /,
) -> Report:
    """Compare two sets of runs of the same recordings: paired differences, B less A, with 95 % intervals.

    Example: palpate compare runs-before runs-after

    Args:
        first: Folder of runs of palpate track, or report of palpate evaluate.
        second: Another one; runs of one name are a pair.
    """
    from palpate_lab.study.compare import compared, read_summaries

    runs_a = read_summaries(first)
    runs_b = read_summaries(second)
    pairs = runs_a.keys() & runs_b.keys()
    if not pairs:
        raise SettingError(f"{first} and {second} have no recording in common; runs of one name are a pair")
    rows = compared(runs_a, runs_b)
    counts = {"pairs": len(pairs), "only_a": len(runs_a) - len(pairs), "only_b": len(runs_b) - len(pairs)}
    notes = ["A difference is B less A. It is sure where low and high have the same sign."]
    return Report("comparison", {"a": str(first), "b": str(second), **counts, "scores": rows}, notes=notes)


def paper(
    *,
    out: Annotated[Path, arg("FOLDER", "required")],
    small: bool = False,
    full: bool = False,
    features: Annotated[str, arg("FILE:CLASS", "the paper's network")] = "",
    seed: Annotated[int, arg("N")] = 5,
    workers: Workers = Workers(),
) -> Report:
    """Repeat the paper's experiments on simulated pushes: Table II, tracking by mode, figures 5 to 8 and 10 to 12.

    Example: palpate paper --out paper --workers 2

    Args:
        out: Folder of the study. Finished parts in it are kept, so that an interrupted run continues.
        small: A few short sequences, to see it all in a few minutes; its numbers say little.
        full: As many sequences as the paper has, which takes hours.
        features: Network of features in a Python file, in place of the paper's key points; see docs/paper.md.
        seed: The same seed gives the same recordings.
    """
    required("palpate paper", "sim,train,paper", "gtsam", "mujoco", "torch")
    from palpate_lab.paper.study import FULL, SMALL, PaperSettings, run

    if seed < 0:
        raise SettingError(f"seed is {seed}; allowed is 0 or more")
    if small and full:
        raise SettingError("palpate paper takes --small or --full, not both")
    size = PaperSettings()
    if small:
        size = SMALL
    if full:
        size = FULL
    settings = replace(size, seed=seed, features=features)
    try:
        results = run(out, settings, progress_bar, workers.workers, workers.dask)
    except KeyboardInterrupt as stop:
        raise KeyboardInterrupt("the same command goes on") from stop
    return Report("experiments of the paper", results, {"folder": str(out), **_beside_published(results)})


def _beside_published(results: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of the paper's study as they are printed: ours beside the published numbers."""

    def shown(model: str, name: str, loss: float) -> str:
        """Return a loss in thousandths and, in brackets, the published one if there is one."""
        published = results["published_table2"].get(model)
        return f"{1e3 * loss:.2f}" + (f" ({1e3 * published[name]:.1f})" if published else "")

    losses = {
        model: {name: shown(model, name, loss) for name, loss in row.items()}
        for model, row in results["table2"].items()
    }
    constant = {name: shown("const", name, row["const"]) for name, row in results["pushes"].items()}
    finals = {}
    for name, by_mode in results["tracking"].items():
        for mode, row in by_mode.items():
            errors = {unit: "{median:.1f} [{low:.1f}, {high:.1f}]".format(**row[unit]) for unit in ("mm", "deg")}
            finals[f"{name}, {mode}"] = {**errors, "lost": row["lost"], "of": row["sequences"]}
    return {
        "table2, thousandths (published)": losses,
        "const over all pushes, thousandths (published)": constant,
        "final errors, median [95 %] (published in figures alone)": finals,
        "share of draws in the paper's order": {name: row["in order"] for name, row in results["order"].items()},
    }


def train(
    source: Annotated[Path, arg("DIR|PRESSES.csv")],
    /,
    *,
    out: Annotated[Path, arg("MODEL")],
    start: Annotated[Path | None, arg("MODEL|NAME", "from nothing", name="from")] = None,
    calibration: Annotated[Path | None, arg("UNIT.npz", "images are as they are")] = None,
    orientation: Orientation = "",
    test: Annotated[Path | None, arg("DIR", "a share of DIR that is left out")] = None,
    untouched: Annotated[tuple[Path, ...], arg("IMAGE", "none")] = (),
    sensor: Annotated[str | None, arg("NAME", "none")] = None,
    seed: Annotated[int, arg("N")] = 0,
    steps: Annotated[int | None, arg("N", "8000; 300 with --from, 600 with presses")] = None,
    workers: Annotated[int, arg("N")] = 1,
    resume: bool = False,
) -> Report:
    """Train a touch model on recordings with images, contacts and ground truth, or on presses; judge it on others.

    Example: palpate train recordings --out model

    Args:
        source: Folder of recordings, or a table of presses (columns file, angle_deg) for a model of directions alone.
        out: Folder of the model.
        start: Go on from this model, or that of a sensor such as digit, to fit it to another unit.
        calibration: The unit that the recordings are of, from palpate calibrate --presses; track with both then.
        test: Recordings to judge the model by.
        untouched: With presses: images of the untouched gel.
        sensor: With presses: the name of the sensor's profile, or its file (.toml).
        seed: Of weights, batches and what is left out.
        steps: Most steps of each descent.
        workers: Processes that read recordings.
        resume: Go on with a training that was cut off.
    """
    required("training", "train", "onnxscript", "torch")
    from palpate.touch.press_calibration import read_presses
    from palpate.types.images import read_image
    from palpate.types.sensor_file import known_sensor
    from palpate_lab.study.recordings import find_recordings
    from palpate_lab.train.train import TrainSettings, train_on_presses
    from palpate_lab.train.train import train as train_model

    settings = TrainSettings(seed=seed, steps=steps, workers=workers)
    results: dict[str, Any]
    if source.suffix.lower() == ".csv":
        if not untouched or not sensor:
            missing = "--sensor" if untouched else "--untouched"
            raise SettingError(f"train: presses (.csv) need {missing}, which is not given")
        if start or calibration or orientation or test:
            raise SettingError("train: presses (.csv) take no --from, --calibration, --orientation or --test")
        still = [read_image(path) for path in untouched]
        presses = read_presses(source)
        with in_file(source):
            name = known_sensor(sensor).name if sensor.lower().endswith(".toml") else sensor
            results = train_on_presses(presses, still, name, out, progress_bar, settings, resume)
    else:
        if untouched or sensor:
            raise SettingError("train: --untouched and --sensor are of presses (.csv); recordings tell both themselves")
        files = list(find_recordings(source).values())
        tested = list(find_recordings(test).values()) if test else ()
        unit = calibration and palpate.load_calibration(calibration)
        results = train_model(files, out, settings, progress_bar, start, tested, resume, unit, orientation)
    left_out = results.get("recordings", {}).get("left_out", {})
    for why in left_out.values():
        complain(f"left out: {why}")
    return Report("training", {"model": str(out), **results}, code=3 if left_out else 0)


def tune(
    folder: RecordingsFolder,
    /,
    *,
    out: Annotated[Path, arg("FILE")],
    touch: Touch = Touch(tactile="learnt"),
    orientation: Orientation = "",
    start: Annotated[str, arg(NOISE)] = "palpate",
    evaluations: Annotated[int, arg("N")] = 100,
    workers: Annotated[int, arg("N")] = 1,
) -> Report:
    """Learn noise settings from recordings with ground truth; a fourth of them is held out to judge the result.

    Example: palpate tune recordings --out noise.json --workers 2

    Args:
        out: File of the settings (.json), for --noise of other commands.
        touch: Measurements of touch; auto is learnt where there are images, else oracle.
        start: Settings to start from; the file of a tuning continues it.
        evaluations: Number of times that all recordings are tracked.
        workers: Processes that share the work.
    """
    from palpate.noise_file import noise_of, write_noise
    from palpate_lab.study.recordings import find_recordings
    from palpate_lab.study.study import StudySettings
    from palpate_lab.tune.tuning import tune as tune_settings

    tracker = palpate.TrackerSettings(noise=noise_of(start))
    unit = touch.load(touch.tactile)
    settings = StudySettings((touch.tactile,), tracker, *unit, orientation)
    if out.exists() and out != Path(start):
        raise FileError(f"{out}: already exists; name another file, or continue it with --start {out}")
    new_file(out, overwrite=True)

    def keep(tuning: "Tuning") -> dict[str, Any]:
        """Write the settings of a tuning, and return the command's result."""
        show(tuning.evaluations, f"{tuning.before.nats:.3f} -> {tuning.after.nats:.3f}")
        about = {key: value for key, value in asdict(tuning).items() if key not in ("settings", "left_out")}
        result = {"tactile": touch.tactile, "start": start, **about}
        write_noise(tuning.settings.noise, out, result, overwrite=True)
        return result

    with progress_bar("tuning", evaluations) as show:
        tuning = tune_settings(find_recordings(folder), settings, evaluations, workers, keep)
        tuned = keep(tuning)
    for error in tuning.left_out.values():
        complain(f"left out: {error}")
    left_out = tuning.left_out
    return Report("tuning", {"out": str(out), **tuned, "left_out": left_out}, code=3 if left_out else 0)
