#pragma once
#include <httplib.h>

#include <memory>
#include <string>

namespace cloudrenderer {

// For the window of a frame's manager, a child of ours: `url` is http[s]://127.0.0.1:PORT/..., `token` the cluster's or "".
std::unique_ptr<httplib::Client> manager_client(const std::string& url, const std::string& token);

}  // namespace cloudrenderer
