#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""What encryption and the reading of metrics cost: designs as RAW_F64 with certificates of both sides and in plain text, and with /metrics
read once a second, fifteen times as often as by a scrape_interval of 15 s, and not at all.

usage: transport.py BUILD [--points N] [--designs N] [--rounds N]
Prints a table of required against measured; needs openssl and python3-grpcio. Both ways are measured in turn in one run; the ratio is that of
medians.
"""
import argparse
import json
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[2]
parser = argparse.ArgumentParser()
parser.add_argument("build", type=pathlib.Path)
parser.add_argument("--points", type=int, default=465_000)
parser.add_argument("--designs", type=int, default=100)
parser.add_argument("--rounds", type=int, default=7)
options = parser.parse_args()
BUILD = options.build.resolve()
os.environ["DEFORM_BIN"], os.environ["DEFORMD_BIN"] = str(BUILD / "client/cli/deform"), str(BUILD / "server/deformd")
sys.path[:0] = [str(ROOT / "tests/end_to_end"), str(BUILD / "tests/wire/generated")]

from harness import AHMED_SETUP, DEFORM, Server  # noqa: E402
from test_identity import Authority  # noqa: E402

LEAST_ENCRYPTED, MOST_SCRAPED = 0.5, 1.02
READ_EVERY, SMALL = 1.0, 20_000


class Way:
    """A server and how it is called."""

    def __init__(self, folder, server_options, client_options):
        folder.mkdir()
        self.folder, self.client_options = folder, client_options
        self.server = Server(str(folder), *server_options).start()

    def deform(self, *words):
        done = subprocess.run([DEFORM, "--server", self.server.address, *self.client_options, *words], cwd=self.folder,
                              stdout=subprocess.PIPE, check=True, text=True)
        return done.stdout

    def prepare(self, points):
        self.deform("sample", "-o", "ahmed.obj", "--points", str(points))
        (self.folder / "setup.yaml").write_text(AHMED_SETUP)
        return json.loads(self.deform("prepare", "setup.yaml", "--json"))["id"]

    def bench(self, system, designs, population):
        return json.loads(self.deform("bench", system, "--population", str(population), "--designs", str(designs), "--encoding",
                                      "raw_f64", "--json"))


def encrypted(folder):
    """Designs per second of both ways."""
    authority = Authority(str(folder), "bench")
    authority.issue("server", "DNS:localhost,IP:127.0.0.1")
    authority.issue("client", "DNS:client")
    file = lambda name: str(folder / name)  # noqa: E731
    ways = [Way(folder / "plain", [], []),
            Way(folder / "mutual", ["--tls-cert", file("server.pem"), "--tls-key", file("server.key"), "--tls-client-ca", file("bench-ca.pem")],
                ["--ca", file("bench-ca.pem"), "--cert", file("client.pem"), "--key", file("client.key")])]
    try:
        systems = [way.prepare(options.points) for way in ways]
        rates = [[], []]
        for turn in range(-1, options.rounds):  # the first one warms up
            for way, system, rate in zip(ways, systems, rates):
                told = way.bench(system, options.designs, 10)["designs_per_second"]
                if turn >= 0:
                    rate.append(told)
    finally:
        for way in ways:
            way.server.stop()
    return [statistics.median(rate) for rate in rates]


class Scraper:
    """Reads /metrics again and again."""

    def __init__(self, port):
        self.port, self.read, self.ending = port, 0, threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        while not self.ending.wait(READ_EVERY):
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/metrics", timeout=10) as reply:
                self.read += len(reply.read()) > 0

    def stop(self):
        self.ending.set()
        self.thread.join()
        return self.read


def scraped(folder):
    """The p99 of designs in milliseconds, without and with readers of /metrics, and how often these have read."""
    way = Way(folder / "metrics", ["--metrics-address", "127.0.0.1:0"], [])
    try:
        port = int(re.search(r"metrics: .* on port (\d+)", way.server.log_text()).group(1))
        system = way.prepare(SMALL)
        times, reads = [[], []], 0
        for turn in range(-1, options.rounds):
            for reading in (False, True):
                scraper = Scraper(port) if reading else None
                told = way.bench(system, 40 * options.designs, 1)
                if scraper:
                    reads += scraper.stop()
                if turn >= 0:
                    times[reading].append(told["latency_ms"]["p99"])
    finally:
        way.server.stop()
    return [statistics.median(time) for time in times], reads


def row(what, required, measured, ok):
    print(f"| {what} | {required} | {measured:.3f} | {'ok' if ok else 'MISSED'} |")
    return ok


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        plain, mutual = encrypted(folder)
        (quiet, read), reads = scraped(folder)
    print("| figure | must reach | measured | |\n|---|---|---|---|")
    good = row(f"designs per second of {options.points} points as RAW_F64, mutual TLS / plain text", f">= {LEAST_ENCRYPTED}", mutual / plain,
               mutual / plain >= LEAST_ENCRYPTED)
    print(f"| the same, each | | {plain:.1f} / {mutual:.1f} | |")
    good &= row(f"p99 of one design of {SMALL} points, /metrics read once a second / not", f"<= {MOST_SCRAPED}", read / quiet,
                read / quiet <= MOST_SCRAPED)
    print(f"| the same, each in ms; reads | | {quiet:.3f} / {read:.3f}; {reads} | |")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
