# The scripts and programs of tools/.
add_test(NAME tools.check_layers COMMAND /usr/bin/python3 ${PROJECT_SOURCE_DIR}/tools/check_layers.py)
add_test(NAME tools.check_layers_finds
  COMMAND /usr/bin/python3 ${CMAKE_CURRENT_SOURCE_DIR}/layers/check_layers_test.py)
add_test(NAME tools.generate_scene
  COMMAND /usr/bin/python3 ${CMAKE_CURRENT_SOURCE_DIR}/tools_generate_scene_test.py $<TARGET_FILE:generate_scene>)
add_test(NAME tools.scale_hosts COMMAND /usr/bin/python3 ${CMAKE_CURRENT_SOURCE_DIR}/tools_scale_hosts_test.py)
set_tests_properties(tools.check_layers tools.check_layers_finds tools.generate_scene tools.scale_hosts
  PROPERTIES LABELS unit TIMEOUT 60)
if(TARGET cloudrenderer)
  add_test(NAME tools.linked_libraries
    COMMAND /usr/bin/python3 ${CMAKE_CURRENT_SOURCE_DIR}/layers/linked_libraries_test.py $<TARGET_FILE:cloudrenderer>)
  set_tests_properties(tools.linked_libraries PROPERTIES LABELS unit TIMEOUT 60)
endif()
# Instructions, by valgrind's callgrind; skipped aloud without it.
if(TARGET cloudrenderer)
  add_test(NAME tools.feature_cost
    COMMAND /usr/bin/python3 ${PROJECT_SOURCE_DIR}/tools/feature_cost.py --program $<TARGET_FILE:cloudrenderer> --check)
  set_tests_properties(tools.feature_cost PROPERTIES LABELS slow TIMEOUT 1200 SKIP_RETURN_CODE 77)
endif()
# Hosts with a share of a core each; skipped aloud where control groups are not permitted.
if(TARGET cloudrenderer)
  add_test(NAME tools.bench_survival
    COMMAND /usr/bin/python3 ${PROJECT_SOURCE_DIR}/tools/bench_survival.py --program $<TARGET_FILE:cloudrenderer>
            --runs 1 --spp 128 --check)
  set_tests_properties(tools.bench_survival
    PROPERTIES LABELS slow TIMEOUT 900 RUN_SERIAL ON SKIP_RETURN_CODE 77)
endif()
# The report of speed against error, and the converter that it stands on.
if(TARGET cloudrenderer)
  function(tool_test name file)
    add_test(NAME tools.${name}
      COMMAND /usr/bin/python3 ${CMAKE_CURRENT_SOURCE_DIR}/tools_${file}_test.py $<TARGET_FILE:cloudrenderer> ${ARGN})
    set_tests_properties(tools.${name} PROPERTIES LABELS image TIMEOUT 300 PROCESSORS 2 SKIP_RETURN_CODE 77)
  endfunction()
  tool_test(to_mitsuba to_mitsuba)
  tool_test(speed_error speed_error TimeAt Tool)
  tool_test(speed_cluster speed_error Hosts)
  tool_test(compare_builds compare_builds)
endif()
# The build for arm64 and what runs of it in qemu-user; skipped aloud where packages cannot be had. It takes hours.
if(NOT CMAKE_CROSSCOMPILING)
  add_test(NAME arm64 COMMAND ${PROJECT_SOURCE_DIR}/tools/arm64.sh)
  set_tests_properties(arm64 PROPERTIES LABELS slow TIMEOUT 14400 RUN_SERIAL ON SKIP_RETURN_CODE 77)
endif()
