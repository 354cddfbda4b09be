cloudrenderer_test(base_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/base_animated_transform_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/base_math_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/base_random_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/base_bulk_array_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/base_lanes_test.cpp
  LINK cr_base)
