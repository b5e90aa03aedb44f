# SPDX-License-Identifier: GPL-3.0-or-later
"""Just enough HTTP/2 to send what no client library would."""

import socket
import struct

DATA, HEADERS, PRIORITY, RST_STREAM, SETTINGS, PING, WINDOW_UPDATE, CONTINUATION = 0, 1, 2, 3, 4, 6, 8, 9
END_STREAM, END_HEADERS, ACK = 1, 4, 1


def frame(kind, flags=0, stream=0, payload=b""):
    return struct.pack(">I", len(payload))[1:] + struct.pack(">BBI", kind, flags, stream) + payload


def text(value):
    value = value.encode()
    if len(value) < 127:
        return bytes([len(value)]) + value
    rest, out = len(value) - 127, bytearray([127])
    while rest >= 128:
        out.append(rest % 128 + 128)
        rest //= 128
    out.append(rest)
    return bytes(out) + value


def literal(name, value, indexed=False):
    """A header spelled out; indexed: the other side shall remember it."""
    return (b"\x40" if indexed else b"\x00") + text(name) + text(value)


def call_headers(method):
    """Those of METHOD of deform.v1.DeformService, or of SERVICE/METHOD."""
    path = method if "/" in method else "deform.v1.DeformService/" + method
    return b"".join(literal(name, value) for name, value in (
        (":method", "POST"), (":scheme", "http"), (":path", "/" + path), (":authority", "x"),
        ("te", "trailers"), ("content-type", "application/grpc")))


def resets(connection, method, count):
    """Calls that are cancelled in the same breath."""
    headers, out = call_headers(method), []
    for _ in range(count):
        stream = connection.next_stream()
        out.append(frame(HEADERS, END_HEADERS, stream, headers))
        out.append(frame(RST_STREAM, 0, stream, struct.pack(">I", 8)))
    return b"".join(out)


class Connection:
    """A connection that has said hello and reads nothing unless asked. Of the address `source` of this machine."""

    def __init__(self, port, source="127.0.0.1"):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=20, source_address=(source, 0))
        self.socket.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + frame(SETTINGS))
        self.stream = -1

    def next_stream(self):
        self.stream += 2
        return self.stream

    def send(self, data):
        """Whether the other side still took it."""
        try:
            self.socket.sendall(data)
            return True
        except OSError:
            return False

    def wait_for_end(self, stream):
        """Until the other side has said all of this stream: what its last frame holds. Nothing opens the windows meanwhile. Raises
        OSError when it closes the connection before."""
        while True:
            head = self.read(9)
            payload = self.read(int.from_bytes(head[:3], "big"))
            if int.from_bytes(head[5:9], "big") == stream and head[3] in (DATA, HEADERS) and head[4] & END_STREAM:
                return payload

    def read(self, count):
        data = bytearray()
        while len(data) < count:
            more = self.socket.recv(count - len(data))
            if not more:
                raise ConnectionResetError("closed")
            data += more
        return bytes(data)

    def drop_replies(self):
        """Whether the other side has closed the connection; what it sent is dropped."""
        self.socket.settimeout(0)
        try:
            while True:
                if not self.socket.recv(1 << 20):
                    return True
        except BlockingIOError:
            return False
        except OSError:
            return True
        finally:
            self.socket.settimeout(20)

    def close(self):
        self.socket.close()
