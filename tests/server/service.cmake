# SPDX-License-Identifier: GPL-3.0-or-later
# The transport side: the real service in front of an engine that the tests play.
deform_test(service_test
  SOURCES access_test.cpp
          admin_test.cpp
          health_service_test.cpp
          held_requests_test.cpp
          identities_test.cpp
          listener_test.cpp
          log_test.cpp
          metrics_test.cpp
          options_test.cpp
          server_test.cpp
          service_deform_stream_test.cpp
          service_engine_test.cpp
          service_large_setups_test.cpp
          service_messages_test.cpp
          service_requests_test.cpp
          service_streams_test.cpp
          service_unary_test.cpp
          service_uploads_test.cpp
          status_test.cpp
  LIBS deform_test_server deform_proto_health
  TIMEOUT 120)
target_compile_definitions(service_test PRIVATE DEFORM_WITH_POSTGRES=$<BOOL:${DEFORM_WITH_POSTGRES}>)
deform_precompile(service_test <gmock/gmock-matchers.h> <gtest/gtest.h> <tests/server/service_fixture.h>)

deform_test(evaluate_test
  SOURCES evaluate_test.cpp
  LIBS deform_test_server
  TIMEOUT 120)

deform_test(deformd_test
  SOURCES deformd_test.cpp
  LIBS deform_test_server
  TIMEOUT 120)
target_compile_definitions(deformd_test PRIVATE DEFORMD_BINARY="$<TARGET_FILE:deformd>")
add_dependencies(deformd_test deformd)
