#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <filesystem>
#include <set>
#include <thread>

#include "cli/commands.h"
#include "cli/size.h"
#include "service/scene_files.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

class NoGeometry : public SceneSink {
  void begin_object(ObjectId, const std::string&) override {}
  void end_object(ObjectId) override {}
  void shape(ShapeDesc&&, const SceneDescription&) override {}
  void instance(const InstanceDesc&, const SceneDescription&) override {}
};

// The folder that all files are in.
fs::path common_folder(const std::set<std::string>& files) {
  fs::path common = fs::path(*files.begin()).parent_path();
  for (const std::string& file : files)
    while (!file.starts_with(common.string() == "/" ? "/" : common.string() + "/")) common = common.parent_path();
  return common;
}

// All files of the scenes. What is not there is said, and left to the service to complain of.
std::set<std::string> files_of(const SubmitOptions& o) {
  std::set<std::string> files, there;
  Warnings warnings;
  for (const std::string& scene : o.scenes) {
    if (!fs::is_regular_file(scene)) throw SceneError({}, scene + ": there is no such scene file");
    ParseOptions parse;
    parse.files = &files;
    const std::string& d = o.request.settings.dialect;
    if (!d.empty()) parse.dialect = d == "v2" ? Dialect::v2 : d == "v3" ? Dialect::v3 : Dialect::v4;
    NoGeometry sink;
    parse_scene(scene, parse, sink, warnings);
  }
  for (const std::string& file : files) {
    if (fs::is_regular_file(file))
      there.insert(file);
    else if (!o.quiet)
      fmt::print(stderr, "warning: the scene names {}, which is not there\n", file);
  }
  return there;
}

std::string upload_scene(ServiceClient& client, const SceneManifest& manifest, const fs::path& root, bool quiet) {
  for (int attempt = 0;; ++attempt) {
    int status = 0;
    const Json answer = client.post("/v1/scenes", to_json(manifest), &status);
    if (status == 201) return answer.at("id");
    if (status != 409 || !answer.contains("missing") || attempt == 3) throw UsageError(answer.at("error").get<std::string>());
    std::set<std::string> missing;
    for (const Json& hash : answer.at("missing")) missing.insert(hash.get<std::string>());
    for (const auto& [path, file] : manifest) {
      if (missing.erase(file.sha256) == 0) continue;
      client.upload(file.sha256, (root / path).string(), [&, p = path, total = file.bytes](std::uint64_t there) {
        if (!quiet && isatty(STDERR_FILENO))
          fmt::print(stderr, "\r{}: {} of {}\x1b[K{}", p, format_size(there), format_size(total), there == total ? "\n" : "");
      });
    }
  }
}

// Says how a job has ended badly, and gives the exit code for it.
int complain(const Json& job) {
  const std::string state = job.at("state"), reason = job.at("reason");
  fmt::print(stderr, "{}: {}\n", state, reason);
  return state != "failed" ? kInterrupted : reason.find("error: ") != std::string::npos ? kBadScene : kNoCluster;
}

int wait_for_end(ServiceClient& client, std::uint64_t id) {
  for (;;) {
    const Json job = client.get(fmt::format("/v1/jobs/{}", id));
    const std::string state = job.at("state");
    if (state == "done") return kDone;
    if (state == "failed" || state == "cancelled" || state == "paused") return complain(job);
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
  }
}

// Until the service knows whether the job can fit. That takes it a split of the first frame, after those of other jobs.
int wait_for_check(ServiceClient& client, std::uint64_t id, const SubmitOptions& o) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  for (;;) {
    const double left = o.check_s - std::chrono::duration<double>(Clock::now() - start).count();
    if (left <= 0) break;
    const Json job = client.get(fmt::format("/v1/jobs/{}?check_s={:.3f}", id, std::min(left, 2.0)));
    const std::string state = job.at("state");
    if (state == "failed" || state == "cancelled") return complain(job);
    if (state != "checking") return kDone;
    // Where many wait for it, the service answers at once.
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  if (!o.quiet && o.check_s > 0) fmt::print(stderr, "it is not known yet whether the job can fit; `status {}` will say\n", id);
  return kDone;
}

}  // namespace

int run_submit(const SubmitOptions& o) {
  const std::set<std::string> files = files_of(o);
  const fs::path root = common_folder(files);
  SceneManifest manifest;
  std::uint64_t bytes = 0;
  for (const std::string& file : files) {
    const std::uint64_t size = fs::file_size(file);
    manifest[fs::path(file).lexically_relative(root).string()] = {sha256_of_file(file), size};
    bytes += size;
  }
  if (!o.quiet) fmt::print(stderr, "{} files, {}, in {}\n", manifest.size(), format_size(bytes), root.string());
  ServiceClient client(o.service);
  JobRequest request = o.request;
  request.scene = upload_scene(client, manifest, root, o.quiet);
  for (const std::string& scene : o.scenes)
    request.files.push_back(fs::absolute(scene).lexically_normal().lexically_relative(root).string());
  if (request.name.empty()) request.name = fs::path(o.scenes.front()).filename().string();
  const Json job = client.post("/v1/jobs", to_json(request));
  const std::uint64_t id = job.at("id");
  fmt::print("{}\n", id);
  std::fflush(stdout);
  return o.wait ? wait_for_end(client, id) : wait_for_check(client, id, o);
}

}  // namespace cloudrenderer
