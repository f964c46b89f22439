"""Compare the method with others on pairs: python compare.py PAIRS [further options of cascadenorm evaluate]"""

import sys

import denoiser

from cascadenorm.cli import run

OTHERS = ("auto", "bilateral-normal", "guided-normal")
OUTPUT = ["--html", "comparison.html", "--latex", "comparison.tex", "--csv", "comparison.csv"]

if __name__ == "__main__":
    methods = [word for name in (denoiser.NAME, *OTHERS) for word in ("--method", name)]
    sys.exit(run(["evaluate", *sys.argv[1:], *methods, *OUTPUT]))
