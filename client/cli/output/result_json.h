// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <google/protobuf/message.h>

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "deform/v1/service.pb.h"

namespace deform::cli {

/// What --json prints of the server's messages. Keys are the names of the proto fields; numbers are numbers.
nlohmann::ordered_json to_json(const v1::GeometryInfo& info);
nlohmann::ordered_json to_json(const v1::SystemInfo& info);
nlohmann::ordered_json to_json(const v1::EstimateReply& estimate);
nlohmann::ordered_json to_json(const v1::ServerInfo& info);
/// Any message whose fields are plain.
nlohmann::ordered_json to_json(const google::protobuf::Message& message);
nlohmann::ordered_json to_json(const v1::CellReport& report);
nlohmann::ordered_json to_json(const v1::QualityReport& report);
nlohmann::ordered_json to_json(const v1::SplitReport& report);
nlohmann::ordered_json to_json(const v1::ConstraintsReport& report);

/// Pretty, on stdout.
void print(const nlohmann::ordered_json& json);

/// A setup as JSON text, which is also YAML: with the names of the proto fields, so that a setup file may contain it.
std::string setup_text(const v1::Setup& setup);

}  // namespace deform::cli
