# SPDX-License-Identifier: GPL-3.0-or-later
"""Manual pages and completion know every command and option that --help names."""

import os
import re
import shutil
import subprocess
import sys
import unittest

PAGES = os.environ["DEFORM_PAGES"]
PROGRAMS = {"deform": os.environ["DEFORM_BIN"], "deformd": os.environ["DEFORMD_BIN"]}
FILES = {"bash": "{}", "zsh": "_{}", "fish": "{}.fish"}


def run(*command, text=None):
    done = subprocess.run(command, input=text, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode != 0:
        raise AssertionError(f"{' '.join(command)}\n{done.stdout}")
    return done.stdout


def read(*names):
    with open(os.path.join(PAGES, *names), encoding="utf-8") as file:
        return file.read()


def options_in(text):
    """The options of a help text: in their column, at the beginning of a line."""
    return {name for names in re.findall(r"^  ((?:-{1,2}[\w-]+,?)+)", text, re.M) for name in names.split(",") if name}


def help_of(words):
    return run(PROGRAMS[words[0]], *words[1:], "--help")


def all_commands():
    """(words, names of its commands, its options) of every command, from what the programs say."""
    waiting = [("deform",), ("deformd",), ("deformd", "store")]
    while waiting:
        words = waiting.pop()
        text = help_of(words)
        commands = re.findall(r"^  (\w[\w-]*) ", text.split("Subcommands:")[1].split("\n\n")[0], re.M) if "Subcommands:" in text else []
        waiting += [(*words, name) for name in commands]
        options = options_in(text)
        if len(words) > 1 and words != ("deformd", "store"):
            options |= options_in(help_of(words[:-1])) - {"--version"}
        yield words, commands, options


class Manual(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.commands = list(all_commands())

    def completed(self, *words):
        script = f"""
            source "$1"; shift
            COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
            _{words[0]}
            printf '%s\\n' "${{COMPREPLY[@]}}" """
        return set(run("bash", "-c", script, "bash", os.path.join(PAGES, "bash", words[0]), *words).split())

    def test_the_programs_have_commands(self):
        self.assertGreater(len(self.commands), 20)
        self.assertLess({("deform",), ("deform", "apply"), ("deformd", "store", "check")}, {words for words, _, _ in self.commands})
        self.assertNotIn("read-isolated", read("bash", "deform"))

    def test_bash_offers_every_command_and_option(self):
        for words, commands, options in self.commands:
            with self.subTest(words=words):
                self.assertGreater(len(options), 1)
                self.assertLessEqual(options, self.completed(*words, "-"))
                if commands:
                    self.assertLessEqual(set(commands), self.completed(*words, ""))

    def test_bash_knows_where_it_is(self):
        self.assertEqual(self.completed("deform", "app"), {"apply"})
        self.assertEqual(self.completed("deform", "--server", "host:1", "apply", "--en"), {"--encoding"})
        self.assertEqual(self.completed("deform", "apply", "a.yaml", "--encoding", "raw"), {"raw_f64", "raw_f32"})
        self.assertEqual(self.completed("deform", "apply", "--timeout", "1"), set())
        self.assertEqual(self.completed("deformd", "store", ""), {"check", "rebuild", "backup", "restore", "import"})
        self.assertNotIn("--workers", self.completed("deformd", "store", "-"))
        here = os.path.dirname(os.path.abspath(__file__))
        self.assertEqual(self.completed("deform", "inspect", os.path.join(here, "test_man")), {os.path.join(here, "test_manual.py")})

    def test_the_other_shells_know_the_same(self):
        for words, commands, options in self.commands:
            with self.subTest(words=words):
                zsh, fish = read("zsh", f"_{words[0]}"), read("fish", f"{words[0]}.fish").splitlines()
                at = "".join("/" + word for word in words[1:])
                block = zsh.split(f'    "{at}")\n      options=(')[1].split(";;")[0]
                for name in options | set(commands):
                    self.assertRegex(block, rf"'{re.escape(name)}[:']")
                lines = [line for line in fish if all(word in line.split(" -d ")[0] for word in words[1:])]
                for name in options:
                    shown = f" -l {name[2:]} " if name.startswith("--") else f" -s {name[1:]} "
                    self.assertTrue(any(shown in line for line in lines), name)
                for name in commands:
                    self.assertTrue(any(f" -a {name} " in line for line in lines), name)

    def test_the_other_shells_know_where_they_are(self):
        """Where they are installed. Zsh's own functions are replaced by ones that print."""
        zsh = """
            file=$1; shift; words=("$@"); CURRENT=$#
            _files() { print PATH }; _message() { print "$1" }; compadd() { print -l -- "${@:#--}" }
            _describe() { local name=$argv[-1]; print -l -- ${(P)name%%:*} }
            source $file"""
        asked = {"zsh": lambda *words: run("zsh", "-f", "-c", zsh, "zsh", os.path.join(PAGES, "zsh", f"_{words[0]}"), *words),
                 "fish": lambda *words: run("fish", "-c", f"source {os.path.join(PAGES, 'fish', words[0] + '.fish')}\n"
                                                          f"complete -C '{' '.join(words)}'")}
        for shell in [name for name in asked if shutil.which(name)]:
            with self.subTest(shell=shell):
                offered = {words: {line.split("\t")[0] for line in asked[shell](*words).splitlines()} for words in (
                    ("deform", ""), ("deform", "apply", "--"), ("deform", "apply", "--encoding", ""), ("deformd", "store", ""))}
                self.assertLess({"apply", "sweep", "status"}, offered["deform", ""])
                self.assertLess({"--set", "--in-place", "--server"}, offered["deform", "apply", "--"])
                self.assertEqual(offered["deform", "apply", "--encoding", ""], {"raw_f64", "raw_f32", "draco", "delta_zstd"})
                self.assertEqual(offered["deformd", "store", ""], {"check", "rebuild", "backup", "restore", "import"})

    def test_shells_accept_their_file(self):
        for shell in FILES:
            if shutil.which(shell) is None:
                continue
            for program in PROGRAMS:
                self.assertEqual(run(shell, "-n", os.path.join(PAGES, shell, FILES[shell].format(program))), "")

    def test_every_command_has_a_page(self):
        for words, commands, options in self.commands:
            with self.subTest(words=words):
                section = "1" if words[0] == "deform" else "8"
                page = read("man" + section, "-".join(words) + "." + section)
                self.assertIn("\n.SH NAME\n", page)
                for name in options:
                    self.assertIn("\\fB" + name.replace("-", "\\-") + "\\fR", page)
                for name in commands:
                    self.assertIn("\\fB" + name.replace("-", "\\-") + "\\fR\n", page)
                self.assertEqual(run("groff", "-man", "-Tutf8", "-ww", "-z", text=page), "")

    def test_pages_name_the_version(self):
        version = run(PROGRAMS["deform"], "--version").split()[1]
        self.assertIn(f'"deform {version}"', read("man1", "deform.1"))


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], "-v", *sys.argv[1:]])
