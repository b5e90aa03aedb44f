# SPDX-License-Identifier: GPL-3.0-or-later
"""Adapters to frameworks with the frameworks themselves; each test needs the library of its name. install.sh brings them."""

import collections
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT

import deformd

X = np.array([0.02, -0.07])


@pytest.fixture
def goal(system):
    return system([0.01, 0.05])


# ---- pycma ----


def test_cma_has_the_history_of_pycma_alone():
    cma = pytest.importorskip("cma")
    from deformd.adapters.cma import CmaObjective

    def sphere(x):
        return float(np.sum((np.asarray(x) - 0.3) ** 2 * [1, 100]))

    def search(evaluate):
        strategy = cma.CMAEvolutionStrategy([0.0, 0.0], 0.5, {"seed": 4, "verbose": -9, "verb_log": 0, "popsize": 15, "CMA_mu": 2, "CMA_active": False, "maxiter": 30})
        history = []
        while not strategy.stop():
            designs = strategy.ask()
            values = evaluate(designs)
            strategy.tell(designs, values)
            history.append((np.array(designs), np.array(values)))
        return history

    class OfVariables:
        """A system whose points are the variables."""

        bounds = np.array([[-1, 1], [-np.inf, np.inf]])

        def deform(self, designs):
            return deformd.Population(np.array(designs)[:, None, :], [collections.namedtuple("R", "bad")(False)] * len(designs))

    objective = CmaObjective(OfVariables(), lambda points, report: sphere(points[0]))
    assert objective.cma_bounds == [[-1, None], [1, None]]
    ours, theirs = search(objective), search(lambda designs: [sphere(design) for design in designs])
    assert len(ours) == len(theirs) > 20
    for mine, other in zip(ours, theirs):
        np.testing.assert_array_equal(mine[0], other[0])
        np.testing.assert_array_equal(mine[1], other[1])


def test_cma_on_points(system, goal):
    cma = pytest.importorskip("cma")
    from deformd.adapters.cma import CmaObjective

    f = CmaObjective(system, lambda points, report: float(((points - goal) ** 2).sum()))
    strategy = cma.CMAEvolutionStrategy([0, 0], 0.03, {"bounds": f.cma_bounds, "seed": 1, "verbose": -9, "verb_log": 0, "maxiter": 25})
    while not strategy.stop():
        designs = strategy.ask()
        strategy.tell(designs, f(designs))
    np.testing.assert_allclose(strategy.result.xbest, [0.01, 0.05], atol=2e-3)
    assert f(strategy.result.xbest) == strategy.result.fbest


def test_cma_ranks_designs_outside_of_limits_of_quality_behind(system, goal):
    from deformd.quality import Quality, QualityConstraints

    pytest.importorskip("cma")
    from deformd.adapters.cma import OUTSIDE, CmaObjective

    quality = Quality(system.geometry)
    designs = [[0.0, 0.0], [0.04, 0.1], [0.02, 0.19], [9.0, 0.0]]
    measured = [quality.values(system(x), ["total_area"])["total_area"] for x in designs[:3]]
    limit = min(measured) * 1.0000001  # one of the three is within
    asked = []
    f = CmaObjective(system, lambda points, report: asked.append(1) or 5.0, constraints=QualityConstraints(quality, {"total_area": {"max": limit}}))
    values = f(designs)
    within = [value <= limit for value in measured]
    assert [value == 5.0 for value in values[:3]] == within and len(asked) == sum(within) == 1
    assert [OUTSIDE <= value < 1e30 for value in values[:3]] == [not each for each in within] and values[3] == 1e30
    beyond = [(value, (found - limit) / limit) for value, found, fine in zip(values, measured, within) if not fine]
    assert all(value == pytest.approx(OUTSIDE * (1 + by)) for value, by in beyond)


# ---- OpenMDAO ----


@pytest.fixture
def component(system):
    om = pytest.importorskip("openmdao.api")
    from deformd.adapters.openmdao import DeformationComponent

    problem = om.Problem(reports=False)
    problem.model.add_subsystem("shape", DeformationComponent(system=system))
    return om, problem


def test_openmdao_check_partials(component):
    om, problem = component
    problem.setup(force_alloc_complex=False)
    problem.set_val("shape.x", X)
    problem.run_model()
    found = problem.check_partials(out_stream=None, method="fd", form="central", step=1e-5)
    partials = found["shape"]["points", "x"]
    forward, reverse, differences = partials["J_fwd"], partials["J_rev"], partials["J_fd"]
    assert np.abs(differences).max() > 0.1
    np.testing.assert_allclose(forward, differences, atol=1e-7)
    np.testing.assert_allclose(reverse, differences, atol=1e-7)


