find_package(SQLite3 REQUIRED)
cloudrenderer_test(service_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/service_scheduler_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/service_store_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/service_files_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/service_api_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/service_elastic_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/service_elastic_input_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/service_fair_shares_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/service_tidy_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/service_window_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/service_pool_hosts_test.cpp
  LINK cr_service SQLite::SQLite3)
