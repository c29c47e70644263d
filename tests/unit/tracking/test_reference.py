"""How restless the background behind a pixel is, where a picture shows it and where it is a guess."""

import numpy as np
from nerfmodal.tracking.reference import _unrest

SIDE = 60


def test_a_guess_is_as_restless_as_what_is_known_around() -> None:
    rows, columns = np.indices((SIDE, SIDE))
    squares = (60 + 120 * ((rows // 4 + columns // 4) % 2)).astype(np.uint8)
    true = np.repeat(squares[..., None], 3, axis=2)
    known = np.ones((SIDE, SIDE), dtype=bool)
    known[22:38, 22:38] = False
    guessed = true.copy()
    guessed[~known] = 120  # smooth, as guesses are
    truth, found = _unrest(true, np.ones_like(known)), _unrest(guessed, known)
    np.testing.assert_allclose(np.median(found[26:34, 26:34]), np.median(truth[26:34, 26:34]), rtol=0.35)
    np.testing.assert_array_equal(found[:15], truth[:15])
    assert _unrest(guessed, np.ones_like(known))[28:32, 28:32].max() < 0.01
