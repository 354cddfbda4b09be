list(APPEND STABILITY_SOURCES film_test.cpp)
