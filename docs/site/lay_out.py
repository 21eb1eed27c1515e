#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Lays out in FOLDER what Sphinx reads: the repository's Markdown pages at their places, pictures, a page for each file
that is a reference in itself or that a page links to, and a page of the API for each package with public headers."""

import os
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = ("*.md", "docker/*.md", "docs/*.md", "docs/results/*.md", "docs/tutorials/*.md", "docs/example_map/*.md", "src/**/*.md", "sim_tests/**/*.md",
         "examples/**/*.md")
PARAMETERS = ("src/*/config/*.yaml", "sim_tests/simulated_world/config/*.yaml")
MESSAGES = ("src/interactive_mapping_msgs/action/*.action", "src/interactive_mapping_msgs/srv/*.srv", "src/interactive_mapping_msgs/msg/*.msg")
NAMESPACES = {"interactive_mapping_common": "interactive_mapping"}  # where it is not the package's name
COPIED = {".png", ".jpg", ".gif", ".svg", ".ply"}
LINK = re.compile(r"(\]\()([^)\s#:]+)(\))")
LEXERS = {".yaml": "yaml", ".py": "python", ".h": "cpp", ".cpp": "cpp", ".launch": "xml", ".xml": "xml"}


def listed(patterns):
    return sorted({path.relative_to(ROOT) for pattern in patterns for path in ROOT.glob(pattern) if path.is_file()})


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def file_page(folder, name):
    """The page NAME.md of a file that is no page: its text, highlighted."""
    text = (ROOT / name).read_text(encoding="utf-8")
    where = f"`{name.parent}`\n\n" if name.parent.parts else ""
    write(folder / f"{name}.md", f"---\norphan: true\nhide-toc: true\n---\n# {name.name}\n\n{where}````{LEXERS.get(name.suffix, 'none')}\n{text.rstrip()}\n````\n")


def contents(names):
    return "\n".join(["```{toctree}", ":maxdepth: 1", "", *names, "```", ""])


def lay_out(folder):
    own = pathlib.Path(__file__).resolve().parent
    folder.mkdir(parents=True)
    (folder / "root").symlink_to(ROOT)
    for name in own.glob("*.md"):
        write(folder / name.name, name.read_text(encoding="utf-8"))
    write(folder / "_static/site.css", (own / "site.css").read_text(encoding="utf-8"))
    write(folder / "conf.py", (own / "conf.py").read_text(encoding="utf-8"))

    files = set(listed(PARAMETERS + MESSAGES))
    for name in listed(PAGES):
        def place_of(link, base=name.parent):
            target = pathlib.Path(os.path.normpath(base / link[2]))
            if target.suffix == ".md" or not (ROOT / target).is_file():
                return link[0]
            if target.suffix in COPIED:
                write(folder / target, "")
                (folder / target).write_bytes((ROOT / target).read_bytes())
                return link[0]
            files.add(target)
            return f"{link[1]}{link[2]}.md{link[3]}"
        write(folder / name, LINK.sub(place_of, (ROOT / name).read_text(encoding="utf-8")))
    for name in files:
        file_page(folder, name)

    text = "# Parameters\n\nThe shipped files, made from the code: every key with its default, range, unit and meaning.\n\n"
    for package in sorted({name.parts[1] for name in listed(PARAMETERS)}):
        text += f"## {package}\n\n" + contents(f"/{name}" for name in listed(PARAMETERS) if name.parts[1] == package) + "\n"
    write(folder / "parameters.md", text)
    text = "# Messages, services, actions\n\nOf the package [interactive_mapping_msgs](src/interactive_mapping_msgs/README.md).\n\n"
    for title, pattern in zip(("Actions", "Services", "Messages"), MESSAGES):
        text += f"## {title}\n\n" + contents(f"/{name}" for name in listed([pattern])) + "\n"
    write(folder / "messages.md", text)

    packages = sorted(path for path in ROOT.glob("src/*/include/*") if path.name == path.parts[-3])
    for package in packages:
        name = package.name
        namespace = NAMESPACES.get(name, name)
        write(folder / f"api/{name}.rst", f"{name}\n{'=' * len(name)}\n\nWhat it does: :doc:`/src/{name}/README`.\n\n"
              f".. doxygennamespace:: {namespace}\n   :content-only:\n   :members:\n   :undoc-members:\n")
    write(folder / "api/index.md", "# C++ API\n\nThe public headers of each package; none of them needs ROS.\n\n" + contents(path.name for path in packages))


if __name__ == "__main__":
    lay_out(pathlib.Path(sys.argv[1]))
