"""A function without a file is known by its code."""

from cascadenorm.evaluation.harness import evaluate
from cascadenorm.io.digests import source_digest


def test_a_function_without_a_file_is_known_by_its_code():
    def made(text):
        names = {"__name__": "no_module"}
        exec(text, names)
        return source_digest(names["smoothed"])

    code = "def helper(x):\n    return {} * x\ndef smoothed(x):\n    return helper(x)\n"
    assert made(code.format(2)) == made("\n\n" + code.format(2)) != made(code.format(3))
    assert source_digest(evaluate) == ""  # of this package, which has a version
