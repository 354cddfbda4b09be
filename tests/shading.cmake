cloudrenderer_test(shading_tests LABEL unit SHARDS 4
  SOURCES ${CMAKE_CURRENT_LIST_DIR}/shading_bsdf_random_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_bsdf_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_eight_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_fourier_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_hair_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_layered_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_light_choice_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_light_distribution_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_light_map_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_light_picture_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_light_rays_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_lights_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_material_params_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_material_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_measured_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_media_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_noise_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_rgl_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_rgl_file_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_subsurface_test.cpp
          ${CMAKE_CURRENT_LIST_DIR}/shading_texture_test.cpp
  LINK cr_shading OpenImageIO::OpenImageIO)
