// What users ask of a service about their jobs.
#include <spdlog/fmt/chrono.h>
#include <spdlog/fmt/fmt.h>

#include <filesystem>

#include "cli/commands.h"
#include "cli/size.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

std::string job_path(std::uint64_t job) { return "/v1/jobs/" + std::to_string(job); }

std::string text(const Json& json, const char* key) { return json.at(key).get<std::string>(); }

std::string usage_text(const Json& usage, const std::string& currency) {
  const auto n = [&](const char* key) { return usage.at(key).get<double>(); };
  std::string out = fmt::format("{:.1f} s of processors, {:.1f} s of hosts, {:.3g} G rays, {:.3g} GB moved", n("cpu_s"), n("host_s"), n("rays") * 1e-9,
                                n("bytes") * 1e-9);
  if (!currency.empty()) out += fmt::format(", {:.4f} {}", n("cost"), currency);
  return out;
}

int show_hosts(ServiceClient& client) {
  fmt::print("{:<20} {:<12} {:>7} {:>10} {:>10}\n", "host", "kind", "threads", "memory", "used");
  for (const Json& h : client.get("/v1/hosts"))
    fmt::print("{:<20} {:<12} {:>7} {:>10} {:>10}\n", text(h, "name"), text(h, "kind"), h.at("threads").get<std::uint64_t>(),
               format_size(h.at("memory").get<std::uint64_t>()), format_size(h.at("memory_used").get<std::uint64_t>()));
  const Json w = client.get("/v1/hosts/wanted");
  for (const Json& k : w.at("kinds"))
    fmt::print("{}: {} wanted, {} there\n", text(k, "kind").empty() ? "any kind" : "kind " + text(k, "kind"), k.at("wanted").get<std::uint64_t>(),
               k.at("there").get<std::uint64_t>());
  for (const Json& r : w.at("reasons")) fmt::print("  {}\n", text(r, "text"));
  for (const Json& h : w.at("surplus")) fmt::print("may be ended: {}\n", text(h, "name"));
  return kDone;
}

}  // namespace

int run_status(const StatusOptions& o) {
  ServiceClient client(o.service);
  if (o.hosts) return show_hosts(client);
  const std::string currency = text(client.get("/v1/usage"), "currency");
  if (o.job == 0) {
    fmt::print("{:>6}  {:<10} {:>8}  {:>9}  {:<12} {}\n", "job", "state", "frames", "cpu_s", "user", "name");
    for (const Json& j : client.get("/v1/jobs"))
      fmt::print("{:>6}  {:<10} {:>8}  {:>9.1f}  {:<12} {}{}\n", j.at("id").get<std::uint64_t>(), text(j, "state"),
                 fmt::format("{}/{}", j.at("frames_done").get<std::uint64_t>(), j.at("frames").get<std::uint64_t>()),
                 j.at("usage").at("cpu_s").get<double>(), text(j, "user"), text(j, "name"),
                 text(j, "reason").empty() ? "" : " (" + text(j, "reason") + ")");
    return kDone;
  }
  const Json j = client.get(job_path(o.job));
  fmt::print("job {} \"{}\" is {}{}\n", o.job, text(j, "name"), text(j, "state"), text(j, "reason").empty() ? "" : ": " + text(j, "reason"));
  if (const Json& deadline = j.at("deadline_at"); !deadline.is_null())
    fmt::print("wanted by {:%Y-%m-%d %H:%M:%S}\n", fmt::localtime(static_cast<std::time_t>(deadline.get<double>())));
  fmt::print("{}\n", usage_text(j.at("usage"), currency));
  for (const Json& f : j.at("frames")) {
    std::string more = text(f, "reason").empty() ? "" : ": " + text(f, "reason");
    if (text(f, "state") == "running") {
      try {
        const Json p = client.get(fmt::format("{}/frames/{}/progress", job_path(o.job), f.at("frame").get<std::uint64_t>()));
        const double total = p.at("paths_total").get<double>();
        if (total > 0) more += fmt::format(", {:.1f} %, {} hosts", 100 * p.at("paths_done").get<double>() / total, p.at("hosts").size());
      } catch (const UsageError&) {  // it has just begun, or ended
      }
    }
    fmt::print("{:>6}  {:<10} {}{}\n", f.at("frame").get<std::uint64_t>(), text(f, "state"), text(f, "file"), more);
  }
  return kDone;
}

int run_fetch(const FetchOptions& o) {
  ServiceClient client(o.service);
  const Json j = client.get(job_path(o.job));
  const fs::path folder = o.output.empty() ? "." : o.output;
  fs::create_directories(folder);
  std::size_t got = 0;
  const std::string ending = o.preview ? "preview.exr" : "picture.exr";
  std::map<std::string, int> names;
  for (const Json& f : j.at("frames")) ++names[fs::path(text(f, "file")).stem().string()];
  for (const Json& f : j.at("frames")) {
    const std::uint64_t frame = f.at("frame");
    std::string name = fs::path(text(f, "file")).stem().string();
    if (names[name] > 1) name += fmt::format("-{:04}", frame);
    const std::string to = (folder / (name + (o.preview && text(f, "state") != "done" ? ".preview.exr" : ".exr"))).string();
    if (!client.download(fmt::format("{}/frames/{}/{}", job_path(o.job), frame, ending), to)) continue;
    fmt::print("{}\n", to);
    ++got;
  }
  if (got == j.at("frames").size()) return kDone;
  fmt::print(stderr, "{} of {} frames have a picture; the job is {}\n", got, j.at("frames").size(), text(j, "state"));
  return kNoCluster;
}

int run_cancel(const CancelOptions& o) {
  ServiceClient client(o.service);
  const Json j = client.post(job_path(o.job) + "/cancel", Json::object());
  fmt::print("job {} is {}\n", o.job, text(j, "state"));
  return kDone;
}

int run_change(const ChangeOptions& o) {
  ServiceClient client(o.service);
  const Json j = client.patch(job_path(o.job), {{"priority", o.priority}});
  fmt::print("job {} has priority {}\n", o.job, j.at("priority").get<int>());
  return kDone;
}

int run_remove(const RemoveOptions& o) {
  ServiceClient client(o.service);
  client.remove(job_path(o.job));
  fmt::print("job {} is removed\n", o.job);
  return kDone;
}

int run_resume(const ResumeOptions& o) {
  ServiceClient client(o.service);
  Json body = Json::object();
  if (o.budget) body["budget"] = *o.budget;
  const Json j = client.post(job_path(o.job) + "/resume", body);
  fmt::print("job {} is {}\n", o.job, text(j, "state"));
  return kDone;
}

int run_logs(const LogsOptions& o) {
  ServiceClient client(o.service);
  if (o.frame) {
    fmt::print("{}", client.text(fmt::format("{}/frames/{}/log", job_path(o.job), *o.frame)));
    return kDone;
  }
  for (const Json& e : client.get(job_path(o.job) + "/events"))
    fmt::print("{:%Y-%m-%d %H:%M:%S} {}\n", fmt::localtime(static_cast<std::time_t>(e.at("time").get<double>())), text(e, "text"));
  return kDone;
}

}  // namespace cloudrenderer
