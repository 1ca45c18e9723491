from palpate.compiled import *  # noqa: F403  (until all import it from there)
from palpate.compiled import is_cached  # noqa: F401
