cloudrenderer_test(trace_tests LABEL unit SHARDS 2
  SOURCES ${CMAKE_CURRENT_LIST_DIR}/trace_curves_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/trace_memory_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/trace_motion_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/trace_part_cache_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/trace_resident_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/trace_triangle_hit_test.cpp
  LINK cr_trace)
