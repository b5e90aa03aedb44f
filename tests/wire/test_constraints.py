# SPDX-License-Identifier: GPL-3.0-or-later
"""What the contract says about constraints: a system with one of every kind reports the distances of their points from the admissible
configurations nearest to them; the same distances are computed here from the delivered points, by the definitions of the contract."""

import unittest

import numpy
from scipy.optimize import least_squares

import wire_client

# ---- what constraints mean: the distances of points from the admissible configuration nearest to them ----

def axes_of(x):
    """Right singular vectors of points about their mean, the longest first."""
    return numpy.linalg.svd(x - x.mean(axis=0))[2]


def copy_of(rest, x, scaled):
    """The moved, turned and perhaps scaled copy of `rest` nearest to x (Kabsch, Umeyama)."""
    p, y = rest - rest.mean(axis=0), x - x.mean(axis=0)
    u, s, v = numpy.linalg.svd(y.T @ p)
    signs = numpy.array([1, 1, numpy.sign(numpy.linalg.det(u @ v))])
    scale = (s * signs).sum() / (p * p).sum() if scaled else 1
    return x.mean(axis=0) + scale * p @ (u @ numpy.diag(signs) @ v).T


def fitted(residuals, *starts):
    """Distances at the best least squares fit from any of the starts; residuals has rows of one or more components."""
    fits = [least_squares(lambda q: residuals(q).ravel(), start, xtol=1e-15, ftol=1e-15, gtol=1e-15) for start in starts]
    best = residuals(min(fits, key=lambda fit: fit.cost).x)
    return abs(best) if best.ndim == 1 else numpy.linalg.norm(best, axis=1)


def unit(v):
    return v / numpy.linalg.norm(v)


def across(x, axis):
    """Radial vectors from the line through the origin along the unit vector axis."""
    return x - numpy.outer(x @ axis, axis)


def planar(x):
    return abs((x - x.mean(axis=0)) @ axes_of(x)[2])


def straight(x):
    return numpy.linalg.norm(across(x - x.mean(axis=0), axes_of(x)[0]), axis=1)


def spherical(x):
    start = numpy.append(x.mean(axis=0), numpy.ptp(x))
    return fitted(lambda q: numpy.linalg.norm(x - q[:3], axis=1) - q[3], start, start + [0, 0, 3, 3], start + [0, 0, -3, 3])


def circular(x):
    def residuals(q):
        axis, y = unit(q[3:6]), x - q[:3]
        return numpy.stack([y @ axis, numpy.linalg.norm(across(y, axis), axis=1) - q[6]], axis=1)
    centre, axes = x.mean(axis=0), axes_of(x)
    return fitted(residuals, *(numpy.concatenate([centre + shift * axes[1], axes[2], [1]]) for shift in (-1, 0, 1)))


def cylindrical(x):
    def residuals(q):
        return numpy.linalg.norm(across(x - q[:3], unit(q[3:6])), axis=1) - q[6]
    centre, axes = x.mean(axis=0), axes_of(x)
    return fitted(residuals, *(numpy.concatenate([centre + shift * axes[2], axis, [abs(shift)]])
                               for shift in (-3, -1, 1, 3) for axis in axes[:2]))


def conical(x):
    def residuals(q):  # a cylinder of radius q[6] at q[:3], opened by the angle q[7]: a cone far from its apex
        axis, y = unit(q[3:6]), x - q[:3]
        return numpy.cos(q[7]) * (numpy.linalg.norm(across(y, axis), axis=1) - q[6]) - numpy.sin(q[7]) * (y @ axis)
    centre, axes = x.mean(axis=0), axes_of(x)
    return fitted(residuals, *(numpy.concatenate([centre + shift * axes[2], axis, [abs(shift), 0]])
                               for shift in (-3, -1, 1, 3) for axis in axes[:2]))


def parallel(*regions):
    centred = numpy.concatenate([x - x.mean(axis=0) for x in regions])
    return abs(centred @ numpy.linalg.svd(centred)[2][2])


def orthogonal(a, b):
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)

    def residuals(q):
        first = unit(q[:3])
        return numpy.concatenate([a @ first, b @ unit(q[3:] - (q[3:] @ first) * first)])
    na, nb = axes_of(a)[2], axes_of(b)[2]
    return fitted(residuals, numpy.append(na, nb), numpy.append(na, axes_of(b)[1]), numpy.append(axes_of(a)[1], nb))


def symmetric(x, partner):
    y = x - x.mean(axis=0)
    values, vectors = numpy.linalg.eigh((y.T @ y[partner] + y[partner].T @ y) / 2)
    images = y[partner] - 2 * numpy.outer(y[partner] @ vectors[:, 0], vectors[:, 0])
    return numpy.linalg.norm(y - images, axis=1) / 2


def distance(a, b, least, most):
    apart = numpy.linalg.norm(a - b, axis=1)
    return abs(apart - numpy.clip(apart, least, most))


