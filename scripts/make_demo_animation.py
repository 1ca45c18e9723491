"""Makes docs/demo.gif: the push of `palpate demo` as it is tracked.

python scripts/make_demo_animation.py [OUT]
"""

import sys
from pathlib import Path

from palpate.config import TrackerSettings
from palpate.pipeline.track import track
from palpate.viewer.video import write_video
from palpate_lab.simulate.recordings import demo_recording

if __name__ == "__main__":
    run = track(demo_recording(), TrackerSettings("learnt"))
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/demo.gif")
    write_video(run, out, ".gif")
