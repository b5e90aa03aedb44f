# SPDX-License-Identifier: GPL-3.0-or-later
"""A client that asks for little: one design and one question again and again, until its standard input ends. A process of its own, so
that nothing but the server keeps it waiting, and of an address of its own, since clients without identities are told apart by theirs.
Prints the seconds of its rounds and its failures as JSON.

    honest.py ADDRESS [TOKEN]    the DeformRequest on standard input, as one line of hexadecimal digits
"""

import json
import os
import sys
import threading
import time

import grpc

sys.path.insert(0, os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "end_to_end"))
from relay import Relay  # noqa: E402
from deform.v1 import deformation_pb2, service_pb2, service_pb2_grpc


def until_answered(call, reconnects=0):
    """An answer that says when to try again is obeyed and is no answer. So is a connection that is lost, that often: while the server
    sheds what an attack has left it may close one that sends much."""
    deadline = time.monotonic() + 30
    lost = 0
    while True:
        try:
            return call()
        except grpc.RpcError as error:
            hint = dict(error.trailing_metadata() or ()).get("retry-after-ms")
            if hint is None and error.code() == grpc.StatusCode.UNAVAILABLE and lost < reconnects:
                lost += 1
                hint = 100 * 2**lost
            if hint is None or time.monotonic() > deadline:
                raise
            time.sleep(min(float(hint) / 1000, 1))


def main():
    request = deformation_pb2.DeformRequest.FromString(bytes.fromhex(sys.stdin.readline()))
    ending = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ending.set()), daemon=True).start()
    token = sys.argv[2] if len(sys.argv) > 2 else ""
    calling = {"timeout": 30, "metadata": (("authorization", f"Bearer {token}"),) if token else ()}
    seconds, failures = [], []
    relay = Relay(int(sys.argv[1].rsplit(":", 1)[1]))
    with grpc.insecure_channel(relay.address) as channel:
        service = service_pb2_grpc.DeformServiceStub(channel)
        while not ending.wait(0.02):
            start = time.monotonic()
            try:
                until_answered(lambda: service.GetServerInfo(service_pb2.GetServerInfoRequest(), **calling))
                replies = until_answered(lambda: list(service.Deform(request, **calling)))
                if replies[-1].WhichOneof("part") != "summary":
                    failures.append(f"the last reply is {replies[-1]}")
            except grpc.RpcError as error:
                failures.append(f"{error.code()}: {error.details()}")
            seconds.append(time.monotonic() - start)
    print(json.dumps({"seconds": seconds, "failures": failures}))


if __name__ == "__main__":
    main()
