# SPDX-License-Identifier: GPL-3.0-or-later
"""Points that were never registered, and many cotangents at once: a real server against direct sums in numpy."""

import asyncio
import csv

import numpy as np
import pytest

import deformd


def sheet(columns=25, rows=13):
    """A height field over [0, 2] x [0, 1]: points (n, 3) and quads."""
    x, y = np.meshgrid(np.linspace(0, 2, columns), np.linspace(0, 1, rows), indexing="xy")
    points = np.stack([x.ravel(), y.ravel(), 0.1 * np.sin(3 * x.ravel()) * np.cos(2 * y.ravel())], axis=1)
    number = np.arange(columns * rows).reshape(rows, columns)
    return points, np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)


POINTS, QUADS = sheet()
END, LEFT = np.flatnonzero(POINTS[:, 0] > 1.7), np.flatnonzero(POINTS[:, 0] < 0.3)
X = [0.2, 0.3]

KERNELS = {
    "TRIHARMONIC": lambda r, s: r ** 3,
    "BIHARMONIC": lambda r, s: r,
    "THIN_PLATE": lambda r, s: r ** 2 * np.log(np.maximum(r, 1e-300)),
    "GAUSSIAN": lambda r, s: np.exp(-((r / s) ** 2)),
    "MULTIQUADRIC": lambda r, s: np.sqrt(r ** 2 + s ** 2),
    "INVERSE_MULTIQUADRIC": lambda r, s: 1 / np.sqrt(r ** 2 + s ** 2),
    "WENDLAND_C2": lambda r, s: np.maximum(0, 1 - r / s) ** 4 * (4 * r / s + 1),
}


def setup(method, **more):
    return {"method": method, "handles": [{"name": "end", "region": {"ids": END.tolist()}}], "fixed": [{"ids": LEFT.tolist()}],
            "variables": [{"name": "up", "handle": "end", "translate": [0.1, 0, 1]},
                          {"name": "turn", "handle": "end", "rotate": {"axis": [0, 1, 0], "centre": [1.8, 0.5, 0]}}], **more}


def prepared(client, method, **more):
    return client.prepare(setup(method, **more), (POINTS, QUADS))


def moved_end(up, turn):
    """What the handle does: sums of displacements about rest."""
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    centre = np.array([1.8, 0.5, 0])
    return (POINTS[END] - centre) @ rotation.T + centre + up * np.array([0.1, 0, 1])


def probes(count=300, seed=3):
    return np.random.default_rng(seed).uniform([-0.2, -0.2, -0.3], [2.2, 1.2, 0.3], (count, 3))


@pytest.mark.parametrize("kernel", sorted(KERNELS))
def test_rbf_is_the_dense_interpolant(client, kernel):
    system = prepared(client, {"rbf": {"kernel": kernel, "shape": 0.1, "reduction": "REDUCTION_OFF", "polynomial_degree": 1}})
    centres = np.vstack([POINTS[END], POINTS[LEFT]])
    handle = np.abs(system(X)[END] - POINTS[END]).max()
    values = np.vstack([system(X)[END] - POINTS[END], np.zeros((len(LEFT), 3))])
    assert handle > 0.1
    s = 0.1 * np.linalg.norm(centres.max(axis=0) - centres.min(axis=0))
    phi = lambda a, b: KERNELS[kernel](np.linalg.norm(a[:, None] - b[None], axis=2), s)  # noqa: E731
    polynomial = lambda a: np.hstack([np.ones((len(a), 1)), a])  # noqa: E731
    matrix = np.block([[phi(centres, centres), polynomial(centres)], [polynomial(centres).T, np.zeros((4, 4))]])
    weights = np.linalg.solve(matrix, np.vstack([values, np.zeros((4, 3))]))
    at = probes()
    expected = at + np.hstack([phi(at, centres), polynomial(at)]) @ weights
    got = system.evaluate(at, X)
    np.testing.assert_allclose(got.points, expected, atol=1e-8)
    assert got.report.points == len(at) and got.report.converged and got.report.sums_error == 0
    np.testing.assert_allclose(got.report.max_displacement, np.linalg.norm(got.points - at, axis=1).max(), rtol=1e-12)


METHODS = {
    "rbf": {"rbf": {"kernel": "TRIHARMONIC"}},
    "rbf incremental": {"rbf": {"kernel": "TRIHARMONIC", "solver": "INCREMENTAL_QR"}},
    "mls": {"mls": {}},
    "subspace": {"subspace": {"centres": 60}},
    "ffd": {"ffd": {"lattice": {"points": [6, 5, 5]}}},
    "ffd MESH": {"ffd": {"control": "MESH", "lattice": {"points": [6, 5, 5]}}},
}


