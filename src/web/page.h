#pragma once
#include <string_view>

namespace cloudrenderer {

extern const std::string_view kPage;  // page/index.html

}  // namespace cloudrenderer
