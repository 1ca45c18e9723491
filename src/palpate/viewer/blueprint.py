"""How Rerun lays a scene out: the push from above, touch beside what the model saw of it, plots below one another."""

from typing import TYPE_CHECKING

import numpy as np

from palpate.viewer.rerun_log import PLANE, TIMELINE
from palpate.viewer.scene import Scene

if TYPE_CHECKING:
    import rerun.blueprint as rrb

_MARGIN = 0.02  # [m] around all that is seen from above


def blueprint(scene: Scene, live: bool) -> "rrb.Blueprint":
    """Return the layout for a scene; one that is tracked live follows the last frame."""
    import rerun.blueprint as rrb

    touch = rrb.Horizontal(
        rrb.Spatial2DView(origin="touch/image", name="Touch"),
        rrb.Spatial2DView(origin="touch/seen", name="What the model saw"),
    )
    left = rrb.Vertical(_above(scene), touch, row_shares=[3, 2]) if scene.recording.image is not None else _above(scene)
    return rrb.Blueprint(
        rrb.Horizontal(left, _plots(), column_shares=[3, 2]) if live or scene.estimate is not None else left,
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following" if live else "paused"),
        collapse_panels=True,
    )


def _above(scene: Scene) -> "rrb.Spatial2DView":
    import rerun.blueprint as rrb

    beginning, cursor = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    so_far = rrb.VisibleTimeRanges(timeline=TIMELINE, start=beginning, end=cursor)
    paths = [f"above/{name}/path" for name in ("truth", "estimate", "sensor")]
    low, high = _bounds(scene)
    return rrb.Spatial2DView(
        origin="above",
        name="From above [mm]",
        visual_bounds=rrb.VisualBounds2D(x_range=(low[0], high[0]), y_range=(low[1], high[1])),
        overrides=dict.fromkeys(paths, so_far),
    )


def _bounds(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """The corners of what sensor and object go over, with the object itself."""
    recording = scene.recording
    reach = np.hypot(*recording.shape.outline().T).max()
    corners = []
    for poses in (recording.sensor_pose, scene.truth, None if scene.estimate is None else scene.estimate.pose):
        if poses is not None and (known := poses[np.isfinite(poses).all(axis=1), :2]).size:
            margin = _MARGIN if poses is recording.sensor_pose and scene.truth is not None else reach + _MARGIN
            corners += [PLANE * (known.min(axis=0) - margin), PLANE * (known.max(axis=0) + margin)]
    return np.min(corners, axis=0), np.max(corners, axis=0)


def _plots() -> "rrb.Vertical":
    import rerun.blueprint as rrb

    legend = rrb.PlotLegend("LeftTop")
    return rrb.Vertical(
        rrb.TimeSeriesView(origin="translation", name="Translation [mm]", plot_legend=legend),
        rrb.TimeSeriesView(origin="rotation", name="Rotation [deg]", plot_legend=legend),
        rrb.TimeSeriesView(
            origin="friction", name="Friction, as learnt, with 1 sigma", plot_legend=rrb.PlotLegend(visible=False)
        ),
        rrb.StateTimelineView(origin="status", name="Status"),
        row_shares=[3, 3, 2, 1.5],
    )
