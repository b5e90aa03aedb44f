# SPDX-License-Identifier: GPL-3.0-or-later
"""The proxy of deploy/replicas before floods of one address: it refuses or cuts off whoever makes them, deformd cuts off none of its
connections, and a client of another address is answered all the while."""

import itertools
import os
import re
import shutil
import socket
import struct
import sys
import threading
import time
import unittest
import urllib.request

from harness import AHMED_SETUP, main
from relay import Relay
from replicas import SOURCE, BehindProxy

sys.path.insert(0, os.path.join(SOURCE, "tests", "attack"))
import http2  # noqa: E402

ATTACKER, HONEST = "127.0.0.2", "127.0.0.3"


def call(stream):
    """An empty request of GetServerInfo."""
    return (http2.frame(http2.HEADERS, http2.END_HEADERS, stream, http2.call_headers("GetServerInfo")) +
            http2.frame(http2.DATA, http2.END_STREAM, stream, bytes(5)))


@unittest.skipUnless(shutil.which("haproxy"), "haproxy is not installed")
class Limits(BehindProxy):
    def options_of(self, number):
        return [*super().options_of(number), "--trusted-proxies", "127.0.0.1"]

    def setUp(self):
        super().setUp()
        relay = Relay(self.port, HONEST)
        self.addCleanup(relay.close)
        self.honest_address = relay.address
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        self.honest_round()

    def honest_round(self):
        self.deform("apply", "setup.yaml", "--set", "roof_up=0.02", "-o", "out.obj", "--server", self.honest_address)

    def figure(self, pattern):
        """The sum of a metric over the servers."""
        total = 0
        for port in self.metrics:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as reply:
                total += sum(map(float, re.findall(rf"^{pattern} (\S+)$", reply.read().decode(), re.MULTILINE)))
        return total

    def besides(self, attack, rounds):
        """Runs attack(stopping) in three threads while the honest client has so many rounds, each of which must succeed."""
        stopping = threading.Event()
        results = []
        threads = [threading.Thread(target=lambda: results.append(attack(stopping))) for _ in range(3)]
        for thread in threads:
            thread.start()
        slowest = 0
        try:
            for _ in range(rounds):
                began = time.monotonic()
                self.honest_round()
                slowest = max(slowest, time.monotonic() - began)
        finally:
            stopping.set()
            for thread in threads:
                thread.join()
        print(f"{self.id().split('.')[-1]}: {results}; slowest honest round {slowest:.2f} s", file=sys.stderr)
        self.assertEqual(self.figure("deformd_connections_cut_off_total"), 0, "the proxy refuses before deformd has to")
        return results

    def flood(self, make):
        """An attack that connects again whenever it is cut off; how often it was, and how many calls it made."""

        def attack(stopping):
            cut_off = calls = 0
            while not stopping.is_set():
                try:
                    connection = http2.Connection(self.port, ATTACKER)
                except OSError:
                    cut_off += 1
                    continue
                while not stopping.is_set():
                    if not connection.send(make(connection)) or connection.drop_replies():
                        cut_off += 1
                        break
                calls += (connection.stream + 1) // 2
                connection.close()
            return cut_off, calls

        return attack

    def is_cut_off(self, make):
        """More often than once for each of three attackers, however they share the machine."""
        self.assertGreater(sum(cut_off for cut_off, _ in self.besides(self.flood(make), 8)), 3)

    def test_calls_that_are_reset(self):
        self.is_cut_off(lambda connection: http2.resets(connection, "GetServerInfo", 200))

    def test_calls_that_are_reset_when_they_have_arrived(self):
        """Those in the same breath the proxy forgets; these it hands on, and then their reset."""
        headers = http2.call_headers("GetServerInfo")

        def make(connection):
            streams = [connection.next_stream() for _ in range(100)]
            connection.send(b"".join(http2.frame(http2.HEADERS, http2.END_HEADERS, stream, headers) for stream in streams))
            time.sleep(0.02)
            return b"".join(http2.frame(http2.RST_STREAM, 0, stream, struct.pack(">I", 8)) for stream in streams)

        self.is_cut_off(make)

    def test_calls_without_waiting_for_answers(self):
        def make(connection):
            return b"".join(call(connection.next_stream()) for _ in range(500))

        self.is_cut_off(make)

    def test_connections(self):
        """300 of one address: those beyond 256 are closed at once."""
        held = [socket.create_connection(("127.0.0.1", self.port), source_address=(ATTACKER, 0)) for _ in range(300)]
        self.addCleanup(lambda: [one.close() for one in held])
        self.honest_round()

        def closed(one):
            one.settimeout(0)
            try:
                return one.recv(1 << 16) == b""
            except BlockingIOError:
                return False
            except OSError:
                return True

        self.wait_until(lambda: sum(map(closed, held)) >= 44, "those beyond the limit are closed")
        self.assertEqual(sum(map(closed, held)), 44)
        self.honest_round()

    def test_connections_one_after_the_other(self):
        """2000 within 10 s are taken; whoever goes on is turned away until they are fewer."""

        def turned_away():
            with socket.create_connection(("127.0.0.1", self.port), source_address=(ATTACKER, 0)) as one:
                one.settimeout(0.05)
                try:
                    return one.recv(1) == b""
                except TimeoutError:
                    return False
                except OSError:
                    return True

        self.assertFalse(turned_away())
        for _ in range(20):
            for _ in range(1000):
                socket.create_connection(("127.0.0.1", self.port), source_address=(ATTACKER, 0)).close()
            if turned_away():
                break
        else:
            self.fail("20,000 connections were taken")
        self.honest_round()

    def test_headers_that_take_long(self):
        """After 10 s a connection without a whole call is closed, whether it says nothing more or goes on saying something."""
        header = http2.frame(http2.HEADERS, http2.END_HEADERS, 1, http2.call_headers("GetServerInfo") + http2.literal("x-long", "y" * 4000))
        silent, talking = ([http2.Connection(self.port, ATTACKER) for _ in range(20)] for _ in range(2))
        self.addCleanup(lambda: [one.close() for one in silent + talking])
        for one in silent:
            one.send(header[:20])
        sent = itertools.count()

        def all_closed():
            at = next(sent)
            for one in talking:
                one.send(header[at:at + 1])
            return all([one.drop_replies() for one in silent + talking])

        self.wait_until(all_closed, "they are closed", 30)
        self.honest_round()

    def test_who_calls(self):
        self.wait_until(lambda: any(f" host=ipv4:{HONEST} " in server.log_text() for server in self.servers), "the servers know it")

    def test_nobody_calls_for_another(self):
        """What a client says of itself does not reach the servers."""
        connection = http2.Connection(self.port, ATTACKER)
        self.addCleanup(connection.close)
        headers = http2.call_headers("GetServerInfo") + http2.literal("x-forwarded-for", HONEST)
        connection.send(http2.frame(http2.HEADERS, http2.END_HEADERS, 1, headers) +
                        http2.frame(http2.DATA, http2.END_STREAM, 1, bytes(5)))
        self.wait_until(lambda: any(f" host=ipv4:{ATTACKER} " in server.log_text() for server in self.servers), "the servers know it")


