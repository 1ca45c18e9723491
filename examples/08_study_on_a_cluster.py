"""Track every recording of a folder in two ways on a cluster, and print what came of it.

Here the cluster is this computer: two processes that listen on loopback only, without Dask's web page. With a cluster
of yours give the address of its scheduler instead; it has to see the same files. Needs the extras sim and cluster.

    palpate simulate recordings --count 4
    python 08_study_on_a_cluster.py recordings report

`palpate evaluate recordings --out report --dask ADDRESS` does the same.
"""

import sys
from pathlib import Path
from typing import Any

from distributed import LocalCluster

from palpate_lab.study.recordings import find_recordings
from palpate_lab.study.results import ALL, table
from palpate_lab.study.study import StudySettings, run_study

LOOPBACK = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}  # on any port that is free
HERE: dict[str, Any] = {"n_workers": 2, "threads_per_worker": 1, **LOOPBACK}
METHODS = ("none", "oracle")


def main(folder: Path, out: Path) -> None:
    """Track the recordings of a folder and write each trial to another; it can be interrupted and gone on with."""
    recordings = find_recordings(folder)
    cluster: Any = LocalCluster(**HERE)
    with cluster:
        study = run_study(recordings, out, StudySettings(METHODS), dask=cluster.scheduler_address, resume=out.exists())
    print(f"{len(study.trials)} runs of {len(recordings)} recordings, {study.kept} of them from before")
    for (name, method), why in {**study.skipped, **study.failed}.items():
        print(f"{name}, {method}: {why}")
    for method, row in table(study.trials, METHODS).get(ALL, {}).items():
        error = row["final_mm"]
        print(f"{method}: final error {error['median']:.1f} mm in the median, {error['worst']:.1f} mm at worst")


if __name__ == "__main__":  # the cluster's processes read this file, too
    main(Path(sys.argv[1]), Path(sys.argv[2]))
