# SPDX-License-Identifier: GPL-3.0-or-later
"""Connections: errors, cancelling, servers that go away, threads and processes."""

import hashlib
import json
import multiprocessing
import os
import pickle
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import deformd
from conftest import Case
from harness import LONG_SETUP, Server


@pytest.fixture
def lonely(tmp_path):
    """A server of its own, to be killed."""
    made = Case(tmp_path)
    yield made
    made.server.stop()


def test_numpy_2_needs_a_pybind11_that_knows_it():
    from deformd.numpy_version import check_numpy_version
    check_numpy_version(0x020A0300, "1.26.4")
    check_numpy_version(0x020C0000, "2.0.0")
    with pytest.raises(ImportError, match="NumPy 2.4.6"):
        check_numpy_version(0x020A03F0, "2.4.6")


def test_errors_name_the_call_that_was_sent(case, client):
    with pytest.raises(deformd.NotFound) as unknown:
        client.geometry("0" * 64)
    assert re.fullmatch("[0-9a-f]{12}-[0-9]+", unknown.value.request_id)
    assert pickle.loads(pickle.dumps(unknown.value)).request_id == unknown.value.request_id
    with pytest.raises(deformd.NotFound) as here:
        client.register(case.folder / "none.obj")
    assert here.value.request_id == ""


def test_errors_have_types_and_say_where(case, client):
    cases = [
        (deformd.NotFound, LookupError, lambda: client.geometry("0" * 64), "", None),
        (deformd.NotFound, LookupError, lambda: client.register(case.folder / "none.obj"), "", None),
        (deformd.InvalidArgument, ValueError, lambda: client.system("no id"), "", None),
        (deformd.InvalidArgument, ValueError, lambda: client.prepare({"handles": [{"name": "a", "region": {"group": "roof"}}],
                                                                           "variables": [{"name": "up", "translate": [0, 0, 1]}]}, case.mesh),
         "variables[0].handle", 0),
        (deformd.InvalidArgument, ValueError, lambda: deformd.Client("http://here"), "", None),
        (deformd.InvalidArgument, ValueError, lambda: client.server_info(timeout=-1), "", None),
    ]
    for kind, builtin, call, field, index in cases:
        with pytest.raises(kind) as raised:
            call()
        error = raised.value
        assert isinstance(error, builtin) and isinstance(error, deformd.Error) and str(error)
        assert (error.field, error.index) == (field, index)
        assert pickle.loads(pickle.dumps(error)).args == error.args


