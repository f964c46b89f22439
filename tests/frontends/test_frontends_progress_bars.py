"""A bar shows the fraction of the work that is done."""

from shapes import icosphere, noisy

import cascadenorm as cn

ROUGH = noisy(icosphere(3), 0.2)


def test_a_bar_shows_the_fraction_that_is_done(capsys):
    with cn.progress_bar("Smoothing") as progress:
        cn.denoise(ROUGH, method="laplacian", iterations=3, progress=progress)
    shown = capsys.readouterr().err
    assert "Smoothing:   0%" in shown and "Smoothing: 100%" in shown
