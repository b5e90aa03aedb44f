// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/mirrored_system.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/handles/sector_points.h"
#include "core/deformers/methods.h"
#include "core/deformers/option_checks.h"
#include "core/deformers/space_map.h"
#include "core/numerics/motion/variable_motion.h"

namespace deform {

namespace {

constexpr std::size_t mirrored_points_per_task = 8192;

/// The copies of handles: handle and image, in the order in which they follow the handles.
struct HandleCopy {
  std::size_t handle, image;
  std::vector<PointId> ids;
};

std::vector<HandleCopy> handle_copies(const SelectedRegions& regions, const MirroredMesh& mirrored) {
  std::vector<HandleCopy> copies;
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    for (std::size_t g = 1; g < mirrored.images(); ++g) {
      HandleCopy copy{h, g, mirrored.own_images(regions.handles[h], g)};
      if (!copy.ids.empty()) copies.push_back(std::move(copy));
    }
  }
  return copies;
}

/// The mirror image of a motion: axes of rotations are pseudovectors.
VariableMotion mirrored_motion(const VariableMotion& motion, const MirroredMesh& mirrored, std::size_t image) {
  VariableMotion result = motion;
  if (auto* translation = std::get_if<Translation>(&result)) {
    translation->direction = mirrored.reflected(translation->direction, image);
  } else if (auto* rotation = std::get_if<Rotation>(&result)) {
    const double sign = mirrored.turns() || std::popcount(image) % 2 == 0 ? 1 : -1;
    rotation->axis = sign * mirrored.reflected(rotation->axis, image);
    rotation->centre = mirrored.reflected_point(rotation->centre, image);
  } else {
    auto& scaling = std::get<Scaling>(result);
    scaling.centre = mirrored.reflected_point(scaling.centre, image);
    scaling.axis = mirrored.reflected(scaling.axis, image);
  }
  return result;
}

/// The map of the model in an image.
Affine map_to(const MirroredMesh& mirrored, std::size_t image) {
  Affine reflection{};
  const Vec3 origin = mirrored.reflected_point({}, image);
  for (std::size_t k = 0; k < 3; ++k) {
    Vec3 axis{};
    axis[k] = 1;
    axis = mirrored.reflected(axis, image);
    for (std::size_t i = 0; i < 3; ++i) reflection[4 * i + k] = axis[i];
    reflection[4 * k + 3] = origin[k];
  }
  return reflection;
}

/// The map R A R^-1 of an image, R its reflection or turn.
Affine mirrored_map(const Affine& map, const MirroredMesh& mirrored, std::size_t image) {
  return compose(map_to(mirrored, image), compose(map, map_to(mirrored, mirrored.inverse(image))));
}

std::vector<PointId> all_images(std::span<const PointId> ids, const MirroredMesh& mirrored) {
  std::vector<PointId> result;
  for (std::size_t g = 0; g < mirrored.images(); ++g) {
    const std::vector<PointId> own = mirrored.own_images(ids, g);
    result.insert(result.end(), own.begin(), own.end());
  }
  return result;
}

/// The setup of the whole model: regions by their points, a copy of each handle for each image, and no planes.
Setup whole_setup(const Setup& half, const Mesh& mesh, const SelectedRegions& regions, const MirroredMesh& mirrored,
                  const MirroredConstraints& constraints) {
  Setup setup = half;
  setup.symmetry.clear();
  setup.constraints = constraints.constraints;
  std::set<std::string> names;
  for (std::size_t h = 0; h < setup.handles.size(); ++h) {
    setup.handles[h].region = {Region::Ids{regions.handles[h]}};
    names.insert(setup.handles[h].name);
  }
  for (HandleCopy& copy : handle_copies(regions, mirrored)) {
    const std::string& of = half.handles[copy.handle].name;
    std::string name = of + " (image " + std::to_string(copy.image) + ")";
    while (!names.insert(name).second) name += "'";
    for (std::size_t k = 0; k < setup.variables.size(); ++k) {
      const DesignVariable& variable = half.variables[k];
      if (variable.handle == of) setup.variables[k].also.push_back({name, mirrored_motion(variable.kind, mirrored, copy.image)});
      for (const DrivenHandle& driven : variable.also) {
        if (driven.handle == of) setup.variables[k].also.push_back({name, mirrored_motion(driven.kind, mirrored, copy.image)});
      }
    }
    setup.handles.push_back({std::move(name), {Region::Ids{std::move(copy.ids)}}});
  }
  setup.fixed.clear();
  if (!regions.fixed.empty()) setup.fixed.push_back({Region::Ids{all_images(regions.fixed, mirrored)}});
  for (const OptionRegion& option : option_regions(setup)) {
    *option.region = {Region::Ids{all_images(select(*option.region, mesh, option.field), mirrored)}};
  }
  return setup;
}

/// Adds to errors that name points which images there are.
template <typename Call>
auto about_images(std::size_t points, const Call& call) {
  try {
    return call();
  } catch (const Error& error) {
    if (error.code() != ErrorCode::invalid_argument) throw;
    throw Error(error.code(), std::string(error.what()) + " (the model is deformed as a whole with its images, which have " +
                                  "the point ids from " + std::to_string(points) + " on)");
  }
}

constexpr const char* leaves_plane =
    "; points on a symmetry plane only slide in it: take them out of the handle with `difference`";

}  // namespace

