// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/methods.h"

#include <algorithm>
#include <iterator>
#include <string>

#include "core/base/error.h"
#include "core/deformers/composed/composed_setup.h"

namespace deform {

namespace {

/// "method.shell, method.subspace or method.mls": those that have a feature.
std::string methods_with(bool MethodFeatures::*feature) {
  std::vector<std::string> names;
  Methods::for_each([&]<Method M>() {
    if (M::features.*feature) names.push_back("method." + std::string(M::name));
  });
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i) {
    text += (i == 0 ? "" : i + 1 == names.size() ? " or " : ", ") + names[i];
  }
  return text;
}

bool has_sector(const Setup& setup) {
  return std::any_of(setup.symmetry.begin(), setup.symmetry.end(),
                     [](const SymmetryPlane& plane) { return std::holds_alternative<SectorOptions>(plane.kind); });
}

}  // namespace

void validate_method(const Setup& setup, const Mesh& mesh, Problems& problems) {
  with_method(setup, [&]<Method M>(const typename M::Options& options) {
    const auto refuse = [](const std::string& field, const std::string& what, const std::string& use) {
      throw Error(ErrorCode::invalid_argument,
                  field + ": method." + std::string(M::name) + " does not take " + what + "; use " + use);
    };
    problems.check("method", [&] {
      if (!has_sector(setup)) return;
      if constexpr (requires { options.solver; }) {
        if (options.solver == Solver::incremental_qr) {
          refuse("symmetry[0].sector",
                 "sectors with solver INCREMENTAL_QR, whose choice of centres would differ from sector to sector",
                 "solver AUTOMATIC or ITERATIVE");
        }
      }
      if (!setup.constraints.empty()) {
        refuse("constraints", "geometric constraints in a sector", "symmetry planes, or deform the whole wheel");
      }
    });
    problems.check("method", [&] {
      if (setup.symmetry.empty()) return;
      if (keeps_symmetry(setup)) return;
      for (std::size_t i = 0; M::features.sampled && i < setup.constraints.size(); ++i) {
        if (!setup.constraints[i].exact) continue;
        refuse("constraints[" + std::to_string(i) + "].exact", "exact constraints in half models",
               "method.shell or method.ffd, leave `exact` out, or deform the whole model");
      }
    });
    problems.check("method", [&] {
      if (!setup.constraints.empty() && !M::features.constraints) {
        refuse("constraints", "geometric constraints", methods_with(&MethodFeatures::constraints));
      }
    });
    if constexpr (requires { options.samples; }) {
      // Samples are values of the variables: whether they are right cannot be said of wrong ones.
      auto without_samples = options;
      if (problems.concern("variables")) without_samples.samples.clear();
      M::validate(without_samples, setup, mesh, problems);
    } else {
      M::validate(options, setup, mesh, problems);
    }
  });
}

std::vector<OptionRegion> option_regions(Setup& setup) {
  return with_method(setup, []<Method M>(typename M::Options& options) { return M::regions(options); });
}

bool selects_controls(const Setup& setup) {
  return with_method(setup, []<Method M>([[maybe_unused]] const typename M::Options& options) {
    if constexpr (requires { M::selects_controls(options); }) return M::selects_controls(options);
    return false;
  });
}

bool keeps_symmetry(const Setup& setup) {
  const bool own = with_method(setup, []<Method M>(const typename M::Options&) { return M::features.symmetry; });
  return own || selects_controls(setup);
}

ControlSet controls_of(const Setup& setup, const Mesh& mesh, const Symmetry& symmetry) {
  return with_method(setup, [&]<Method M>([[maybe_unused]] const typename M::Options& options) {
    if constexpr (requires { M::controls(options, mesh, symmetry); }) return M::controls(options, mesh, symmetry);
    return ControlSet{};
  });
}

std::vector<Vec3> control_places(const Setup& setup, const Mesh& mesh, const Symmetry& symmetry) {
  return with_method(setup, [&]<Method M>([[maybe_unused]] const typename M::Options& options) {
    if constexpr (requires { M::control_places(options, mesh, symmetry); }) return M::control_places(options, mesh, symmetry);
    return std::vector<Vec3>{};
  });
}

std::optional<std::vector<PointId>> known_centres(const Mesh& mesh, const Setup& setup) {
  return known_centres(mesh, setup, validate(setup, mesh));
}

std::optional<std::vector<PointId>> known_centres(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                                                  const RunContext& context) {
  if (is_composed(setup)) {
    std::optional<std::vector<PointId>> all;
    for (std::size_t s = 0; s <= setup.then.size(); ++s) {
      const auto own = known_centres(mesh, stage_setup(setup, s).setup, regions.stages[s], context);
      if (!own) continue;
      std::vector<PointId> sum;
      if (all) std::set_union(all->begin(), all->end(), own->begin(), own->end(), std::back_inserter(sum));
      all = all ? std::move(sum) : *own;
    }
    return all;
  }
  return with_method(
      setup, [&]<Method M>(const typename M::Options& options) { return M::known_centres(options, mesh, regions, context); });
}

}  // namespace deform
