// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "client/error_field.h"
#include "client/setup/cage_file.h"
#include "client/setup/control_points.h"
#include "client/setup/csv.h"
#include "client/setup/expression.h"
#include "client/setup/id_files.h"
#include "client/setup/numbers.h"
#include "client/setup/refuse.h"
#include "client/setup/setup_file.h"
#include "client/setup/yaml_message.h"

namespace deform::cli {

// The reader of setup files, which other programs use as well, by the names it has there.
using client::BadRows;
using client::Csv;
using client::evaluate_expression;
using client::field_of;
using client::IdFiles;
using client::looks_like_id;
using client::mesh_length;
using client::NamedValue;
using client::parse_csv;
using client::parse_number;
using client::parse_yaml;
using client::read_control_points;
using client::read_csv;
using client::read_method_file;
using client::read_setup_file;
using client::ReadBytes;
using client::ReadIds;
using client::refuse;
using client::SetupFile;
using client::ValueFiles;

}  // namespace deform::cli
