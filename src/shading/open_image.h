#pragma once
#include <OpenImageIO/imageio.h>

#include <memory>
#include <string>

namespace cloudrenderer {

// Opens a picture that a scene names; null with the reason in `why`. Takes pictures only: OpenImageIO also reads
// movies, among them play lists that name further files, and makes up pictures of any size from a name.
std::unique_ptr<OIIO::ImageInput> open_image_file(const std::string& path, const OIIO::ImageSpec* config, std::string& why);

}  // namespace cloudrenderer
