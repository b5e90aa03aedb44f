# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluators of test_study.py; studies import them by name."""

import os
import signal
import time

import numpy as np


def _note(text):
    with open(os.environ["STUDY_LOG"], "a") as file:
        file.write(text + "\n")


def height(points, variables, report):
    _note(f"{variables['roof_up']!r} {variables['slant_turn']!r}")
    time.sleep(float(os.environ.get("STUDY_SECONDS", "0")))
    return {"height": float(points[:, 2].mean()), "turn": variables["slant_turn"] ** 2}


def by_process(points, variables, report):
    _note(f"{os.getpid()} {variables['roof_up']!r},{variables['slant_turn']!r}")
    time.sleep(float(os.environ.get("STUDY_SECONDS", "0")))
    return float(points[:, 2].mean())


def deadly(points, variables, report):
    if variables["roof_up"] > 0.001:
        _note("the end")
        os.kill(os.getpid(), signal.SIGKILL)
    return float(points[:, 2].mean())


def always_broken(points, variables, report):
    raise RuntimeError("did not start")


def half_broken(points, variables, report):
    if variables["roof_up"] > -0.03:
        raise RuntimeError("did not converge")
    return points[:, 2].mean()


def to_the_edge(points, variables, report):
    """The lower the higher the points are, until nothing works any more; with its gradient."""
    if variables["roof_up"] > 0.02:
        raise RuntimeError("did not converge")
    return {"low": 1e5 - 1e3 * float(points[:, 2].sum())}, {"low": np.tile([0, 0, -1e3], (len(points), 1))}


def in_a_corner(points, variables, report):
    """A corner of a hundredth of the bounds, which are about 0.1 and 0.5, around the original."""
    if max(abs(variables["roof_up"]), abs(variables["slant_turn"])) > 0.003:
        raise RuntimeError("did not converge")
    return points[:, 2].mean()


def two_goals(points, variables, report):
    """Values that contend: how far from the original, and how high."""
    if variables["roof_up"] < -0.04:
        raise RuntimeError("did not converge")
    return {"near": abs(variables["roof_up"]) * 20 + abs(variables["slant_turn"]), "high": float(points[:, 2].mean())}


def distance(points, variables, report):
    """To a point; with its gradient."""
    away = points - np.array([1.0, 0, 0.5])
    return {"distance": float((away ** 2).sum())}, {"distance": 2 * away}


def angle(points, variables, report):
    return {"least_angle": 1.0}
