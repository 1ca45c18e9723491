"""`palpate train`: a touch model from recordings."""

from pathlib import Path
from typing import Annotated, Any

import tyro

from palpate.cli.options import JsonOption


def train(
    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR", help="Folder of recordings (.h5).")],
    /,
    *,
    out: Annotated[Path, tyro.conf.arg(metavar="MODEL", help="Folder of the model.")],
    start: Annotated[
        Path | None,
        tyro.conf.arg(
            name="from",
            metavar="MODEL",
            help="Go on from this model, to fit it to another sensor unit.",
            help_behavior_hint="(default: from nothing)",
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="UNIT.npz",
            help="The unit that the recordings are of, from palpate calibrate --presses; track with both then.",
            help_behavior_hint="(default: images are as they are)",
        ),
    ] = None,
    test: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="DIR",
            help="Recordings to judge the model by.",
            help_behavior_hint="(default: a share of DIR that is left out)",
        ),
    ] = None,
    seed: Annotated[int, tyro.conf.arg(metavar="N", help="Of weights, batches and what is left out.")] = 0,
    steps: Annotated[
        int | None,
        tyro.conf.arg(
            metavar="N",
            help="Most steps of each descent.",
            help_behavior_hint="(default: 1000 of key points and 3000 of touch; 300 with --from)",
        ),
    ] = None,
    workers: Annotated[int, tyro.conf.arg(metavar="N", help="Processes that read recordings.")] = 1,
    resume: Annotated[bool, tyro.conf.arg(help="Go on with a training that was cut off.")] = False,
    json: JsonOption = False,
) -> int:
    """Train a touch model on recordings with images, contacts and ground truth, and judge it on others."""
    import os
    import time

    from palpate.cli.console import complain, print_json, print_line, progress_bar
    from palpate.errors import SettingError

    # Before torch starts its threads: those that wait in a loop cost several times the work where cores are shared.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    try:
        import onnxscript  # noqa: F401
        import torch  # noqa: F401
    except ImportError as error:
        raise SettingError(
            f"training needs {error.name}, which is not installed: pip install palpate[train]"
        ) from error
    from palpate.touch.calibration import load_calibration
    from palpate.training.train import TrainSettings
    from palpate.training.train import train as train_model

    begin = time.perf_counter()
    settings = TrainSettings(seed=seed, steps=steps, workers=workers)
    unit = None if calibration is None else load_calibration(calibration)
    results = train_model(
        _files(folder), out, settings, progress_bar, start, _files(test) if test else (), resume, unit
    )
    results["wall_s"] = time.perf_counter() - begin
    for why in results["recordings"]["left_out"].values():
        complain(f"left out: {why}")
    if json:
        print_json({"model": str(out), **results})
    else:
        _report(results)
        print_line(f"model: {out}   figures and logs: {out / 'training'}   {results['wall_s']:.0f} s")
    return 3 if results["recordings"]["left_out"] else 0


def _files(folder: Path) -> list[Path]:
    from palpate.errors import FileError

    if not folder.is_dir():
        raise FileError(f"{folder}: no such folder of recordings")
    files = sorted(folder.glob("*.h5"))
    if not files:
        raise FileError(f"{folder}: holds no recordings (*.h5)")
    return files


def _report(results: dict[str, Any]) -> None:
    from palpate.cli.console import print_table

    kinds = list(results["pairs"])
    rows = [
        [name, *(f"{1e3 * values[kind]:.2f}" for kind in kinds)]
        for name, values in results["mean_square_of_sine"].items()
    ]
    title = "mean square error of sin(yaw) between two images, in thousandths (the published loss is half of it)"
    print_table(title, ["model", *kinds], rows, numbers=range(1, len(kinds) + 1))
    rows = []
    for name, values in results["honesty"].items():
        shares = [f"{100.0 * share:.1f} %" for share in values["coverage"].values()]
        likelihoods = [f"{values[key]:.2f}" for key in ("log_likelihood", "log_likelihood_constant")]
        rows.append([name, f"{values['median_deg']:.2f}", f"{values['rms_deg']:.2f}", *shares, *likelihoods])
    columns = ("told", "median deg", "RMS deg", "in 68 %", "in 95 %", "log likelihood", "of constant noise")
    print_table("how far told distributions are to be believed", columns, rows, numbers=range(1, 7))
