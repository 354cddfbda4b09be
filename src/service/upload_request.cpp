#include "service/upload_request.h"

#include <charconv>

#include "web/http_server.h"

namespace cloudrenderer {
namespace {

constexpr std::uint64_t kLargest = std::uint64_t{1} << 40;

std::optional<std::uint64_t> take_number(std::string_view& text, std::string_view end) {
  std::uint64_t value = 0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || value > kLargest) return std::nullopt;
  text.remove_prefix(static_cast<std::size_t>(stop - text.data()));
  if (!text.starts_with(end) || (end.empty() && !text.empty())) return std::nullopt;
  text.remove_prefix(end.size());
  return value;
}

void check_name(const std::string& sha256) {
  if (!is_sha256(sha256)) throw ApiError(404, "a file is named by its SHA-256, 64 small hexadecimal digits");
}

}  // namespace

std::optional<ByteRange> parse_content_range(const std::string& given) {
  std::string_view text = given;
  const std::string_view unit = "bytes ";
  if (!text.starts_with(unit)) return std::nullopt;
  text.remove_prefix(unit.size());
  const auto first = take_number(text, "-");
  if (!first) return std::nullopt;
  const auto last = take_number(text, "/");
  if (!last) return std::nullopt;
  const auto total = take_number(text, "");
  if (!total || *last < *first || *last >= *total) return std::nullopt;
  return ByteRange{*first, *last - *first + 1, *total};
}

void send_blob_state(Service& service, const Caller& caller, const std::string& sha256, httplib::Response& response) {
  check_name(sha256);
  const Json state = service.blob(caller, sha256);
  response.set_header("Upload-Offset", std::to_string(state.at("offset").get<std::uint64_t>()));
  response.set_header("Upload-Complete", state.at("complete").get<bool>() ? "?1" : "?0");
  answer_json(response, state);
}

void take_blob(Service& service, const Caller& caller, const std::string& sha256, const httplib::Request& request,
               httplib::Response& response, const httplib::ContentReader* content) {
  check_name(sha256);
  ByteRange range;
  if (request.has_header("Content-Range")) {
    const auto given = parse_content_range(request.get_header_value("Content-Range"));
    if (!given) throw ApiError(400, "Content-Range must be 'bytes FIRST-LAST/TOTAL', of at most 1 TiB");
    range = *given;
  } else if (content) {
    std::string text = request.get_header_value("Content-Length");
    std::string_view rest = text;
    const auto length = take_number(rest, "");
    if (!length) throw ApiError(411, "a Content-Length of at most 1 TiB, or a Content-Range, is needed");
    range = {0, *length, *length};
  }
  if (service.blob(caller, sha256).at("complete")) {
    response.status = 200;
    return send_blob_state(service, caller, sha256, response);
  }
  service.check_upload(caller, range.total);
  bool whole = false;
  {
    const auto upload = service.blobs().upload(caller.name, sha256, range.first, range.total);
    std::exception_ptr failed;
    std::uint64_t left = range.length;
    const auto take = [&](const char* data, std::size_t n) {
      if (failed) return true;  // drained
      try {
        if (n > left) throw ApiError(400, "more has come than Content-Range says");
        left -= n;
        upload->add({data, n});
      } catch (...) {
        failed = std::current_exception();
      }
      return true;
    };
    const bool came = !content || (*content)(take);
    if (failed) std::rethrow_exception(failed);
    if (!came || left != 0) throw ApiError(400, "less has come than was announced", {{"offset", upload->offset()}});
    whole = upload->finish();
  }
  if (whole) service.blob_came(caller, sha256, range.total);
  send_blob_state(service, caller, sha256, response);
  response.status = whole ? 201 : 202;
}

}  // namespace cloudrenderer
