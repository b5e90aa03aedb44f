# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled deformations: the bits of the server and of the command line, without either."""

import asyncio
import multiprocessing
import pathlib
import pickle
import threading
import time

import numpy as np
import pytest

import deformd
from conftest import brick
from deformd.adapters import ScipyObjective
from harness import read_obj


@pytest.fixture
def fast(system):
    return system.local()


@pytest.fixture
def block(client):
    """More points than one thread takes: 17,000."""
    points, hexahedra = brick((40, 20, 20))
    x = points[:, 0]
    geometry = client.register((points, {"hexahedron": hexahedra}), groups={"left": np.flatnonzero(x == 0), "right": np.flatnonzero(x == 40)})
    return client.prepare({"handles": [{"name": "right", "region": {"group": "right"}}], "fixed": [{"group": "left"}],
                           "variables": [{"name": "push", "handle": "right", "translate": [-1, 0, 0], "lower": -10, "upper": 10},
                                         {"name": "turn", "handle": "right", "rotate": {"axis": [1, 0, 0], "centre": [40, 10, 10]},
                                          "lower": -1, "upper": 1}]}, geometry).local()


def assert_same(actual, expected, diagonal):
    """The bits of a server that fuses products with sums, which needs FMA; else the bound that docs/compiled.md has."""
    info = pathlib.Path("/proc/cpuinfo")
    if not info.exists() or {"avx2", "fma"} <= set(info.read_text().split()):
        np.testing.assert_array_equal(actual, expected)
    else:
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-14 * diagonal)


def test_the_bits_of_the_server(system, fast, population):
    one = fast(population[0])
    assert one.shape == (system.info.points, 3) and one.dtype == np.float64 and one.flags.c_contiguous
    assert_same(one, system(population[0], path="PATH_BASIS"), system.info.diagonal)
    assert np.abs(one - fast.rest).max() > 1e-3
    many = np.tile(population, (4, 1)) * np.linspace(0.1, 1, 36)[:, None]  # more than share one pass
    assert_same(fast(many), system(many, path="PATH_BASIS", batch=7), system.info.diagonal)
    np.testing.assert_array_equal(fast(many)[17], fast(many[17]))
    np.testing.assert_array_equal(fast({"slant_turn": 0.1}), fast([0, 0.1]))
    np.testing.assert_array_equal(fast([{"roof_up": 0.02}, {"slant_turn": 0.1}]), fast([[0.02, 0], [0, 0.1]]))
    np.testing.assert_array_equal(fast(None), system.geometry.points)
    assert fast(np.empty((0, 2))).shape == (0, system.info.points, 3)


def test_the_bits_of_the_command_line(case, fast):
    fast.save(case.folder / "car.deformation")
    case.command("apply", "car.deformation", "--set", "roof_up=0.03", "--set", "slant_turn=0.1", "-o", "applied.obj")
    np.testing.assert_array_equal(fast([0.03, 0.1]), np.array(read_obj(str(case.folder / "applied.obj"))[0]))


def test_what_it_says_of_itself(case, system, fast):
    assert fast.variables == system.variables and fast.names == ("roof_up", "slant_turn")
    np.testing.assert_array_equal(fast.bounds, system.bounds)
    np.testing.assert_array_equal(fast.rest, system.geometry.points)
    assert not fast.rest.flags.writeable
    assert (fast.system_id, fast.geometry_id, fast.mesh, fast.method) == (system.id, system.geometry.id, "ahmed.obj", "rbf")
    assert fast.diagonal == system.info.diagonal and list(fast.notes) == list(system.info.notes)
    assert "2018 points, variables roof_up, slant_turn" in repr(fast)


def test_the_mesh_has_the_name_of_the_setup_and_not_of_its_first_copy(case, client, system, tmp_path):
    copy = tmp_path / "copy.obj"
    copy.write_text("# a copy\n" + case.mesh.read_text())
    again = client.prepare(case.setup, str(copy))
    assert again.id == system.id
    again.local().save(tmp_path / "copy.deformation")
    assert deformd.load(tmp_path / "copy.deformation").mesh == "copy.obj"
    assert client.prepare(case.setup, client.register(str(copy), name="mine")).local().mesh == "mine"
    assert client.system(system.id).local().mesh == "ahmed.obj"  # no mesh is known here but the first


