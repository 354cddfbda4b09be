// What the service answers to those who ask.
#include <spdlog/fmt/fmt.h>

#include <chrono>
#include <filesystem>
#include <fstream>

#include "service/service.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

double unix_time() { return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count(); }

std::string existing(const std::string& path, const std::string& what) {
  std::error_code none;
  if (!fs::is_regular_file(path, none)) throw ApiError(404, "there is no " + what + " yet");
  return path;
}

}  // namespace

const Job& Service::job_of(const Caller& caller, std::uint64_t id) const {
  const Job* job = scheduler_.find(id);
  if (!job || (job->request.user != caller.name && !caller.admin)) throw ApiError(404, fmt::format("you have no job {}", id));
  return *job;
}

Json Service::blob(const Caller& caller, const std::string& hash) {
  const std::lock_guard lock(mutex_);
  const auto bytes = store_.blob(caller.name, hash);
  return {{"sha256", hash}, {"complete", bytes.has_value()}, {"offset", bytes ? *bytes : blobs_.offset(caller.name, hash)}};
}

void Service::check_upload(const Caller& caller, std::uint64_t total) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t there = store_.bytes_of(caller.name);
  if (total > config_.user_bytes || there > config_.user_bytes - total)
    throw ApiError(413, fmt::format("you have uploaded {} bytes, and may have {}", there, config_.user_bytes));
}

void Service::blob_came(const Caller& caller, const std::string& hash, std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  store_.add_blob(caller.name, hash, bytes);
}

Json Service::add_scene(const Caller& caller, const Json& body) {
  const SceneManifest manifest = read_manifest(body);
  const std::string text = dump(to_json(manifest));
  const std::string id = sha256(caller.name + "\n" + text).substr(0, 32);
  const std::lock_guard lock(mutex_);
  SceneRecord record{id, caller.name, text, 0};
  Json missing = Json::array();
  std::set<std::string> asked;
  for (const auto& [path, file] : manifest) {
    record.bytes += file.bytes;
    const auto bytes = store_.blob(caller.name, file.sha256);
    if (!bytes && asked.insert(file.sha256).second) missing.push_back(file.sha256);
    if (bytes && *bytes != file.bytes)
      throw ApiError(422, fmt::format("'{}' is said to have {} bytes; the file with this SHA-256 has {}", path, file.bytes, *bytes));
  }
  if (!missing.empty())
    throw ApiError(409, fmt::format("{} files have not been uploaded", missing.size()), {{"missing", std::move(missing)}});
  const std::string folder = config_.folder + "/scenes/" + id;
  if (!fs::exists(folder)) blobs_.materialise(manifest, folder);
  store_.add_scene(record, unix_time());
  return {{"id", id}, {"bytes", record.bytes}, {"files", manifest.size()}};
}

Json Service::scene(const Caller& caller, const std::string& id) {
  const std::lock_guard lock(mutex_);
  const auto record = store_.scene(caller.name, id);
  if (!record) throw ApiError(404, "you have no such scene");
  const Json manifest = Json::parse(record->manifest);
  return {{"id", id}, {"bytes", record->bytes}, {"files", manifest.at("files")}};
}

Json Service::scenes(const Caller& caller) {
  const std::lock_guard lock(mutex_);
  Json out = Json::array();
  for (const SceneRecord& s : store_.scenes(caller.name)) {
    const Json manifest = Json::parse(s.manifest);
    out.push_back({{"id", s.id}, {"bytes", s.bytes}, {"files", manifest.at("files").size()}});
  }
  return out;
}

