# SPDX-License-Identifier: BSD-3-Clause
"""What the commands have in common: their parser, and an error in one line."""

import argparse
import functools
import pathlib
import sys


class Refusal(Exception):
    """The command cannot do it; the text says why, to its user."""


def parser_of(doc):
    return argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)


def one_line_errors(main):
    """A Refusal or an error with a file ends the command with one line and code 1; a main() without a result ends with 0."""
    @functools.wraps(main)
    def wrapped():
        try:
            return main() or 0
        except Refusal as error:
            text = error
        except OSError as error:
            text = f"{error.filename}: {error.strerror}"
        print(f"{pathlib.Path(sys.argv[0]).stem}: {text}", file=sys.stderr)
        return 1
    return wrapped
