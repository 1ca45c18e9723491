"""`palpate train`: a touch model from recordings."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.options import Json

if TYPE_CHECKING:
    from palpate.lab.train.train import TrainSettings


def train(
    source: Annotated[
        tyro.conf.Positional[Path],
        tyro.conf.arg(
            metavar="DIR|PRESSES.csv",
            help="Folder of recordings (.mcap), or presses at known angles: columns file, an image beside the CSV, and "
            "angle_deg, of the contact on the tip. These give a model of directions alone.",
        ),
    ],
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
    untouched: Annotated[
        tuple[Path, ...],
        tyro.conf.arg(metavar="IMAGE", help="With presses: images of the untouched gel.", help_behavior_hint=""),
    ] = (),
    sensor: Annotated[
        str | None,
        tyro.conf.arg(metavar="NAME", help="With presses: the name of the sensor's profile.", help_behavior_hint=""),
    ] = None,
    seed: Annotated[int, tyro.conf.arg(metavar="N", help="Of weights, batches and what is left out.")] = 0,
    steps: Annotated[
        int | None,
        tyro.conf.arg(
            metavar="N",
            help="Most steps of each descent.",
            help_behavior_hint="(default: 4000; 300 with --from or presses)",
        ),
    ] = None,
    workers: Annotated[int, tyro.conf.arg(metavar="N", help="Processes that read recordings.")] = 1,
    resume: Annotated[bool, tyro.conf.arg(help="Go on with a training that was cut off.")] = False,
    json: Json = False,
) -> int:
    """Train a touch model on recordings with images, contacts and ground truth, or on presses; judge it on others.

    Example: palpate train recordings --out model
    """
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
    from palpate.lab.train.train import TrainSettings
    from palpate.lab.train.train import train as train_model
    from palpate.touch.calibration import load_calibration

    begin = time.perf_counter()
    settings = TrainSettings(seed=seed, steps=steps, workers=workers)
    if source.suffix.lower() == ".csv":
        if not untouched or not sensor:
            raise SettingError("train: presses take --untouched and --sensor")
        given = {"--from": start, "--calibration": calibration, "--test": test, "--workers": workers != 1}
        if of_no_use := [option for option, value in given.items() if value]:
            raise SettingError(f"train: {', '.join(of_no_use)}: of no use with presses (.csv)")
        results = _train_on_presses(source, untouched, sensor, out, settings, resume)
        results["wall_s"] = time.perf_counter() - begin
        if json:
            print_json({"model": str(out), **results})
        else:
            print_line(
                f"model: {out}   of {results['held_out']} presses that were left out, directions are off by "
                f"{results['rms_deg']:.2f} degrees RMS, {results['median_deg']:.2f} in the median"
            )
        return 0
    if untouched or sensor:
        raise SettingError("train: --untouched and --sensor are of presses (.csv); recordings tell both themselves")
    unit = None if calibration is None else load_calibration(calibration)
    results = train_model(
        _files(source), out, settings, progress_bar, start, _files(test) if test else (), resume, unit
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


def _train_on_presses(
    presses: Path, untouched: tuple[Path, ...], sensor: str, out: Path, settings: "TrainSettings", resume: bool
) -> dict[str, Any]:
    """Train on presses and return what the model is worth."""
    from palpate.cli.console import progress_bar
    from palpate.files import in_file
    from palpate.lab.train.train import train_on_presses
    from palpate.touch.press_files import read_image, read_presses

    at_rest = [read_image(path, grey=True) for path in untouched]
    given = read_presses(presses, grey=True)
    with in_file(presses):
        return train_on_presses(given, at_rest, sensor, out, progress_bar, settings, resume)


def _files(folder: Path) -> list[Path]:
    from palpate.errors import FileError

    if not folder.is_dir():
        raise FileError(f"{folder}: no such folder of recordings")
    files = sorted(folder.glob("*.mcap"))
    if not files:
        raise FileError(f"{folder}: holds no recordings (*.mcap)")
    return files


def _report(results: dict[str, Any]) -> None:
    from palpate.cli.console import print_table

    rows = []
    for name, values in results["scores"].items():
        shares = [f"{100.0 * share:.1f} %" for share in values["coverage"].values()]
        likelihoods = [f"{values[key]:.2f}" for key in ("log_likelihood", "log_likelihood_constant")]
        median, rms = (next(values[key] for key in values if key.startswith(what)) for what in ("median", "rms"))
        label = f"{name} [mm]" if name == "place" else name
        rows.append([label, f"{median:.2f}", f"{rms:.2f}", *shares, *likelihoods])
    columns = ("output", "median deg", "RMS deg", "in 68 %", "in 95 %", "log likelihood", "of constant noise")
    print_table("accuracy and calibration on recordings not trained on", columns, rows, numbers=range(1, 7))