def test_derivatives_are_those_of_the_server(system, fast):
    x, v = [0.01, -0.05], [0.3, -0.7]
    w = np.random.default_rng(3).normal(size=fast.rest.shape)
    assert_same(fast.jvp(x, v), system.jvp(x, v), system.info.diagonal)
    assert_same(fast.jacobian(x), system.jacobian(x), system.info.diagonal)
    assert_same(fast.jvp(None, {"roof_up": 1}), system.jacobian()[:, :, 0], system.info.diagonal)
    np.testing.assert_allclose(fast.vjp(x, w), system.vjp(x, w), rtol=1e-11)
    np.testing.assert_allclose(fast.vjp(x, w), np.einsum("nd,ndk->k", w, fast.jacobian(x)), rtol=1e-10)


def test_derivatives_are_those_of_the_points(fast):
    x, step = np.array([0.01, -0.05]), 1e-5
    for i, direction in enumerate(np.eye(2)):
        difference = (fast(x + step * direction) - fast(x - step * direction)) / (2 * step)
        assert np.abs(difference).max() > 0.1
        np.testing.assert_allclose(fast.jacobian(x)[:, :, i], difference, rtol=0, atol=1e-8)


def test_float32_is_rounded_once(fast, population):
    exact = fast(population)
    points = fast(population, dtype=np.float32)
    assert points.dtype == np.float32
    np.testing.assert_array_equal(points, exact.astype(np.float32))
    np.testing.assert_array_equal(fast.deform(population[0], dtype="float32").points, points[0])
    np.testing.assert_array_equal(fast(population, dtype=np.float32, bad="keep"), points)
    vectors = fast.jvp(population[0], [1, 1], dtype=np.float32)
    np.testing.assert_array_equal(vectors, fast.jvp(population[0], [1, 1]).astype(np.float32))
    w = np.random.default_rng(3).normal(size=fast.rest.shape).astype(np.float32)
    gradient = fast.vjp(population[0], w)
    assert gradient.dtype == np.float64
    np.testing.assert_array_equal(gradient, fast.vjp(population[0], w.astype(np.float64)))
    np.testing.assert_array_equal(gradient, fast.vjp(population[0], np.asfortranarray(w)))
    with pytest.raises(deformd.InvalidArgument, match="dtype: int32, expected float64 or float32"):
        fast(population, dtype=np.int32)


def test_out_is_filled(fast, population):
    n = len(fast.rest)
    for bad in ("raise", "keep"):
        for dtype in (np.float64, np.float32):
            out = np.zeros((9, n, 3), dtype)
            assert fast(population, out=out, bad=bad) is out
            np.testing.assert_array_equal(out, fast(population, dtype=dtype))
    vectors = np.zeros((n, 3))
    assert fast.jvp(None, [1, 0], out=vectors) is vectors
    np.testing.assert_array_equal(vectors, fast.jvp(None, [1, 0]))
    locked = np.zeros((9, n, 3))
    locked.flags.writeable = False
    out = np.zeros((9, n, 3))
    for wrong in (np.zeros((8, n, 3)), np.zeros((9, n, 3), np.int64), out[:, :, ::-1], np.zeros((9, n, 3), ">f8"), locked, out.tolist()):
        with pytest.raises(deformd.InvalidArgument, match=rf"out: expected a writeable array of shape \(9, {n}, 3\), float64 or float32 in C"):
            fast(population, out=wrong)
    with pytest.raises(deformd.InvalidArgument, match=r"out: .*\), float32 in C"):
        fast(population, out=out, dtype=np.float32)


