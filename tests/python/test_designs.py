# SPDX-License-Identifier: GPL-3.0-or-later
"""Designs: the same bits as the command line gives, populations, streams, verdicts."""

import pickle
import warnings

import numpy as np
import pytest

import deformd
from harness import read_obj


def written(case, name, *options):
    case.command("apply", "ahmed.yaml", "-o", name, *options)
    return np.array(read_obj(str(case.folder / name))[0])


def test_one_design_has_the_bits_of_the_command_line(case, system):
    expected = written(case, "cli.obj", "--set", "roof_up=0.03", "--set", "slant_turn=0.1")
    points = system([0.03, 0.1])
    assert points.shape == (system.info.points, 3) and points.dtype == np.float64 and points.flags.c_contiguous
    np.testing.assert_array_equal(points, expected)
    np.testing.assert_array_equal(system({"slant_turn": 0.1, "roof_up": 0.03}), expected)
    system.geometry.write(case.folder / "python.obj", points)
    assert (case.folder / "python.obj").read_bytes() == (case.folder / "cli.obj").read_bytes()


def test_one_variable_takes_its_value_alone(squeezed, system):
    expected = squeezed([0.5])
    for x in (0.5, np.float32(0.5), np.array(0.5)):
        np.testing.assert_array_equal(squeezed(x), expected)
    np.testing.assert_array_equal(squeezed(0), squeezed([0]))
    np.testing.assert_array_equal(squeezed.jvp(0.5, 1), squeezed.jvp([0.5], [1]))
    with pytest.raises(deformd.InvalidArgument, match="1 values, the setup has 2 variables: roof_up, slant_turn"):
        system(0.5)
    np.testing.assert_array_equal(system([{"roof_up": 0.01}, [0.01, 0]])[0], system([0.01, 0]), "mappings and rows may be mixed")


@pytest.mark.parametrize("encoding, tolerance", [("raw_f32", 0), ("delta_zstd", 1e-5), ("draco", 1e-5)])
def test_every_encoding_has_the_bits_of_the_command_line(case, system, encoding, tolerance):
    expected = written(case, "cli.obj", "--set", "roof_up=0.03", "--encoding", encoding, *(["--tolerance", tolerance] if tolerance else []))
    deformed = system.deform({"roof_up": 0.03}, encoding=encoding.upper(), tolerance=tolerance or None)
    np.testing.assert_array_equal(deformed.points, expected)
    assert not np.array_equal(deformed.points, system({"roof_up": 0.03}))
    assert 0 < np.abs(deformed.points - system({"roof_up": 0.03})).max() == pytest.approx(deformed.report.max_error, rel=1e-6)


def test_a_client_that_compresses_keeps_what_files_keep(case, client, system):
    with deformd.Client(case.server.address, encoding="DELTA_ZSTD") as far:
        report = far.system(system.id).deform([0.03, 0]).report
    assert 0 < report.max_error <= 1e-9 * system.info.diagonal


