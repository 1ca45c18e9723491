"""`palpate paper`: the paper's experiments from nothing."""

from pathlib import Path
from typing import Annotated

from palpate.cli.options import Json, Workers, arg


def paper(
    *,
    out: Annotated[Path, arg("FOLDER", "required")],
    full: bool = False,
    seed: Annotated[int, arg("N")] = 0,
    workers: Workers = Workers(),
    json: Json = False,
) -> int:
    """Repeat the paper's experiments on simulated pushes: Table II, tracking by mode, figures 5 to 8 and 10 to 12.

    Example: palpate paper --out paper --workers 2

    Args:
        out: Folder of the study. Finished parts in it are kept, so that an interrupted run continues.
        full: As many sequences as the paper has, which takes hours.
        seed: The same seed gives the same recordings.
    """
    import dataclasses
    import os

    from palpate.cli.console import print_json, print_line, print_table, progress_bar
    from palpate.errors import SettingError

    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch starts threads that wait in a loop
    try:
        import gtsam  # noqa: F401
        import mujoco  # noqa: F401
        import torch  # noqa: F401
    except ImportError as error:
        needed = "pip install palpate[sim,train,paper]"
        raise SettingError(f"palpate paper needs {error.name}, which is not installed: {needed}") from error
    from palpate.lab.paper.study import FULL, StudySettings, run

    if seed < 0:
        raise SettingError(f"seed is {seed}; allowed is 0 or more")
    settings = dataclasses.replace(FULL if full else StudySettings(), seed=seed)
    results = run(out, settings, progress_bar, workers.workers, workers.dask)
    if json:
        print_json({"table2": results["table2"], "tracking": results["tracking"]})
        return 0
    datasets = ("disc", "rect", "ellip", "combined")
    rows = [[name, *(f"{1e3 * loss[each]:.2f}" for each in datasets)] for name, loss in results["table2"].items()]
    print_table("Table II: validation loss, in thousandths", ["model", *datasets], rows, numbers=range(1, 5))
    names = ("final_translation_mm", "final_rotation_deg", "lost", "in_95_share")
    rows = [[mode, *(f"{each[name]:.4g}" for name in names)] for mode, each in results["tracking"].items()]
    print_table("tracking, medians", ["mode", "final mm", "final deg", "lost", "in 95 %"], rows, numbers=range(1, 5))
    print_line(f"results.json and figures: {out}")
    return 0
