cloudrenderer_test(web_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/web_tiles_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/web_job_view_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/web_display_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/web_http_server_test.cpp
  LINK cr_web nlohmann_json::nlohmann_json)
