# SPDX-License-Identifier: BSD-3-Clause
"""Sphinx' configuration of the site that scripts/docs builds. lay_out.py makes the folder of sources it reads."""

import pathlib
import re

project = "Interactive mapping"
author = "the authors of interactive_mapping"
version = release = re.search(r"<version>(.*)</version>", pathlib.Path("root/src/gpis_mapping/package.xml").read_text(encoding="utf-8"))[1]

extensions = ["myst_parser", "breathe"]
myst_heading_anchors = 4          # links to headings, as the git host has them
exclude_patterns = ["root"]

breathe_projects = {"api": "../doxygen/xml"}
breathe_default_project = "api"
breathe_default_members = ("members",)
breathe_show_include = False
primary_domain = "cpp"
highlight_language = "none"

html_theme = "furo"
html_title = f"{project} {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
