"""A whole scene in Rerun: in a file, or in a viewer on this machine."""

from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import SettingError
from palpate.files import whole_file
from palpate.touch.calibration import view_of
from palpate.touch.view import AS_IT_IS
from palpate.viewer.blueprint import blueprint
from palpate.viewer.images import Image, jpeg, views
from palpate.viewer.rerun_log import SceneLog
from palpate.viewer.scene import Scene
from palpate.viewer.viewer import check_rerun, open_viewer

if TYPE_CHECKING:
    import rerun as rr

_PATIENCE = 20.0  # [s] for what is on its way
_AT_ONCE = 200  # images that are in memory together


def save_scene(scene: Scene, path: Path, force: bool = False) -> None:
    """Write a file for Rerun's viewer (.rrd), whole or not at all; FileError if it exists, unless `force`."""
    with whole_file(path, overwrite=force) as part:
        stream = open_stream(scene.name)
        stream.save(part, blueprint(scene, live=False))
        _send(stream, scene)
        close_stream(stream)


def show_scene(scene: Scene) -> None:
    """Open a viewer that shows the scene and stays when this process ends."""
    address = open_viewer()
    stream = open_stream(scene.name)
    stream.connect_grpc(address, default_blueprint=blueprint(scene, live=False))
    _send(stream, scene)
    close_stream(stream)


def open_stream(name: str) -> "rr.RecordingStream":
    """Return a stream of this name that goes nowhere yet. Raises SettingError where Rerun is not installed."""
    check_rerun()
    import rerun as rr

    stream = rr.RecordingStream("palpate")
    stream.send_recording_name(name)
    return stream


def close_stream(stream: "rr.RecordingStream") -> None:
    """Send what is on its way, and let go of file and viewer; SettingError where not all of it arrives."""
    try:
        stream.flush(timeout_sec=_PATIENCE)
    except RuntimeError as error:
        raise SettingError(f"the view is not whole: {error}") from error
    finally:
        stream.disconnect()


def _as_seen(scene: Scene, index: int, image: Image) -> bytes:
    """The image as it is in the recording, or, where a calibration turns it, as it lies then."""
    assert scene.recording.image is not None
    is_turned = view_of(scene.calibration) != AS_IT_IS
    return jpeg(image) if is_turned else scene.recording.image[index]


def _send(stream: "rr.RecordingStream", scene: Scene) -> None:
    recording = scene.recording
    log = SceneLog(stream, recording.shape, recording.sensor)
    log.send(scene)
    if recording.image is None:
        return
    pairs = enumerate(views(recording, scene.calibration))
    while some := list(islice(pairs, _AT_ONCE)):
        time = recording.time[[index for index, _ in some]]
        log.send_images("touch/image", time, [_as_seen(scene, index, image) for index, (image, _) in some])
        told = [seen is not None for _, (_, seen) in some]
        log.send_images("touch/seen", time[told], [jpeg(seen) for _, (_, seen) in some if seen is not None])
