# The transport side: the real service in front of an engine that the tests play.
deform_test(service_test
  SOURCES service_deform_stream_test.cpp
          service_streams_test.cpp
          service_unary_test.cpp
  LIBS deform_test_server
  TIMEOUT 120)
