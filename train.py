"""Train a cascade: the same as `cascadenorm train`, with the same options."""

import sys

from cascadenorm.cli import main

if __name__ == "__main__":
    main(["train", *sys.argv[1:]])
