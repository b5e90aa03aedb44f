// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>

#include "core/base/run_context.h"
#include "core/compiled/reader.h"
#include "core/deformers/handles/stored_basis.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"

// What a prepared system leaves so that its designs on the basis path can be evaluated without preparing it again, with the same
// bits. Functions for any thread.

namespace deform {

/// Whether systems of a setup can be stored: those of one method with a handle basis, without constraints. A system may still
/// have been prepared without a basis.
bool can_be_stored(const Setup& setup);

/// The system of a setup, or of the whole model where that is deformed with its images, if it can be stored; else null.
const HandleSystem* stored_source(const Setup& setup, const System& system);

/// The system that was written (StoredBasis::write()), without its solution: see RestoredSystem. Throws the errors of validate()
/// and StoredBasis::read(), Error(data_loss) for a basis of another mesh or setup, and Error(failed_precondition) for a setup
/// that cannot be stored.
std::shared_ptr<const System> restore(std::shared_ptr<const Mesh> mesh, const Setup& setup, StoredBasis&& stored,
                                      const RunContext& context = {});

}  // namespace deform
