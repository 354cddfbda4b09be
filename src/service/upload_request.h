#pragma once
// Uploads over HTTP: PUT with a Content-Range (RFC 9110, section 14.4) goes on where an earlier one has ended.
#include <httplib.h>

#include <optional>
#include <string>

#include "service/service.h"

namespace cloudrenderer {

struct ByteRange {
  std::uint64_t first = 0, length = 0, total = 0;
};
// "bytes 0-99/200"; none: it is no such range.
std::optional<ByteRange> parse_content_range(const std::string& text);

void send_blob_state(Service& service, const Caller& caller, const std::string& sha256, httplib::Response& response);
// `content` null: no body. Throws ApiError.
void take_blob(Service& service, const Caller& caller, const std::string& sha256, const httplib::Request& request,
               httplib::Response& response, const httplib::ContentReader* content);

}  // namespace cloudrenderer
