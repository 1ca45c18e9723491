from pathlib import Path

import pytest
from hypothesis import settings

from palpate.estimation.warm_up import warm_up

# A shared machine may stall for longer than any deadline; random inputs must not differ from run to run.
settings.register_profile("palpate", deadline=None, derandomize=True)
settings.load_profile("palpate")


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """Compile the estimator, so that no test waits for it or sees what is said of it."""
    warm_up()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real data beside the repository."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("real data is not there: no folder ../shared/data")
    return folder