def test_threads_change_nothing(block):
    x = np.random.default_rng(5).uniform(-1, 1, (20, 2))
    w = np.random.default_rng(3).normal(size=block.rest.shape)
    for threads in (0, 2, 3):
        np.testing.assert_array_equal(block(x, threads=threads), block(x))
        np.testing.assert_array_equal(block.jvp(x[0], [1, 2], threads=threads), block.jvp(x[0], [1, 2]))
        np.testing.assert_array_equal(block.vjp(x[0], w, threads=threads), block.vjp(x[0], w))
    for wrong in (-1, 1.5, 1025, "all"):
        with pytest.raises(deformd.InvalidArgument, match=r"threads: .*, expected 0 \(all cores\) to 1024"):
            block(x, threads=wrong)


def test_calls_give_the_gil_back(block):
    x = np.zeros((1500, 2))
    out = np.empty((1500, *block.rest.shape), np.float32)
    w = np.zeros(block.rest.shape)
    calls = {"points": lambda: block._native.evaluate(x, out, 1), "deform": lambda: block._native.deform(x, out, 1)}
    for name, call in calls.items():
        span, ticks = [], []

        def work():
            begin = time.monotonic()
            call()
            span.extend((begin, time.monotonic()))

        thread = threading.Thread(target=work)
        thread.start()
        while thread.is_alive():
            ticks.append(time.monotonic())
        thread.join()
        begin, end = span
        assert any(begin + 0.2 * (end - begin) < tick < end - 0.2 * (end - begin) for tick in ticks), name
    assert block.vjp(None, w).tolist() == [0, 0]


def test_designs_that_cannot_be_evaluated(system, fast, population):
    population[4, 1] = 7
    expected = system.deform(population)
    result = fast.deform(population)
    np.testing.assert_array_equal(result.usable, expected.usable)
    assert np.isnan(result.points[4]).all()
    np.testing.assert_array_equal(np.delete(result.points, 4, axis=0), fast(np.delete(population, 4, axis=0)))
    error, server_error = result.reports[4].error, expected.reports[4].error
    assert isinstance(error, deformd.InvalidArgument) and "7 is outside of its bounds [-0.2, 0.2]" in str(error)
    assert (error.field, error.index) == (server_error.field, server_error.index) == ("variables[1]", 1)
    assert result.reports[4].bad and result.reports[4].to_dict()["error"]["code"] == "invalid_argument"
    np.testing.assert_array_equal(fast(population, bad="keep"), result.points)
    with pytest.warns(deformd.BadDesignWarning, match=r"designs\[4\]: .*slant_turn"):
        fast(population, bad="warn")
    with pytest.raises(deformd.BadDesign, match=r"^designs\[4\]: ") as raised:
        fast(population)
    np.testing.assert_array_equal(raised.value.deformation.points, result.points)
    with pytest.raises(deformd.InvalidArgument, match=r"^variables\[1\] \(.slant_turn.\): 7 is outside"):
        fast(population[4])
    assert np.isnan(fast(population[4], bad="keep")).all()
    assert np.isnan(fast(population[4:5], bad="keep")).all()
    with pytest.raises(deformd.InvalidArgument, match=r"variables\[0\].*must be finite"):
        fast([np.nan, 0])


def test_motions_beyond_the_digits_of_the_model_are_bad(case, client):
    (case.folder / "unbounded.yaml").write_text((case.folder / "ahmed.yaml").read_text().replace("lower: -0.05, upper: 0.05", "lower: -1e308, upper: 1e308"))
    system = client.prepare(case.folder / "unbounded.yaml")
    for report in (system.deform([1e300, 0]).report, system.local().deform([1e300, 0]).report):
        assert report.max_displacement == pytest.approx(1e300, rel=1e-6)
        assert report.bad and "times the diagonal of the model" in report.reasons[0]
    assert not system.local().deform([1e9, 0]).report.bad


