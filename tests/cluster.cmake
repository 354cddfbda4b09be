cloudrenderer_test(cluster_tests LABEL unit
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/cluster_checkpoint_file_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/cluster_pool_test.cpp
  LINK cr_cluster)