bool is_mirrored(const Setup& setup) { return !setup.symmetry.empty() && !keeps_symmetry(setup); }

/// Designs bound to a MirroredSystem, or its derivative.
class MirroredEvaluation : public Evaluation {
 public:
  MirroredEvaluation(std::shared_ptr<const MirroredSystem> system, std::unique_ptr<const Evaluation> whole)
      : system_(std::move(system)), whole_(std::move(whole)) {
    for (std::size_t i = 0; i < whole_->design_count(); ++i) {
      reports_.push_back(whole_->report(i));
      if (reports_.back().prescribed_displacement > 0) reports_.back().error += system_->image_rounding_;
      reports_.back().constraints = system_->constraints_.reports(reports_.back().constraints, [&](PointId id) {
        Vec3 place{};
        Vec3* const to = &place;
        MirroredEvaluation::evaluate(id, id + std::size_t{1}, i, {&to, 1});
        return place;
      });
    }
  }

  std::size_t design_count() const override { return whole_->design_count(); }
  const DesignReport& report(std::size_t design) const override { return reports_[design]; }
  void evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const override;

 private:
  const std::shared_ptr<const MirroredSystem> system_;
  const std::unique_ptr<const Evaluation> whole_;
  std::vector<DesignReport> reports_;
};

template <typename DisplacementOf>
Vec3 MirroredSystem::mean(const DisplacementOf& displacement_of) const {
  // In the frame of the planes: what a reflection changes is a sign, so that components across planes add up to exactly zero.
  const Symmetry& symmetry = regions_.symmetry;
  Vec3 sum{};
  for (std::size_t g = 0; g < mirrored_.images(); ++g) {
    Vec3 u = symmetry.to_frame(displacement_of(g));
    if (symmetry.is_sector()) u = symmetry.sector().turned(u, mirrored_.inverse(g));
    for (std::size_t k = 0; k < symmetry.planes(); ++k) {
      if ((g >> k & 1u) != 0) u[k] = -u[k];
    }
    sum = sum + u;
  }
  return symmetry.from_frame(sum / static_cast<double>(mirrored_.images()));
}

template <typename DisplacementOf>
Vec3 MirroredSystem::mean_at(PointId id, const DisplacementOf& displacement_of) const {
  const PointId first = regions_.symmetry.sector().first_of(id);
  Vec3 u = mean([&](std::size_t g) { return displacement_of(mirrored_.image(first, g)); });
  if (first != id) u = regions_.symmetry.turned(u, 1);
  if (regions_.symmetry.sector().on_axis(id)) u = dot(u, regions_.symmetry.normal(0)) * regions_.symmetry.normal(0);
  return u;
}