def test_wrong_arguments_are_refused(fast):
    for wrong, message in [([1, 2, 3], "3 values, the setup has 2 variables: roof_up, slant_turn"), (np.zeros((1, 1, 2)), r"shape \(1, 1, 2\)"),
                           ({"roof": 1}, 'no variable "roof"; did you mean "roof_up"')]:
        with pytest.raises(deformd.InvalidArgument, match=message):
            fast(wrong)
    with pytest.raises(deformd.InvalidArgument, match="bad: 'maybe'"):
        fast([0, 0], bad="maybe")
    with pytest.raises(deformd.InvalidArgument, match=r"cotangent: an array of shape \(3, 2\), expected \(2018, 3\)"):
        fast.vjp(None, np.zeros((3, 2)))
    w = np.zeros(fast.rest.shape)
    w[5, 1] = np.inf
    with pytest.raises(deformd.InvalidArgument, match=r"cotangent\[5\]: must be finite"):
        fast.vjp(None, w)
    with pytest.raises(deformd.InvalidArgument, match=r"direction\[1\]: must be finite"):
        fast.jvp(None, [0, np.nan])


def test_reports_are_those_of_the_server(system, fast, population):
    for report, right in zip(fast.report(population), system.deform(population).reports):
        for name in ("estimated_error", "prescribed_displacement", "max_displacement", "relative_error", "interpolation_residual"):
            assert getattr(report, name) == pytest.approx(getattr(right, name), rel=1e-11), name
        assert report.converged and not report.bad and report.reasons == () and report.error is None
    report = fast.deform(population[0]).report
    assert fast.report(population[0]).to_dict() == report.to_dict() == pickle.loads(pickle.dumps(report)).to_dict()
    assert fast.report(None).relative_error == 0 and fast.report(None).max_displacement == 0
    assert fast.report([9, 0]).error.index == 0


def test_points_across_symmetry_planes_are_those_of_the_server(client):
    points, hexahedra = brick((6, 3, 3))
    axis = np.array([0.6, 0.8, 0.0])  # of the plane; the block is on its side
    turned = points @ np.array([axis, [-0.8, 0.6, 0], [0, 0, 1]])
    geometry = client.register((turned, {"hexahedron": hexahedra}), groups={"end": np.flatnonzero(points[:, 0] == 6), "low": np.flatnonzero(points[:, 2] == 0)})
    setup = {"handles": [{"name": "end", "region": {"group": "end"}}], "fixed": [{"intersection": [{"group": "low"}, {"box": {"min": [-9, -9, -9], "max": [0.4, 9, 9]}}]}],
             "symmetry": [{"point": [0, 0, 0], "normal": axis.tolist()}],
             "variables": [{"name": "push", "handle": "end", "translate": (-axis).tolist(), "lower": 0, "upper": 9}]}
    system = client.prepare(setup, geometry)
    fast = system.local()
    pushes = np.array([[0.0], [1.0], [6.5], [8.0]])
    expected = [report.points_across_symmetry for report in system.deform(pushes).reports]
    assert expected[:2] == [0, 0] and 0 < expected[2] <= expected[3]
    reports = fast.report(pushes)
    assert [report.points_across_symmetry for report in reports] == expected == [report.to_dict()["points_across_symmetry"] for report in reports]
    assert [report.points_across_symmetry for report in fast.deform(pushes, dtype=np.float32).reports] == expected
    assert pickle.loads(pickle.dumps(reports[3])).points_across_symmetry == expected[3]
    assert fast.report([10]).points_across_symmetry is None


def test_a_mirrored_handle_is_doubtful_as_the_server_says(case, client):
    setup = {"geometry": str(case.mesh), "handles": [{"name": "roof", "region": {"group": "roof"}}], "fixed": [{"group": "stilts"}], "method": {"rbf": {}},
             "variables": [{"name": "fat", "handle": "roof", "scale": {"centre": [0.5, 0, 0.3], "axis": [0, 1, 0]}, "lower": -3, "upper": 1}]}
    system = client.prepare(setup)
    fast = system.local()
    told = ('handle "roof" is mirrored by fat = -3: its linear map has determinant -2',)
    report = fast.report([-3])
    assert report.doubts == told and pickle.loads(pickle.dumps(report)).doubts == told and report.to_dict()["doubts"] == list(told)
    assert told[0] in system.deform([-3]).report.reasons
    assert fast.report([-0.5]).doubts == () == fast.report([9]).doubts


