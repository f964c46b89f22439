"""Numbers as text: the fewest digits that restore their value, in the layout of Python."""

import numpy as np
import pytest

from cascadenorm.io.text.number_format import lines_of, replace_words, rows_of
from cascadenorm.io.text.text import Text


def formatted(values):
    """Format numbers in place of the words of a text."""
    return b"".join(replace_words(Text(b"x " * len(values)), (np.arange(len(values)), values))).split()


def of_all_sizes(kind):
    """Numbers of any bits, powers of two and of ten and those next to them, whole ones, short decimals."""
    draw, bits = np.random.default_rng(0), np.dtype(kind).itemsize * 8
    limits = np.finfo(kind)
    with np.errstate(over="ignore", under="ignore"):
        powers = np.concatenate(
            [
                2.0 ** np.arange(limits.minexp - limits.nmant, limits.maxexp),
                np.array([float(f"1e{e}") for e in range(-45 if bits == 32 else -323, limits.precision * 2)]),
            ]
        ).astype(kind)
        beside = [np.nextafter(powers, kind(to)) for to in (-np.inf, np.inf)]
    return np.concatenate(
        [
            draw.integers(0, 2**bits, 3000, dtype=np.uint64).astype(f"u{bits // 8}").view(kind),
            *(powers, -powers, *beside),
            draw.integers(-(2**62), 2**62, 300).astype(kind),
            np.arange(-300, 300).astype(kind),
            np.round(draw.normal(size=300), 4).astype(kind),
            np.array([0.0, -0.0, np.nan, -np.nan, np.inf, -np.inf, limits.max, limits.tiny], kind),
        ]
    )


def test_doubles_are_formatted_as_python_does():
    values = of_all_sizes(np.float64)
    assert formatted(values) == [repr(value).encode() for value in values.tolist()]


def test_single_precision_takes_the_fewest_digits():
    values = of_all_sizes(np.float32)
    words = formatted(values)
    assert np.array_equal(np.array([float(word) for word in words], np.float32), values, equal_nan=True)
    for value, word in zip(values[np.isfinite(values)], np.array(words)[np.isfinite(values)].tolist(), strict=True):
        shortest = np.format_float_scientific(value, unique=True, trim="-")
        assert float(word) == float(shortest)
        plain = value == 0 or 1e-4 <= abs(float(value)) < 1e6
        assert word == repr(float(shortest)).encode() or (not plain and b"e" in word)


def test_whole_numbers():
    values = np.array([0, 7, -7, 10, 99, 100, -(2**63), 2**63 - 1])
    assert formatted(values) == [b"%d" % value for value in values.tolist()]
    assert formatted(np.array([0, 255], np.uint8)) == [b"0", b"255"]


@pytest.mark.parametrize("keyword", [b"", b"v"])
def test_tables_side_by_side(keyword):
    first, second = np.array([[1.5, -2.0], [1e-7, 0.1]]), np.array([[3], [40]], np.uint8)
    begin = keyword + b" " * bool(keyword)
    assert lines_of(keyword, first, second) == begin + b"1.5 -2.0 3\n" + begin + b"1e-07 0.1 40\n"
    assert rows_of(second) == [b"3", b"40"]
    assert rows_of(np.zeros((0, 3))) == []


def test_long_tables_are_formatted_in_parts():
    table = np.arange(600_000).reshape(-1, 2)
    assert lines_of(b"f", table) == b"".join(b"f %d %d\n" % tuple(row) for row in table.tolist())


def test_words_of_a_long_text_are_replaced_by_numbers_of_two_types():
    words = [b"%d" % number for number in range(600_000)]
    text, first, second = Text(b"\t".join(words)), np.arange(5, 400_000, 7), np.arange(6, 400_000, 70)
    doubles, singles = first / 3, (second / 3).astype(np.float32)
    for word, value in zip([*first, *second], [*doubles, *singles], strict=True):
        words[word] = (repr(float(value)) if value.dtype == np.float64 else str(value)).encode()
    assert b"".join(replace_words(text, (first, doubles), (second, singles))) == b"\t".join(words)
    assert b"".join(replace_words(text)) == text.data