@pytest.mark.parametrize("name", sorted(METHODS))
def test_registered_points_go_where_deform_puts_them(client, name):
    system = prepared(client, METHODS[name])
    direct = system.deform(X, path="PATH_DIRECT", encoding="RAW_F64")
    got = system.evaluate(POINTS, X, encoding="RAW_F64")
    assert np.array_equal(got.points, direct.points)
    assert got.report.estimated_error == direct.report.estimated_error
    if name != "rbf incremental":  # which takes fewer centres for a design than for a basis
        np.testing.assert_allclose(got.points, system(X), atol=1e-12 * system.info.diagonal)


def test_symmetry_planes_hold_on_both_sides(client):
    system = prepared(client, {"rbf": {}}, symmetry=[{"point": [0, 0, 0], "normal": [0, 1, 0]}])
    at = probes()
    at[:50, 1] = 0
    mirror = np.array([1, -1, 1])
    got, other = system.evaluate(at, X).points, system.evaluate(at * mirror, X).points
    np.testing.assert_allclose(other, got * mirror, atol=1e-12)
    assert (got[:50, 1] == 0).all()


def test_large_sets_motions_and_encodings(client):
    system = prepared(client, {"rbf": {}})
    at = probes(200_001)
    exact = system.evaluate(at, X, encoding="RAW_F64")
    assert exact.points.shape == at.shape
    part = system.evaluate(at[70_000:70_500], X, encoding="RAW_F64").points
    assert np.array_equal(part, exact.points[70_000:70_500])
    coded = system.evaluate(at, X, encoding="DELTA_ZSTD", tolerance=1e-5)
    assert np.abs(coded.points - exact.points).max() <= 1.000001e-5
    assert coded.report.max_error <= 1e-5
    lift = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.2]])
    moved = system.evaluate(at[:100], motions={"end": lift}, encoding="RAW_F64").points
    by_point = system.evaluate(at[:100], motions={"end": np.tile([0, 0, 0.2], (len(END), 1))}, encoding="RAW_F64").points
    np.testing.assert_allclose(moved, by_point, atol=1e-12)
    np.testing.assert_allclose(moved, system.evaluate(at[:100], [0.2, 0], encoding="RAW_F64").points - 0, atol=0.03)  # which goes along x, too
    assert system.evaluate(np.empty((0, 3)), X).points.shape == (0, 3)
    assert np.array_equal(system.evaluate(at[:10]).points, at[:10]), "at rest"


def test_what_is_not_defined_is_refused(client):
    with pytest.raises(deformd.FailedPrecondition, match="shell.*faces"):
        prepared(client, {"shell": {}}).evaluate(probes(), X)
    system = prepared(client, {"rbf": {}})
    at = probes()
    at[17, 1] = np.nan
    with pytest.raises(deformd.InvalidArgument, match=r"points\[17\].*finite"):
        system.evaluate(at, X)
    with pytest.raises(deformd.InvalidArgument, match="points"):
        system.evaluate(np.zeros((5, 2)), X)
    with pytest.raises(deformd.InvalidArgument, match="variables|designs"):
        system.evaluate(probes(), [1, 2, 3])
    cancel = deformd.Cancel()
    cancel.cancel()
    with pytest.raises(deformd.Cancelled):
        system.evaluate(probes(), X, cancel=cancel)


def test_points_outside_of_a_lattice_stay(client):
    system = prepared(client, METHODS["ffd"])
    at = np.array([[1.9, 0.5, 0], [1.9, 0.5, 50], [-30, 0, 0]])
    got = system.evaluate(at, X)
    assert got.report.still == 2
    assert np.array_equal(got.points[1:], at[1:]) and not np.array_equal(got.points[0], at[0])


def test_asyncio(case):
    async def run():
        async with deformd.aio.Client(case.server.address) as client:
            system = await client.prepare(setup({"rbf": {}}), (POINTS, QUADS))
            return await asyncio.gather(*(system.evaluate(probes(100, seed), X) for seed in range(4)))

    with deformd.Client(case.server.address) as client:
        system = prepared(client, {"rbf": {}})
        for seed, got in enumerate(asyncio.run(run())):
            assert np.array_equal(got.points, system.evaluate(probes(100, seed), X).points)


