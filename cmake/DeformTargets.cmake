# Flags of our own targets; dependencies keep theirs.
add_library(deform_flags INTERFACE)
target_include_directories(deform_flags INTERFACE ${PROJECT_SOURCE_DIR})
# No -march=native: hot loops dispatch at run time. Contraction off: the same source gives the same bits on every target and inlining.
target_compile_options(deform_flags INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -ffp-contract=off)
target_link_libraries(deform_flags INTERFACE Threads::Threads)
if(DEFORM_SANITIZE)
  target_compile_options(deform_flags INTERFACE -fsanitize=${DEFORM_SANITIZE} -fno-omit-frame-pointer
                                                -fno-sanitize-recover=undefined)
  target_link_options(deform_flags INTERFACE -fsanitize=${DEFORM_SANITIZE})
  target_compile_definitions(deform_flags INTERFACE DEFORM_SANITIZED=1)
endif()

# deform_library(NAME SOURCES ... PUBLIC libs ... PRIVATE libs ...): one static library per folder.
function(deform_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  add_library(${name} STATIC ${ARG_SOURCES})
  target_link_libraries(${name} PUBLIC deform_flags ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE})
endfunction()

# deform_test(NAME SOURCES ... LIBS ... [LABELS ...]): one GoogleTest binary whose cases are ctest cases.
function(deform_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT" "SOURCES;LIBS;LABELS" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE deform_flags ${ARG_LIBS} GTest::gtest GTest::gmock GTest::gtest_main)
  gtest_discover_tests(${name} TEST_PREFIX "${name}." DISCOVERY_TIMEOUT 120 PROPERTIES TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}")
endfunction()
