#pragma once
#include <optional>
#include <string>

#include "wire/messages.h"

namespace cloudrenderer {

// Why nobody takes a host that says this of itself, whatever there is to do; nothing: it may be taken.
std::optional<std::string> unbelievable(const wire::Hello& hello);

}  // namespace cloudrenderer
