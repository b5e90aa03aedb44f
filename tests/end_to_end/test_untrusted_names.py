# SPDX-License-Identifier: GPL-3.0-or-later
"""Names in meshes, setups and errors reach terminals and logs only as text: nothing in them moves the cursor or reorders a line."""

import json
import os

from harness import EndToEnd, main

TITLE = "\x1b]0;owned\x07"
REVERSED = "\u202ejbo.rac"
ACTING = [chr(c) for c in [*range(0x20), 0x7f, *range(0x80, 0xa0), 0x61c, 0x200e, 0x200f, *range(0x202a, 0x202f), *range(0x2066, 0x206a)]
          if chr(c) not in "\n\t"]


def mesh():
    """Two triangles: groups whose names act on terminals."""
    return (f"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\n"
            f"g red{TITLE}\nf 1 2 3\ng {REVERSED}\nf 1 3 4\n")


class UntrustedNames(EndToEnd):
    def tame(self, text, where):
        for c in ACTING:
            self.assertNotIn(c, text, f"{where}: U+{ord(c):04X}")
        return text

    def say(self, *arguments, expect=0):
        result = self.deform(*arguments, expect=expect)
        self.tame(result.out, arguments)
        self.tame(result.err, arguments)
        return result

    def test_no_name_acts_on_the_terminal(self):
        self.start_server()
        name = f"m{REVERSED}{TITLE}.obj"
        self.write(name, mesh())
        text = self.say("inspect", name).out
        self.assertIn("red_]0;owned_", text, "a group has no name with controls")
        self.assertIn("\\u{202e}jbo.rac", text)
        for command in (["inspect", name], ["register", name], ["quality", name], ["list"]):
            self.say(*command)
            reply = self.say(*command, "--json")
            self.assertTrue(reply.out.isascii())
        groups = [g["name"] for g in self.deform("inspect", name, "--json").json["groups"]]
        self.assertEqual(groups, ["red_]0;owned_", REVERSED], "JSON holds the name itself")
        setup = {"geometry": name, "method": {"rbf": {"polynomial_degree": 0, "kernel": "BIHARMONIC"}},
                 "handles": [{"name": "h" + TITLE, "region": {"ids": [3]}}], "fixed": [{"ids": [0, 1]}],
                 "variables": [{"name": REVERSED, "handle": "h" + TITLE, "translate": [0, 0, 1], "upper": 1}]}
        self.write("setup.yaml", json.dumps(setup))
        self.assertIn("h\\x1b]0;owned\\x07", self.say("prepare", "setup.yaml", "--check").out)
        self.say("apply", "setup.yaml", "--set", REVERSED + "=0.1", "-o", f"out{TITLE}.obj")
        prepared = self.say("prepare", "setup.yaml", "--json").json["id"]
        shown = self.write("again.yaml", self.say("show", prepared, "--setup").out)
        self.assertEqual(self.say("prepare", shown, "--json").json["id"], prepared, "what is shown can be read again")
        error = self.say("apply", "setup.yaml", "--set", REVERSED + "=7", "-o", "x.obj", expect=1).err
        self.assertIn("\\u{202e}jbo.rac", error)
        self.assertEqual(error.count("\n"), 1)
        self.say("apply", "setup.yaml", "--set", "x\r\ny=7", "-o", "x.obj", expect=1)
        setup["handles"][0]["region"] = {"group": "green" + TITLE + "\nerror: forged"}
        self.write("bad.yaml", json.dumps(setup))
        self.assertEqual(self.say("prepare", "bad.yaml", expect=1).err.count("\n"), 1)
        self.say("inspect", f"missing{TITLE}.obj", expect=1)
        self.say(f"app{TITLE}ly", expect=2)
        self.server.stop()
        log = self.tame(self.server.log_text(), "log")
        self.assertIn("\\x1b]0;owned", log)
        self.assertNotIn("\nerror: forged", log)

    def test_file_names_that_are_no_text(self):
        path = os.fsencode(self.folder) + b"/\xff\x9b31m.obj"
        with open(path, "w") as file:
            file.write(mesh())
        self.assertIn("\\xff\\x9b31m.obj", self.say("inspect", os.fsdecode(path).replace("\udcff", "\udcff")).out)


if __name__ == "__main__":
    main()