void MirroredEvaluation::evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const {
  const MirroredMesh& mirrored = system_->mirrored_;
  const Mesh& whole = *mirrored.mesh();
  // One run of points per image; of the first, all.
  std::vector<std::size_t> starts{0};
  std::vector<PointId> firsts;
  for (std::size_t g = 0; g < mirrored.images(); ++g) {
    const auto [low, high] = mirrored.own_range(begin, end, g);
    firsts.push_back(low);
    starts.push_back(starts.back() + (high - low));
  }
  std::vector<Vec3> places(starts.back() * out.size());
  std::vector<Vec3*> to(out.size());
  for (std::size_t g = 0; g < mirrored.images(); ++g) {
    if (starts[g + 1] == starts[g]) continue;
    for (std::size_t d = 0; d < out.size(); ++d) to[d] = places.data() + d * starts.back() + starts[g];
    whole_->evaluate(firsts[g], firsts[g] + (starts[g + 1] - starts[g]), first, to);
  }
  const Symmetry& symmetry = system_->regions_.symmetry;
  for (std::size_t d = 0; d < out.size(); ++d) {
    const Vec3* const from = places.data() + d * starts.back();
    const auto displacement_at = [&](PointId image) {
      // The last image that begins before it, if it has the point.
      const auto after = std::upper_bound(firsts.begin(), firsts.end(), image);
      auto g = static_cast<std::size_t>(after - firsts.begin());
      while (g > 0 && starts[g] == starts[g - 1]) --g;
      if (g > 0 && image - firsts[g - 1] < starts[g] - starts[g - 1]) {
        return from[starts[g - 1] + (image - firsts[g - 1])] - whole.points[image];
      }
      Vec3 place{};  // an image of a partner that is not in the range
      Vec3* const at = &place;
      whole_->evaluate(image, image + std::size_t{1}, first + d, {&at, 1});
      return place - whole.points[image];
    };
    for (std::size_t i = begin; i < end; ++i) {
      const auto id = static_cast<PointId>(i);
      const Vec3& x = whole.points[i];
      const Vec3 u = system_->mean_at(id, displacement_at);
      out[d][i - begin] = symmetry.slid(x, x + u, symmetry.on(id));
    }
  }
}

MirroredSystem::MirroredSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context,
                               std::size_t memory_budget)
    : MirroredSystem(std::move(mesh), setup, [&](std::shared_ptr<const Mesh> whole, const Setup& whole_setup) {
        return prepare(std::move(whole), whole_setup, context, memory_budget);
      }) {}

MirroredSystem::MirroredSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const MakeWhole& make)
    : mesh_(std::move(mesh)),
      setup_(setup),
      regions_(validate(setup_, *mesh_)),
      images_(std::make_shared<const MirroredMesh>(*mesh_, regions_.symmetry)),
      mirrored_(*images_),
      constraints_(setup_, *mesh_, regions_, mirrored_) {
  Setup whole = whole_setup(setup_, *mesh_, regions_, mirrored_, constraints_);
  whole.images = images_;
  whole_ = about_images(mesh_->point_count(), [&] { return make(mirrored_.mesh(), whole); });
  image_rounding_ = rounding_of_images();
  fill_info();
}

/// Eight roundings, of products of maps and of places: in 150 half models far from the origin, whose errors were at rounding,
/// points were up to 2.5 times as far off as the whole model said without them.
double MirroredSystem::rounding_of_images() const {
  double largest = 0;
  for (const Vec3& x : mirrored_.mesh()->points) largest = std::max({largest, std::abs(x[0]), std::abs(x[1]), std::abs(x[2])});
  return 8 * std::numeric_limits<double>::epsilon() * largest;
}

void MirroredSystem::fill_info() {
  info_ = whole_->info();
  info_.points = mesh_->point_count();
  info_.fixed_points = regions_.fixed.size();
  info_.handle_points = 0;
  for (const auto& handle : regions_.handles) info_.handle_points += handle.size();
  info_.constraint_points = info_.handle_points + info_.fixed_points;
  info_.deformable_points = info_.points - info_.constraint_points;
  info_.basis_fields = whole_->info().basis_fields;
  info_.bytes += mirrored_.bytes() + mirrored_.mesh_bytes();
  info_.diagonal = bounding_box(mesh_->points).diagonal();
  if (regions_.symmetry.is_sector()) info_.notes.push_back(regions_.symmetry.sector().note());
  info_.notes.push_back(
      "The model is deformed as a whole with its " + std::string(regions_.symmetry.is_sector() ? "" : "mirror ") +
      "images: " + std::to_string(mirrored_.mesh()->point_count()) + " points instead of " + std::to_string(info_.points) + ".");
  info_.notes.insert(info_.notes.end(), constraints_.notes.begin(), constraints_.notes.end());
}

