cloudrenderer_test(tasks_tests LABEL unit SHARDS 2
  SOURCES ${CMAKE_CURRENT_SOURCE_DIR}/tasks_task_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_link_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/tasks_routing_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_placement_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/tasks_ledger_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_worker_core_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/tasks_manager_core_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_manager_final_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_manager_resume_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/tasks_visits_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_cluster_map_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/tasks_manager_copies_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_manager_light_paths_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_manager_lobes_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_worker_cancel_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/tasks_overhead_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_paging_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/tasks_checkpoint_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_share_trial_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/tasks_progress_record_test.cpp ${CMAKE_CURRENT_SOURCE_DIR}/tasks_kinds_of_hosts_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/tasks_manager_drop_test.cpp
          ${CMAKE_CURRENT_SOURCE_DIR}/tasks_manager_teams_test.cpp
  LINK cr_simulate)
