#!/usr/bin/env python3
"""check_sources.py finds std::to_string() of floating-point numbers, and leaves that of others alone."""
import os
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


if __name__ == "__main__":
    unittest.main()