std::vector<Design> MirroredSystem::mirrored(std::span<const Design> designs) const {
  const std::vector<HandleCopy> copies = handle_copies(regions_, mirrored_);
  std::vector<Design> result(designs.begin(), designs.end());
  for (Design& design : result) {
    const std::size_t given = design.motions.size();
    for (std::size_t c = 0; c < copies.size(); ++c) {
      const HandleCopy& copy = copies[c];
      const std::vector<PointId>& ids = regions_.handles[copy.handle];
      for (std::size_t m = 0; m < given; ++m) {
        const Motion motion = design.motions[m];
        if (motion.handle != copy.handle) continue;
        Motion image{setup_.handles.size() + c, identity_affine};
        if (const auto* map = std::get_if<Affine>(&motion.value)) {
          if (*map != identity_affine) image.value = mirrored_map(*map, mirrored_, copy.image);
        } else {
          const auto& from = std::get<std::vector<Vec3>>(motion.value);
          if (from.size() != ids.size()) break;  // which the whole model refuses
          std::vector<Vec3> to;
          for (std::size_t k = 0; k < ids.size(); ++k) {
            if (mirrored_.is_own(ids[k], copy.image)) to.push_back(mirrored_.reflected(from[k], copy.image));
          }
          image.value = std::move(to);
        }
        design.motions.push_back(std::move(image));
      }
    }
  }
  return result;
}

std::function<std::string(PointId)> MirroredSystem::name_of() const {
  return [this](PointId id) {
    for (std::size_t h = 0; h < regions_.handles.size(); ++h) {
      if (!std::binary_search(regions_.handles[h].begin(), regions_.handles[h].end(), id)) continue;
      return std::to_string(id) + " (handle \"" + setup_.handles[h].name + "\")";
    }
    return std::to_string(id) + " (fixed)";
  };
}

void MirroredSystem::check_sliding(const Design& design, std::size_t index) const {
  const bool sector = regions_.symmetry.is_sector();
  std::vector<Affine> maps(setup_.handles.size(), identity_affine);
  if (!design.variables.empty()) maps = handle_motions(setup_, design.variables);
  std::vector<const std::vector<Vec3>*> displacements(setup_.handles.size(), nullptr);
  for (const Motion& motion : design.motions) {
    if (const auto* map = std::get_if<Affine>(&motion.value)) {
      maps[motion.handle] = *map;
    } else {
      displacements[motion.handle] = &std::get<std::vector<Vec3>>(motion.value);
    }
  }
  const Symmetry& symmetry = regions_.symmetry;
  if (sector) {
    const auto moved = [&](PointId id) -> std::optional<Vec3> {
      if (std::binary_search(regions_.fixed.begin(), regions_.fixed.end(), id)) return Vec3{};
      for (std::size_t h = 0; h < maps.size(); ++h) {
        const std::vector<PointId>& ids = regions_.handles[h];
        const auto at = std::lower_bound(ids.begin(), ids.end(), id);
        if (at == ids.end() || *at != id) continue;
        const Vec3& x = mesh_->points[id];
        return displacements[h] != nullptr ? (*displacements[h])[static_cast<std::size_t>(at - ids.begin())]
                                           : transformed(maps[h], x) - x;
      }
      return std::nullopt;
    };
    const std::string conflict = sector_conflict(symmetry, moved, name_of(), sector_agreement * info_.diagonal);
    if (!conflict.empty()) refuse_argument("designs[" + std::to_string(index) + "]: " + conflict);
    return;
  }
  for (std::size_t h = 0; h < maps.size(); ++h) {
    for (std::size_t i = 0; i < regions_.handles[h].size(); ++i) {
      const PointId id = regions_.handles[h][i];
      if (symmetry.on(id) == 0) continue;
      const Vec3& x = mesh_->points[id];
      const Vec3 u = symmetry.to_frame(displacements[h] != nullptr ? (*displacements[h])[i] : transformed(maps[h], x) - x);
      for (std::size_t k = 0; k < symmetry.planes(); ++k) {
        if ((symmetry.on(id) >> k & 1u) == 0 || std::abs(u[k]) <= symmetry.reach(k)) continue;
        refuse_argument("designs[" + std::to_string(index) + "]: point " + std::to_string(id) + " (handle \"" +
                        setup_.handles[h].name + "\") lies on symmetry[" + std::to_string(k) + "] but is sent a distance of " +
                        number_digits(u[k]) + " out of it" + leaves_plane);
      }
    }
  }
}

