#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""A PostgreSQL of its own for tests, in a temporary folder, reached by a socket in it.

usage: postgres.py run COMMAND...     runs COMMAND with one: DEFORM_TEST_POSTGRES is its folder, DEFORM_TEST_POSTGRES_CONTROL a
                                      command that takes start, stop, kill, pause or resume. Exit code 77: it is not installed
       postgres.py control FOLDER ACTION
"""
import glob
import os
import pathlib
import pwd
import shutil
import signal
import subprocess
import sys
import tempfile

NOT_INSTALLED = 77


def programs():
    """The folder of initdb and pg_ctl, which Debian keeps out of PATH; None when there is no server."""
    found = shutil.which("initdb")
    if found:
        return os.path.dirname(os.path.realpath(found))
    folders = sorted(glob.glob("/usr/lib/postgresql/*/bin"), key=lambda folder: int(folder.split("/")[4]))
    return next((folder for folder in reversed(folders) if os.path.exists(os.path.join(folder, "initdb"))), None)


def missing():
    """Why there can be none, or ''."""
    if programs() is None:
        return "PostgreSQL's server is not installed (package postgresql)"
    if os.getuid() == 0:
        try:
            pwd.getpwnam("postgres")
        except KeyError:
            return "PostgreSQL does not run as root, and there is no user postgres"
    return ""


class Postgres:
    """Runs as the user postgres where the tests run as root, which PostgreSQL refuses."""

    def __init__(self, folder):
        self.folder = folder
        self.data = os.path.join(folder, "data")

    def _run(self, program, *arguments):
        command = [os.path.join(programs(), program), *arguments]
        if os.getuid() == 0:
            command = ["runuser", "-u", "postgres", "--", *command]
        done = subprocess.run(command, cwd="/", stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{program}: {done.stdout}")

    def create(self):
        if os.getuid() == 0:
            shutil.chown(self.folder, "postgres")
        self._run("initdb", "-D", self.data, "-A", "trust", "-U", "deformd", "-E", "UTF8", "--locale=C", "--no-sync")
        settings = f"listen_addresses = ''\nunix_socket_directories = '{self.folder}'\nfsync = off\nmax_connections = 200\n"
        with open(os.path.join(self.data, "postgresql.conf"), "a") as file:
            file.write(settings)  # fsync: its processes die in tests, the machine does not
        return self

    def start(self):
        self._run("pg_ctl", "-D", self.data, "-w", "-l", os.path.join(self.folder, "log"), "start")
        return self

    def stop(self, mode="fast"):
        if os.path.exists(os.path.join(self.data, "postmaster.pid")):
            self._run("pg_ctl", "-D", self.data, "-w", "-m", mode, "stop")

    def _pids(self):
        """The ids of the server and of the processes that it has started."""
        main = int(pathlib.Path(self.data, "postmaster.pid").read_text().split()[0])
        with open(f"/proc/{main}/task/{main}/children") as file:
            return [main, *map(int, file.read().split())]

    def kill(self):
        """As a crash: nothing is written any more."""
        pids = self._pids()
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        for name in glob.glob(os.path.join(self.folder, ".s.PGSQL.*")) + [os.path.join(self.data, "postmaster.pid")]:
            if os.path.exists(name):
                os.remove(name)

    def pause(self):
        """It takes connections and answers nothing."""
        for pid in self._pids():
            os.kill(pid, signal.SIGSTOP)

    def resume(self):
        for pid in self._pids():
            os.kill(pid, signal.SIGCONT)

    def uri(self, database="postgres"):
        return f"postgresql:///{database}?host={self.folder}&user=deformd"


def main():
    if sys.argv[1:2] == ["control"] and len(sys.argv) == 4:
        getattr(Postgres(sys.argv[2]), sys.argv[3])()
        return 0
    if sys.argv[1:2] != ["run"] or len(sys.argv) < 3:
        print(__doc__, file=sys.stderr)
        return 2
    if missing():
        print(f"skipped: {missing()}")
        return NOT_INSTALLED
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # what has a time limit takes the server along
    folder = tempfile.mkdtemp(prefix="deform-pg-")
    server = Postgres(folder)
    try:
        server.create().start()
        control = f"{sys.executable} {os.path.abspath(__file__)} control {folder}"
        environment = {**os.environ, "DEFORM_TEST_POSTGRES": folder, "DEFORM_TEST_POSTGRES_CONTROL": control}
        return subprocess.run(sys.argv[2:], env=environment).returncode
    finally:
        server.stop("immediate")
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
