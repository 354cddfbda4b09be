#pragma once
// Jobs as JSON: what users send, what they are shown, and what the store keeps.
#include <nlohmann/json.hpp>

#include "service/job.h"

namespace cloudrenderer {

using Json = nlohmann::ordered_json;

// A request that cannot be taken: the HTTP status, and why.
class ApiError : public std::runtime_error {
 public:
  ApiError(int http_status, const std::string& why, Json more_keys = Json::object())
      : std::runtime_error(why), status(http_status), more(std::move(more_keys)) {}
  int status;
  Json more;  // keys beside "error"
};

// Text of strangers: objects and arrays nested at most 16 deep. Throws ApiError 400.
Json parse_json(const std::string& text);
std::string dump(const Json& json);  // text that is not UTF-8 becomes it

// What POST /v1/jobs takes; unknown keys, wrong types and numbers out of range are refused. Throws ApiError 422.
JobRequest read_request(const Json& body, const std::string& user);

Json to_json(const RenderSettings& settings);
Json to_json(const JobRequest& request);  // what read_request takes
Json to_json(const Usage& usage);
Usage usage_from_json(const Json& json);
Json to_json(const Job& job);
Job job_from_json(const Json& json);  // what to_json gave
FrameNeeds needs_from_json(const Json& json);  // as `split --report` writes them, and to_json a frame's

// Fields of an object by their names, each wanted with a type and range; finish() refuses what nobody asked for.
class Fields {
 public:
  Fields(const Json& object, std::string where);
  std::optional<std::string> text(const char* key, std::size_t longest);
  std::optional<std::uint64_t> whole(const char* key, std::uint64_t least, std::uint64_t most);
  std::optional<std::int64_t> integer(const char* key, std::int64_t least, std::int64_t most);
  std::optional<double> number(const char* key, double least, double most);
  std::optional<bool> boolean(const char* key);
  const Json* any(const char* key);  // null: it is not there, or null
  void finish() const;

 private:
  [[noreturn]] void refuse(const std::string& key, const std::string& expected) const;
  const Json& object_;
  const std::string where_;
  std::vector<std::string> seen_;
};

}  // namespace cloudrenderer