void MirroredSystem::check_sliding(const std::vector<Affine>& derivative, const std::string& what) const {
  const Symmetry& symmetry = regions_.symmetry;
  if (symmetry.is_sector()) {
    double size = 0;
    const Box box = bounding_box(mesh_->points);
    for (const Affine& m : derivative) {
      for (std::size_t i = 0; i < 12; ++i) {
        const std::size_t k = i % 4;
        size = std::max(size, std::abs(m[i]) * (k == 3 ? 1.0 : std::max(std::abs(box.min[k]), std::abs(box.max[k]))));
      }
    }
    const auto rate = [&](PointId id) -> std::optional<Vec3> {
      if (std::binary_search(regions_.fixed.begin(), regions_.fixed.end(), id)) return Vec3{};
      for (std::size_t h = 0; h < derivative.size(); ++h) {
        const bool has = std::binary_search(regions_.handles[h].begin(), regions_.handles[h].end(), id);
        if (has) return transformed(derivative[h], mesh_->points[id]);
      }
      return std::nullopt;
    };
    const std::string conflict = sector_conflict(symmetry, rate, name_of(), 10 * sector_agreement * size);
    if (!conflict.empty()) refuse_argument(what + ": " + conflict);
    return;
  }
  for (std::size_t h = 0; h < derivative.size(); ++h) {
    if (derivative[h] == Affine{}) continue;
    for (const PointId id : regions_.handles[h]) {
      if (symmetry.on(id) == 0) continue;
      const Vec3& x = mesh_->points[id];
      double size = 0;  // of the terms of the rate
      for (std::size_t i = 0; i < 12; ++i) size = std::max(size, std::abs(derivative[h][i] * (i % 4 == 3 ? 1.0 : x[i % 4])));
      const Vec3 across = symmetry.to_frame(transformed(derivative[h], x));
      for (std::size_t k = 0; k < symmetry.planes(); ++k) {
        if ((symmetry.on(id) >> k & 1u) == 0 || std::abs(across[k]) * info_.diagonal <= symmetry.reach(k) * size) continue;
        refuse_argument(what + ": moves point " + std::to_string(id) + " (handle \"" + setup_.handles[h].name +
                        "\") out of symmetry[" + std::to_string(k) + "] at a rate of " + number_digits(across[k]) + leaves_plane);
      }
    }
  }
}

std::unique_ptr<const Evaluation> MirroredSystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                       const RunContext& context) const {
  auto whole = whole_->bind(mirrored(designs), path, context);
  for (std::size_t i = 0; i < designs.size(); ++i) check_sliding(designs[i], i);
  return std::make_unique<MirroredEvaluation>(std::static_pointer_cast<const MirroredSystem>(shared_from_this()),
                                              std::move(whole));
}

std::unique_ptr<const Evaluation> MirroredSystem::bind_sequence(std::span<const Design> designs, EvaluationPath path,
                                                                WarmStart& warm, const RunContext& context) const {
  auto whole = whole_->bind_sequence(mirrored(designs), path, warm, context);
  for (std::size_t i = 0; i < designs.size(); ++i) check_sliding(designs[i], i);
  return std::make_unique<MirroredEvaluation>(std::static_pointer_cast<const MirroredSystem>(shared_from_this()),
                                              std::move(whole));
}

/// A design of a MirroredSystem as a map of space: the mean of those of the images of a place, as for points of the mesh.
class MirroredMap : public SpaceMap {
 public:
  MirroredMap(std::shared_ptr<const MirroredSystem> system, std::unique_ptr<const SpaceMap> whole)
      : system_(std::move(system)),
        whole_(std::move(whole)),
        partners_(system_->regions_.symmetry.sector(), *system_->mesh_),
        report_(whole_->report()) {
    report_.constraints = system_->constraints_.reports(report_.constraints, [&](PointId id) {
      Vec3 place{};
      MirroredMap::evaluate({&system_->mesh_->points[id], 1}, 0, {&place, 1}, {});
      return place;
    });
  }

  const DesignReport& report() const override { return report_; }
  Found evaluate(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                 const RunContext& context) const override;

 private:
  const std::shared_ptr<const MirroredSystem> system_;
  const std::unique_ptr<const SpaceMap> whole_;
  const PartnerPlaces partners_;
  DesignReport report_;
};

SpaceMap::Found MirroredMap::evaluate(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                      const RunContext& context) const {
  const MirroredMesh& mirrored = system_->mirrored_;
  const Symmetry& symmetry = system_->regions_.symmetry;
  // As those of the mesh, places on a plane are their own images in it.
  const auto image = [&](const Vec3& x, unsigned on, std::size_t g) {
    const std::size_t reduced = g & ~std::size_t{on};
    return reduced == 0 ? x : mirrored.reflected_point(x, reduced);
  };
  std::vector<std::vector<Vec3>> from(mirrored.images()), to(mirrored.images());
  Found found;
  for (std::size_t g = 0; g < mirrored.images(); ++g) {
    for (const Vec3& x : points) {
      const PartnerPlaces::Entry* const partner = partners_.at(x);
      from[g].push_back(partner == nullptr ? image(x, symmetry.on(x), g)
                                           : mirrored.mesh()->points[mirrored.image(partner->first, g)]);
    }
    to[g].resize(points.size());
    const Found of_image = whole_->evaluate(from[g], first, to[g], context);
    if (g == 0) found.still = of_image.still;
    found.sums_error = std::max(found.sums_error, of_image.sums_error);
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    Vec3 u = system_->mean([&](std::size_t g) { return to[g][i] - from[g][i]; });
    if (const PartnerPlaces::Entry* const partner = partners_.at(points[i]); partner != nullptr && partner->is_second) {
      u = symmetry.turned(u, 1);
    }
    out[i] = symmetry.is_sector() ? points[i] + symmetry.from_frame(symmetry.admissible(symmetry.to_frame(u), points[i]))
                                  : symmetry.slid(points[i], points[i] + u, symmetry.on(points[i]));
  }
  return found;
}

