from pathlib import Path

import pytest
from hypothesis import settings

# A shared machine may stall for longer than any deadline; random inputs must not differ from run to run.
settings.register_profile("palpate", deadline=None, derandomize=True)
settings.load_profile("palpate")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real data beside the repository."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("real data is not there: no folder ../shared/data")
    return folder