def extent_at_most(heights, value):
    return fitted(lambda q: numpy.maximum(heights - q[0] - value, 0) + numpy.minimum(heights - q[0], 0), [heights.mean() - value / 2])


def ids(columns, rows):
    """Points of the plate: columns first .. last, rows first .. last."""
    return [i + wire_client.COLUMNS * j for j in range(rows[0], rows[1] + 1) for i in range(columns[0], columns[1] + 1)]


PATCH, OTHER, MIRRORED = ids((4, 10), (3, 9)), ids((12, 17), (8, 13)), ids((7, 17), (5, 9))
ROW, FAR_ROW = ids((4, 18), (4, 4)), ids((4, 18), (11, 11))
AXIS, LEAST, MOST = unit([1, 0, 2]), 2.0, 0.2
CONSTRAINTS = [
    ("planar", {}, [PATCH], planar),
    ("circular", {}, [ROW], circular),
    ("cylindrical", {}, [PATCH], cylindrical),
    ("spherical", {}, [PATCH], spherical),
    ("conical", {}, [OTHER], conical),
    ("straight", {}, [ROW], straight),
    ("featureLine", {}, [PATCH], lambda rest, x: numpy.linalg.norm(x - copy_of(rest, x, scaled=True), axis=1)),
    ("rigid", {}, [OTHER], lambda rest, x: numpy.linalg.norm(x - copy_of(rest, x, scaled=False), axis=1)),
    ("fixedPlane", {"point": [0, 0, 0.25], "normal": [0, 1, 5]}, [OTHER], lambda x: abs((x - [0, 0, 0.25]) @ unit([0, 1, 5]))),
    ("symmetric", {"point": [1.5, 0, 0], "normal": [3, 0, 0]}, [MIRRORED],
     lambda x: symmetric(x, numpy.arange(len(MIRRORED)).reshape(-1, 11)[:, ::-1].ravel())),
    ("coplanar", {}, [PATCH, OTHER], lambda a, b: planar(numpy.concatenate([a, b]))),
    ("parallel", {}, [PATCH, OTHER, ROW], parallel),
    ("orthogonal", {}, [PATCH, OTHER], orthogonal),
    ("distance", {}, [ROW, FAR_ROW], None),
    ("distance", {"bound": "MINIMUM", "value": 1.5}, [ROW, FAR_ROW], lambda a, b: distance(a, b, 1.5, numpy.inf)),
    ("extent", {"axis": [2, 0, 4], "bound": "MAXIMUM", "value": MOST}, [PATCH], lambda x: extent_at_most(x @ AXIS, MOST)),
    ("extent", {"axis": [1, 0, 2], "bound": "MINIMUM", "value": LEAST, "ends": 0.1}, [PATCH], None)]


class Constraints(wire_client.TestCase):
    setup = {**wire_client.SETUP, "method": {"shell": {}}, "constraints": [
        {"name": f"{k}", kind: shape, "weight": 1e-3, "regions": [{"ids": region} for region in regions]}
        for k, (kind, shape, regions, _) in enumerate(CONSTRAINTS)]}

    def distances(self, k, points):
        kind, shape, regions, function = CONSTRAINTS[k]
        rest, x = [self.plate.points[region] for region in regions], [points[region] for region in regions]
        if kind in ("featureLine", "rigid"):
            return function(rest[0], x[0])
        if function is None and kind == "distance":
            kept = numpy.linalg.norm(rest[0] - rest[1], axis=1)
            return distance(*x, kept, kept)
        if function is None:
            at_rest, heights = rest[0] @ AXIS, x[0] @ AXIS
            share = 0.1 * numpy.ptp(at_rest)
            upper, lower = at_rest >= at_rest.max() - share, at_rest <= at_rest.min() + share
            return fitted(lambda q: numpy.where(upper, numpy.minimum(heights - q[0] - LEAST, 0), 0) +
                          numpy.where(lower, numpy.maximum(heights - q[0], 0), 0), [heights.mean() - LEAST / 2])
        return function(*x)

    def test_distances(self):
        design = self.deform([(0.25, 0.4, 0.3)])[0]
        for k, residual in enumerate(design.result.constraints.residuals):
            distances = self.distances(k, design.points)
            with self.subTest(f"{residual.name} {CONSTRAINTS[k][0]}"):
                self.assertGreater(residual.rms, 1e-4)
                self.assertAlmostEqual(residual.rms / numpy.sqrt((distances**2).mean()), 1, delta=1e-6)
                self.assertAlmostEqual(residual.largest / distances.max(), 1, delta=1e-3)

    def test_a_large_weight_meets_a_constraint(self):
        system = self.prepare({**wire_client.SETUP, "method": {"shell": {}},
                               "constraints": [{"name": "flat", "planar": {}, "regions": [{"ids": PATCH}]}]})
        design = self.deform([(0.25, 0.4, 0.3)], system=system)[0]
        self.assertLess(planar(design.points[PATCH]).max(), 1e-4)
        self.assertGreater(design.result.constraints.residuals[0].free_rms, 1e-3)


if __name__ == "__main__":
    unittest.main(verbosity=2)