def test_errors_are_judged_by_the_size_of_the_rest_where_points_have_strayed(client):
    """What is wrong by many motions is a part of the box that would be neglected."""
    points, hexahedra = brick((6, 6, 6))
    setup = {"method": {"rbf": {"kernel": "TRIHARMONIC"}}, "handles": [{"name": "right", "region": {"group": "right"}}], "fixed": [{"group": "left"}],
             "variables": [{"name": "push", "handle": "right", "translate": [-0.1, 0.1, 0]}]}
    for far, bad in ((20, False), (1e15, True)):
        strayed = np.vstack([points, [[far, 3, 3]]])
        geometry = client.register((strayed, {"hexahedron": hexahedra}),
                                   groups={"left": np.flatnonzero(points[:, 0] == 0), "right": np.flatnonzero(points[:, 0] == 6)})
        system = client.prepare(setup, geometry)
        served, report = system.deform([1]).report, system.local().report([1])
        assert (report.bad, served.bad) == (bad, bad), (report, served)
        assert [reason for reason in served.reasons if "most points lie within" in reason] == list(report.doubts)
        assert len(report.doubts) == bad


def test_a_solution_that_is_wrong_is_bad():
    fine = deformd.CompiledReport(1e-5, 1.0, 1.0, 0.0, True, diagonal=2.0)
    assert not fine.bad
    assert deformd.CompiledReport(2e-3, 1.0, 1.0, 0.0, True, diagonal=2.0).reasons == ("the estimated error is 0.002, 0.002 of the largest displacement",)
    assert not deformd.CompiledReport(1e-14, 1e-12, 1e-12, 0.0, True, diagonal=2.0).bad  # nothing beside the mesh
    assert "did not reach its tolerance" in deformd.CompiledReport(1e-5, 1.0, 1.0, 0.0, False, diagonal=2.0).reasons[0]
    assert deformd.CompiledReport(np.inf, np.inf, 1.0, 0.0, True, diagonal=2.0).reasons == ("points are not finite",)


def test_files(case, fast, population):
    path = case.folder / "saved.deformation"
    fast.save(path)
    case.command("compile", "ahmed.yaml", "-o", "compiled.deformation")
    assert path.read_bytes() == (case.folder / "compiled.deformation").read_bytes()
    again = deformd.load(path)
    again.save(path)  # over what it was read from
    precious = case.folder / "precious.txt"
    precious.write_text("mine")
    with pytest.raises(deformd.InvalidArgument, match="precious.txt exists and is no compiled deformation"):
        again.save(precious)
    assert precious.read_text() == "mine"
    assert path.read_bytes() == (case.folder / "compiled.deformation").read_bytes()
    np.testing.assert_array_equal(deformd.load(str(path))(population), fast(population))
    assert not list(case.folder.glob("*.part"))


def test_a_file_with_a_basis_in_codes_stays_small(case, client, population):
    setup = case.folder / "coded.yaml"
    setup.write_text(case.setup.read_text().replace("kernel: TRIHARMONIC", "kernel: TRIHARMONIC, basis_tolerance: 1e-6"))
    fast = client.prepare(setup).local()
    fast.save(case.folder / "coded.deformation")
    case.command("compile", "coded.yaml", "-o", "right.deformation")
    content = (case.folder / "coded.deformation").read_bytes()
    assert content == (case.folder / "right.deformation").read_bytes() and b"CODE" in content
    for other in (deformd.load(case.folder / "right.deformation"), pickle.loads(pickle.dumps(fast))):
        np.testing.assert_array_equal(other(population), fast(population))
    assert len(pickle.dumps(fast)) < len(content) + 200
    case.command("apply", "coded.deformation", "--set", "roof_up=0.03", "-o", "coded.obj")
    np.testing.assert_array_equal(fast({"roof_up": 0.03}), np.array(read_obj(str(case.folder / "coded.obj"))[0]))


