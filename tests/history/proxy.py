# SPDX-License-Identifier: GPL-3.0-or-later
"""A stretch of network between clients and a server that can be cut, held up and slowed down."""

import socket
import threading
import time


class Proxy:
    """Listens on a port of its own for as long as it lives. A client whose server is not there is turned away at once."""

    def __init__(self, port_of_server):
        self.port_of_server = port_of_server
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.seconds = 0.0  # that every piece takes longer
        self.passing = threading.Event()
        self.passing.set()
        self.lock = threading.Lock()
        self.pairs = set()
        threading.Thread(target=self.accept, daemon=True).start()

    @property
    def address(self):
        return f"127.0.0.1:{self.port}"

    def accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            try:
                server = socket.create_connection(("127.0.0.1", self.port_of_server()), timeout=5)
            except OSError:
                client.close()
                continue
            server.settimeout(None)
            for one in (client, server):
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            pair = (client, server)
            with self.lock:
                self.pairs.add(pair)
            for one, other in (pair, pair[::-1]):
                threading.Thread(target=self.carry, args=(one, other, pair), daemon=True).start()

    def carry(self, one, other, pair):
        try:
            while data := one.recv(1 << 16):
                self.passing.wait()
                if self.seconds:
                    time.sleep(self.seconds)
                other.sendall(data)
        except OSError:
            pass
        self.end(pair)

    def end(self, pair):
        with self.lock:
            self.pairs.discard(pair)
        for one in pair:
            try:
                one.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass
            one.close()

    def cut(self):
        with self.lock:
            pairs = list(self.pairs)
        for pair in pairs:
            self.end(pair)

    def hold(self):
        self.passing.clear()

    def release(self):
        self.passing.set()

    def close(self):
        self.listener.close()
        self.release()
        self.cut()
