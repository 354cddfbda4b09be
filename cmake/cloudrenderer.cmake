# One small library per folder. cloudrenderer_library(name SOURCES ... LINK ...) and cloudrenderer_test(name LABEL ...).
add_library(cloudrenderer_options INTERFACE)
target_include_directories(cloudrenderer_options INTERFACE ${PROJECT_SOURCE_DIR}/src ${PROJECT_SOURCE_DIR}/include)
# The same bits on every host: no contraction, no fast-math, one instruction set for the whole program.
target_compile_options(cloudrenderer_options INTERFACE
  -ffp-contract=off -fno-math-errno -fno-trapping-math
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion $<$<BOOL:${CLOUDRENDERER_WERROR}>:-Werror>)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  # GCC 12 warns of std::string's own code (bug 105651).
  target_compile_options(cloudrenderer_options INTERFACE -Wno-restrict)
endif()
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  target_compile_options(cloudrenderer_options INTERFACE -march=x86-64-v3)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 12)
    # GCC copies and clears records of a hundred bytes with `rep movs` and `rep stos`, which take longer to begin than a
    # few vector moves take altogether: half of the time of camera rays.
    target_compile_options(cloudrenderer_options INTERFACE -mstringop-strategy=vector_loop -mmove-max=256 -mstore-max=256)
  endif()
endif()
if(CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64")
  # A char is signed, as on x86. GCC's note that it once passed vectors in another way is of no use here.
  target_compile_options(cloudrenderer_options INTERFACE -fsigned-char -Wno-psabi)
endif()
if(CLOUDRENDERER_SANITIZE)
  target_compile_options(cloudrenderer_options INTERFACE -fsanitize=${CLOUDRENDERER_SANITIZE} -fno-omit-frame-pointer)
  target_link_options(cloudrenderer_options INTERFACE -fsanitize=${CLOUDRENDERER_SANITIZE})
endif()
if(CLOUDRENDERER_FUZZ)
  # What was reached is counted everywhere; the driver itself is linked to the targets in tests/fuzz.
  # Types of function pointers cannot be checked by clang 14 in coroutines ("difference across sections").
  target_compile_options(cloudrenderer_options INTERFACE -fsanitize=fuzzer-no-link -fno-sanitize-recover=all
    -fno-sanitize=function -g)
  target_compile_definitions(cloudrenderer_options INTERFACE _GLIBCXX_ASSERTIONS)
endif()

function(cloudrenderer_library name)
  cmake_parse_arguments(A "" "" "SOURCES;LINK" ${ARGN})
  add_library(${name} STATIC ${A_SOURCES})
  target_link_libraries(${name} PUBLIC cloudrenderer_options ${A_LINK})
endfunction()

# A test program: every file in SOURCES. One ctest for all of its cases, or SHARDS of them that may run side by side: to start
# a program takes longer than most cases. EACH: one ctest a case, for cases that take seconds.
function(cloudrenderer_test name)
  cmake_parse_arguments(A "EACH" "LABEL;SHARDS" "SOURCES;LINK" ${ARGN})
  add_executable(${name} ${A_SOURCES})
  target_link_libraries(${name} PRIVATE cloudrenderer_options ${A_LINK} GTest::gtest GTest::gtest_main)
  target_compile_definitions(${name} PRIVATE CLOUDRENDERER_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
    CLOUDRENDERER_SHARED_DIR="${PROJECT_SOURCE_DIR}/../shared")
  if(A_EACH)
    gtest_discover_tests(${name} DISCOVERY_TIMEOUT 60 PROPERTIES LABELS ${A_LABEL} TIMEOUT 120)
    return()
  endif()
  if(NOT A_SHARDS)
    set(A_SHARDS 1)
  endif()
  foreach(shard RANGE 1 ${A_SHARDS})
    math(EXPR index "${shard} - 1")
    set(test ${name}.${shard})
    if(A_SHARDS EQUAL 1)
      set(test ${name})
    endif()
    add_test(NAME ${test} COMMAND ${name})
    set_tests_properties(${test} PROPERTIES LABELS ${A_LABEL} TIMEOUT 600
      ENVIRONMENT "GTEST_TOTAL_SHARDS=${A_SHARDS};GTEST_SHARD_INDEX=${index}")
  endforeach()
endfunction()
