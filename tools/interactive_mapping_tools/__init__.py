# SPDX-License-Identifier: BSD-3-Clause
"""What scripts/ runs: missions and their reports, plots, tables, pictures and long checks."""

import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[2]  # of the repository
