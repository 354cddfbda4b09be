#include "service/job_json.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

namespace cloudrenderer {
namespace {

constexpr int kDeepest = 16;
constexpr std::size_t kMostFrames = 10000;
constexpr std::uint32_t kLargestSide = 65536, kMost32 = 0xffffffffu;

template <class T>
Json or_null(const std::optional<T>& value) {
  return value ? Json(*value) : Json(nullptr);
}

template <class T>
std::optional<T> optional_of(const Json& json, const char* key) {
  const auto found = json.find(key);
  if (found == json.end() || found->is_null()) return std::nullopt;
  return found->get<T>();
}

std::uint32_t to32(std::uint64_t value) { return static_cast<std::uint32_t>(value); }

RenderSettings read_settings(const Json& json) {
  Fields f(json, "options");
  RenderSettings s;
  if (const auto v = f.whole("spp", 1, 1 << 24)) s.spp = to32(*v);
  if (const auto v = f.whole("max_depth", 0, 1 << 16)) s.max_depth = to32(*v);
  if (const auto v = f.whole("seed", 0, kMost32)) s.seed = to32(*v);
  if (const Json* wh = f.any("resolution")) {
    const auto side = [](const Json& n) { return n.is_number_unsigned() && n.get<std::uint64_t>() >= 1 && n.get<std::uint64_t>() <= kLargestSide; };
    if (!wh->is_array() || wh->size() != 2 || !side((*wh)[0]) || !side((*wh)[1]))
      throw ApiError(422, "options.resolution must be [width, height], each 1 to 65536");
    s.width = to32((*wh)[0].get<std::uint64_t>());
    s.height = to32((*wh)[1].get<std::uint64_t>());
  }
  if (const Json* crop = f.any("crop")) {
    const auto within = [](const Json& n) { return n.is_number() && n.get<double>() >= 0 && n.get<double>() <= 1; };
    if (!crop->is_array() || crop->size() != 4 || !std::ranges::all_of(*crop, within) || !((*crop)[0] < (*crop)[1]) || !((*crop)[2] < (*crop)[3]))
      throw ApiError(422, "options.crop must be [x0, x1, y0, y1] in 0 to 1 with x0 < x1 and y0 < y1");
    s.crop = {(*crop)[0].get<double>(), (*crop)[1].get<double>(), (*crop)[2].get<double>(), (*crop)[3].get<double>()};
  }
  s.max_error = f.number("max_error", 0, 1e9);
  s.integrator = f.text("integrator", 64).value_or("");
  if (s.integrator.starts_with('-')) throw ApiError(422, "options.integrator must be pbrt's name of an integrator");
  s.dialect = f.text("dialect", 2).value_or("");
  if (!s.dialect.empty() && s.dialect != "v2" && s.dialect != "v3" && s.dialect != "v4")
    throw ApiError(422, "options.dialect must be v2, v3 or v4");
  s.light_paths = f.text("light_paths", 8).value_or("");
  if (!s.light_paths.empty() && s.light_paths != "off" && s.light_paths != "caustics" && s.light_paths != "all")
    throw ApiError(422, "options.light_paths must be off, caustics or all");
  s.part_size = f.whole("part_size", 1 << 16, std::uint64_t{1} << 40).value_or(0);
  f.finish();
  return s;
}

JobState job_state(const std::string& text) {
  for (int i = 0; i <= static_cast<int>(JobState::cancelled); ++i)
    if (text == name(static_cast<JobState>(i))) return static_cast<JobState>(i);
  throw std::runtime_error("the store has a job in the state " + text);
}

FrameState frame_state(const std::string& text) {
  for (int i = 0; i <= static_cast<int>(FrameState::cancelled); ++i)
    if (text == name(static_cast<FrameState>(i))) return static_cast<FrameState>(i);
  throw std::runtime_error("the store has a frame in the state " + text);
}

Json frame_json(const JobFrame& f, std::size_t index) {
  Json needs = nullptr;
  if (f.needs)
    needs = {{"main_bytes", f.needs->main_bytes}, {"largest_bytes", f.needs->largest_bytes}, {"bytes", f.needs->bytes},
             {"parts", f.needs->parts}, {"triangles", f.needs->triangles}, {"pixels", f.needs->pixels}, {"spp", f.needs->spp}};
  return {{"frame", index},
          {"file", f.file},
          {"state", name(f.state)},
          {"reason", f.reason},
          {"attempts", f.attempts},
          {"started_at", or_null(f.started)},
          {"ended_at", or_null(f.ended)},
          {"needs", std::move(needs)},
          {"usage", to_json(f.usage)}};
}

JobFrame frame_from(const Json& json) {
  JobFrame f;
  f.file = json.at("file");
  f.state = frame_state(json.at("state"));
  f.reason = json.at("reason");
  f.attempts = json.at("attempts");
  f.started = optional_of<double>(json, "started_at");
  f.ended = optional_of<double>(json, "ended_at");
  if (const Json& n = json.at("needs"); !n.is_null()) f.needs = needs_from_json(n);
  f.usage = usage_from_json(json.at("usage"));
  return f;
}

}  // namespace

Json parse_json(const std::string& text) {
  const auto check = [](int depth, nlohmann::detail::parse_event_t, Json&) {
    if (depth > kDeepest) throw ApiError(400, fmt::format("the JSON is nested deeper than {}", kDeepest));
    return true;
  };
  try {
    return Json::parse(text, check);
  } catch (const Json::exception& e) {
    throw ApiError(400, "the body must be JSON: " + std::string(e.what()));
  }
}

std::string dump(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

Fields::Fields(const Json& object, std::string where) : object_(object), where_(std::move(where)) {
  if (!object.is_object()) throw ApiError(422, (where_.empty() ? "the body" : where_) + " must be an object");
}

void Fields::refuse(const std::string& key, const std::string& expected) const {
  throw ApiError(422, (where_.empty() ? "" : where_ + ".") + key + " must be " + expected);
}

const Json* Fields::any(const char* key) {
  seen_.emplace_back(key);
  const auto found = object_.find(key);
  return found == object_.end() || found->is_null() ? nullptr : &*found;
}

std::optional<std::string> Fields::text(const char* key, std::size_t longest) {
  const Json* json = any(key);
  if (!json) return std::nullopt;
  const std::string expected = fmt::format("text of at most {} bytes without control characters", longest);
  if (!json->is_string()) refuse(key, expected);
  const std::string& value = json->get_ref<const std::string&>();
  const bool control = std::ranges::any_of(value, [](char c) { return static_cast<unsigned char>(c) < 32 || c == 127; });
  if (value.size() > longest || control) refuse(key, expected);
  return value;
}

std::optional<std::uint64_t> Fields::whole(const char* key, std::uint64_t least, std::uint64_t most) {
  const Json* json = any(key);
  if (!json) return std::nullopt;
  if (!json->is_number_unsigned() || json->get<std::uint64_t>() < least || json->get<std::uint64_t>() > most)
    refuse(key, fmt::format("a whole number of {} to {}", least, most));
  return json->get<std::uint64_t>();
}

std::optional<std::int64_t> Fields::integer(const char* key, std::int64_t least, std::int64_t most) {
  const Json* json = any(key);
  if (!json) return std::nullopt;
  const bool fits = json->is_number_integer() && (!json->is_number_unsigned() || json->get<std::uint64_t>() <= std::uint64_t{INT64_MAX});
  if (!fits || json->get<std::int64_t>() < least || json->get<std::int64_t>() > most)
    refuse(key, fmt::format("a whole number of {} to {}", least, most));
  return json->get<std::int64_t>();
}

std::optional<double> Fields::number(const char* key, double least, double most) {
  const Json* json = any(key);
  if (!json) return std::nullopt;
  if (!json->is_number() || !(json->get<double>() >= least) || !(json->get<double>() <= most))
    refuse(key, fmt::format("a number of {:g} to {:g}", least, most));
  return json->get<double>();
}

std::optional<bool> Fields::boolean(const char* key) {
  const Json* json = any(key);
  if (!json) return std::nullopt;
  if (!json->is_boolean()) refuse(key, "true or false");
  return json->get<bool>();
}

void Fields::finish() const {
  for (const auto& [key, value] : object_.items())
    if (std::ranges::find(seen_, key) == seen_.end())
      throw ApiError(422, fmt::format("{} has no '{}'; known are {}", where_.empty() ? "the body" : where_, key.substr(0, 100), fmt::join(seen_, ", ")));
}

JobRequest read_request(const Json& body, const std::string& user) {
  Fields f(body, "");
  JobRequest r;
  r.user = user;
  const auto scene = f.text("scene", 64);
  if (!scene) throw ApiError(422, "scene is missing: the id of a scene");
  r.scene = *scene;
  const Json* files = f.any("files");
  if (!files || !files->is_array() || files->empty() || files->size() > kMostFrames)
    throw ApiError(422, fmt::format("files must be a list of 1 to {} files of the scene", kMostFrames));
  for (const Json& file : *files) {
    if (!file.is_string()) throw ApiError(422, "files must be a list of names");
    r.files.push_back(file);
  }
  r.name = f.text("name", 200).value_or("");
  r.priority = static_cast<int>(f.integer("priority", -10, 10).value_or(0));
  r.retries = to32(f.whole("retries", 0, 100).value_or(2));
  r.timeout_s = f.number("timeout_s", 0.1, 1e9);
  r.budget = f.number("budget", 0, 1e15);
  const auto beyond = f.text("on_budget", 8);
  if (beyond && *beyond != "stop" && *beyond != "ask") throw ApiError(422, "on_budget must be stop or ask");
  r.ask = beyond == "ask";
  if (const auto text = f.text("deadline", 64)) {
    r.deadline = parse_deadline(*text);
    if (!r.deadline) throw ApiError(422, "deadline must be a time from now like 90s, 45m, 2h or 1d, or an ISO 8601 time like 2026-03-01T18:00:00Z");
  }
  if (const Json* options = f.any("options")) r.settings = read_settings(*options);
  f.finish();
  return r;
}

Json to_json(const RenderSettings& s) {
  Json out = Json::object();
  const auto put = [&](const char* key, const auto& value) {
    if (value) out[key] = *value;
  };
  put("spp", s.spp);
  put("max_depth", s.max_depth);
  put("seed", s.seed);
  if (s.width && s.height) out["resolution"] = {*s.width, *s.height};
  put("crop", s.crop);
  put("max_error", s.max_error);
  if (!s.integrator.empty()) out["integrator"] = s.integrator;
  if (!s.dialect.empty()) out["dialect"] = s.dialect;
  if (!s.light_paths.empty()) out["light_paths"] = s.light_paths;
  if (s.part_size != 0) out["part_size"] = s.part_size;
  return out;
}

Json to_json(const JobRequest& r) {
  return {{"name", r.name},
          {"scene", r.scene},
          {"files", r.files},
          {"priority", r.priority},
          {"retries", r.retries},
          {"timeout_s", or_null(r.timeout_s)},
          {"budget", or_null(r.budget)},
          {"on_budget", r.ask ? "ask" : "stop"},
          {"deadline", r.deadline ? Json(r.deadline->text) : Json(nullptr)},
          {"options", to_json(r.settings)}};
}

Json to_json(const Usage& u) {
  return {{"cpu_s", u.cpu_s}, {"memory_byte_s", u.memory_byte_s}, {"bytes", u.bytes}, {"rays", u.rays}, {"host_s", u.host_s}, {"cost", u.cost},
          {"service_cpu_s", u.service_cpu_s}};
}

Usage usage_from_json(const Json& json) {
  return {json.at("cpu_s"), json.at("memory_byte_s"), json.at("bytes"), json.at("rays"), json.at("host_s"), json.at("cost"),
          json.value("service_cpu_s", 0.0)};  // stores of earlier programs have none
}

Json to_json(const Job& job) {
  const JobRequest& r = job.request;
  Json frames = Json::array();
  for (std::size_t i = 0; i < job.frames.size(); ++i) frames.push_back(frame_json(job.frames[i], i));
  return {{"id", job.id},
          {"name", r.name},
          {"user", r.user},
          {"state", name(job.state)},
          {"reason", job.reason},
          {"over_budget", job.over_budget},
          {"scene", r.scene},
          {"priority", r.priority},
          {"retries", r.retries},
          {"timeout_s", or_null(r.timeout_s)},
          {"budget", or_null(r.budget)},
          {"on_budget", r.ask ? "ask" : "stop"},
          {"options", to_json(r.settings)},
          {"submitted_at", job.submitted},
          {"deadline_at", or_null(job.deadline)},
          {"started_at", or_null(job.started)},
          {"ended_at", or_null(job.ended)},
          {"usage", to_json(job.usage())},
          {"frames", std::move(frames)}};
}

// Splits of older services do not say how large the picture is.
FrameNeeds needs_from_json(const Json& n) {
  return {n.at("main_bytes"), n.at("largest_bytes"), n.at("bytes"), n.at("parts"), n.at("triangles"), n.value("pixels", std::uint64_t{0}),
          n.value("spp", std::uint32_t{0})};
}

Job job_from_json(const Json& json) {
  Job job;
  job.id = json.at("id");
  job.state = job_state(json.at("state"));
  job.reason = json.at("reason");
  job.over_budget = json.at("over_budget");
  job.submitted = json.at("submitted_at");
  job.deadline = optional_of<double>(json, "deadline_at");  // a job of an older service has none
  job.started = optional_of<double>(json, "started_at");
  job.ended = optional_of<double>(json, "ended_at");
  JobRequest& r = job.request;
  r.name = json.at("name");
  r.user = json.at("user");
  r.scene = json.at("scene");
  r.priority = json.at("priority");
  r.retries = json.at("retries");
  r.timeout_s = optional_of<double>(json, "timeout_s");
  r.budget = optional_of<double>(json, "budget");
  r.ask = json.at("on_budget") == "ask";
  r.settings = read_settings(json.at("options"));
  for (const Json& f : json.at("frames")) {
    job.frames.push_back(frame_from(f));
    r.files.push_back(job.frames.back().file);
  }
  return job;
}

}  // namespace cloudrenderer