Json Service::submit(const Caller& caller, const Json& body) {
  JobRequest request = read_request(body, caller.name);
  const std::lock_guard lock(mutex_);
  const auto scene = store_.scene(caller.name, request.scene);
  if (!scene) throw ApiError(422, "you have no scene '" + request.scene + "'");
  std::set<std::string> known;
  const Json manifest = Json::parse(scene->manifest);
  for (const Json& file : manifest.at("files")) known.insert(file.at("path").get<std::string>());
  for (const std::string& file : request.files)
    if (!known.contains(file)) throw ApiError(422, "the scene has no file '" + file.substr(0, 200) + "'");
  const double now = unix_time();
  if (request.deadline && request.deadline->at(now) <= now) throw ApiError(422, "deadline must lie ahead; it is past");
  if (const auto wrong = scheduler_.refuse_priority(request.priority, request.user)) throw ApiError(422, *wrong);
  const Result<std::uint64_t> id = scheduler_.submit(std::move(request), now);
  if (!id) throw ApiError(429, id.error());
  keep(now);  // what is answered is kept
  return to_json(*scheduler_.find(*id));
}

Json Service::jobs(const Caller& caller) {
  const std::lock_guard lock(mutex_);
  Json out = Json::array();
  for (const auto& [id, job] : scheduler_.jobs()) {
    if (job.request.user != caller.name && !caller.admin) continue;
    std::size_t done = 0;
    for (const JobFrame& f : job.frames) done += f.state == FrameState::done;
    Json row = {{"id", id},
                {"name", job.request.name},
                {"user", job.request.user},
                {"state", name(job.state)},
                {"reason", job.reason},
                {"priority", job.request.priority},
                {"frames", job.frames.size()},
                {"frames_done", done},
                {"submitted_at", job.submitted},
                {"usage", to_json(job.usage())}};
    out.push_back(std::move(row));
  }
  return out;
}

Json Service::job(const Caller& caller, std::uint64_t id) {
  const std::lock_guard lock(mutex_);
  return to_json(job_of(caller, id));
}

Json Service::cancel(const Caller& caller, std::uint64_t id) {
  const std::lock_guard lock(mutex_);
  const Job& job = job_of(caller, id);
  const double now = unix_time();
  if (!scheduler_.cancel(id, now)) throw ApiError(409, std::string("the job has ended: it is ") + name(job.state));
  keep(now);
  return to_json(job);
}

Json Service::change(const Caller& caller, std::uint64_t id, const Json& body) {
  Fields f(body, "");
  const auto priority = f.integer("priority", Scheduler::kLowestPriority, Scheduler::kHighestPriority);
  f.finish();
  const std::lock_guard lock(mutex_);
  const Job& job = job_of(caller, id);
  if (!priority) throw ApiError(422, "priority is missing");
  if (is_final(job.state)) throw ApiError(409, std::string("the job has ended: it is ") + name(job.state));
  if (const auto wrong = scheduler_.set_priority(id, static_cast<int>(*priority), caller.name)) throw ApiError(422, *wrong);
  const double now = unix_time();
  note(id, fmt::format("its priority is {} now", *priority), now);
  keep(now);
  return to_json(job);
}

Json Service::resume(const Caller& caller, std::uint64_t id, const Json& body) {
  Fields f(body, "");
  const auto budget = f.number("budget", 0, 1e15);
  f.finish();
  const std::lock_guard lock(mutex_);
  const Job& job = job_of(caller, id);
  if (!scheduler_.resume(id, budget)) throw ApiError(409, std::string("no budget has stopped the job: it is ") + name(job.state));
  keep(unix_time());
  return to_json(job);
}

Json Service::events(const Caller& caller, std::uint64_t id) {
  const std::lock_guard lock(mutex_);
  job_of(caller, id);
  Json out = Json::array();
  for (const Store::Event& e : store_.events(id)) out.push_back({{"time", e.time}, {"text", e.text}});
  return out;
}

std::string Service::frame_file(const Caller& caller, std::uint64_t id, std::uint64_t frame, const std::string& name) {
  const std::lock_guard lock(mutex_);
  const Job& job = job_of(caller, id);
  if (frame >= job.frames.size()) throw ApiError(404, fmt::format("the job has no frame {}", frame));
  if (job.frames[frame].state != FrameState::done) throw ApiError(404, fmt::format("frame {} is not done: it is {}", frame, cloudrenderer::name(job.frames[frame].state)));
  return existing(frame_folder({id, static_cast<std::uint32_t>(frame)}) + "/" + name, name);
}

