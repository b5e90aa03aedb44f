# SPDX-License-Identifier: GPL-3.0-or-later
"""More connections than the server takes or has files for, connections that say nothing, and connections that grow old."""

import ctypes
import os
import resource
import socket
import time

from harness import AHMED_SETUP, EndToEnd, main
from relay import Relay

MANY = 1500  # more than the files of the server in these tests


class Connections(EndToEnd):
    @classmethod
    def setUpClass(cls):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        if soft < 2 * MANY:
            resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 2 * MANY), hard))

    def setUp(self):
        super().setUp()
        self.sockets = []

    def tearDown(self):
        self.close_all()
        super().tearDown()

    def start_server(self, *options):
        return super().start_server(*map(str, options))

    def open_many(self, count):
        for _ in range(count):
            self.sockets.append(socket.create_connection(("127.0.0.1", self.server.port), timeout=10))

    def close_all(self):
        for one in self.sockets:
            one.close()
        self.sockets.clear()

    def closed(self):
        """How many of the sockets the other side has closed."""
        count = 0
        for one in self.sockets:
            one.settimeout(0)
            try:
                while True:
                    if one.recv(65536) == b"":
                        count += 1
                        break
            except BlockingIOError:
                pass
            except OSError:
                count += 1
        return count

    def resident(self):
        with open(f"/proc/{self.server.process.pid}/status") as status:
            return next(1024 * int(line.split()[1]) for line in status if line.startswith("VmRSS"))

    def busy_client(self):
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        self.deform("prepare", "setup.yaml")
        client = self.spawn("bench", "setup.yaml", "--designs", 8000, "--json")
        self.wait_until(lambda: client.poll() is not None or self.status()["designs_served"] > 0, "the client is at work")
        return client

    def test_connections_beyond_the_limit_are_refused_and_the_others_work(self):
        self.start_server("--max-connections", 50)
        client = self.busy_client()
        self.open_many(200)
        self.wait_until(lambda: self.closed() >= 200 - 41, "those beyond the share of this address are closed")
        self.assertLessEqual(self.closed(), 200 - 41 + 5, "the others stay")  # some places are taken by deform
        self.fails(3, "status")
        self.assertIsNone(client.poll(), "a client that is connected goes on")
        self.close_all()
        self.wait_until(lambda: self.deform("status", expect=None).code == 0, "new clients are served again", seconds=10)
        out, err = client.communicate(timeout=120)
        self.assertEqual(client.returncode, 0, err)
        self.assertIn("refused: their address has most of the connections that --max-connections allows", self.server.log_text())

    def test_one_address_does_not_keep_another_out(self):
        """A stranger who opens connections for as long as it likes, each with a hello."""
        self.start_server("--max-connections", 1000)
        relay = Relay(self.server.port)
        self.addCleanup(relay.close)
        self.deform("--server", relay.address, "status")
        before = self.resident()
        for _ in range(3):
            self.open_many(MANY // 3)
            for one in self.sockets[-(MANY // 3):]:
                one.settimeout(5)
                try:
                    one.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\4\0\0\0\0\0")
                except OSError:
                    pass  # refused
            self.deform("--server", relay.address, "status")
        self.wait_until(lambda: self.closed() >= MANY - 801, "those beyond four fifths of the limit are closed")
        self.deform("--server", relay.address, "status")
        self.assertLessEqual(self.closed(), MANY - 795, "the others stay")
        self.assertLess(self.resident() - before, 64 << 20)
        self.fails(3, "status")

    def test_a_server_without_files_lives(self):
        self.start_server()
        client = self.busy_client()
        # Fewer files than --max-connections counts on: accept() fails.
        resource.prlimit(self.server.process.pid, resource.RLIMIT_NOFILE, (300, 300))
        self.open_many(MANY)
        self.wait_until(lambda: "refused: no more files can be opened" in self.server.log_text(), "the log says so")
        self.assertIsNone(client.poll())
        self.close_all()
        self.wait_until(lambda: self.deform("status", expect=None).code == 0, "new clients are served again", seconds=20)
        out, err = client.communicate(timeout=120)
        self.assertEqual(client.returncode, 0, err)

    def test_a_server_that_can_accept_no_more_ends(self):
        """Its socket is shut down beneath it, which takes the right to look into another process."""
        self.start_server()
        self.deform("status")
        listening = self.listening_socket()
        listening.shutdown(socket.SHUT_RDWR)
        listening.close()
        self.assertEqual(self.server.process.wait(20), 1)
        self.assertIn("no more connections are accepted: nothing can be accepted from a socket that is listened on", self.server.log_text())

    def listening_socket(self):
        """That of the server."""
        pidfd_open, pidfd_getfd = 434, 438  # which Python does not have by name
        system = ctypes.CDLL(None, use_errno=True).syscall
        process = system(pidfd_open, self.server.process.pid, 0)
        for name in os.listdir(f"/proc/{self.server.process.pid}/fd"):
            if not os.readlink(f"/proc/{self.server.process.pid}/fd/{name}").startswith("socket:"):
                continue
            fd = system(pidfd_getfd, process, int(name), 0)
            if fd < 0:
                self.skipTest(f"a descriptor of another process cannot be had here: {os.strerror(ctypes.get_errno())}")
            one = socket.socket(fileno=fd)
            if one.family == socket.AF_INET and one.getsockname()[1] == self.server.port and one.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
                os.close(process)
                return one
            one.close()
        self.fail("the server listens on no socket")

    def test_more_connections_than_files_are_refused_at_the_start(self):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        with self.assertRaisesRegex(RuntimeError, "option max_connections: .* files may be open"):
            self.start_server("--max-connections", hard)

    def test_connections_that_say_nothing_are_closed(self):
        self.start_server()
        self.open_many(20)
        self.assertEqual(self.closed(), 0)
        self.wait_until(lambda: self.closed() == 20, "connections without a handshake are closed", seconds=40)
        self.deform("status")

    def test_old_connections_are_left_without_an_error(self):
        self.start_server("--connection-age", 1, "--connection-age-grace", 30, "--connection-idle", 1)
        client = self.busy_client()
        start = time.time()
        out, err = client.communicate(timeout=120)
        self.assertEqual(client.returncode, 0, err)
        self.assertGreater(time.time() - start, 1, "the connection was older than allowed meanwhile")


if __name__ == "__main__":
    main()
