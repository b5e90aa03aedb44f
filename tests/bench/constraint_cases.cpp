// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/constraint_cases.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>

#include "core/base/parallel.h"
#include "core/mesh/elements.h"

namespace deform::bench {

namespace {

constexpr double slack = 1e-9;  // of comparisons with coordinates of grids

using Test = std::function<bool(const Vec3&)>;
using Place = std::function<Vec3(double, double)>;

enum class Around { open, closed };  ///< closed: the last row is the first

/// columns x rows intervals in quads; s and t from 0 to 1.
Mesh grid(std::size_t columns, std::size_t rows, Around around, const Place& place) {
  Mesh mesh;
  const std::size_t row_points = around == Around::closed ? rows : rows + 1;
  for (std::size_t j = 0; j < row_points; ++j) {
    for (std::size_t i = 0; i <= columns; ++i) {
      mesh.points.push_back(
          place(static_cast<double>(i) / static_cast<double>(columns), static_cast<double>(j) / static_cast<double>(rows)));
    }
  }
  const auto at = [&](std::size_t i, std::size_t j) { return static_cast<PointId>(i + (columns + 1) * (j % row_points)); };
  for (std::size_t j = 0; j < rows; ++j) {
    for (std::size_t i = 0; i < columns; ++i) {
      mesh.face_sizes.push_back(4);
      mesh.face_points.insert(mesh.face_points.end(), {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return mesh;
}

Region where(const Mesh& mesh, const Test& test) {
  Region::Ids ids;
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    if (test(mesh.points[i])) ids.ids.push_back(static_cast<PointId>(i));
  }
  return {std::move(ids)};
}

bool between(double low, double x, double high) { return x >= low - slack && x <= high + slack; }

/// By `angle` about the axis k through the centre.
Affine turned(std::size_t k, double angle, const Vec3& centre) {
  Affine map = identity_affine;
  const std::size_t a = (k + 1) % 3, b = (k + 2) % 3;
  const double c = std::cos(angle), s = std::sin(angle);
  map[4 * a + a] = map[4 * b + b] = c;
  map[4 * a + b] = -s;
  map[4 * b + a] = s;
  for (const std::size_t row : {a, b})
    map[4 * row + 3] = centre[row] - map[4 * row + a] * centre[a] - map[4 * row + b] * centre[b];
  return map;
}

Affine shifted(const Vec3& by) { return {1, 0, 0, by[0], 0, 1, 0, by[1], 0, 0, 1, by[2]}; }

/// What several constraints share.
struct Bench {
  std::shared_ptr<const Mesh> mesh;
  Region fixed, handle;
  Affine motion = identity_affine;

  Bench(Mesh shape, const Test& is_fixed, const Test& is_handle, const Affine& moves)
      : mesh(std::make_shared<const Mesh>(std::move(shape))),
        fixed(where(*mesh, is_fixed)),
        handle(where(*mesh, is_handle)),
        motion(moves) {}

  ConstraintCase with(const ConstraintKind& kind, const std::vector<Test>& sets) const {
    ConstraintCase result;
    result.name = kind_name(kind);
    result.mesh = mesh;
    result.setup.handles = {{"end", handle}};
    result.setup.fixed = {fixed};
    Constraint constraint{result.name, {}, kind};
    for (const Test& set : sets) constraint.regions.push_back(where(*mesh, set));
    result.setup.constraints = {std::move(constraint)};
    result.design.motions.push_back({0, motion});
    return result;
  }
};

Test patch(double from, double to) {
  return [=](const Vec3& x) { return between(from, x[0], to) && between(0.2, x[1], 0.8); };
}

/// Bent up and twisted at its right end.
Bench bent_sheet(std::size_t n, const Affine& motion) {
  return {grid(2 * n, n, Around::open,
               [](double s, double t) {
                 return Vec3{2 * s, t, 0};
               }),
          [](const Vec3& x) { return x[0] <= 0.2 + slack; }, [](const Vec3& x) { return x[0] >= 1.8 - slack; }, motion};
}

/// A polygon in the plane of x and z with corners at whole multiples of 1 / n, one unit deep along y.
Bench folded(std::size_t n, const std::vector<std::array<double, 2>>& corners, const Test& is_fixed, const Test& is_handle,
             const Vec3& shift) {
  std::vector<double> ends{0};
  for (std::size_t k = 1; k < corners.size(); ++k) {
    ends.push_back(ends.back() + std::hypot(corners[k][0] - corners[k - 1][0], corners[k][1] - corners[k - 1][1]));
  }
  const auto columns = static_cast<std::size_t>(std::lround(ends.back() * static_cast<double>(n)));
  const Place place = [&](double s, double t) {
    const double along = s * ends.back();
    std::size_t k = 1;
    while (k + 1 < ends.size() && along > ends[k] + slack) ++k;
    const double share = (along - ends[k - 1]) / (ends[k] - ends[k - 1]);
    const auto &a = corners[k - 1], &b = corners[k];
    return Vec3{a[0] + share * (b[0] - a[0]), t, a[1] + share * (b[1] - a[1])};
  };
  return {grid(columns, n, Around::open, place), is_fixed, is_handle, shifted(shift)};
}

/// A tube of length 2 along x, of a radius that depends on x, whose right end is squeezed and lifted.
Bench squeezed_tube(std::size_t n, const std::function<double(double)>& radius) {
  const auto place = [&](double s, double t) {
    const double angle = 2 * std::numbers::pi * t, r = radius(2 * s);
    return Vec3{2 * s, r * std::cos(angle), r * std::sin(angle)};
  };
  const Affine squeezed{1, 0, 0, 0, 0, 1.3, 0, 0.1, 0, 0, 0.6, 0.25};
  return {grid(2 * n, 8 * n / 5, Around::closed, place), [](const Vec3& x) { return x[0] <= 0.2 + slack; },
          [](const Vec3& x) { return x[0] >= 1.8 - slack; }, squeezed};
}

void sheets(std::size_t n, std::vector<ConstraintCase>& cases) {
  const Affine motion =
      compose(shifted({-0.15, 0.1, 0.3}), compose(turned(0, 0.6, {1.8, 0.5, 0}), turned(1, -0.5, {1.8, 0.5, 0})));
  const Bench sheet = bent_sheet(n, motion);
  const Test middle = patch(0.8, 1.2), left = patch(0.6, 0.8), right = patch(1.2, 1.4);
  cases.push_back(sheet.with(Planar{}, {middle}));
  const Test across = [](const Vec3& x) { return between(0.7, x[0], 1.3) && between(0.5, x[1], 0.5); };
  cases.push_back(sheet.with(Straight{}, {across}));
  cases.push_back(sheet.with(FeatureLine{},
                             {[=](const Vec3& x) { return across(x) || (between(1.3, x[0], 1.3) && between(0.5, x[1], 0.8)); }}));
  cases.push_back(sheet.with(Rigid{}, {middle}));
  cases.push_back(sheet.with(FixedPlane{{0, 0, 0}, {0, 0, 1}}, {middle}));
  Symmetric symmetric;
  symmetric.plane = Symmetric::Plane{{1, 0.5, 0}, {0, 1, 0}};
  cases.push_back(sheet.with(symmetric, {patch(0.7, 1.3)}));
  cases.push_back(sheet.with(Coplanar{}, {left, right}));
  cases.push_back(sheet.with(Parallel{}, {left, right}));
  const Bench pressed = bent_sheet(n, shifted({-0.5, 0, 0.1}));
  cases.push_back(pressed.with(Extent{{1, 0, 0}, Bound::minimum, 0.6}, {patch(0.7, 1.3)}));
}

void folds(std::size_t n, std::vector<ConstraintCase>& cases) {
  const Bench corner = folded(
      n, {{0, 0}, {1, 0}, {1, 1}}, [](const Vec3& x) { return x[0] <= 0.1 + slack; },
      [](const Vec3& x) { return x[2] >= 0.9 - slack; }, {0.4, 0.1, 0});
  cases.push_back(corner.with(Orthogonal{}, {patch(0.4, 0.8), [](const Vec3& x) {
                                               return between(1, x[0], 1) && between(0.2, x[2], 0.6) && between(0.2, x[1], 0.8);
                                             }}));
  const Bench clip = folded(
      n, {{0, 0}, {1, 0}, {1, 0.3}, {0, 0.3}}, [](const Vec3& x) { return x[0] <= 0.1 + slack && x[2] < 0.15; },
      [](const Vec3& x) { return x[0] <= 0.1 + slack && x[2] > 0.15; }, {0, 0, 0.25});
  const Test area = patch(0.4, 0.7);
  cases.push_back(clip.with(Distance{}, {[=](const Vec3& x) { return area(x) && between(0, x[2], 0); },
                                         [=](const Vec3& x) { return area(x) && between(0.3, x[2], 0.3); }}));
}

void rounds(std::size_t n, std::vector<ConstraintCase>& cases) {
  const Bench plate(
      plate_with_hole(16 * n / 5, n / 2), [](const Vec3& x) { return x[0] <= 0.1 + slack; },
      [](const Vec3& x) { return x[0] >= 1.9 - slack; }, shifted({0.4, 0, 0.2}));
  cases.push_back(
      plate.with(Circular{}, {[](const Vec3& x) { return std::abs(std::hypot(x[0] - 1, x[1] - 0.5) - 0.25) < 1e-6; }}));
  const Test middle = [](const Vec3& x) { return between(0.7, x[0], 1.3); };
  cases.push_back(squeezed_tube(n, [](double) { return 0.3; }).with(Cylindrical{}, {middle}));
  cases.push_back(squeezed_tube(n, [](double x) {
                    const double from_middle = std::min(std::abs(x - 1), 0.5);
                    return std::sqrt(0.36 - from_middle * from_middle);
                  }).with(Spherical{}, {middle}));
  cases.push_back(squeezed_tube(n, [](double x) { return 0.4 - 0.1 * x; }).with(Conical{}, {middle}));
}

double square(const Vec3& a, const Vec3& b) {
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
  return sum;
}

std::vector<Vec3> places(const std::vector<PointId>& ids, const Points& points) {
  std::vector<Vec3> out;
  for (const PointId id : ids) out.push_back(points[id]);
  return out;
}

}  // namespace

Mesh plate_with_hole(std::size_t around, std::size_t across) {
  // s runs outwards and t around: the rim comes first in rows of one column, so columns and rows change places.
  Mesh mesh;
  for (std::size_t j = 0; j <= across; ++j) {
    const double t = static_cast<double>(j) / static_cast<double>(across);
    for (std::size_t k = 0; k < around; ++k) {
      const double angle = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(around);
      const double c = std::cos(angle), s = std::sin(angle);
      const double reach = std::min(1 / std::max(std::abs(c), slack), 0.5 / std::max(std::abs(s), slack));
      const double radius = (1 - t) * 0.25 + t * reach;
      mesh.points.push_back({1 + radius * c, 0.5 + radius * s, 0});
    }
  }
  const auto at = [&](std::size_t j, std::size_t k) { return static_cast<PointId>(j * around + k % around); };
  for (std::size_t j = 0; j < across; ++j) {
    for (std::size_t k = 0; k < around; ++k) {
      mesh.face_sizes.push_back(4);
      mesh.face_points.insert(mesh.face_points.end(), {at(j, k), at(j + 1, k), at(j + 1, k + 1), at(j, k + 1)});
    }
  }
  return mesh;
}

std::vector<ConstraintCase> constraint_cases(std::size_t fineness) {
  std::vector<ConstraintCase> cases;
  rounds(fineness, cases);
  sheets(fineness, cases);
  folds(fineness, cases);
  return cases;
}

ConstraintCase prism_block() {
  constexpr std::size_t nx = 20, ny = 10;
  const std::vector<double> heights{0, 0.01, 0.022, 0.036, 0.054, 0.1, 0.18, 0.3, 0.45, 0.62, 0.8, 1};
  Mesh mesh;
  const auto at = [&](std::size_t i, std::size_t j, std::size_t k) {
    return static_cast<PointId>(i + (nx + 1) * (j + (ny + 1) * k));
  };
  for (const double z : heights) {
    for (std::size_t j = 0; j <= ny; ++j) {
      for (std::size_t i = 0; i <= nx; ++i) {
        mesh.points.push_back({2.0 * static_cast<double>(i) / nx, static_cast<double>(j) / ny, z});
      }
    }
  }
  Elements elements;
  for (std::size_t k = 0; k + 1 < heights.size(); ++k) {
    for (std::size_t j = 0; j < ny; ++j) {
      for (std::size_t i = 0; i < nx; ++i) {
        const PointId first[] = {at(i, j, k),     at(i + 1, j, k),     at(i + 1, j + 1, k),
                                 at(i, j, k + 1), at(i + 1, j, k + 1), at(i + 1, j + 1, k + 1)};
        const PointId second[] = {at(i, j, k),     at(i + 1, j + 1, k),     at(i, j + 1, k),
                                  at(i, j, k + 1), at(i + 1, j + 1, k + 1), at(i, j + 1, k + 1)};
        elements.add(ElementType::prism, first);
        elements.add(ElementType::prism, second);
      }
    }
  }
  BoundaryFaces boundary = boundary_faces(elements);
  mesh.face_sizes = std::move(boundary.sizes);
  mesh.face_points = std::move(boundary.points);
  mesh.elements = std::make_shared<const Elements>(std::move(elements));

  ConstraintCase result;
  result.name = "prism block";
  const auto on_wall = [](const Vec3& x) { return x[2] < slack; };
  result.setup.handles = {{"right", where(mesh, [&](const Vec3& x) { return on_wall(x) && x[0] >= 1.6 - slack; })}};
  result.setup.fixed = {where(mesh, [&](const Vec3& x) { return (on_wall(x) && x[0] <= 0.4 + slack) || x[2] > 1 - slack; })};
  Rigid columns;
  columns.layers = 4;
  result.setup.constraints = {
      {"columns", {where(mesh, [&](const Vec3& x) { return on_wall(x) && between(0.8, x[0], 1.2); })}, columns}};
  result.design.motions.push_back({0, compose(shifted({0, 0, 0.15}), turned(1, -0.2, {1.6, 0.5, 0}))});
  result.mesh = std::make_shared<const Mesh>(std::move(mesh));
  return result;
}

Setup with_method(const ConstraintCase& of, const decltype(Setup::method)& method, double weight, Exactness exact) {
  Setup setup = of.setup;
  setup.method = method;
  for (Constraint& constraint : setup.constraints) {
    constraint.weight = weight;
    constraint.exact = exact == Exactness::on;
  }
  return setup;
}

Outcome solved(const System& system, const Design& design) {
  Outcome outcome;
  const auto start = std::chrono::steady_clock::now();
  const auto evaluation = system.bind({&design, 1}, EvaluationPath::automatic, {});
  outcome.report = evaluation->report(0);
  outcome.points.resize(system.info().points);
  parallel_for({}, outcome.points.size(), 1024, [&](std::size_t begin, std::size_t end) {
    Vec3* out = outcome.points.data() + begin;
    evaluation->evaluate(begin, end, 0, std::span<Vec3* const>(&out, 1));
  });
  outcome.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return outcome;
}

Misfit misfit(const Constraint& constraint, const Mesh& mesh, const Points& points) {
  std::vector<std::vector<Vec3>> rest;
  std::vector<Vec3> now;
  for (const Region& region : constraint.regions) {
    const std::vector<PointId> ids = select(region, mesh, constraint.name);
    rest.push_back(places(ids, mesh.points));
    for (const Vec3& x : places(ids, points)) now.push_back(x);
  }
  const auto projection = make_projection(constraint.kind, rest);
  ShapeParameters shape;
  std::vector<Vec3> at_rest, targets(now.size());
  for (const auto& region : rest) at_rest.insert(at_rest.end(), region.begin(), region.end());
  projection->project(at_rest, targets, shape);  // of several fits the one that belongs to the shape at rest
  Misfit result;
  const double sum = projection->project(now, targets, shape);
  result.rms = std::sqrt(sum / static_cast<double>(now.size()));
  for (std::size_t i = 0; i < now.size(); ++i) result.max = std::max(result.max, std::sqrt(square(now[i], targets[i])));
  return result;
}

ShapeChange shape_change(const std::vector<std::vector<PointId>>& sets, const Points& rest, const Points& points) {
  ShapeChange change;
  for (const std::vector<PointId>& set : sets) {
    const std::vector<Vec3> before = places(set, rest), after = places(set, points);
    std::vector<Vec3> targets(after.size());
    ShapeParameters shape;
    const double sum = make_projection(Rigid{}, std::vector<std::vector<Vec3>>{before})->project(after, targets, shape);
    const double distance = std::sqrt(sum / static_cast<double>(after.size()));
    const double relative = distance / bounding_box(before).diagonal();
    change.largest = std::max(change.largest, relative);
    change.largest_distance = std::max(change.largest_distance, distance);
    change.mean += relative / static_cast<double>(sets.size());
  }
  return change;
}

}  // namespace deform::bench