@unittest.skipUnless(shutil.which("haproxy"), "haproxy is not installed")
class FewWithoutAnswer(BehindProxy):
    """With a limit of three calls in a second that are not answered."""

    def proxy_configuration(self, text):
        self.assertIn(" gt 400 ", text)
        return text.replace(" gt 400 ", " gt 3 ")

    def test_answers_make_room(self):
        connection = http2.Connection(self.port)
        self.addCleanup(connection.close)
        for _ in range(20):
            stream = connection.next_stream()
            connection.send(call(stream))
            connection.wait_for_end(stream)


@unittest.skipUnless(shutil.which("haproxy"), "haproxy is not installed")
class FewCalls(BehindProxy):
    """More calls than this machine could make: with a limit of three in a second."""

    def proxy_configuration(self, text):
        self.assertIn(" gt 5000 ", text)
        return text.replace(" gt 5000 ", " gt 3 ")

    def test_the_refusal_says_when_to_try_again(self):
        connection = http2.Connection(self.port)
        self.addCleanup(connection.close)
        for stream in range(1, 20, 2):
            connection.send(call(stream))
        replies = bytearray()
        connection.socket.settimeout(10)
        while b"too many calls from this address" not in replies:
            replies += connection.socket.recv(1 << 16)
        for _ in range(6):
            self.deform("status")


if __name__ == "__main__":
    main()
