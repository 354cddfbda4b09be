cloudrenderer_test(cli_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/cli_parse_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/cli_report_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/cli_language_test.cpp
  LINK cr_cli)
