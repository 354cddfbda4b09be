cloudrenderer_test(parts_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_LIST_DIR}/parts_file_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/parts_manifest_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/parts_map_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/parts_motion_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/parts_partition_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/parts_scenes_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/parts_specular_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/parts_split_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/parts_text_test.cpp
  LINK cr_parts)
