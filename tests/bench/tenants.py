#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""What one tenant gets while another one calls at 50 times its quota: the server on one core, all clients on another.

usage: tenants.py BUILD [--designs N] [--rounds N]      prints a table of required against measured; needs openssl, taskset and python3-grpcio
Tenant B computes designs, alone and beside tenant A in turn. A may make 4 requests per second and sends 200, each of them for one design,
so that what it may have takes next to nothing, without looking at what it is told about when to try again. The ratio is that of the medians of B's rates.
"""
import argparse
import hashlib
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
parser = argparse.ArgumentParser()
parser.add_argument("build", type=pathlib.Path)
parser.add_argument("--designs", type=int, default=3000)
parser.add_argument("--rounds", type=int, default=5)
options = parser.parse_args()
BUILD = options.build.resolve()
os.environ["DEFORM_BIN"], os.environ["DEFORMD_BIN"] = str(BUILD / "client/cli/deform"), str(BUILD / "server/deformd")
sys.path[:0] = [str(ROOT / "tests/end_to_end"), str(BUILD / "tests/wire/generated")]

import grpc  # noqa: E402
from deform.v1 import deformation_pb2  # noqa: E402

from harness import AHMED_SETUP, DEFORM, Server  # noqa: E402
from test_identity import Authority  # noqa: E402

ALLOWED, TIMES, LEAST = 4, 50, 0.9
SERVER_CORE, CLIENT_CORE = 0, 1


def token_line(folder, name, tenant):
    """A file with a token, and the line of it for the file of identities."""
    (folder / f"{name}.token").write_text(f"{name}-secret\n")
    return f"{name} user sha256:{hashlib.sha256(f'{name}-secret'.encode()).hexdigest()} tenant={tenant}\n"


class Flood:
    """Tenant A at work, from a thread; counts what it is answered."""

    def __init__(self, address, certificate, system):
        credentials = grpc.composite_channel_credentials(grpc.ssl_channel_credentials(certificate),
                                                         grpc.access_token_call_credentials("a-secret"))
        self.channel = grpc.secure_channel(address, credentials)
        designs = [deformation_pb2.Design(variables=[0.01, 0.02])]
        self.request = deformation_pb2.DeformRequest(system_id=system, designs=designs, output={"encoding": deformation_pb2.DELTA_ZSTD})
        # As a call with one answer, which a refusal has none of, so that it takes no thread of Python's: they would slow down B's client,
        # which shares the core. The few calls that are served end for A as ones with too many answers.
        self.ask = self.channel.unary_unary("/deform.v1.DeformService/Deform", request_serializer=deformation_pb2.DeformRequest.SerializeToString)
        self.sent = self.refused = self.served = 0
        self.ending = threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        start = time.monotonic()
        while not self.ending.is_set():
            self.ask.future(self.request, timeout=60).add_done_callback(self.read)
            self.sent += 1
            self.ending.wait(max(0, start + self.sent / (ALLOWED * TIMES) - time.monotonic()))

    def read(self, call):
        refused = call.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
        self.refused += refused
        self.served += not refused

    def stop(self):
        self.ending.set()
        self.thread.join()
        self.channel.close()


def main():
    os.sched_setaffinity(0, {CLIENT_CORE})
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        authority = Authority(name, "bench")
        authority.issue("server", "DNS:localhost,IP:127.0.0.1")
        (folder / "identities").write_text(token_line(folder, "a", "a") + token_line(folder, "b", "b") +
                                           f"tenant:a requests-per-second={ALLOWED} calls=1\n")
        server = Server(name, "--tls-cert", str(folder / "server.pem"), "--tls-key", str(folder / "server.key"), "--identities",
                        str(folder / "identities")).start()
        for thread in os.listdir(f"/proc/{server.process.pid}/task"):
            os.sched_setaffinity(int(thread), {SERVER_CORE})
        try:
            def deform(who, *words):
                done = subprocess.run([DEFORM, "--server", server.address, "--ca", "bench-ca.pem", "--token-file", f"{who}.token", *words],
                                      cwd=folder, stdout=subprocess.PIPE, check=True, text=True)
                return done.stdout

            deform("b", "sample", "-o", "ahmed.obj", "--points", "20000")
            (folder / "setup.yaml").write_text(AHMED_SETUP)
            systems = {who: json.loads(deform(who, "prepare", "setup.yaml", "--json"))["id"] for who in "ab"}
            certificate = (folder / "bench-ca.pem").read_bytes()

            def rate():
                told = json.loads(deform("b", "bench", systems["b"], "--population", "15", "--designs", str(options.designs), "--json"))
                return told["designs_per_second"]

            rate()  # warms up
            alone, beside, sent, refused, served = [], [], 0, 0, 0
            for _ in range(options.rounds):
                alone.append(rate())
                flood = Flood(server.address, certificate, systems["a"])
                time.sleep(1)
                beside.append(rate())
                flood.stop()
                sent, refused, served = sent + flood.sent, refused + flood.refused, served + flood.served
        finally:
            server.stop()
    ratio = statistics.median(beside) / statistics.median(alone)
    print("| figure | must reach | measured | |\n|---|---|---|---|")
    print(f"| designs per second of tenant B beside A at {TIMES} times its quota, of those alone | >= {LEAST} | {ratio:.3f} | "
          f"{'ok' if ratio >= LEAST else 'MISSED'} |")
    print(f"| designs per second of B alone / beside A, medians of {options.rounds} | | {statistics.median(alone):.0f} / "
          f"{statistics.median(beside):.0f} | |")
    print(f"| requests of A sent / refused / served | | {sent} / {refused} / {served} | |")
    return 0 if ratio >= LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
