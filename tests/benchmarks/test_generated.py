"""The generated shapes of benchmarks/, with fewer faces."""

from benchmarks.accuracy import generated


def test_relief_without_error_is_what_a_smoothing_method_removes(monkeypatch):
    monkeypatch.setattr(generated, "FACES", 1500)
    angles = generated.of_reliefs(2, methods=["taubin"])
    assert set(angles) >= {"waves of 4 edges", "scales of 12 edges"}
    assert all(0 < flat < 25 and smoothed > flat for flat, smoothed in angles.values()), angles
