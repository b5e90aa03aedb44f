// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <vector>

#include "core/base/error.h"
#include "core/deformers/handles/handle_evaluation.h"
#include "core/deformers/handles/handle_system.h"
#include "core/deformers/method.h"

namespace deform::test {

/// The template of a method: every deformable point takes the mean of what the handles' maps (and rest, where points are fixed)
/// would do to it. Not a good deformation, but a linear one with everything that a method has.
class UniformBlend : public HandleSystem {
 public:
  UniformBlend(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context)
      : HandleSystem(std::move(mesh), setup, HandleMode::hard, Unit::diagonal, context),
        share_(1 / static_cast<double>(frames_.size() + (regions_.fixed.empty() ? 0 : 1))) {
    end_stage("select");
    HandleBasis basis{{0, 1, 2}, FieldTiles(following().size(), fields()), std::vector<double>(fields(), 0.0)};
    for (std::size_t s = 0; s < following().size(); ++s) {
      for (std::size_t h = 0; h < frames_.size(); ++h) {
        const std::array<double, 4> values = handle_fields(h, following()[s]);
        for (std::size_t f = 0; f < 4; ++f) basis.tiles.at(s, 4 * h + f) = share_ * values[f];
      }
    }
    add_basis(std::move(basis), 0, context);
    end_stage("basis");
    set_bytes(0, 0);
  }

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override {
    return std::make_unique<Bound>(self(), designs, path, context);
  }

 private:
  /// Its direct path moves all points by the mean displacement of the handles' points.
  class Bound : public HandleEvaluation {
   public:
    Bound(const std::shared_ptr<const UniformBlend>& system, std::span<const Design> designs, EvaluationPath path,
          const RunContext& context)
        : HandleEvaluation(system, designs, path, context), means_(designs.size(), Vec3{}) {
      for_each_direct(context, [&](std::size_t i) {
        for (const std::vector<PointId>& handle : held_.regions.handles) {
          const double weight = system->share_ / static_cast<double>(handle.size());
          for (const PointId id : handle) {
            const Vec3 u = prescribed_displacement(designs_[i], id);
            for (std::size_t k = 0; k < 3; ++k) means_[i][k] += weight * u[k];
          }
        }
      });
    }
    Bound(const std::shared_ptr<const UniformBlend>& system, const std::vector<Affine>& derivatives)
        : HandleEvaluation(system, derivatives) {}

   private:
    void direct_tile(std::size_t, std::size_t first, std::size_t count, double* values) const override {
      for (std::size_t c = 0; c < 3 * count; ++c) std::fill_n(values + c * tile_size, tile_size, means_[first + c / 3][c % 3]);
    }
    std::vector<Vec3> means_;  ///< per design
  };

  std::shared_ptr<const UniformBlend> self() const { return std::static_pointer_cast<const UniformBlend>(shared_from_this()); }
  std::unique_ptr<const Evaluation> derivative(std::span<const double>, const std::vector<Affine>& maps,
                                               const RunContext&) const override {
    return std::make_unique<Bound>(self(), maps);
  }
  Fields adjoint(std::span<const double>, Cotangents, const RunContext&) const override {
    throw Error(ErrorCode::internal, "there is always a basis");
  }

  double share_;  ///< of every handle
};

struct UniformBlendOptions {
  BasisMode basis = BasisMode::automatic;
};

/// What the table of methods needs.
struct UniformBlendMethod {
  using Options = UniformBlendOptions;
  static constexpr std::string_view name = "uniform_blend";
  static constexpr MethodFeatures features{};
  static std::vector<OptionRegion> regions(Options&) { return {}; }
  static void validate(const Options&, const Setup&, const Mesh&, Problems&) {}
  static std::optional<std::vector<PointId>> known_centres(const Options&, const Mesh&, const SelectedRegions&,
                                                           const RunContext&) {
    return {};
  }
  static Estimate estimate(const Options&, const Mesh& mesh, const Setup&, const SelectedRegions& regions,
                           const RunContext& = {}) {
    Estimate estimate;
    estimate.basis_bytes = HandleBasis::bytes_for(mesh.point_count(), 4 * regions.handles.size(), 0);
    estimate.resident_bytes = estimate.peak_bytes = estimate.basis_bytes + point_bytes(mesh.point_count(), regions.symmetry);
    estimate.advice = "use fewer handles";
    return estimate;
  }
  static std::shared_ptr<const System> prepare(const Options&, const std::shared_ptr<const Mesh>& mesh, const Setup& setup,
                                               const RunContext& context, std::size_t) {
    return std::make_shared<const UniformBlend>(mesh, setup, context);
  }
};
static_assert(Method<UniformBlendMethod>);

}  // namespace deform::test
