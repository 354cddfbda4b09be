cloudrenderer_test(film_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_LIST_DIR}/film_film_test.cpp ${CMAKE_CURRENT_LIST_DIR}/film_image_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/film_camera_test.cpp ${CMAKE_CURRENT_LIST_DIR}/film_realistic_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/film_filter_test.cpp ${CMAKE_CURRENT_LIST_DIR}/film_sample_plan_test.cpp
  LINK cr_film OpenImageIO::OpenImageIO)
