"""`palpate warm-up`."""

from pathlib import Path

from palpate import compiled


def test_warm_up_says_where_compiled_code_is_kept(json_of, fails, monkeypatch):
    assert list(Path(json_of("warm-up")["folder"]).glob("*.nbc"))
    monkeypatch.setattr(compiled, "folder_of", lambda function: None)
    assert "set NUMBA_CACHE_DIR" in fails("warm-up")
