"""Train a cascade with the options of `cascadenorm train`."""

import sys

from cascadenorm.cli import main

if __name__ == "__main__":
    main(["train", *sys.argv[1:]])
