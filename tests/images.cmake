cloudrenderer_test(images_tests LABEL unit SOURCES ${CMAKE_CURRENT_LIST_DIR}/images_test.cpp LINK cr_images)
