# SPDX-License-Identifier: GPL-3.0-or-later
"""Running studies against a deformd of one's own, reading what they wrote, and putting it into tables and figures: for evolution_page.py and
car_page.py."""
import json
import os
import pathlib
import socket
import subprocess
import sys
import urllib.request

import matplotlib.pyplot as plt
import numpy as np

COLOURS = {"rbf": "#00798c", "dm_ffd": "#d1495b", "ffd": "#edae49"}
plt.rcParams.update({"font.size": 8, "font.family": "DejaVu Sans", "axes.spines.top": False, "axes.spines.right": False,
                     "svg.hashsalt": "deformd", "svg.fonttype": "path", "savefig.bbox": "tight"})

def save(figure, folder, name):
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / name, dpi=110, metadata={"Date": None} if name.endswith(".svg") else {"Software": None})
    plt.close(figure)


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows])


class Server:
    """deformd with its figures."""

    def __init__(self, folder):
        import harness

        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._metrics = free.getsockname()[1]
        folder.mkdir(exist_ok=True)
        self._server = harness.Server(str(folder), "--metrics-address", f"127.0.0.1:{self._metrics}").start()
        self.address = self._server.address
        self.stop = self._server.stop

    def figure(self, name):
        with urllib.request.urlopen(f"http://127.0.0.1:{self._metrics}/metrics") as answer:
            return sum(float(line.split()[-1]) for line in answer.read().decode().splitlines() if line.startswith(name))

    def seconds(self):
        """Seconds of the processor."""
        fields = pathlib.Path(f"/proc/{self._server.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run_study(path, server):
    environment = {**os.environ, "DEFORM_SERVER": server.address}
    with open(path.with_suffix(".log"), "a") as log:
        done = subprocess.run([sys.executable, "-m", "deformd.study", str(path)], env=environment, stdout=log, stderr=log)
    if done.returncode != 0:
        sys.exit(f"{path}: ended with {done.returncode}, see {path.with_suffix('.log')}")


def records(path):
    """The records of a study, by number."""
    lines = (path.with_suffix("") / "journal.jsonl").read_text().splitlines()
    found = {each["number"]: each for each in map(json.loads, lines)}
    return [found[number] for number in sorted(found)]


def value(record):
    return record["values"].get("fitness", np.inf)


class Run:
    """One study by CMA-ES."""

    def __init__(self, path, seed, generations, bound):
        """bound: of each variable, on both sides of 0."""
        import cma

        self.records = records(path)[:15 * generations]
        self.generations = len(self.records) // 15
        self.best = min(self.records, key=value)
        self.course = np.minimum.accumulate([value(record) for record in self.records])
        self.unusable = sum(record["verdict"] in ("bad", "failed") for record in self.records)
        # pycma alone, told what the study was told: gives the step sizes, and shows that the study is pycma and nothing else.
        designs = np.array([record["x"] for record in self.records])
        span = 2 * bound
        strategy = cma.CMAEvolutionStrategy([0.5] * designs.shape[1], 0.1, {"bounds": [0, 1], "seed": seed, "verbose": -9, "popsize": 15, "CMA_mu": 2,
                                                                             "CMA_active": False})
        self.steps = [0.1 * span]
        self.same = True
        for first in range(0, 15 * self.generations, 15):
            asked = strategy.ask()
            self.same &= bool(np.array_equal(np.array([-bound + np.asarray(u) * span for u in asked]) + 0.0, designs[first:first + 15]))
            strategy.tell(asked, [value(record) if record["values"] else 1e60 * (1 + float(np.linalg.norm(np.asarray(u) - 0.5)))
                                  for u, record in zip(asked, self.records[first:first + 15])])
            self.steps.append(strategy.sigma * span)
