#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""check_sources.py finds std::to_string() of floating-point numbers, classes in several files, folders without a description, and what
programs left at the top."""
import os
import subprocess
import tempfile
import unittest

import check_sources

HEADER = "#pragma once\nstruct Options {\n  double share = 0.5, shape = 0;\n  int rings = 1;\n  Vec3 centre;\n  double ambiguous;\n};\n"
OTHER = "#pragma once\nstruct Counts {\n  std::size_t ambiguous;\n};\n"

FLOATING = [
    "std::to_string(options.share)",
    "std::to_string(options.shape)",
    "std::to_string(options.centre[2])",
    "std::to_string(0.5)",
    "std::to_string(static_cast<double>(n) / 2)",
    "std::to_string(std::sqrt(n))",
    "double x = f();\nstd::to_string(x)",
    "void f(const std::vector<double>& values) { std::to_string(values[0]); }",
    "void f(double value) { g(std::to_string(value) + std::to_string(1)); }",
    "double limit(int i);\nstd::to_string(limit())",
]
OTHERS = [
    "std::to_string(options.rings)",
    "std::to_string(values.size())",
    "std::to_string(counts.ambiguous)",
    "std::to_string(static_cast<int>(share))",
    "const auto [share, most] = counts();\nstd::to_string(share)",
    "std::size_t share = 1;\nstd::to_string(share)",
    "std::to_string(std::numeric_limits<std::uint32_t>::max())",
    "number_digits(options.share)",
]


class Tests(unittest.TestCase):
    def test_each_source_has_a_namespace_of_its_own(self):
        def findings(path, text):
            return [line for line, _ in check_sources.check(path, text.splitlines())]

        self.assertEqual(findings("mesh_test.cpp", "namespace deform::io::mesh_test {\nnamespace {\n"), [])
        for text in ("namespace deform {\nnamespace {\n", "namespace deform::other_mesh_test {\n", "// namespace deform::mesh_test {\n"):
            self.assertEqual(findings("mesh_test.cpp", text), [1], text)
        self.assertEqual(findings("mesh.cpp", "namespace deform {\n"), [])


class Language(unittest.TestCase):
    def check(self, path, text, left=None):
        return list(check_sources.check_language(path, text.splitlines(), left or {}))

    def test_comments_begin_with_their_subject(self):
        of = "O" + "f the points."
        for text in (f"/// {of}", f"int n;  ///< {of}", f"// {of}", f'"""{of}"""', f'add("--seed", seed, "{of}")'):
            self.assertEqual([line for line, _ in self.check("tests/a.cpp", "\n" + text)], [2], text)
        for text in ("/// The number of points.", "int n;  ///< of the points", "f(Of());  // Offset"):
            self.assertEqual(self.check("core/a.cpp", text), [], text)

    def test_people_do_not_act_for_data(self):
        for text in ("/// Errors that are told.", "v1::Info told;", "// null: nobody looks at it", "/// Nobody knows.", "picked(1)"):
            self.assertEqual(len(self.check("server/a.h", text)), 1, text)
            self.assertEqual(self.check("tests/a.h", text), [], text)
        self.assertEqual(self.check("server/a.h", "/// A server that asks nobody who calls. Foretold."), [])

    def test_what_is_left_falls(self):
        text = "told\ntold\n"
        self.assertEqual(self.check("core/a.h", text, {"core/a.h": 2}), [])
        self.assertEqual([line for line, _ in self.check("core/a.h", text, {"core/a.h": 1})], [2])
        self.assertIn("lower it", self.check("core/a.h", text, {"core/a.h": 3})[0][1])


class FloatingNumbers(unittest.TestCase):
    def check(self, text):
        with tempfile.TemporaryDirectory() as root:
            os.makedirs(os.path.join(root, "core"))
            for name, header in (("a.h", HEADER), ("b.h", OTHER)):
                with open(os.path.join(root, "core", name), "w", encoding="utf-8") as file:
                    file.write(header)
            return list(check_sources.FloatingNumbers(root).check(text))

    def test_floating_numbers_are_found(self):
        for text in FLOATING:
            findings = self.check(text)
            self.assertEqual(len(findings), 1, text)
            self.assertIn("number_digits()", findings[0][1])

    def test_the_line_is_told(self):
        self.assertEqual([line for line, _ in self.check("\n\nf(std::to_string(0.5));\n")], [3])

    def test_other_numbers_are_left_alone(self):
        for text in OTHERS:
            self.assertEqual(self.check(text), [], text)


BODY = "#pragma once\nnamespace deform {\nclass Body {\n  void lift();\n  struct Part {\n    void turn();\n  };\n};\n}\n"


def source(*definitions, before=""):
    return "namespace deform {\n" + before + "\n".join(f"{each} {{\n  work();\n}}" for each in definitions) + "\n}  // namespace deform\n"


class OneClassOneFile(unittest.TestCase):
    def check(self, first, second, scattered=()):
        classes = check_sources.Classes()
        for path, text in (("core/body.h", BODY), ("core/a.cpp", first), ("core/b.cpp", second)):
            classes.add(path, text)
        return classes.findings(set(scattered))

    def test_members_in_two_files_are_found(self):
        for member in ("Body::Body()", "Body::~Body()", "std::vector<Id> Body::lift(double by) const", "bool Body::operator==(const Body& b) const",
                       "Body::operator bool() const", "template <typename T>\nT Body::as(int)", "std::unique_ptr<const Body>\nBody::copy()"):
            found = self.check(source("void Body::lift()"), source("void f()", member))
            self.assertEqual([place[0] for place in found], ["core/b.cpp"], member)
            self.assertIn("deform::Body", found[0][2])

    def test_the_line_of_the_first_member_is_named(self):
        self.assertEqual([place[1] for place in self.check(source("void Body::lift()"), source("void f()", "void Body::lift()", "Body::Body()"))], [5])

    def test_nested_classes_count_for_themselves(self):
        self.assertEqual(self.check(source("void Body::lift()"), source("void Body::Part::turn()")), [])
        self.assertEqual(len(self.check(source("void Body::Part::turn()"), source("void Body::Part::turn()"))), 1)

    def test_uses_of_a_class_are_no_definitions(self):
        for use in ("void f(Body::Part part)", "const int x = Body::count(", "void quality::measure()"):
            self.assertEqual(self.check(source("void Body::lift()", "void quality::add()"), source(use)), [], use)

    def test_classes_of_one_source_file_may_share_a_name(self):
        local = source("Body::Body()", before="namespace {\nclass Body {\n  Body();\n};\n}  // namespace\n")
        self.assertEqual(self.check(source("void Body::lift()"), local), [])
        other = source("void Body::lift()").replace("namespace deform", "namespace deform::io")
        self.assertEqual(self.check(source("void Body::lift()"), other), [])

    def test_the_list_of_exceptions_only_shrinks(self):
        twice = source("void Body::lift()"), source("Body::Body()")
        self.assertEqual(self.check(*twice, ["deform::Body"]), [])
        found = self.check(source("void Body::lift()", "Body::Body()"), source("void f()"), ["deform::Body"])
        self.assertEqual([place[0] for place in found], ["tests/support/check_sources.py"])


class Folders(unittest.TestCase):
    SAID = "# Body\n\nWhat lives here.\n"

    def check(self, folder, names, text):
        return list(check_sources.check_folder(folder, names, text))

    def test_folders_with_sources_are_described(self):
        self.assertEqual(len(self.check("core/body", ["a.h", "a.cpp"], None)), 1)
        self.assertEqual(self.check("core/body", ["a.h", "a.cpp"], self.SAID), [])
        self.assertEqual(len(self.check("core/body", ["a.h"], "\n")), 1)
        self.assertEqual(len(self.check("core/body", ["a.h"], 30 * "line\n")), 1)
        self.assertEqual(self.check("core", ["CMakeLists.txt"], None), [])

    def test_folders_have_rooms(self):
        names = [f"part{i}{end}" for i in range(25) for end in (".h", ".cpp")]
        self.assertEqual(self.check("core/io/formats/body", names, self.SAID), [])
        self.assertEqual(len(self.check("core/io/formats/body", names + ["one_more.h"], self.SAID)), 1)
        self.assertEqual(self.check("core/quality", names + ["one_more.h"], self.SAID), [])


class Top(unittest.TestCase):
    def test_what_a_program_left_is_found(self):
        with tempfile.TemporaryDirectory() as root:
            self.assertEqual(check_sources.check_top(root), [], "no repository")
            subprocess.run(["git", "-C", root, "init", "-q"], check=True)
            for name in ("core/a.h", ".hidden", "README.md", "some_bench/data/lock", "log"):
                os.makedirs(os.path.dirname(os.path.join(root, name)), exist_ok=True)
                with open(os.path.join(root, name), "w", encoding="utf-8"):
                    pass
            self.assertEqual(check_sources.check_top(root), [], "nothing is tracked")
            subprocess.run(["git", "-C", root, "add", "-A"], check=True)
            self.assertEqual(check_sources.check_top(root), ["log", "some_bench"])


if __name__ == "__main__":
    unittest.main()