def test_a_population_is_its_designs(system, population):
    points = system(population)
    assert points.shape == (9, system.info.points, 3)
    for x, y in zip(population, points):
        np.testing.assert_allclose(y, system(x), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(system([{"roof_up": a, "slant_turn": b} for a, b in population]), points)
    assert system(np.empty((0, 2))).shape == (0, system.info.points, 3)


@pytest.mark.parametrize("batch", [1, 2, 4, 100])
def test_batches_do_not_mix_designs_up(system, population, batch):
    expected = system(population, batch=1)
    np.testing.assert_allclose(system(population, batch=batch), expected, rtol=0, atol=1e-13)
    seen = {}
    for i, y, report in system.stream(population, batch=batch):
        assert i not in seen and report.error is None and report.verdict == "good"
        seen[i] = y
    assert sorted(seen) == list(range(9))
    np.testing.assert_allclose(np.array([seen[i] for i in range(9)]), expected, rtol=0, atol=1e-13)


def test_out_is_filled(system, population):
    out = np.zeros((9, system.info.points, 3))
    assert system(population, out=out) is out
    np.testing.assert_array_equal(out, system(population))
    one = np.zeros((system.info.points, 3))
    assert system(population[0], out=one) is one
    np.testing.assert_array_equal(one, system(population[0]))
    for wrong in (np.zeros((8, system.info.points, 3)), np.zeros((9, system.info.points, 3), np.float32), out[:, :, ::-1]):
        with pytest.raises(deformd.InvalidArgument, match=r"out: expected an array of shape \(9, "):
            system(population, out=wrong)
    one.flags.writeable = False
    with pytest.raises(deformd.InvalidArgument, match="writeable"):
        system(population[0], out=one)


def test_leaving_a_stream_ends_it(case, client, system, population):
    stream = system.stream(np.tile(population, (200, 1)), batch=3)
    next(stream)
    stream.close()
    assert len(system.stream(population).__next__()) == 3


def test_a_design_out_of_bounds_fails_alone(system, population):
    population[4, 1] = 7
    result = system.deform(population, batch=3)
    assert [report.error is not None for report in result.reports] == [False] * 4 + [True] + [False] * 4
    assert not result.usable[4] and result.usable.sum() == 8
    assert np.isnan(result.points[4]).all() and np.isfinite(np.delete(result.points, 4, axis=0)).all()
    error = result.reports[4].error
    assert isinstance(error, deformd.InvalidArgument) and "7 is outside of its bounds [-0.2, 0.2]" in str(error)
    assert "slant_turn" in error.message and error.index == 1 and error.field == "variables[1]"
    streamed = {i: (y, report) for i, y, report in system.stream(population)}
    assert streamed[4][0] is None and streamed[4][1].verdict == "bad"
    with pytest.raises(AttributeError, match="could not be evaluated"):
        streamed[4][1].max_displacement


def test_what_is_raised_for_designs_that_cannot_be_evaluated(system, population):
    with pytest.raises(deformd.InvalidArgument, match="outside of its bounds"):
        system([9, 0])
    population[2, 0] = 9
    with pytest.raises(deformd.BadDesign, match=r"^designs\[2\]: ") as raised:
        system(population)
    assert raised.value.index == 2 and isinstance(raised.value.__cause__, deformd.InvalidArgument)
    np.testing.assert_array_equal(np.isnan(raised.value.deformation.points).all(axis=(1, 2)), np.arange(9) == 2)
    with pytest.warns(deformd.BadDesignWarning, match=r"designs\[2\]"):
        points = system(population, bad="warn")
    assert np.isnan(points[2]).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(system(population, bad="keep"), points)


def test_bad_verdicts(squeezed):
    good, bad = squeezed.deform([1]), squeezed.deform([6])
    assert good.report.verdict == "good" and not good.report.bad and good.report.cells.inverted == 0
    assert bad.report.verdict == "bad" and bad.report.cells.inverted > 0 and bad.report.reasons
    assert 0 < bad.report.cells.safe_amplitude < 1
    with pytest.raises(deformd.BadDesign) as raised:
        squeezed([6])
    np.testing.assert_array_equal(raised.value.deformation.points, bad.points)
    np.testing.assert_array_equal(squeezed([6], bad="keep"), bad.points)
    # The message has the reasons for which it is bad, and not those that would have made it doubtful.
    deciding = bad.report.reasons_of_verdict
    assert 1 <= deciding < len(bad.report.reasons)
    assert all(reason in str(raised.value) for reason in bad.report.reasons[:deciding])
    assert not any(reason in str(raised.value) for reason in bad.report.reasons[deciding:])
    with pytest.raises(deformd.BadDesign, match=r"^2 bad designs: designs\[0\]: .* designs\[2\]: "):
        squeezed([[6], [1], [7]])


def test_options_reach_the_server(squeezed):
    assert squeezed.deform([1], check="CELL_CHECK_OFF").report.cells is None
    assert squeezed.deform([1], check="CELL_QUALITY").report.quality.measures
    split = squeezed.deform([3.9], splitting="SPLIT_ADAPTIVE").report.split
    assert split is not None and split.steps >= 1
    assert squeezed.deform([1], path="PATH_DIRECT").report.path == "PATH_DIRECT"
    with pytest.raises(deformd.InvalidArgument, match="CELL_CHECK_OFF"):
        squeezed.deform([1], check="sometimes")
    with pytest.raises(TypeError, match="unknown options: checks"):
        squeezed.deform([1], checks="CELL_QUALITY")


def test_motions(system):
    lift = np.hstack([np.eye(3), [[0], [0], [0.03]]])
    np.testing.assert_allclose(system.deform(None, motions={"roof": lift}).points, system({"roof_up": 0.03}), rtol=0, atol=1e-12)
    handle = next(handle for handle in system.info.handles if handle.name == "roof")
    shift = np.tile([0, 0, 0.03], (handle.points, 1))
    np.testing.assert_allclose(system.deform(None, motions={"roof": shift}).points, system({"roof_up": 0.03}), rtol=0, atol=1e-9)
    pair = system.deform(np.zeros((2, 2)), motions=[{"roof": lift}, {}])
    np.testing.assert_allclose(pair.points[1], system.geometry.points, rtol=0, atol=1e-12)
    assert pair.reports[0].max_displacement == pytest.approx(0.03)
    assert isinstance(system.deform(None, motions={"roof": shift[1:]}).report.error, deformd.InvalidArgument)


def test_wrong_designs_are_refused(system):
    for wrong, message in [([1, 2, 3], "3 values, the setup has 2 variables: roof_up, slant_turn"), ([[0.01]], "1 values"),
                           (np.zeros((1, 1, 2)), r"shape \(1, 1, 2\)"), ({"roof": 1}, 'no variable "roof"; did you mean "roof_up"')]:
        with pytest.raises(deformd.InvalidArgument, match=message):
            system(wrong)
    with pytest.raises(deformd.InvalidArgument, match="one design"):
        system.stream([0, 0])
    with pytest.raises(deformd.InvalidArgument, match="bad: 'maybe'"):
        system([0, 0], bad="maybe")


def test_the_derivative_is_that_of_the_points(system):
    x, step = np.array([0.01, -0.05]), 1e-5
    jacobian = system.jacobian(x)
    assert jacobian.shape == (system.info.points, 3, 2)
    for i, direction in enumerate(np.eye(2)):
        difference = (system(x + step * direction) - system(x - step * direction)) / (2 * step)
        assert np.abs(difference).max() > 0.1
        np.testing.assert_allclose(jacobian[:, :, i], difference, rtol=0, atol=1e-8)
    v, w = np.array([0.3, -0.7]), np.random.default_rng(3).normal(size=(system.info.points, 3))
    np.testing.assert_allclose(system.jvp(x, v), jacobian @ v, rtol=0, atol=1e-12)
    np.testing.assert_allclose(system.vjp(x, w), np.einsum("nd,ndk->k", w, jacobian), rtol=1e-10)
    np.testing.assert_allclose(system.jvp(None, {"roof_up": 1}), system.jacobian()[:, :, 0], rtol=0, atol=1e-12)
    n = system.info.points
    for shape in [(3, 2), (n - 1, 3), (n, 2), (3, n), (4, n + 1, 3), (3 * n,), (1, 1, n, 3)]:
        with pytest.raises(deformd.InvalidArgument) as raised:
            system.vjp(x, np.zeros(shape))
        assert raised.value.message == f"cotangent: an array of shape {shape}, expected ({n}, 3), or (m, {n}, 3) of many"


def test_reports(system):
    report = system.deform([0.03, 0]).report
    assert report.verdict == "good" and report.reasons == () and report.error is None
    assert report.max_displacement == pytest.approx(0.03) and report.prescribed_displacement == pytest.approx(0.03)
    assert report.faces.flipped == 0 and report.faces.flipped_ids == () and report.cells is None
    assert report.faces.intersecting is None and report.points_across_symmetry == 0
    looked = system.deform([0.03, 0], intersections=True).report
    assert looked.faces.intersecting == 0 and looked.faces.intersecting_ids == ()
    assert 0 <= report.estimated_error < 1e-9
    plain = report.to_dict()
    assert plain["faces"]["faces"] == report.faces.faces and plain["verdict"] == "good" and plain["error"] is None
    assert "max_displacement" in dir(report) and repr(report) == "<Report: good>"
    with pytest.raises(AttributeError, match="no field"):
        report.max_displacment
    copy = pickle.loads(pickle.dumps(report))
    assert copy.to_dict() == plain


def test_system_says_what_it_is(case, system):
    assert system.names == ("roof_up", "slant_turn")
    np.testing.assert_array_equal(system.bounds, [[-0.05, 0.05], [-0.2, 0.2]])
    assert system.variables[1] == deformd.Variable("slant_turn", "slant", -0.2, 0.2)
    assert system.info.setup.method.rbf.kernel == "TRIHARMONIC" and system.info.resident
    assert system.id in case.command("status", "--json") or system.id in case.command("list", "--json")
