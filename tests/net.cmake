cloudrenderer_test(net_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/net_address_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/net_handshake_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/net_session_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/net_peer_link_test.cpp
  LINK cr_net)
