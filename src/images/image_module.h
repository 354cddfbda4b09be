#pragma once
// What the module offers to the program that has loaded it. Both are made by one build, so that C++'s types may pass.
#include "images/images.h"

namespace cloudrenderer {

struct ImageModule {
  decltype(open_image)* open = nullptr;
  decltype(encode_bytes)* encode = nullptr;
};
inline constexpr const char* kImageModuleSymbol = "cloudrenderer_image_module";

}  // namespace cloudrenderer
