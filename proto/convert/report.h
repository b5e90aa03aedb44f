// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "core/deformers/system.h"
#include "core/quality/report.h"
#include "deform/v1/deformation.pb.h"
#include "proto/convert/findings.h"

namespace deform::convert {

/// Converts the constraint report of a design.
v1::ConstraintsReport constraints_report(const DesignReport& report, const Setup& setup);
/// A sentence if exact constraints were given up, else an empty string.
std::string given_up_warning(const DesignReport& report, const Setup& setup);

v1::EvaluationPath path_to_proto(EvaluationPath path);
EvaluationPath path_from_proto(v1::EvaluationPath path);

v1::QualityReport quality_to_proto(const QualityReport& report);

}  // namespace deform::convert
