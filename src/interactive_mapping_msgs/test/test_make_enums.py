#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""make_enums on messages that are right and on broken ones; and the message files of this package against the marks in them."""

import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import rosunit

PACKAGE = pathlib.Path(__file__).resolve().parent.parent
GOOD = """# A comment.
# enum ArmStatus, names in UPPER_CASE
uint8 SUCCESS=0
uint8 NOT_READY=1  # the arm is off
uint8 NUM_STATUS=2
uint8 OUTSIDE=7
uint8 status
# enum Kind

uint8 IS_REAL = 0 # "real": a side that was seen
uint8 TOO_FAR = 1
string kind
# enum Step, names in snake_case
uint8 LET_GO=0
"""


class MakeEnums(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def run_on(self, **texts):
        """Files NAME.msg with these texts: exit code, what was said of them without the folder, the headers."""
        paths = []
        for name, text in texts.items():
            paths.append(self.folder / f"{name}.msg")
            paths[-1].write_text(text)
        done = subprocess.run([sys.executable, str(PACKAGE / "scripts" / "make_enums"), "--out", str(self.folder / "out"), *map(str, paths)],
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, check=False)
        headers = {path.name: path.read_text() for path in self.folder.glob("out/*")}
        return done.returncode, done.stderr.replace(f"{self.folder}/", "").splitlines(), headers

    def refused(self, text, *expected):
        code, problems, headers = self.run_on(Broken=text)
        self.assertEqual(code, 1)
        self.assertEqual(problems, list(expected))
        self.assertEqual(headers, {})

    def test_values_and_names_are_those_of_the_message(self):
        code, problems, headers = self.run_on(ArmState=GOOD)
        self.assertEqual((code, problems), (0, []))
        self.assertEqual(list(headers), ["arm_state.h"])
        body = headers["arm_state.h"]
        self.assertEqual(re.findall(r"enum class (\w+) : std::uint8_t {\n(.*?)};", body, re.DOTALL), [
            ("ArmStatus", "  kSuccess = 0,\n  kNotReady = 1,  // the arm is off\n"),
            ("Kind", "  kIsReal = 0,  // a side that was seen\n  kTooFar = 1,\n"),
            ("Step", "  kLetGo = 0,\n")])
        self.assertEqual(re.findall(r'{"(.*)", (\w+::\w+)}', body), [
            ("SUCCESS", "ArmStatus::kSuccess"), ("NOT_READY", "ArmStatus::kNotReady"), ("real", "Kind::kIsReal"), ("too far", "Kind::kTooFar"),
            ("let_go", "Step::kLetGo")])
        self.assertEqual(re.findall(r"int kNum(\w+) = (\d+);", body), [("ArmStatus", "2"), ("Kind", "2"), ("Step", "1")])

    def test_header_compiles(self):
        self.run_on(ArmState=GOOD)
        (self.folder / "use.cpp").write_text("""#include "out/arm_state.h"
using namespace interactive_mapping;
constexpr bool same(const char* a, const char* b) { return *a == *b && (*a == 0 || same(a + 1, b + 1)); }
static_assert(same(toString(ArmStatus::kNotReady), "NOT_READY") && same(toString(Kind::kTooFar), "too far"), "names");
static_assert(same(toString(static_cast<Kind>(2)), "?") && kNumKind == 2 && kKindNames.size() == 2 && sizeof(Kind) == 1, "numbers");
""")
        common = PACKAGE.parent / "interactive_mapping_common" / "include"
        done = subprocess.run([os.environ.get("CXX", "c++"), "-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-I", str(common),
                               str(self.folder / "use.cpp")], stderr=subprocess.PIPE, universal_newlines=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_unchanged_header_keeps_its_time(self):
        text = GOOD
        self.run_on(ArmState=text)
        header = self.folder / "out" / "arm_state.h"
        os.utime(header, (1, 1))
        self.run_on(ArmState=text + "float32 more\n")
        self.assertEqual(header.stat().st_mtime, 1)
        self.run_on(ArmState=text.replace("the arm is off", "no power"))
        self.assertGreater(header.stat().st_mtime, 1)

    def test_what_is_wrong_is_said_with_file_and_line(self):
        for text, problem in (
                ("uint8 A=0\nint8 B=1\nuint8 C=2\n", "3: B is of type int8, must be uint8 as every constant of enum E"),
                ("string A=0\n", "2: A is of type string, must be uint8 as every constant of enum E"),
                ("uint8 A=0\nuint8 B=0\nuint8 C=2\n", "3: B = 0, must be 1: the values of enum E count up from 0"),
                ("uint8 A=0\nuint8 B=2\n", "3: B = 2, must be 1: the values of enum E count up from 0"),
                ("uint8 A=-1\n", "2: A = -1, must be 0: the values of enum E count up from 0"),
                ("uint8 A=zero\n", "2: A = zero, must be 0: the values of enum E count up from 0"),
                ("uint8 A=0\nuint8 NUM_E=2\n", "3: NUM_E = 2, must be 1: the values of enum E count up from 0"),
                ("uint8 A=0\nuint8 A=1\n", "3: A is twice in enum E"),
                ('uint8 A=0\nuint8 B=1 # "a"\n', '3: B has the name "a" of A, must have one of its own'),
                ("uint8 lower=0\nuint8 A=0\n", '2: "uint8 lower=0", must be "uint8 NAME=VALUE" in enum E'),
                ("uint8 e\nuint8 A=0\n", "1: enum E has no constants"),
                ("---\nuint8 A=0\n", "1: enum E has no constants"),
        ):
            with self.subTest(text):
                self.refused("# enum E\n" + text, f"Broken.msg:{problem}")

    def test_wrong_mark_is_refused(self):
        for mark in ("# enum lower", "# enum E names in snake_case", "# enum E, names in CamelCase"):
            with self.subTest(mark):
                code, problems, _ = self.run_on(Broken=f"uint8 e\n{mark}\n# enum F\nuint8 A=0\n")
                self.assertEqual(code, 1)
                self.assertEqual(len(problems), 1)
                self.assertTrue(problems[0].startswith(f'Broken.msg:2: "{mark}", must be "# enum CamelCase"'), problems[0])

    def test_file_without_enumeration_is_refused(self):
        self.refused("uint8 A=0\nuint8 status\n", 'Broken.msg: has no line "# enum NAME"')

    def test_all_problems_are_listed(self):
        self.refused("# enum E\nint8 A=0\nuint8 B=3\nuint8 C=2\n",
                     "Broken.msg:2: A is of type int8, must be uint8 as every constant of enum E",
                     "Broken.msg:3: B = 3, must be 1: the values of enum E count up from 0")

    def test_enumeration_in_two_files_is_refused(self):
        code, problems, headers = self.run_on(One="# enum E\nuint8 A=0\n", Two="uint8 x\n# enum E\nuint8 A=0\n")
        self.assertEqual((code, problems, headers), (1, ["Two.msg:2: enum E is already in One.msg:1"], {}))

    def test_every_marked_message_is_made(self):
        marked = {str(path.relative_to(PACKAGE)) for folder in ("msg", "srv", "action") for path in (PACKAGE / folder).iterdir()
                  if re.search(r"^# enum ", path.read_text(encoding="utf-8"), re.MULTILINE)}
        listed = re.search(r"set\(enum_files(.*?)\)", (PACKAGE / "enums/CMakeLists.txt").read_text(encoding="utf-8"), re.DOTALL).group(1).split()
        self.assertEqual(sorted(marked), listed)


if __name__ == "__main__":
    rosunit.unitrun("interactive_mapping_msgs", "test_make_enums", MakeEnums)
