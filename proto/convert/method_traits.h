// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>

#include "core/deformers/method_features.h"
#include "core/numerics/kernels/kernel.h"
#include "deform/v1/setup.pb.h"

namespace deform::convert {

// The properties of methods and kernels that are read off their messages, without a setup of core. Fields are found by their
// names, so that what holds for all methods holds for a new one. Any thread.

/// The name of the method as in a setup, "rbf"; that of an empty message, too.
std::string method_name(const v1::Method& message);

/// The features of the method in core. Throws Error(internal) for a field of Method that is no method of core.
MethodFeatures method_features(const v1::Method& message);

/// The energy of a method that has one, else null. It lives as long as the message.
const v1::Energy* energy_of(const v1::Method& message);

/// Whether the handle basis is stored: `basis` of the method, or of its energy.
v1::BasisMode basis_of(const v1::Method& message);

/// Whether control points are found by least squares for the points of handles, control MESH.
bool manipulates_directly(const v1::Method& message);

/// The kernel of core with the name of an enumerator of the contract; they differ in case only. std::nullopt for other names.
std::optional<Kernel> kernel_named_as(std::string name);

}  // namespace deform::convert
