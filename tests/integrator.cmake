cloudrenderer_test(integrator_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_LIST_DIR}/integrator_light_paths_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/integrator_media_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/integrator_shade_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/integrator_subsurface_test.cpp
  LINK cr_integrator)
