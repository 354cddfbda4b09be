cloudrenderer_test(wire_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/wire_codec_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/wire_hostile_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/wire_conformance_test.cpp
  LINK cr_wire cr_film nlohmann_json::nlohmann_json)
