cloudrenderer_test(scene_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/scene_number_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/scene_files_test.cpp
  LINK cr_scene)