std::unique_ptr<const SpaceMap> MirroredSystem::bind_in_space(const Design& design, const RunContext& context) const {
  auto whole = whole_->bind_in_space(mirrored({&design, 1}).front(), context);
  check_sliding(design, 0);
  return std::make_unique<MirroredMap>(std::static_pointer_cast<const MirroredSystem>(shared_from_this()), std::move(whole));
}

System::SpaceBytes MirroredSystem::space_bytes(std::size_t points) const {
  SpaceBytes bytes = whole_->space_bytes(points);
  bytes.map += PartnerPlaces::bytes_for(regions_.symmetry.sector());
  bytes.call += 2 * mirrored_.images() * points * sizeof(Vec3);
  return bytes;
}

Points MirroredSystem::jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                                       const RunContext& context) const {
  check_sliding(motion_derivative(setup_, variables, direction), "direction");
  const Points field = whole_->jacobian_vector(variables, direction, context);
  Points result(mesh_->point_count());
  parallel_for(context, result.size(), mirrored_points_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      result[i] = mean_at(static_cast<PointId>(i), [&](PointId image) { return field[image]; });
    }
  });
  return result;
}

std::vector<double> MirroredSystem::vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                                    const RunContext& context) const {
  return vector_jacobians(variables, {&cotangent, 1}, context).front();
}

std::vector<std::vector<double>> MirroredSystem::vector_jacobians(std::span<const double> variables,
                                                                  std::span<const Points> cotangents,
                                                                  const RunContext& context) const {
  for (const Points& cotangent : cotangents) check_cotangent(cotangent, mesh_->point_count());
  handle_motions(setup_, variables);  // checks them
  for (std::size_t k = 0; k < setup_.variables.size(); ++k) {
    check_sliding(handle_motion_derivative(setup_, variables, k), "variable \"" + setup_.variables[k].name + "\"");
  }
  std::vector<Points> of_images(cotangents.size(), Points(mirrored_.mesh()->point_count()));
  for (std::size_t j = 0; j < cotangents.size(); ++j) {
    for (std::size_t g = 0; g < mirrored_.images(); ++g) {
      for (std::size_t i = 0; i < cotangents[j].size(); ++i) {
        const PointId id = static_cast<PointId>(i), of = regions_.symmetry.sector().first_of(id);
        Vec3& sum = of_images[j][mirrored_.image(of, g)];
        const Vec3 back = of == id ? cotangents[j][i] : regions_.symmetry.turned(cotangents[j][i], mirrored_.images() - 1);
        sum = sum + mirrored_.reflected(back, g) / static_cast<double>(mirrored_.images());
      }
    }
  }
  return whole_->vector_jacobians(variables, of_images, context);
}

Estimate estimate_mirrored(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const RunContext& context) {
  const auto images = std::make_shared<const MirroredMesh>(mesh, regions.symmetry);
  const MirroredMesh& mirrored = *images;
  const MirroredConstraints constraints(setup, mesh, regions, mirrored);
  RunContext unclaimed = context;  // what its regions select was claimed for the model
  unclaimed.on_claim = nullptr;
  Estimate expected = about_images(mesh.point_count(), [&] {
    Setup whole = whole_setup(setup, mesh, regions, mirrored, constraints);
    whole.images = images;
    return estimate(*mirrored.mesh(), whole, unclaimed);
  });
  expected.constraint_points = regions.fixed.size();
  for (const auto& handle : regions.handles) expected.constraint_points += handle.size();
  expected.resident_bytes += mirrored.bytes() + mirrored.mesh_bytes();
  expected.peak_bytes += mirrored.bytes() + mirrored.mesh_bytes();
  return expected;
}

}  // namespace deform
