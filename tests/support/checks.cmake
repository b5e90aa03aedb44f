# SPDX-License-Identifier: GPL-3.0-or-later
# Checks of the sources themselves, as tests. Once is enough: not in the sanitizer builds.
if(NOT DEFORM_SANITIZE)
  set(checks ${CMAKE_CURRENT_LIST_DIR})
  add_test(NAME sources.floors COMMAND ${DEFORM_PYTHON} ${checks}/check_floors.py ${PROJECT_SOURCE_DIR})
  add_test(NAME sources.floors_are_checked COMMAND ${DEFORM_PYTHON} ${checks}/check_floors_test.py)
  add_test(NAME sources.house_rules_are_checked COMMAND ${DEFORM_PYTHON} ${checks}/check_sources_test.py)
  add_test(NAME sources.house_rules COMMAND ${DEFORM_PYTHON} ${checks}/check_sources.py ${PROJECT_SOURCE_DIR})
  add_test(NAME sources.licences COMMAND ${DEFORM_PYTHON} ${checks}/check_licences.py ${PROJECT_SOURCE_DIR})
  add_test(NAME sources.licences_are_checked COMMAND ${DEFORM_PYTHON} ${checks}/check_licences_test.py)
  add_test(NAME sources.references_are_checked COMMAND ${DEFORM_PYTHON} ${checks}/check_references_test.py)
  add_test(NAME sources.references COMMAND ${DEFORM_PYTHON} ${checks}/check_references.py ${PROJECT_SOURCE_DIR})
  add_test(NAME sources.format COMMAND ${checks}/check_format.sh)
  if(DEFORM_BUILD_NETWORK)
    add_test(NAME sources.documents COMMAND ${DEFORM_PYTHON} ${checks}/check_docs.py ${PROJECT_SOURCE_DIR} $<TARGET_FILE:deform>
                                            $<TARGET_FILE:deformd>)
  endif()
  add_test(NAME sources.compiler_cache COMMAND ${DEFORM_PYTHON} ${checks}/ccache_launcher_test.py)
  add_test(NAME sources.documents_are_checked COMMAND ${DEFORM_PYTHON} ${checks}/check_docs_test.py)
  add_test(NAME sources.mutants COMMAND ${DEFORM_PYTHON} ${PROJECT_SOURCE_DIR}/tests/mutation/mutate_test.py)
  set_tests_properties(sources.floors_are_checked sources.house_rules_are_checked sources.references_are_checked
                       sources.licences sources.licences_are_checked
                       sources.documents_are_checked sources.mutants PROPERTIES ENVIRONMENT PYTHONDONTWRITEBYTECODE=1)
endif()