def test_openmdao_has_quality(system):
    om = pytest.importorskip("openmdao.api")
    from deformd.adapters.openmdao import DeformationComponent

    quality = deformd.Quality(system.geometry)
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("shape", DeformationComponent(system=system, quality=quality, measures=["total_area", "flipped_faces"]))
    problem.setup(force_alloc_complex=False)
    problem.set_val("shape.x", X)
    problem.run_model()
    assert problem.get_val("shape.total_area")[0] == quality(system(X))["total_area"]
    found = problem.check_partials(out_stream=None, method="fd", form="central", step=1e-4)["shape"]
    for output in ("total_area", "flipped_faces"):
        np.testing.assert_allclose(found[output, "x"]["J_fwd"], found[output, "x"]["J_fd"], rtol=1e-4, atol=1e-7)
        np.testing.assert_allclose(found[output, "x"]["J_rev"], found[output, "x"]["J_fd"], rtol=1e-4, atol=1e-7)
    assert np.abs(found["total_area", "x"]["J_fd"]).min() > 1e-3
    wrong = om.Problem(reports=False)
    wrong.model.add_subsystem("shape", DeformationComponent(system=system, quality=quality, measures=["total_aria"]))
    with pytest.raises(deformd.InvalidArgument, match='did you mean "total_area"'):
        wrong.setup()


def test_openmdao_says_that_a_design_failed(component):
    om, problem = component
    problem.setup()
    problem.set_val("shape.x", [9, 0])
    with pytest.raises(om.AnalysisError, match="roof_up"):
        problem.run_model()


# ---- torch and jax ----


def test_torch_gradcheck(system, goal):
    torch = pytest.importorskip("torch")
    from deformd.adapters.torch import torch_function

    deform = torch_function(system)
    x = torch.tensor(X, dtype=torch.float64, requires_grad=True)
    some = torch.arange(0, len(goal), 97)
    assert torch.autograd.gradcheck(lambda each: deform(each)[some], (x,), eps=1e-6, atol=1e-6)
    both = torch.tensor(np.array([X, -X]), dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda each: deform(each)[:, some], (both,), eps=1e-6, atol=1e-6)
    with pytest.raises(deformd.InvalidArgument):
        deform(torch.tensor([9.0, 0.0]))


def test_jax_gradcheck(system, goal):
    jax = pytest.importorskip("jax")
    from deformd.adapters.jax import jax_function

    jax.config.update("jax_enable_x64", True)
    deform = jax_function(system)

    def distance(x):
        return ((deform(x) - goal) ** 2).sum()

    np.testing.assert_allclose(deform(X), system(X), rtol=0, atol=0)
    gradient = jax.jit(jax.grad(distance))(jax.numpy.asarray(X))
    np.testing.assert_allclose(gradient, system.vjp(X, 2 * (system(X) - goal)), rtol=1e-12)
    from jax.test_util import check_grads

    check_grads(distance, (jax.numpy.asarray(X),), order=1, modes=("rev",), eps=1e-5, atol=1e-4, rtol=1e-4)


# ---- libEnsemble ----

ENSEMBLE = """
import sys
import numpy as np
import deformd
from deformd.adapters.libensemble import generator_user, sim_function
from libensemble import Ensemble
from libensemble.gen_funcs.sampling import latin_hypercube_sample
from libensemble.specs import ExitCriteria, GenSpecs, LibeSpecs, SimSpecs

def mean_height(points, report):
    return points[:, 2].mean()

if __name__ == "__main__":
    system = deformd.Client(sys.argv[1]).prepare(sys.argv[2])
    ensemble = Ensemble(parse_args=False, libE_specs=LibeSpecs(comms="threads", nworkers=2, disable_log_files=True))
    ensemble.sim_specs = SimSpecs(sim_f=sim_function, inputs=["x"], out=[("f", float), ("usable", bool), ("total_area", float)],
                                  user={"system": system, "objective": mean_height, "quality": deformd.Quality(system.geometry)})
    ensemble.gen_specs = GenSpecs(gen_f=latin_hypercube_sample, outputs=[("x", float, (2,))], user=generator_user(system, gen_batch_size=8))
    ensemble.exit_criteria = ExitCriteria(sim_max=8)
    ensemble.add_random_streams()
    h, _, flag = ensemble.run()
    done = h[h["sim_ended"]]
    expected = system(done["x"])[:, :, 2].mean(axis=1)
    assert len(done) == 8 and done["usable"].all(), done
    np.testing.assert_allclose(done["f"], expected, rtol=1e-12)
    areas = [deformd.Quality(system.geometry)(points)["total_area"] for points in system(done["x"])]
    np.testing.assert_allclose(done["total_area"], areas, rtol=1e-12)
    print("agreed")
"""


