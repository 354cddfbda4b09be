#pragma once
#include <string_view>

namespace cloudrenderer {

// The folder page/ as one file each: the window of a render, and that of a service's jobs.
extern const std::string_view kPage, kServicePage;

}  // namespace cloudrenderer
