"""Runs the chapter: `python -m chapters.chNN ...` is `strata run NN ...`."""

import sys

from chapters.__main__ import main

main(["run", __package__.rpartition("ch")[2].lstrip("0"), *sys.argv[1:]])
