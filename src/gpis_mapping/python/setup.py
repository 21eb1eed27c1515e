# SPDX-License-Identifier: BSD-3-Clause
"""Builds the extension of the wheel with CMake; pyproject.toml has the rest."""

import os
import pathlib
import re
import shlex
import subprocess
import sys

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

FOLDER = pathlib.Path(__file__).resolve().parent


class CMakeBuild(build_ext):
    def build_extension(self, ext):
        target = pathlib.Path(self.get_ext_fullpath(ext.name)).resolve()
        build = pathlib.Path(self.build_temp).resolve()
        options = [f"-DPYTHON_EXECUTABLE={sys.executable}", f"-DPython3_EXECUTABLE={sys.executable}"]
        try:
            import pybind11  # pip's; otherwise CMake finds the system's
            options.append(f"-Dpybind11_DIR={pybind11.get_cmake_dir()}")
        except ImportError:
            pass
        subprocess.run(["cmake", "-S", FOLDER, "-B", build, *options, *shlex.split(os.environ.get("CMAKE_ARGS", ""))], check=True)
        subprocess.run(["cmake", "--build", build, "--target", "gpis_mapping_python", "--parallel", str(os.cpu_count())], check=True)
        target.parent.mkdir(parents=True, exist_ok=True)
        self.copy_file(str(build / "gpis_mapping" / target.name), str(target))


version = re.search(r"<version>(.*)</version>", (FOLDER.parent / "package.xml").read_text(encoding="utf-8"))[1]
setup(version=version, ext_modules=[Extension("gpis_mapping._core", sources=[])], cmdclass={"build_ext": CMakeBuild})
