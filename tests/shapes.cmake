cloudrenderer_test(shapes_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_LIST_DIR}/shapes_brick_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shapes_curve_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shapes_loopsubdiv_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shapes_mesh_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shapes_nurbs_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shapes_quadric_surface_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shapes_quadric_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shapes_triangle_test.cpp
  LINK cr_shapes)