@pytest.mark.parametrize("basis", ["BASIS_ALWAYS", "BASIS_NEVER"])
@pytest.mark.parametrize("method", ["rbf", "shell"])
def test_many_cotangents_are_single_ones(client, method, basis):
    options = {"basis": basis} if method == "rbf" else {"energy": {"basis": basis}}
    system = prepared(client, {method: options})
    fields = np.random.default_rng(8).normal(size=(5, *POINTS.shape))
    together = system.vjp(X, fields)
    assert together.shape == (5, 2)
    alone = np.array([system.vjp(X, field) for field in fields])
    np.testing.assert_allclose(together, alone, rtol=1e-9, atol=1e-9 * np.abs(alone).max())
    products = np.stack([system.jvp(X, direction) for direction in np.eye(2)])
    np.testing.assert_allclose(together, np.einsum("mij,kij->mk", fields, products), rtol=1e-8, atol=1e-8 * np.abs(alone).max())
    assert system.vjp(X, fields[:0]).shape[0] == 0
    broken = fields.copy()
    broken[3, 7, 1] = np.inf
    with pytest.raises(deformd.InvalidArgument, match=r"cotangents\[3\].*point 7"):
        system.vjp(X, broken)
    with pytest.raises(deformd.InvalidArgument, match=r"cotangent: an array of shape \(5, \d+, 3\), expected \(\d+, 3\), or"):
        system.vjp(X, fields[:, :-1])
    with pytest.raises(deformd.InvalidArgument, match="1001.*1000"):
        system.vjp(X, np.zeros((1001, *POINTS.shape)))


def test_command_line(case, system):
    at = np.random.default_rng(4).uniform([0, -0.2, 0], [1, 0.2, 0.3], (5000, 3))
    table = case.folder / "probes.csv"
    lines = ["# probes of a test", "name, z, x,y , note"]
    lines += [f'p{i}, {p[2]!r}, {p[0]!r},{p[1]!r},"a, b"' for i, p in enumerate(at.tolist())]
    lines.insert(40, "")
    table.write_bytes("\r\n".join(lines).encode() + b"\r\n")
    printed = case.command("evaluate", "ahmed.yaml", "probes.csv", "--set", "roof_up=0.03", "-o", "moved.csv", "--encoding", "raw_f64")
    assert "5000 points" in printed and "estimated error" in printed
    expected = system.evaluate(at, {"roof_up": 0.03}, encoding="RAW_F64").points
    written = (case.folder / "moved.csv").read_bytes().decode()
    assert written.count("\r\n") == len(lines) and written.startswith("# probes of a test\r\nname, z, x,y , note\r\n")
    rows = [row for row in csv.reader(line for line in written.splitlines() if line and not line.startswith("#"))][1:]
    got = np.array([[float(row[2]), float(row[3]), float(row[1])] for row in rows])
    assert np.array_equal(got, expected)
    assert [row[0] for row in rows] == [f"p{i}" for i in range(5000)] and all(row[4].endswith("b") or row[5:] for row in rows)

    np.savetxt(case.folder / "probes.xyz", at, fmt="%.17g")
    case.command("evaluate", "ahmed.yaml", "probes.xyz", "--set", "roof_up=0.03", "-o", "moved.xyz", "--encoding", "raw_f64")
    assert np.array_equal(np.loadtxt(case.folder / "moved.xyz"), expected)

    case.command("sample", "-o", "other.obj", "--points", "3000")  # another mesh of the same body
    case.command("evaluate", "ahmed.yaml", "other.obj", "--set", "roof_up=0.03", "-o", "other_moved.obj", "--encoding", "raw_f64")
    vertices = lambda name: np.array([[float(v) for v in line.split()[1:4]] for line in (case.folder / name).read_text().splitlines() if line.startswith("v ")])  # noqa: E731
    np.testing.assert_allclose(vertices("other_moved.obj"), system.evaluate(vertices("other.obj"), {"roof_up": 0.03}, encoding="RAW_F64").points, atol=1e-15)


def test_command_line_refuses(case):
    def refused(*arguments):
        with pytest.raises(AssertionError) as raised:
            case.command("evaluate", *arguments)
        return str(raised.value)

    (case.folder / "bad.csv").write_text("x,y,z\n1,2,3\n4,five,6\n")
    assert "bad.csv:3: y: \"five\" is no finite number" in refused("ahmed.yaml", "bad.csv", "-o", "out.csv").replace('\\"', '"')
    assert not (case.folder / "out.csv").exists() and not (case.folder / "out.csv.partial").exists()
    (case.folder / "columns.csv").write_text("x,z\n1,2\n")
    assert "no column y" in refused("ahmed.yaml", "columns.csv", "-o", "out.csv")
    (case.folder / "short.xyz").write_text("1 2 3\n4 5\n")
    assert "short.xyz:2" in refused("ahmed.yaml", "short.xyz", "-o", "out.xyz")
    (case.folder / "infinite.xyz").write_text("1 2 inf\n")
    assert "infinite.xyz:1: z" in refused("ahmed.yaml", "infinite.xyz", "-o", "out.xyz")
    assert "bad.csv" in refused("ahmed.yaml", "bad.csv", "-o", "bad.csv")