def test_libensemble(case, tmp_path):
    pytest.importorskip("libensemble")
    (tmp_path / "run.py").write_text(ENSEMBLE)
    done = subprocess.run([sys.executable, "run.py", case.server.address, str(case.setup)], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and "agreed" in done.stdout, done.stdout + done.stderr


# ---- Dakota: its files; the program itself is not needed ----

STANDARD = """\
                                          2 variables
                     {a:.17g} roof_up
                     {b:.17g} slant_turn
                                          2 functions
                                          {active} ASV_1:v
                                          1 ASV_2:a
                                          2 derivative_variables
                                          2 DVV_1:slant_turn
                                          1 DVV_2:roof_up
                                          0 analysis_components
                                          1 eval_id
"""
APREPRO = """\
                    {{ DAKOTA_VARS     =                      2 }}
                    {{ roof_up         = {a:.17g} }}
                    {{ slant_turn      = {b:.17g} }}
                    {{ DAKOTA_FNS      =                      2 }}
                    {{ ASV_1:v         =                      {active} }}
                    {{ ASV_2:a         =                      1 }}
                    {{ DAKOTA_DER_VARS =                      2 }}
                    {{ DVV_1:slant_turn =                      2 }}
                    {{ DVV_2:roof_up   =                      1 }}
                    {{ DAKOTA_AN_COMPS =                      0 }}
                    {{ DAKOTA_EVAL_ID  =                      1 }}
"""


@pytest.fixture
def dakota(case, tmp_path, system):
    def run(text, *options):
        (tmp_path / "params.in").write_text(text)
        done = subprocess.run([sys.executable, "-m", "deformd.dakota", "--setup", str(case.setup), "--server", case.server.address, *options, "params.in",
                               "results.out"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
        return done, (tmp_path / "results.out").read_text() if done.returncode == 0 else None

    return run


MEASURES = ("--measure", "v=volume", "--measure", "a=area")


@pytest.mark.parametrize("form", [STANDARD, APREPRO])
def test_dakota_values_and_gradients(dakota, system, form):
    from deformd.measures import Volume

    done, results = dakota(form.format(a=X[0], b=X[1], active=3), *MEASURES)
    assert done.returncode == 0, done.stderr
    value, slope = Volume(system.geometry)(system(X))
    lines = results.splitlines()
    assert len(lines) == 3 and lines[0].split()[1] == "v" and lines[1].split()[1] == "a"
    assert float(lines[0].split()[0]) == pytest.approx(value, rel=1e-12)
    gradient = [float(word) for word in lines[2].strip("[] ").split()]
    np.testing.assert_allclose(gradient, system.vjp(X, slope)[::-1], rtol=1e-9)


def test_dakota_has_quality(dakota, system):
    from deformd.quality import differences

    text = STANDARD.format(a=X[0], b=X[1], active=3).replace(":v", ":least_angle").replace(":a\n", ":max_displacement\n")
    done, results = dakota(text, "--quality", "least_angle", "--quality", "max_displacement")
    assert done.returncode == 0, done.stderr
    points, report = system.deform(X)
    quality = deformd.Quality(system.geometry)
    lines = results.splitlines()
    values = {line.split()[1]: float(line.split()[0]) for line in lines[:2]}
    assert values == pytest.approx(quality.values(points, ["least_angle", "max_displacement"], report), rel=1e-9)
    gradient = [float(word) for word in lines[2].strip("[] ").split()]
    np.testing.assert_allclose(gradient, differences(system, X, quality, ["least_angle"])["least_angle"][::-1], rtol=1e-9)
    for options, message in ((("--quality", "least_angel"), 'did you mean "least_angle"'), (("--quality", "scaled_jacobian"), "other kinds of meshes"),
                             ((), "or --quality alone")):
        done, _ = dakota(text, *options)
        assert done.returncode == 1 and message in done.stderr, done.stderr
    done, _ = dakota(text.replace(":least_angle", ":flipped_faces"), "--quality", "flipped_faces", "--quality", "max_displacement")
    assert done.returncode == 1 and "flipped_faces is a number of faces" in done.stderr


def test_dakota_measures_with_options(dakota, system):
    from deformd.measures import ProjectedArea, Thickness

    text = STANDARD.format(a=X[0], b=X[1], active=1)
    done, results = dakota(text, "--measure", "v={thickness: {at: roof, tolerance: 0.01}}", "--measure", "a=projected_area:x")
    assert done.returncode == 0, done.stderr
    values = {line.split()[1]: float(line.split()[0]) for line in results.splitlines()}
    assert values["v"] == pytest.approx(Thickness(system.geometry, at="roof", tolerance=0.01).value(system(X)), rel=1e-12)
    assert values["a"] == pytest.approx(ProjectedArea(system.geometry, "x").value(system(X)), rel=1e-12)
    for measure, message in (("v=projected_area", "a direction is missing"), ("v={thickness: {at: 3}}", "v.thickness.at: 3, expected the name"),
                             ("v={thickness}: 1", "expected RESPONSE={MEASURE"), ("v=drag", "'drag', expected one of volume, ")):
        done, _ = dakota(text, "--measure", measure)
        assert done.returncode == 1 and message in done.stderr, done.stderr


def test_dakota_finds_the_mesh_beside_a_compiled_deformation(case, tmp_path, system):
    kept = tmp_path / "kept"
    kept.mkdir()
    shutil.copy(case.mesh, kept)
    system.local().save(kept / "car.deformation")
    (tmp_path / "params.in").write_text(STANDARD.format(a=0.01, b=0, active=1))

    def run(*options):
        return subprocess.run([sys.executable, "-m", "deformd.dakota", "--setup", str(kept / "car.deformation"), *options, *MEASURES, "params.in", "results.out"],
                              cwd=tmp_path, capture_output=True, text=True, timeout=60)

    assert run().returncode == 0
    results = (tmp_path / "results.out").read_text()
    os.rename(kept / case.mesh.name, tmp_path / "other.obj")
    missing = run()
    assert missing.returncode == 1 and "mesh: missing, and it does not stand beside" in missing.stderr
    assert run("--mesh", str(tmp_path / "other.obj")).returncode == 0 and (tmp_path / "results.out").read_text() == results


def test_dakota_batch_and_fail(dakota):
    done, results = dakota("".join(STANDARD.format(a=a, b=0, active=1) for a in (0.01, 9, 0.03)), *MEASURES)
    assert done.returncode == 0 and "roof_up" in done.stderr
    parts = results.split("#\n")
    assert len(parts) == 3 and parts[1] == "FAIL\n" and parts[0] != parts[2]
    done, results = dakota(STANDARD.format(a=0.01, b=0, active=1), "--function", "study_functions:no")
    assert done.returncode == 1


def test_dakota_files_that_are_wrong(dakota):
    for text, message in (("", "no parameter set"), ("2 variables\n1 roof_up\n", "fewer variables than said"),
                          (STANDARD.format(a=0, b=0, active=4), "no Hessians"), (STANDARD.replace("roof_up", "wing").format(a=0, b=0, active=1), "no wing"),
                          (STANDARD.replace(":v", ":drag").format(a=0, b=0, active=1), "nothing measures drag")):
        done, _ = dakota(text, *MEASURES)
        assert done.returncode == 1 and message in done.stderr, done.stderr


# ---- the examples ----


@pytest.mark.parametrize("library", ["cma", "openmdao", "torch", "jax"])
def test_examples(case, library):
    pytest.importorskip(library)
    path = ROOT / "client" / "python" / "examples" / f"with_{library}.py"
    assert len(path.read_text().splitlines()) <= 40
    done = subprocess.run([sys.executable, str(path)], cwd=case.folder, env={**os.environ, "DEFORM_SERVER": case.server.address}, capture_output=True,
                          text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    if library != "cma":
        found = [float(word) for word in done.stdout.strip("[] \n").split()]
        np.testing.assert_allclose(found, [0.02, -0.1], atol=1e-4)


@pytest.mark.parametrize("name", ["study", "dataset", "quality"])
def test_the_studies_of_the_docs_are_read(case, tmp_path, name):
    from deformd.study import read_spec

    text = (ROOT / "client" / "python" / "examples" / f"{name}.yaml").read_text()
    (tmp_path / "s.yaml").write_text(text.replace("ahmed.yaml", str(case.setup)))
    assert (read_spec(tmp_path / "s.yaml").optimizer is None) == (name == "dataset")
