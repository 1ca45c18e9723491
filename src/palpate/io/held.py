"""What data hold beyond what every format can."""

from palpate.types.recording import Recording
from palpate.types.trajectory import Trajectory

WORDS = {
    "image": "images",
    "contact": "contact flags",
    "episode": "contact episodes",
    "extra": "other measurements",
    "covariance": "covariances",
    "status": "statuses",
}


def present(data: Recording | Trajectory, *names: str) -> list[str]:
    """In words, those of the named fields that the data have."""
    fields = {name: getattr(data, name) for name in names}
    return [WORDS[name] for name, value in fields.items() if value is not None and len(value)]
