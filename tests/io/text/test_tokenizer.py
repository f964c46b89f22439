"""Numbers in text are those that Python reads, to the last bit."""

import re

import numpy as np
import pytest

from cascadenorm.io.text.text import Text


def shortest(random: np.random.Generator) -> str:
    return repr(float(random.normal() * 10.0 ** random.integers(-4, 5)))


def fixed(random: np.random.Generator) -> str:
    return f"{random.normal():.{random.integers(10, 20)}f}"


def scientific(random: np.random.Generator) -> str:
    return f"{random.normal():.16e}"


def any_point(random: np.random.Generator) -> str:
    digits = str(random.integers(10**18))
    place = random.integers(len(digits) + 1)
    return f"{digits[:place]}.{digits[place:]}"


def halfway(random: np.random.Generator) -> str:
    """Half of an odd number of 54 bits, and the like: as near to one double as to the next."""
    power = int(random.integers(1, 10))
    digits = str((int(random.integers(2**53, 2**54)) | 1) * 5**power).zfill(power + 1)
    return f"{digits[:-power]}.{digits[-power:]}"


@pytest.mark.parametrize("spell", [shortest, fixed, scientific, any_point, halfway])
def test_decimals_are_rounded_as_python_rounds_them(spell):
    random = np.random.default_rng(0)
    words = [spell(random) for _ in range(4000)]
    found = Text(" ".join(words).encode()).numbers(np.arange(len(words)))
    assert found.tolist() == [float(word) for word in words]


@pytest.mark.parametrize("letters", [b"a\x01\xff", b"\x01\x1f", b"a \n"])
def test_words_are_what_lies_between_white_space_whatever_their_bytes(letters):
    data = np.random.default_rng(0).choice(np.frombuffer(letters + b"\x00\t\r ", np.uint8), 5000).tobytes()
    text = Text(data)
    assert [text.word(i) for i in range(len(text.starts))] == re.findall(rb"[^\x00\t-\r ]+", data)
    lines = [line for line in re.split(rb"[\r\n]", data) if line.strip(b"\x00\t\v\f ")]
    assert [text.word(i) for i in text.first] == [re.findall(rb"[^\x00\t-\r ]+", line)[0] for line in lines]
    assert text.stop[-1] == len(text.starts)