def test_a_file_that_cannot_be_written_leaves_nothing(case, fast):
    target = case.folder / "folder.deformation"
    target.mkdir()
    with pytest.raises(OSError):
        fast.save(target)
    with pytest.raises(OSError):
        fast.save(case.folder / "missing" / "car.deformation")
    assert not list(case.folder.glob("*.part"))


def test_files_that_are_wrong_are_refused(case, fast, tmp_path):
    fast.save(tmp_path / "right.deformation")
    content = (tmp_path / "right.deformation").read_bytes()
    path = tmp_path / "wrong.deformation"
    for at in np.random.default_rng(2).integers(24, len(content), 40):
        damaged = bytearray(content)
        damaged[at] ^= 0x10
        path.write_bytes(damaged)
        with pytest.raises(deformd.DataLoss, match=r"wrong\.deformation: ."):
            deformd.load(path)
    for wrong in (b"", content[:-1], content[:1000], content + b"\0", case.mesh.read_bytes()):
        path.write_bytes(wrong)
        with pytest.raises(deformd.DataLoss):
            deformd.load(path)
    path.write_bytes(content[:8] + b"\2" + content[9:])
    with pytest.raises(deformd.FailedPrecondition, match="version"):
        deformd.load(path)
    for missing in (tmp_path / "missing.deformation", tmp_path):
        with pytest.raises(deformd.NotFound, match="cannot be read"):
            deformd.load(missing)


@pytest.mark.parametrize("change, reason", [
    ({"method": {"rbf": {"basis": "BASIS_NEVER"}}}, "BASIS_ALWAYS"),
    ({"variables": []}, "design variables"),
    ({"method": {"mls": {}}, "constraints": [{"name": "flat", "regions": [{"group": "roof"}], "planar": {}}]}, "constraints"),
])
def test_the_server_says_why_there_is_none(client, change, reason):
    points, hexahedra = brick()
    x = points[:, 0]
    geometry = client.register((points, {"hexahedron": hexahedra}), groups={
        "left": np.flatnonzero(x == 0), "right": np.flatnonzero(x == 4), "roof": np.flatnonzero((points[:, 2] == 3) & (x > 0) & (x < 4))})
    setup = {"handles": [{"name": "right", "region": {"group": "right"}}], "fixed": [{"group": "left"}],
             "variables": [{"name": "push", "handle": "right", "translate": [-1, 0, 0], "lower": -10, "upper": 10}]}
    with pytest.raises(deformd.FailedPrecondition, match=reason):
        client.prepare({**setup, **change}, geometry).local()


def forked(x):
    return FORKED(x)


def test_copies_travel(fast, population):
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(fast))(population), fast(population))
    global FORKED
    FORKED = fast
    with multiprocessing.get_context("fork").Pool(2) as pool:
        np.testing.assert_array_equal(np.array(pool.map(forked, list(population))), fast(population))


def test_objectives_take_it_for_a_system(system, fast, population):
    values = [ScipyObjective(one, lambda y, report: y[:, 2].mean(), lambda y, report: np.tile([0, 0, 1 / len(y)], (len(y), 1)))
              for one in (fast, system)]
    np.testing.assert_allclose(values[0](population.T), values[1](population.T), rtol=1e-14)
    np.testing.assert_allclose(values[0].gradient(population[0]), values[1].gradient(population[0]), rtol=1e-9)


def test_with_asyncio(case, fast, population):
    from deformd import aio

    async def points():
        async with aio.Client(case.server.address) as client:
            return (await (await client.prepare(case.setup)).local())(population)

    np.testing.assert_array_equal(asyncio.run(points()), fast(population))


def test_a_call_that_was_cancelled(system):
    cancel = deformd.Cancel()
    cancel.cancel()
    with pytest.raises(deformd.Cancelled):
        system.local(cancel=cancel)


# ---- flipped faces ----


