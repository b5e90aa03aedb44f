# SPDX-License-Identifier: GPL-3.0-or-later
"""A SLURM of this machine alone: munged, slurmctld and slurmd of whoever runs this, with all their files in one folder and no other configuration.

    python3 slurm_on_loopback.py COMMAND...        runs a command with such a SLURM; its folder goes afterwards

Needs the Debian packages slurm-wlm and munge. No systemd, no cgroups, no database of accounts: sacct is refused, as on clusters without one.
"""

import contextlib
import getpass
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import tempfile
import time

CPUS = 4
"""That it says it has, whatever the machine has."""
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "scontrol")


def missing():
    """The programs that are not there."""
    return [name for name in PROGRAMS if shutil.which(name, path=_paths()) is None]


def _paths():
    return os.pathsep.join([os.environ["PATH"], "/usr/sbin", "/sbin"])


class Loopback:
    """environment: of programs that shall use it. stop_controller() and start_controller(): what a cluster does now and then."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.environment = {"SLURM_CONF": str(self.folder / "slurm.conf")}
        self._processes = {}

    def start(self):
        (self.folder / "state").mkdir()
        (self.folder / "spool").mkdir()
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        ports = _free_ports(2)
        (self.folder / "slurm.conf").write_text(f"""\
ClusterName=loopback
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/munge
AuthInfo=socket={self.folder}/munge.socket
CredType=cred/munge
SlurmUser={getpass.getuser()}
SlurmdUser={getpass.getuser()}
StateSaveLocation={self.folder}/state
SlurmdSpoolDir={self.folder}/spool
SlurmctldPidFile={self.folder}/slurmctld.pid
SlurmdPidFile={self.folder}/slurmd.pid
SlurmctldLogFile={self.folder}/slurmctld.log
SlurmdLogFile={self.folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
ReturnToService=2
KillWait=5
OverTimeLimit=0
NodeName=localhost NodeAddr=127.0.0.1 NodeHostname={socket.gethostname()} CPUs={CPUS} State=UNKNOWN
PartitionName=short Nodes=ALL Default=YES MaxTime=60 State=UP
""")
        self._run("munged", "--force", "--foreground", f"--socket={self.folder}/munge.socket", f"--key-file={key}", f"--pid-file={self.folder}/munge.pid",
                  f"--seed-file={self.folder}/munge.seed", f"--log-file={self.folder}/munge.log")
        self._wait_for(lambda: (self.folder / "munge.socket").exists(), "munged")
        self.start_controller()
        self._run("slurmd", "-D", "-N", "localhost")
        self._wait_for(lambda: self.command("sinfo", "--noheader", "--format=%T") == "idle\n", "an idle node")
        return self

    def start_controller(self):
        self._run("slurmctld", "-D")
        self._wait_for(lambda: self.command("scontrol", "ping").count("is UP"), "slurmctld")

    def stop_controller(self):
        """As for maintenance: it saves what it knows, and jobs go on. After a crash nodes are drained, and someone has to look."""
        process = self._processes.pop("slurmctld")
        process.terminate()
        process.wait(60)

    def command(self, *words):
        """What a command of SLURM prints, whether it succeeds or not."""
        return subprocess.run(words, env={**os.environ, **self.environment}, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, timeout=60).stdout

    def jobs(self):
        """Identifiers of those that wait or run."""
        return self.command("squeue", "--noheader", "--array", "--format=%i").split()

    def stop(self):
        if "slurmctld" in self._processes:
            self.command("scancel", f"--user={getpass.getuser()}", "--signal=KILL", "--full")
            self.command("scancel", f"--user={getpass.getuser()}")
            with contextlib.suppress(RuntimeError):
                self._wait_for(lambda: not self.jobs(), "the end of the jobs", 20)
        for name in ("slurmd", "slurmctld", "munged"):
            if name in self._processes:
                process = self._processes.pop(name)
                process.terminate()
                try:
                    process.wait(20)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    def _run(self, name, *options):
        with open(self.folder / f"{name}.out", "ab") as output:
            self._processes[name] = subprocess.Popen([shutil.which(name, path=_paths()), *options], env={**os.environ, **self.environment},
                                                     stdin=subprocess.DEVNULL, stdout=output, stderr=output)

    def _wait_for(self, condition, what, seconds=40):
        deadline = time.time() + seconds
        while not condition():
            for name, process in self._processes.items():
                if process.poll() is not None:
                    raise RuntimeError(f"{name} ended with {process.returncode}: {(self.folder / f'{name}.out').read_text()[-500:]}")
            if time.time() > deadline:
                raise RuntimeError(f"after {seconds} s still not there: {what}")
            time.sleep(0.1)


def _free_ports(count):
    taken = [socket.socket() for _ in range(count)]
    try:
        for each in taken:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in taken]
    finally:
        for each in taken:
            each.close()


@contextlib.contextmanager
def loopback():
    """The folder is short and its own: sockets have short names, and munged wants a folder that nobody else writes to."""
    with tempfile.TemporaryDirectory(prefix="slurm-") as folder:
        made = Loopback(folder)
        try:
            yield made.start()
        finally:
            made.stop()


def main():
    if missing():
        print(f"slurm_on_loopback: no {', '.join(missing())}: install slurm-wlm and munge", file=sys.stderr)
        return 2
    with loopback() as made:
        return subprocess.run(sys.argv[1:], env={**os.environ, **made.environment}).returncode


if __name__ == "__main__":
    sys.exit(main())
