"""A path that branches share."""

import numpy as np

from palpate.graph.trail import Trail


def test_branches_go_their_own_ways():
    rows = np.arange(5000.0).reshape(2500, 2)
    trail = Trail()
    assert trail.rows().reshape(-1, 2).shape == (0, 2)
    trail.extend(rows[:3])
    for row in rows[3:2100]:
        trail.append(row)
    other = trail.copied()
    for row in rows[2100:]:
        trail.append(row)
    other.append(-rows[0] - 1.0)
    other.extend(rows[:2])
    np.testing.assert_array_equal(trail.rows(), rows)
    np.testing.assert_array_equal(other.rows(), [*rows[:2100], -rows[0] - 1.0, *rows[:2]])


def test_a_copy_of_a_long_one_holds_few_pieces():
    trail = Trail()
    for _ in range(100_000):
        trail.append(np.zeros(3))
    held = vars(trail.copied()).values()
    assert sum(map(len, held)) < 1200
    assert len(trail.rows()) == 100_000