def test_setups_of_ten_mebibytes_go_their_way(tmp_path, client):
    n, lists = 128, 400
    number = np.arange(n * n).reshape(n, n)
    points = np.stack([number % n / n, number // n / n, 0 * number], axis=-1).reshape(-1, 3)
    faces = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    ids = {"left": number[:, :60].ravel().tolist(), "right": number[:, 68:].ravel().tolist()}
    (tmp_path / "ids.json").write_text(json.dumps(ids))

    def setup(count):
        def region(name):
            return {"union": [{"ids": {"file": str(tmp_path / "ids.json"), "set": name}}] * count}
        return {"method": {"rbf": {"kernel": "TRIHARMONIC"}}, "handles": [{"name": "right", "region": region("right")}],
                "fixed": [region("left")],
                "variables": [{"name": "up", "handle": "right", "translate": [0, 0, 1], "lower": -1, "upper": 1}]}

    geometry = client.register((points, faces))
    assert not client.check(setup(lists), geometry).problems
    large, small = client.prepare(setup(lists), geometry), client.prepare(setup(1), geometry)
    assert large.id != small.id and large.info.setup_bytes > 10 << 20
    assert large.bounds.tolist() == [[-1, 1]]  # of the setup, which came in pieces
    assert np.array_equal(large.deform([[0.1]]).points, small.deform([[0.1]]).points)
    assert list(client.system(large.id).names) == ["up"]
    assert {system.id for system in client.systems()} >= {large.id, small.id}
    geometry.delete(systems=True)


def test_the_line_of_a_setup_file_is_named(case, client):
    path = case.folder / "wrong.yaml"
    path.write_text("geometry: ahmed.obj\nhandels: []\n")
    with pytest.raises(deformd.InvalidArgument, match=r"wrong\.yaml:2.*handels.*handles"):
        client.prepare(path)
    with pytest.raises(deformd.InvalidArgument, match="geometry: missing"):
        client.prepare({"handles": []})


def test_mappings_take_expressions_as_texts_and_name_their_fields(case, client):
    def setup(lower):
        return {"geometry": str(case.mesh), "handles": [{"name": "roof", "region": {"group": "roof"}}], "fixed": [{"group": "underbody"}],
                "variables": [{"name": "up", "handle": "roof", "translate": [0, 0, 1], "lower": lower}]}

    points = client.register(case.mesh).points
    diagonal = np.linalg.norm(points.max(axis=0) - points.min(axis=0))
    np.testing.assert_allclose(client.prepare(setup("-0.05*L")).bounds[0, 0], -0.05 * diagonal, rtol=1e-12)
    for wrong, match in (("-1", "the text"), ("0.05*Q", "Q")):
        with pytest.raises(deformd.InvalidArgument, match=match) as raised:
            client.prepare(setup(wrong))
        assert (raised.value.field, raised.value.index) == ("variables[0].lower", 0)


def test_tls_and_tokens(tmp_path, monkeypatch):
    from test_identity import Authority
    Authority(str(tmp_path), "test").issue("server", "DNS:localhost,IP:127.0.0.1")
    token = tmp_path / "ada.token"
    token.write_text("a-secret-of-this-test")
    (tmp_path / "identities").write_text("ada reader sha256:" + hashlib.sha256(b"a-secret-of-this-test").hexdigest() + "\n")
    server = Server(str(tmp_path), "--tls-cert", str(tmp_path / "server.pem"), "--tls-key", str(tmp_path / "server.key"), "--identities",
                    str(tmp_path / "identities")).start()
    try:
        ca = tmp_path / "test-ca.pem"
        with deformd.Client(server.address, ca=ca, token_file=token) as made:
            assert made.geometries() == []
            assert pickle.loads(pickle.dumps(made)).geometries() == []
        with deformd.Client(server.address, ca=ca) as made, pytest.raises(deformd.Error, match="asks who calls.*--token-file"):
            made.geometries()
        with deformd.Client(server.address, ca=ca, token_file=token, server_name="other") as made, pytest.raises(deformd.Error, match="not for other"):
            made.geometries()
        with deformd.Client(server.address, max_attempts=1) as made, pytest.raises(deformd.Error, match="wants TLS"):
            made.geometries()
        contexts = tmp_path / "contexts.yaml"
        contexts.write_text(f"current: here\ncontexts: {{here: {{server: '{server.address}', ca: test-ca.pem, token_file: {token}}}}}\n")
        monkeypatch.setenv("DEFORM_CONFIG", str(contexts))
        for client in (deformd.Client(), deformd.Client(context="here"), deformd.Client(server.address, context="here")):
            with client as made:
                assert made.address == server.address and made.geometries() == []
        with deformd.Client(server.address, ca=ca) as made, pytest.raises(deformd.Error, match="asks who calls"):
            made.geometries()  # the token of the context in use is for its own address
        with pytest.raises(deformd.NotFound, match="there is no \"away\".*only here"):
            deformd.Client(context="away")
        monkeypatch.setenv("DEFORM_CA", str(ca))
        monkeypatch.setenv("DEFORM_TOKEN_FILE", str(token))
        with deformd.Client(server.address) as made:
            assert made.geometries() == []
        with pytest.raises(deformd.InvalidArgument, match="tls: False"):
            deformd.Client(server.address, tls=False, ca=ca)
        with pytest.raises(deformd.InvalidArgument, match="cert and key"):
            deformd.Client(server.address, cert=tmp_path / "server.pem")
    finally:
        server.stop()


def test_setups_have_expressions_degrees_and_variables_of_several_handles(case, client):
    path = case.folder / "degrees.yaml"
    text = case.setup.read_text().replace("upper: 0.05}", "upper: 0.05*L, also: [{handle: slant}]}")
    path.write_text(text.replace("centre: [0.843, 0, 0.338]}, lower: -0.2, upper: 0.2", "centre: [0.843, 0, 0.338], unit: DEGREES}, lower: -90/8"))
    system = client.prepare(path)
    np.testing.assert_allclose(system.bounds, [[-0.05, 0.05 * system.info.diagonal], [-11.25, np.inf]], rtol=1e-15)
    sizes, corners = system.geometry.faces
    faces = np.split(corners, np.cumsum(sizes)[:-1])
    roof, slant = (np.unique(np.concatenate([faces[f] for f in system.geometry.groups[name][1]])) for name in ("roof", "slant"))
    rest = system([0, 0])
    lifted = system([0.03, 0]) - rest
    np.testing.assert_allclose(lifted[slant], np.broadcast_to([0, 0, 0.03], (len(slant), 3)), atol=1e-12)
    assert np.abs(lifted[roof] - [0, 0, 0.03]).min() < 1e-12
    centre, angle = np.array([0.843, 0, 0.338]), np.radians(5)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    np.testing.assert_allclose(system([0, 5])[slant], (rest[slant] - centre) @ turn.T + centre, atol=1e-12)
    with pytest.raises(deformd.InvalidArgument, match=r"degrees\.yaml:.*upper.*lengths of the mesh"):
        client.prepare(path, case.mesh)


def test_check_lists_all_that_is_wrong(case, client):
    setup = {"handles": [{"name": "a", "region": {"group": "roff"}}, {"name": "", "region": {"group": "roof"}}]}
    problems = client.check(setup, case.mesh).problems
    assert len(problems) >= 2 and any("roff" in problem.message for problem in problems)
    estimate = client.check(case.setup)
    assert estimate.problems == () and estimate.fits and estimate.peak_bytes > 0


def test_nobody_there():
    start = time.monotonic()
    with deformd.Client("127.0.0.1:1", connect_timeout=0.2, max_attempts=2) as client:
        with pytest.raises(deformd.Unavailable, match="cannot reach deformd at 127.0.0.1:1") as raised:
            client.server_info()
    assert isinstance(raised.value, ConnectionError) and time.monotonic() - start < 20


class Door:
    """A port of this machine. Connections get the answer of greet(socket), which runs in a thread of its own."""

    def __init__(self, greet):
        self.greet = greet
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.listener.getsockname()[1]}"
        self.sockets = []
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        try:
            while True:
                self.sockets.append(self.listener.accept()[0])
                threading.Thread(target=self.greet, args=(self.sockets[-1],), daemon=True).start()
        except OSError:
            pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for one in [self.listener, *self.sockets]:
            one.close()


def pump(source, target):
    try:
        while data := source.recv(65536):
            target.sendall(data)
        target.shutdown(socket.SHUT_WR)
    except OSError:
        pass


def test_an_unreached_server_is_named_with_the_reason():
    def speak_http(connection):
        connection.sendall(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n")

    cases = [(lambda connection: None, "did not answer in time"), (lambda connection: connection.close(), "closed the connection"),
             (speak_http, "something other than deformd")]
    for greet, reason in cases:
        with Door(greet) as door, deformd.Client(door.address, connect_timeout=0.3, max_attempts=2) as client:
            with pytest.raises(deformd.Unavailable, match=f"cannot reach deformd at {door.address} .*{reason}"):
                client.server_info()
    with deformd.Client("127.0.0.1:1", connect_timeout=0.2, max_attempts=2) as client:
        with pytest.raises(deformd.Unavailable, match="nobody listens there"):
            client.server_info()


def test_a_server_too_busy_to_answer_at_once_is_waited_for(case):
    """Each attempt to connect counts, however quickly gRPC repeats the failure of the one before."""
    seen = []

    def answer_the_third(connection):
        seen.append(connection)
        if len(seen) < 3:
            return
        server = socket.create_connection(("127.0.0.1", case.server.port))
        threading.Thread(target=pump, args=(server, connection), daemon=True).start()
        pump(connection, server)

    with Door(answer_the_third) as door, deformd.Client(door.address, connect_timeout=1.5) as client:
        assert client.server_info().version == deformd.__version__
    assert len(seen) == 3


def test_waiting_for_a_silent_server_ends_at_the_deadline(case):
    with Door(lambda connection: None) as door, deformd.Client(door.address, connect_timeout=30, max_attempts=4) as client:
        start = time.monotonic()
        with pytest.raises((deformd.DeadlineExceeded, deformd.Unavailable)):
            client.server_info(timeout=0.5)
        assert time.monotonic() - start < 15


def test_the_address_comes_from_the_environment(case, monkeypatch):
    monkeypatch.setenv("DEFORM_SERVER", case.server.address)
    with deformd.Client() as client:
        assert client.address == case.server.address and client.server_info().version == deformd.__version__
    with pytest.raises(deformd.FailedPrecondition, match="closed"):
        client.server_info()


def long_setup(case):
    case.command("sample", "-o", "long.obj", "--points", "30000")
    (case.folder / "long.yaml").write_text(LONG_SETUP)
    return case.folder / "long.yaml"


def is_idle(client):
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        info = client.server_info()
        if info.running + info.queue_length == 0:
            return True
        time.sleep(0.05)
    return False


def test_control_c_cancels_here_and_on_the_server(lonely):
    setup = long_setup(lonely)
    with deformd.Client(lonely.server.address) as client:
        stages = []

        def interrupt(stage, fraction):
            stages.append(stage)
            if len(stages) == 1:
                os.kill(os.getpid(), signal.SIGINT)

        with pytest.raises(KeyboardInterrupt):
            client.prepare(setup, progress=interrupt)
        assert stages and is_idle(client)


def test_cancel_timeout_and_callbacks_that_raise(lonely):
    setup = long_setup(lonely)
    with deformd.Client(lonely.server.address) as client:
        geometry = client.register(lonely.folder / "long.obj")
        flag = deformd.Cancel()
        threading.Timer(0.3, flag.cancel).start()
        with pytest.raises(deformd.Cancelled):
            client.prepare(setup, geometry, cancel=flag)
        with pytest.raises(deformd.DeadlineExceeded) as raised:
            client.prepare(setup, geometry, timeout=0.2)
        assert isinstance(raised.value, TimeoutError)

        def fail(stage, fraction):
            raise RuntimeError("no more")

        with pytest.raises(RuntimeError, match="no more"):
            client.prepare(setup, geometry, progress=fail)
        assert is_idle(client)


def test_a_server_that_comes_back_is_found_again(lonely):
    with deformd.Client(lonely.server.address, max_attempts=8, connect_timeout=0.5) as client:
        system = client.prepare(lonely.setup)
        before = system([0.03, 0])
        lonely.server.kill()
        threading.Timer(0.5, lonely.server.start).start()
        np.testing.assert_array_equal(system([0.03, 0]), before)


def test_a_population_survives_a_killed_server(lonely):
    with deformd.Client(lonely.server.address, max_attempts=8, connect_timeout=0.5) as client:
        system = client.prepare(lonely.setup)
        designs = np.random.default_rng(5).uniform(-0.05, 0.05, (400, 2))
        expected = system(designs[:1])[0]
        seen = []
        killed = False
        for i, y, report in system.stream(designs, batch=4):
            assert report.error is None
            if i == 0:
                np.testing.assert_allclose(y, expected, rtol=0, atol=1e-13)
            seen.append(i)
            if len(seen) == 20 and not killed:
                killed = True
                lonely.server.kill()
                lonely.server.start()
        assert sorted(seen) == list(range(400)), "each once"


def test_several_servers_are_one(lonely, tmp_path):
    others = [Server(str(tmp_path / name)) for name in ("b", "c")]
    for server in others:
        os.mkdir(server.folder)
        server.start()
    servers = [lonely.server, *others]
    try:
        with deformd.Client(",".join(server.address for server in servers)) as client:
            system = client.prepare(lonely.setup)
            designs = np.random.default_rng(5).uniform(-0.05, 0.05, (200, 2))
            expected = system(designs)
            w = np.random.default_rng(6).normal(size=expected[0].shape)
            gradient = system.vjp(designs[0], w)

            def kill_the_owner():
                for server in servers:
                    if server.process.poll() is None:
                        with deformd.Client(server.address) as one:
                            if one.geometries():
                                server.kill()
                                return
                raise AssertionError("nobody has it")

            seen = {}
            for i, y, report in system.stream(designs, batch=4):
                assert report.error is None and i not in seen
                seen[i] = y.copy()
                if len(seen) == 20:
                    kill_the_owner()
            assert sorted(seen) == list(range(200)), "each once"
            for i, y in seen.items():
                np.testing.assert_array_equal(y, expected[i])
            kill_the_owner()
            np.testing.assert_array_equal(system.vjp(designs[0], w), gradient)
            assert system.evaluate(expected[0][:7], designs[1]).points.shape == (7, 3)
    finally:
        for server in others:
            server.stop()


def test_an_address_may_stand_for_several(lonely, monkeypatch):
    def forget():
        lonely.server.kill()
        shutil.rmtree(lonely.server.data)
        lonely.server.start()

    with deformd.Client(lonely.server.address) as plain:
        system = plain.prepare(lonely.setup)
        before = system([0.03, 0])
        forget()
        with pytest.raises(deformd.NotFound):
            system([0.03, 0])
    with deformd.Client(lonely.server.address, replicas=True) as told:
        system = told.prepare(lonely.setup)
        forget()
        np.testing.assert_array_equal(system([0.03, 0]), before)
        assert pickle.loads(pickle.dumps(told))._settings["replicas"] is True
    monkeypatch.setenv("DEFORM_REPLICAS", "1")
    with deformd.Client(lonely.server.address) as told:
        system = told.prepare(lonely.setup)
        forget()
        np.testing.assert_array_equal(system([0.03, 0]), before)


def test_many_threads_share_a_client(system, population):
    expected = [system(x) for x in population]
    wrong = []

    def work(i):
        for _ in range(5):
            if not np.array_equal(system(population[i]), expected[i]):
                wrong.append(i)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(9)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def evaluate(system):
    return system([0.03, 0])


def test_systems_go_to_other_processes(system):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        np.testing.assert_array_equal(pool.apply(evaluate, (system,)), system([0.03, 0]))
    copy = pickle.loads(pickle.dumps(system))
    assert copy.id == system.id and copy._client is not system._client


# A process of its own: what other libraries do at a fork is not looked at.
FORKING = """
import gc, os, sys, deformd
address, before, within = sys.argv[1:]
client = deformd.Client(address)
if before != "made":
    client.server_info()
if before == "closed":
    client.close()
child = os.fork()
if child == 0:
    try:
        (client if within == "same" else deformd.Client(address)).server_info()
        code = 3
    except deformd.FailedPrecondition as error:
        code = 7 if "os.fork()" in str(error) and "spawn" in str(error) else 8
    if within == "ends":
        del client
        gc.collect()
        sys.exit(code)
    os._exit(code)
code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
if before != "closed":
    client.server_info()
sys.exit(code)
"""


@pytest.mark.parametrize("before, within, code", [("made", "same", 7), ("called", "same", 7), ("made", "other", 7), ("called", "other", 7),
                                                  ("called", "ends", 7), ("closed", "other", 3), ("closed", "same", 7)])
def test_processes_forked_beside_a_client_are_refused_and_others_connect(case, before, within, code):
    assert subprocess.run([sys.executable, "-c", FORKING, case.server.address, before, within], timeout=60).returncode == code


FORKED_POOL = """
import multiprocessing, sys, deformd

def evaluate(system):
    return system([0.03, 0])

if __name__ == "__main__":
    client = deformd.Client(sys.argv[1])
    with multiprocessing.get_context("fork").Pool(1) as pool:
        try:
            pool.apply_async(evaluate, (client.system(sys.argv[2]),)).get(30)
        except deformd.FailedPrecondition:
            sys.exit(7)
"""


def test_a_forked_pool_that_is_given_systems_says_why_it_cannot(case, system, tmp_path):
    script = tmp_path / "pool.py"
    script.write_text(FORKED_POOL)
    assert subprocess.run([sys.executable, script, case.server.address, system.id], timeout=60).returncode == 7


def test_release_and_delete(case, client):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1.0]])
    geometry = client.register((points, [[0, 1, 2], [0, 2, 3], [0, 4, 5], [0, 5, 1]]))
    setup = {"method": {"rbf": {"kernel": "BIHARMONIC"}}, "handles": [{"name": "a", "region": {"ids": np.array([4, 5])}}],
             "fixed": [{"ids": [0, 1, 2]}], "variables": [{"name": "up", "handle": "a", "translate": [0, 0, 1]}]}
    system = client.prepare(setup, geometry)
    assert client.prepare(system.info.setup, geometry).id == system.id
    assert client.prepare(setup, geometry.id).id == system.id
    assert system.id in {one.id for one in client.systems()} and geometry.id in {one.id for one in client.geometries()}
    with pytest.raises(deformd.FailedPrecondition):
        geometry.delete()
    system.release()
    assert not client.system(system.id).info.resident
    system.release(forget=True)
    with pytest.raises(deformd.NotFound):
        client.system(system.id)
    geometry.delete()
    with pytest.raises(deformd.NotFound):
        client.geometry(geometry.id)
