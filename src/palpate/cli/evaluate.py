"""`palpate evaluate`: a study of many recordings, tracked in many ways."""

import shlex
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from palpate.cli.evaluate_faults import evaluate_faults
from palpate.cli.evaluate_report import report_shard, report_study
from palpate.cli.options import (
    DaskOption,
    FirstPoseSigmaOption,
    FirstPoseUnknownOption,
    HypothesesOption,
    JsonOption,
    ModelOption,
    NoiseOption,
    PressureOption,
    RecordingsFolder,
    ShardOption,
    SmootherName,
    Tactile,
    UnitOption,
    WorkersOption,
    check_model,
    pressure_of,
    stated_first_pose,
)

if TYPE_CHECKING:
    from palpate.lab.study.study import Study

TACTILES: tuple[Tactile, ...] = (
    "none",
    "constant",
    "learnt-linear",
    "learnt-pairs",
    "learnt-turn",
    "learnt-direction",
    "learnt",
    "oracle",
)
"""What is compared unless told otherwise, in the order of tables."""


def evaluate(
    folder: RecordingsFolder,
    /,
    *,
    out: Annotated[Path, tyro.conf.arg(metavar="REPORT", help="Folder of the report.")],
    tactile: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[Tactile, ...], ...]],
        tyro.conf.arg(
            metavar="MODE...",
            help="What touch says, as in palpate track: none, constant, learnt-linear, learnt-pairs, learnt-turn, "
            "learnt-direction, learnt, oracle.",
            help_behavior_hint="(default: all)",
        ),
    ] = (),
    smoother: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[SmootherName, ...], ...]],
        tyro.conf.arg(
            metavar="NAME...",
            help="How the graph is solved, as in palpate track; each with every mode.",
            help_behavior_hint="(default: fixed-lag)",
        ),
    ] = (),
    noise: NoiseOption = "palpate",
    pressure: PressureOption = "uniform",
    model: ModelOption = None,
    calibration: UnitOption = None,
    first_pose: Annotated[
        tuple[float, float, float] | None,
        tyro.conf.arg(
            metavar="X Y THETA",
            help="Object pose at the start [m, m, rad] of recordings without ground truth.",
            help_behavior_hint="(default: these are skipped)",
        ),
    ] = None,
    first_pose_sigma: FirstPoseSigmaOption = None,
    first_pose_unknown: FirstPoseUnknownOption = False,
    hypotheses: HypothesesOption = None,
    workers: WorkersOption = 1,
    dask: DaskOption = None,
    shard: ShardOption = None,
    resume: Annotated[bool, tyro.conf.arg(help="Go on with a study: keep what is tracked and do the rest.")] = False,
    against: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="OTHER",
            help="Report of another study to compare with, sequence by sequence.",
            help_behavior_hint="(default: none)",
        ),
    ] = None,
    faults: Annotated[
        bool,
        tyro.conf.arg(help="Break the recordings, one fault after the other, and tell what learnt touch makes of it."),
    ] = False,
    json: JsonOption = False,
) -> int:
    """Track many recordings in several ways; writes tables, figures and a page with all results.

    Example: palpate evaluate recordings --out report --tactile none learnt --workers 2
    """
    if faults:
        given = {
            "--tactile": tactile,
            "--smoother": smoother,
            "--noise": noise != "palpate",
            "--pressure": pressure != "uniform",
            "--calibration": calibration,
            "--first-pose": first_pose,
            "--first-pose-sigma": first_pose_sigma,
            "--first-pose-unknown": first_pose_unknown,
            "--hypotheses": hypotheses is not None,
            "--dask": dask,
            "--shard": shard,
            "--resume": resume,
            "--against": against,
        }
        return evaluate_faults(folder, out, [option for option, value in given.items() if value], model, workers, json)
    from palpate.cli.console import busy, complain, print_json, progress_bar
    from palpate.config import noise_of
    from palpate.errors import SettingError
    from palpate.lab.study.comparison import check_common, compare, read_scores
    from palpate.lab.study.files import find_recordings
    from palpate.lab.study.job import StudySettings
    from palpate.lab.study.report import write_report
    from palpate.lab.study.results import results_of, write_results
    from palpate.lab.study.study import run_study
    from palpate.lab.study.trial import Method
    from palpate.shards import part_of_work
    from palpate.touch.calibration import load_calibration
    from palpate.touch.model import TouchModel

    tactiles = dict.fromkeys(mode for given in tactile for mode in given) or dict.fromkeys(TACTILES)
    smoothers = dict.fromkeys(name for given in smoother for name in given) or {"fixed-lag": None}
    methods = tuple(Method(mode, name) for name in smoothers for mode in tactiles)
    check_model(model, tactiles)
    if shard is not None and against is not None:
        raise SettingError("--shard: a part of a study is compared with nothing; say --against when it is whole")
    settings = StudySettings(
        methods,
        noise_of(noise),
        pressure_of(pressure),
        *stated_first_pose(first_pose, first_pose_sigma, first_pose_unknown),
        first_pose_of_all=first_pose_unknown,
        calibration=None if calibration is None else load_calibration(calibration),
        **({} if hypotheses is None else {"hypotheses": hypotheses}),
    )
    learnt = TouchModel(model) if model else None
    files = find_recordings(folder, leave_out=out)
    before = None if against is None else read_scores(against)
    if against is not None and before is not None:
        check_common(against, before, files, methods)
    with progress_bar("tracking", len(part_of_work(tuple(files), shard)) * len(methods)) as progress:
        study = run_study(files, out, settings, learnt, workers, dask, resume, progress, shard)
    for why in _complaints(study):
        complain(f"{folder}/{why}")
    if shard is not None:
        return report_shard(out, study, json)
    if study.skipped and not (study.trials or study.broken or study.failed):
        (name, _), why = next(iter(study.skipped.items()))
        raise SettingError(f"{folder}: nothing in it can be tracked in these ways; the first reason: {name} {why}")
    options = {
        "--tactile": tactiles if tactile else (),
        "--smoother": smoothers if smoother else (),
        "--noise": [noise] if noise != "palpate" else (),
        "--pressure": [pressure] if pressure != "uniform" else (),
        "--model": [model] if model else (),
        "--calibration": [calibration] if calibration else (),
        "--first-pose": first_pose or (),
        "--first-pose-sigma": first_pose_sigma or (),
        "--first-pose-unknown": first_pose_unknown,
        "--hypotheses": () if hypotheses is None else [hypotheses],
        "--against": [against] if against else (),
    }
    results = results_of(study, settings, learnt, folder, workers, _command(folder, out, options))
    if against is not None and before is not None:
        results["against"] = compare(against, before, study.trials)
    write_results(out, results, study.trials)
    if study.trials:
        with busy("drawing figures"):
            write_report(out, results, study.trials)
    if json:
        print_json({"report": str(out), **{key: results[key] for key in ("study", "table", "failed", "broken")}})
    else:
        report_study(out, results)
    return 3 if study.failed or study.broken else 0


def _command(folder: Path, out: Path, options: Mapping[str, Collection[object] | bool]) -> str:
    """The command line that makes the same report, without what only changes how long it takes."""
    told = [(option, *(() if given is True else given)) for option, given in options.items() if given]
    return shlex.join(
        map(str, ("palpate", "evaluate", folder, "--out", out, *(word for words in told for word in words)))
    )


def _complaints(study: "Study") -> Iterator[str]:
    """A line for each recording that is broken, and for each way in which some failed."""
    for name, why in study.broken.items():
        yield f"{name}: {why}"
    methods = defaultdict[tuple[str, str], list[str]](list)
    for (name, method), why in study.failed.items():
        methods[name, why].append(str(method))
    for (name, why), failed in methods.items():
        yield f"{name} by {', '.join(failed)}: {why}"
