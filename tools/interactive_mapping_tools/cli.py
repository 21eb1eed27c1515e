# SPDX-License-Identifier: BSD-3-Clause
"""What the commands have in common: their parser, and an error in one line."""

import argparse
import functools
import pathlib
import re
import sys


class Refusal(Exception):
    """The command cannot do it; the text says why, to its user."""


class UsageError(Exception):
    """The command cannot begin: an option is wrong, or something that it needs is not there."""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    def __init__(self, doc, needed="a value"):
        super().__init__(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
        self.needed = needed

    def error(self, message):
        raise UsageError(re.sub(r"argument (\S+): expected one argument", rf"\1 needs {self.needed}", message))


def parser_of(doc):
    return argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)


def file_error(error):
    """Of an OSError; a write knows no name."""
    return f"{error.filename}: {error.strerror}" if error.filename else error.strerror


def one_line_errors(main):
    """A Refusal or an error with a file ends the command with one line and code 1, a UsageError with 2; a main() without a result ends with 0."""
    @functools.wraps(main)
    def wrapped():
        try:
            return main() or 0
        except UsageError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        except Refusal as error:
            text = error
        except OSError as error:
            text = file_error(error)
        print(f"{pathlib.Path(sys.argv[0]).stem}: {text}", file=sys.stderr)
        return 1
    return wrapped
