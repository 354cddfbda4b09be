cloudrenderer_test(cli_tests LABEL unit SHARDS 2
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/cli_parse_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/cli_parse_service_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/cli_report_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/cli_language_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/cli_v4_names_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/cli_v4_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/cli_needs_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/cli_broken_scenes_test.cpp
  LINK cr_cli ZLIB::ZLIB)
