cloudrenderer_test(net_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/net_address_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/net_handshake_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/net_session_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/net_peer_link_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/net_tls_test.cpp
  LINK cr_net)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  # GCC 12 warns of the standard library's own inlined copy of a byte array (bug 105329).
  target_compile_options(net_tests PRIVATE -Wno-array-bounds -Wno-stringop-overflow)
endif()
