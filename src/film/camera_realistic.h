#pragma once
#include <memory>

#include "film/camera.h"

namespace cloudrenderer {

// pbrt-v3's camera with a lens from a file; film_diagonal in millimetres. Reads the parameters of its own. Throws
// SceneError.
std::unique_ptr<Camera> realistic_camera(const CameraDesc& desc, const Transform& camera_to_world, const FilmFrame& frame,
                                         float film_diagonal, Warnings& warnings);

}  // namespace cloudrenderer
