"""Units that are easily taken for others."""

import numpy as np
import pytest

from palpate.errors import FileError, ShapeError
from palpate.geometry.shapes import Disc, Polygon, Rectangle
from palpate.types.units import check_metres, check_outline


@pytest.mark.parametrize(
    ("span", "words"),
    [
        (126.7, "are these millimetres or centimetres? times 0.001 makes it 0.127 m, times 0.01 makes it 1.27 m"),
        (12.67, "are these millimetres or centimetres? times 0.001 makes it 0.0127 m, times 0.01 makes it 0.127 m"),
        (1267.0, "are these millimetres? times 0.001 makes it 1.27 m"),
    ],
)
def test_positions_in_another_unit_are_asked_about(span, words):
    with pytest.raises(FileError) as found:
        check_metres("poses", np.array([[0.0, 0.0], [span, 0.1]]))
    assert str(found.value) == f"poses: found positions that span {span:.4g} m, allowed are 5 m: {words}"
    check_metres("poses", np.array([[0.0, 0.0], [4.9, 0.1]]))


@pytest.mark.parametrize("shape", [Rectangle(240, 160), Disc(50.0), Polygon([(0, 0), (90, 0), (90, 60)])])
def test_an_outline_in_millimetres_is_asked_about(shape):
    with pytest.raises(ShapeError, match=r"the outline is .* m wide, .* 0.005 to 2 m: are these millimetres"):
        check_outline(shape)


def test_an_outline_that_may_be_so_is_taken(caplog):
    check_outline(Disc(0.05))
    assert not caplog.records
    check_outline(Disc(1.5))
    assert "the outline is 3 m wide" in caplog.text
