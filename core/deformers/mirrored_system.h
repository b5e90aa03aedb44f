// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/deformers/mirrored_constraints.h"
#include "core/deformers/mirrored_mesh.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"

namespace deform {

/// A half model with its images: symmetry planes, or a sector, for methods that have none of their own
/// (MethodFeatures::symmetry). The system of the whole model is prepared, with a copy of each handle for each image, which moves
/// as its mirror image, and with constraints as MirroredConstraints says. The displacement of a point is the mean of those of its
/// images, mirrored back, so that the result is symmetric to rounding, although centres, samples and sums are not. Points on a
/// plane stay in it exactly.
class MirroredSystem : public System {
 public:
  /// Throws what prepare() throws for the whole model; ids in messages beyond the points of the half model are those of images.
  MirroredSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context, std::size_t memory_budget);
  /// Where the system of the whole model comes from.
  using MakeWhole = std::function<std::shared_ptr<const System>(std::shared_ptr<const Mesh> mesh, const Setup& setup)>;
  MirroredSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const MakeWhole& make);

  const System& whole() const { return *whole_; }  ///< the system of the whole model

  const SystemInfo& info() const override { return info_; }
  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;
  std::unique_ptr<const Evaluation> bind_sequence(std::span<const Design> designs, EvaluationPath path, WarmStart& warm,
                                                  const RunContext& context) const override;
  std::unique_ptr<const SpaceMap> bind_in_space(const Design& design, const RunContext& context) const override;
  SpaceBytes space_bytes(std::size_t points) const override;
  Points jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                         const RunContext& context) const override;
  std::vector<double> vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                      const RunContext& context) const override;
  std::vector<std::vector<double>> vector_jacobians(std::span<const double> variables, std::span<const Points> cotangents,
                                                    const RunContext& context) const override;

 private:
  friend class MirroredEvaluation;
  friend class MirroredMap;

  void fill_info();
  double rounding_of_images() const;
  /// With the motions of the copies of handles.
  std::vector<Design> mirrored(std::span<const Design> designs) const;
  /// Throws Error(invalid_argument) for handle points that leave their plane.
  void check_sliding(const Design& design, std::size_t index) const;
  void check_sliding(const std::vector<Affine>& derivative, const std::string& what) const;
  std::function<std::string(PointId)> name_of() const;  ///< names handle and fixed points, for messages
  /// The mean of the displacements of the images of a point, mirrored back; displacement_of(image).
  template <typename DisplacementOf>
  Vec3 mean(const DisplacementOf& displacement_of) const;
  /// The same of a point, from those of points of the whole model: displacement_of(id). That of the second of two partners is the
  /// one of the first, turned.
  template <typename DisplacementOf>
  Vec3 mean_at(PointId id, const DisplacementOf& displacement_of) const;

  const std::shared_ptr<const Mesh> mesh_;
  const Setup setup_;
  const SelectedRegions regions_;
  const std::shared_ptr<const MirroredMesh> images_;
  const MirroredMesh& mirrored_;  ///< the same
  const MirroredConstraints constraints_;
  std::shared_ptr<const System> whole_;
  double image_rounding_ = 0;  ///< error of designs that move, model units: motions of images are made of products of maps
  SystemInfo info_;
};

/// Whether a setup has symmetry planes that its method leaves to MirroredSystem.
bool is_mirrored(const Setup& setup);
/// Estimates the cost of a MirroredSystem. The regions are those of validate().
Estimate estimate_mirrored(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const RunContext& context);

}  // namespace deform