@pytest.fixture
def folding(case, client):
    """A system whose handle may be pushed along the roof until faces fold over."""
    return client.prepare({"handles": [{"name": "roof", "region": {"box": {"min": [0.4, -1, 0.3], "max": [0.6, 1, 1]}}}],
                           "fixed": [{"group": "nose"}, {"group": "slant"}, {"group": "underbody"}],
                           "variables": [{"name": "push", "handle": "roof", "translate": [1, 0, 0], "lower": -0.5, "upper": 0.5}]},
                          client.register(case.mesh))


def test_flipped_faces_are_those_of_the_server(case, folding):
    fast, check = folding.local(), deformd.FaceCheck(case.mesh)
    pushes = np.array([[0], [0.05], [0.2], [-0.3], [0.45]])
    expected = [report.faces.flipped for report in folding.deform(pushes).reports]
    assert expected[0] == 0 and len(set(expected)) >= 3, expected
    population = fast.deform(pushes, faces=check)
    assert [report.flipped_faces for report in population.reports] == expected
    assert [report.flipped_faces for report in fast.report(np.tile(pushes, (8, 1)), faces=check, threads=2)] == 8 * expected
    assert fast.report([0.45], faces=check).to_dict()["flipped_faces"] == expected[4]
    assert check.flipped(population.points, threads=3) == check.flipped(population.points) == expected
    assert check.flipped(population.points[4]) == expected[4:]
    assert check.flipped(population.points.astype(np.float32)) == expected
    assert pickle.loads(pickle.dumps(population.reports[4])).flipped_faces == expected[4]
    assert check.faces == folding.geometry.info.faces and check.points == len(fast.rest)
    assert [deformd.FaceCheck(source).flipped(population.points) for source in (folding.geometry, str(case.mesh))] == [expected, expected]


def test_flipped_faces_of_a_plane_are_those_with_the_other_sign():
    rows = 12
    points = np.array([[x, y, 0] for y in range(rows) for x in range(rows)], dtype=float)
    faces = np.array([triangle for y in range(rows - 1) for x in range(rows - 1) for i in [y * rows + x]
                      for triangle in ([i, i + 1, i + rows + 1], [i, i + rows + 1, i + rows])])
    designs = np.tile(points, (6, 1, 1))
    random = np.random.default_rng(4)
    for design in designs[1:]:
        design[random.choice(rows * rows, 3, replace=False), :2] += random.uniform(-2.5, 2.5, (3, 2))
    a, b, c = (designs[:, faces[:, i], :2] for i in range(3))
    turned = np.cross(b - a, c - a) < 0
    assert deformd.FaceCheck((points, faces)).flipped(designs) == turned.sum(axis=1).tolist()
    assert turned.any(axis=1).sum() == 5


def test_nobody_looks_at_faces_unasked(fast):
    assert fast.report([0.01, 0]).flipped_faces is None
    assert fast.deform([0.01, 0]).report.flipped_faces is None


def test_faces_of_what_could_not_be_evaluated_and_of_other_meshes(case, folding):
    fast, check = folding.local(), deformd.FaceCheck(case.mesh)
    reports = fast.deform([[9], [0]], faces=check).reports
    assert reports[0].error is not None and reports[0].flipped_faces is None and reports[1].flipped_faces == 0
    small = deformd.FaceCheck((np.eye(3), [[0, 1, 2]]))
    with pytest.raises(deformd.InvalidArgument, match=f"faces: a mesh of 3 points, the deformation has {len(fast.rest)}"):
        fast.deform([0], faces=small)
    with pytest.raises(deformd.InvalidArgument, match=r"points: an array of shape \(4, 3\), expected \(3, 3\)"):
        small.flipped(np.zeros((4, 3)))
    with pytest.raises(deformd.InvalidArgument, match="threads"):
        small.flipped(np.eye(3), threads=-1)
    with pytest.raises(deformd.InvalidArgument, match="mesh: it has no faces"):
        deformd.FaceCheck((np.eye(3), np.empty((0, 3), dtype=int)))
