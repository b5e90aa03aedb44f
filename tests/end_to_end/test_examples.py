# SPDX-License-Identifier: GPL-3.0-or-later
"""The programs of client/examples against a real server."""

import os
import subprocess

from harness import EndToEnd, main


class Examples(EndToEnd):
    def run_example(self, variable):
        return subprocess.run([os.environ[variable], self.server.address], timeout=120, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True)

    def test_deform_once(self):
        self.start_server()
        done = self.run_example("DEFORM_ONCE_BIN")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("0.338 -> 0.368", done.stdout)

    def test_optimizer_loop(self):
        self.start_server()
        done = self.run_example("OPTIMIZER_LOOP_BIN")
        self.assertEqual(done.returncode, 0, done.stderr + done.stdout)
        self.assertIn("reached 2 % more volume", done.stdout)
        self.assertEqual(done.stdout, self.run_example("OPTIMIZER_LOOP_BIN").stdout, "the same seed, the same way")
        self.assertEqual(self.deform("status", "--json").json["running"], 0)

    def test_no_server(self):
        self.start_server()
        self.server.stop()
        done = self.run_example("DEFORM_ONCE_BIN")
        self.assertEqual(done.returncode, 1)
        self.assertIn("cannot reach deformd", done.stderr)


if __name__ == "__main__":
    main()
