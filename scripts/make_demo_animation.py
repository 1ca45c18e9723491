"""Makes docs/demo.gif: the push of `palpate demo` as it is tracked, by the pictures of a run's page.

python scripts/make_demo_animation.py [OUT]
"""

import sys
from pathlib import Path

from PIL import Image

from palpate.config import TrackerSettings
from palpate.pipeline.track import track
from palpate.viewer.page import pictures
from palpate_lab.simulate.recordings import demo_recording

if __name__ == "__main__":
    run = track(demo_recording(), TrackerSettings("learnt"))
    last = len(run.online) - 1
    drawn = [Image.fromarray(each) for each in pictures(run, [*range(0, last, 4), last])]
    palette = drawn[-1].quantize(256)
    drawn = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in drawn]
    durations = [90] * (len(drawn) - 1) + [1500]  # [ms]
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/demo.gif")
    drawn[0].save(out, save_all=True, append_images=drawn[1:], duration=durations, loop=0, optimize=True)
