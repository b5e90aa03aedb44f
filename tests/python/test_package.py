# SPDX-License-Identifier: GPL-3.0-or-later
"""What the package promises about itself: version, types, syntax, its example in the README."""

import ast
import inspect
import re
import subprocess
import sys

import pytest

import deformd
from conftest import ROOT
from deformd import _deformd

SOURCES = ROOT / "client" / "python" / "deformd"


def test_version():
    project = re.search(r"project\(deformd VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text())
    assert deformd.__version__ == project.group(1)


def test_the_syntax_is_that_of_python_3_9():
    files = sorted(SOURCES.rglob("*.py*"))
    assert len(files) > 5
    for path in files:
        ast.parse(path.read_text(), str(path), feature_version=(3, 9))


def test_asyncio_comes_with_the_package():
    done = subprocess.run([sys.executable, "-c", "import deformd; deformd.aio.Client"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_pymoo_says_how_to_get_it(monkeypatch):
    from deformd.adapters import pymoo_problem
    monkeypatch.setitem(sys.modules, "pymoo.core.problem", None)
    with pytest.raises(ImportError, match="pip install pymoo"):
        pymoo_problem(None, lambda points, report: 0)


def declared(tree):
    """Names at the top of a stub, and those in its classes as "Class.name"."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            yield node.name
            for inner in node.body:
                if isinstance(inner, ast.FunctionDef):
                    yield f"{node.name}.{inner.name}"
                elif isinstance(inner, ast.AnnAssign):
                    yield f"{node.name}.{inner.target.id}"
        elif isinstance(node, ast.FunctionDef):
            yield node.name
        elif isinstance(node, ast.AnnAssign):
            yield node.target.id


def test_the_stub_names_what_the_module_has():
    found = set()
    for name, value in vars(_deformd).items():
        if name.startswith("__"):
            continue
        found.add(name)
        if inspect.isclass(value):
            found |= {f"{name}.{inner}" for inner in vars(value) if not inner.startswith("_")}
    stub = {name for name in declared(ast.parse((SOURCES / "_deformd.pyi").read_text())) if not name.split(".")[-1].startswith("__")}
    assert stub == found
    assert (SOURCES / "py.typed").exists()


def test_everything_public_is_described():
    for name in deformd.__all__:
        value = getattr(deformd, name)
        assert value.__doc__, name
        if inspect.isclass(value) and value.__module__.startswith("deformd.") and not issubclass(value, tuple):
            for inner, member in vars(value).items():
                if not inner.startswith("_") and (callable(member) or isinstance(member, property)):
                    assert inspect.getdoc(getattr(value, inner)), f"{name}.{inner}"


def test_every_function_says_its_types():
    for path in SOURCES.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                arguments = [*node.args.args, *node.args.kwonlyargs]
                untyped = [a.arg for a in arguments if a.annotation is None and a.arg not in ("self", "cls")]
                assert not untyped and node.returns is not None, f"{path.name}: {node.name}"


def test_importing_needs_no_server_and_no_other_library():
    done = subprocess.run([sys.executable, "-c", "import sys, deformd; print(sorted({'scipy', 'grpc', 'google'} & set(sys.modules)))"],
                          stdout=subprocess.PIPE, text=True, check=True)
    assert done.stdout == "[]\n"


def test_the_example_of_the_readme_runs_as_it_stands(case, tmp_path, monkeypatch):
    text = (ROOT / "README.md").read_text()
    block = re.search(r"```python\n(.*?)```", text, re.S).group(1)
    assert len(block.strip().splitlines()) <= 15
    (tmp_path / "ahmed.obj").write_bytes(case.mesh.read_bytes())
    (tmp_path / "ahmed.yaml").write_bytes((ROOT / "deploy" / "examples" / "ahmed.yaml").read_bytes())
    (tmp_path / "example.py").write_text(block)
    monkeypatch.setenv("DEFORM_SERVER", case.server.address)
    done = subprocess.run([sys.executable, "example.py"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() and (tmp_path / "best.obj").stat().st_size > 1000
