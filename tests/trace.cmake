cloudrenderer_test(trace_tests LABEL unit SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/trace_resident_test.cpp LINK cr_trace)