std::string Service::frame_log(const Caller& caller, std::uint64_t id, std::uint64_t frame) {
  constexpr std::streamoff kMost = 1 << 20;
  std::string path;
  {
    const std::lock_guard lock(mutex_);
    if (frame >= job_of(caller, id).frames.size()) throw ApiError(404, fmt::format("the job has no frame {}", frame));
    path = existing(frame_folder({id, static_cast<std::uint32_t>(frame)}) + "/log", "log");
  }
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  const std::streamoff end = file.tellg(), start = std::max<std::streamoff>(0, end - kMost);
  std::string text(static_cast<std::size_t>(end - start), '\0');
  file.seekg(start);
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  return shown(text);
}

std::string Service::frame_window(const Caller& caller, std::uint64_t id, std::uint64_t frame) {
  const std::lock_guard lock(mutex_);
  if (frame >= job_of(caller, id).frames.size()) throw ApiError(404, fmt::format("the job has no frame {}", frame));
  const auto child = children_.find({id, static_cast<std::uint32_t>(frame)});
  if (child == children_.end() || child->second.window.empty()) throw ApiError(404, fmt::format("frame {} does not run", frame));
  return child->second.window;
}

Json Service::hosts() {
  const std::lock_guard lock(mutex_);
  Json out = Json::array();
  for (const auto& [id, h] : host_view_)
    if (h.here)
      out.push_back({{"name", h.name}, {"kind", h.kind}, {"threads", h.threads}, {"memory", h.memory}, {"memory_used", h.memory_used},
                     {"cpu_s", h.cpu_s}});
  return out;
}

Json Service::usage(const Caller& caller) {
  const std::map<std::string, UserLimits> limits = users_.limits();
  const std::lock_guard lock(mutex_);
  const std::map<std::string, Usage> used = scheduler_.usage();
  Json users = Json::array();
  for (const auto& [user, limit] : limits) {
    if (user != caller.name && !caller.admin) continue;
    const auto found = used.find(user);
    Json row = to_json(found == used.end() ? Usage{} : found->second);
    row["user"] = user;
    row["share"] = limit.share;
    row["budget"] = limit.budget ? Json(*limit.budget) : Json(nullptr);
    row["uploaded_bytes"] = store_.bytes_of(user);
    users.push_back(std::move(row));
  }
  return {{"currency", prices_ ? prices_->currency() : ""}, {"users", std::move(users)}};
}

std::string Service::metrics(const Caller& caller) {
  if (!caller.admin) throw ApiError(403, "only administrators may read the service's figures");
  const std::lock_guard lock(mutex_);
  Families f;
  std::map<std::string, std::size_t> jobs, frames;
  for (const auto& [id, job] : scheduler_.jobs()) {
    ++jobs[name(job.state)];
    for (const JobFrame& frame : job.frames) ++frames[name(frame.state)];
  }
  const auto number = [](auto n) { return static_cast<double>(n); };
  std::size_t hosts = 0;
  for (const auto& [id, h] : host_view_) hosts += h.here;
  f.gauge("cloudrenderer_service_hosts", "Hosts that are there", number(hosts));
  add_wanted(f);
  for (const auto& [state, n] : jobs) f.gauge("cloudrenderer_service_jobs", "Jobs, by state", number(n), {{"state", state}});
  for (const auto& [state, n] : frames) f.gauge("cloudrenderer_service_frames", "Frames, by state", number(n), {{"state", state}});
  for (const auto& [user, u] : scheduler_.usage()) {
    f.counter("cloudrenderer_service_cpu_seconds_total", "Processor time of hosts, by user", u.cpu_s, {{"user", user}});
    f.counter("cloudrenderer_service_host_seconds_total", "Time of hosts, shared out, by user", u.host_s, {{"user", user}});
    f.counter("cloudrenderer_service_bytes_total", "Bytes moved, by user", u.bytes, {{"user", user}});
    f.counter("cloudrenderer_service_rays_total", "Rays, by user", u.rays, {{"user", user}});
    f.counter("cloudrenderer_service_cost_total", "Money, by user", u.cost, {{"user", user}});
  }
  return f.text();
}

}  // namespace cloudrenderer
