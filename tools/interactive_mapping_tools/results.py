# SPDX-License-Identifier: BSD-3-Clause
"""What programs measured, as tables and plots: reading it, Markdown, the part of a document that holds it."""

import csv
import json
import math
import pathlib

from .cli import Refusal, one_line_errors, parser_of


def read_json(path):
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise Refusal(f"{path}: {error}") from None


def read_rows(path, texts=()):
    """[{column: number}] of a CSV file, but for columns of texts."""
    with path.open(encoding="utf-8", newline="") as stream:
        rows = [{key: value if key in texts else float(value) for key, value in row.items()}
                for row in csv.DictReader(stream)]
    if not rows:
        raise Refusal(f"{path}: holds no row")
    return rows


def read_machine(path):
    """{"date": ..., "commit": ...} of machine.txt; empty without it."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return dict(line.split(None, 1) for line in lines if len(line.split(None, 1)) == 2)


def measured(machine):
    return (f"Measured {machine.get('date', 'at an unknown date')} on "
            f"{machine.get('processor', 'an unknown machine')}; "
            f"{machine.get('compiler', 'unknown compiler')}, {machine.get('build', 'unknown build')}; "
            f"load {machine.get('load', 'unknown')}; commit {machine.get('commit', 'unknown')}.")


def number(value, form):
    return "-" if value is None or math.isnan(value) else format(value, form)


def holds(is_so):
    return "yes" if is_so else "**no**"


def markdown(rows):
    rows = [[str(cell) for cell in row] for row in rows]
    rule = ["---"] + ["---:"] * (len(rows[0]) - 1)
    return "\n".join("| " + " | ".join(row) + " |" for row in (rows[0], rule, *rows[1:]))


def replace_between_marks(path, name, text):
    begin_mark, end_mark = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    content = path.read_text(encoding="utf-8")
    begin, end = content.find(begin_mark), content.find(end_mark)
    if begin < 0 or end < begin:
        raise Refusal(f"{path}: the marks {begin_mark} and {end_mark} are missing")
    path.write_text(content[:begin + len(begin_mark)] + "\n" + text + content[end:], encoding="utf-8")


def main_of(doc, plots, read, texts_of):
    """main() of a command that draws and tabulates a folder of results. read(folder): what was measured; plots:
    {option: function of that and a path}; texts_of: {mark in the document: Markdown} of that, the first is the
    table."""
    @one_line_errors
    def main():
        parser = parser_of(doc)
        parser.add_argument("folder", type=pathlib.Path, metavar="RESULTS", help="results/bench")
        for option in plots:
            parser.add_argument(f"--{option}", type=pathlib.Path, metavar="PNG")
        parser.add_argument("--table", type=pathlib.Path, metavar="MD")
        parser.add_argument("--document", type=pathlib.Path, metavar="MD", help="replace the part between the marks")
        arguments = vars(parser.parse_args())
        try:
            result = read(arguments["folder"])
            texts = texts_of(result)
            for option, draw in plots.items():
                out = arguments[option.replace("-", "_")]
                if out:
                    draw(result, out)
                    print(out)
        except (AttributeError, KeyError, StopIteration, TypeError, ValueError) as error:
            raise Refusal(f"a result is missing or not a number: {error!r}") from error
        if arguments["table"]:
            arguments["table"].write_text(next(iter(texts.values())), encoding="utf-8")
            print(arguments["table"])
        if arguments["document"]:
            for name, text in texts.items():
                replace_between_marks(arguments["document"], name, text)
            print(arguments["document"])
    return main
