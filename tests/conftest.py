import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import settings

from palpate.cli.main import main
from palpate.tracker import warm_up

# A shared machine may stall for longer than any deadline; random inputs must not differ from run to run.
settings.register_profile("palpate", deadline=None, derandomize=True)
settings.load_profile("palpate")

# A shell ignores interrupts for what it runs in the background, and programs that tests start would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


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


@pytest.fixture(scope="session")
def command() -> Callable[..., int]:
    """Run a command of palpate in this process; returns its exit code. For fixtures that several tests share."""
    return lambda *words: main([str(word) for word in words])


@pytest.fixture
def run_palpate(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run a command of palpate in this process; returns its exit code and what it printed, output and errors."""

    def run(*words: object) -> tuple[int, str, str]:
        capsys.readouterr()
        try:
            code = main([str(word) for word in words])
        except SystemExit as stop:  # bad usage
            code = int(stop.code or 0)
        out, err = capsys.readouterr()
        return code, out, err

    return run


@pytest.fixture
def fails(run_palpate: Callable[..., tuple[int, str, str]]) -> Callable[..., str]:
    """Run a command that must fail because of its input; return its one line on standard error."""

    def run(*words: object) -> str:
        code, out, err = run_palpate(*words)
        assert (code, out) == (2, ""), err
        assert err.startswith("palpate: ") and err.count("\n") == 1
        return err

    return run


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs get an empty picture at once; what they would show is tested in tests/pipeline/test_run_figure.py."""
    blank = SimpleNamespace(savefig=lambda path, **_: path.write_bytes(b""))
    monkeypatch.setattr("palpate.pipeline.run_folder.run_figure", lambda run: blank)


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Any]:
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        lacking = "no chromium and chromedriver to open a page in: apt-get install chromium chromium-driver"
        if os.environ.get("CI") == "true" and shutil.which("apt-get"):
            pytest.fail(lacking)
        pytest.skip(lacking)
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    # No sandbox: root cannot have one, and the page is our own. The rest keeps Chromium from calling home.
    quiet = "no-first-run disable-background-networking disable-component-update disable-sync disable-quic"
    for flag in f"headless no-sandbox disable-gpu disable-dev-shm-usage {quiet}".split():
        options.add_argument(f"--{flag}")
    options.add_argument(f"--user-data-dir={tmp_path / 'profile'}")
    service = Service(driver)
    chrome = webdriver.Chrome(options=options, service=service)
    try:
        yield chrome
    finally:
        chrome.quit()
