# SPDX-License-Identifier: Apache-2.0
# Writes commit.cpp, only when the commit is another than before:
#   cmake -D SOURCE=ROOT -D OUTPUT=FILE [-D DEFORM_COMMIT=NAME] -P commit.cmake
if(NOT DEFORM_COMMIT AND EXISTS ${SOURCE}/.git)
  execute_process(
    COMMAND git -C ${SOURCE} --no-optional-locks describe --always --dirty --abbrev=12 --exclude=*
    OUTPUT_VARIABLE DEFORM_COMMIT OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
endif()
if(NOT DEFORM_COMMIT)
  set(DEFORM_COMMIT unknown)
endif()
configure_file(${CMAKE_CURRENT_LIST_DIR}/commit.cpp.in ${OUTPUT} @ONLY)
