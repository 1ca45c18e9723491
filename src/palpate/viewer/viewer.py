"""Rerun's viewer as a process of its own, which only this machine can reach and which reports to nobody."""

import os
import socket
import subprocess
import sys
import time

from palpate.errors import SettingError
from palpate.graph.compiled import cache_folder

_COMMAND = (sys.executable, "-m", "rerun_cli")
_MEMORY, _SERVER_MEMORY = "1GiB", "256MiB"  # the oldest data go first
_PATIENCE = 30.0  # [s] until a viewer listens
_WINDOW = 1.0  # [s] from then on in which it fails where it can open no window


def check_rerun() -> None:
    """Raise SettingError where Rerun is not installed."""
    try:
        import rerun  # noqa: F401
    except ImportError as error:
        raise SettingError("the viewer needs rerun-sdk, which is not installed: pip install palpate[view]") from error


def has_display() -> bool:
    """Whether a window can be opened."""
    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_viewer(*mode: str) -> str:
    """Start a viewer that outlives this process and return its address; SettingError where it does not come up.

    `mode` are further options of Rerun's command line.
    """
    environment = quiet_environment()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen(
        [*_COMMAND, *_options(port), *mode],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    last = time.monotonic() + _PATIENCE
    while time.monotonic() < last and process.poll() is None:
        with socket.socket() as attempt:
            is_listening = attempt.connect_ex(("127.0.0.1", port)) == 0
        if not _ends_within(process, _WINDOW if is_listening else 0.05) and is_listening:
            return f"rerun+http://127.0.0.1:{port}/proxy"
    process.kill()
    process.wait()
    raise SettingError("the viewer does not start; `rerun` by itself says why, and a file can be written instead")


def _ends_within(process: subprocess.Popen[bytes], seconds: float) -> bool:
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def quiet_environment() -> dict[str, str]:
    """Return the environment of a Rerun that sends no analytics: with settings of its own, in which they are off.

    Rerun looks for them in XDG_CONFIG_HOME on Linux; elsewhere they are those of the user, who then sends none either.
    """
    home = cache_folder().parent / "rerun"
    environment = {**os.environ, "XDG_CONFIG_HOME": str(home), "XDG_DATA_HOME": str(home)}
    turned_off = subprocess.run([*_COMMAND, "analytics", "disable"], env=environment, capture_output=True)
    if turned_off.returncode:
        raise SettingError(f"the viewer's analytics cannot be turned off in {home}, so it is not started")
    return environment


def _options(port: int) -> list[str]:
    limits = ["--memory-limit", _MEMORY, "--server-memory-limit", _SERVER_MEMORY]
    return ["--bind", "127.0.0.1", "--port", str(port), *limits, "--hide-welcome-screen", "--expect-data-soon"]
