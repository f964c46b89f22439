"""`python -m cascadenorm` is the command `cascadenorm`."""

from cascadenorm.cli import main

main()
