"""`palpate warm-up`."""

from pathlib import Path

from numba.core.caching import NullCache


def test_warm_up_says_where_compiled_code_is_kept(json_of, fails, monkeypatch):
    assert list(Path(json_of("warm-up")["folder"]).glob("*.nbc"))
    monkeypatch.setattr("palpate.models.pushing.compiled.PUSHING.improve._cache", NullCache())
    assert "set NUMBA_CACHE_DIR" in fails("warm-up")
