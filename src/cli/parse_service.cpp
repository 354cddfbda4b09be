#include "cli/parse_service.h"

#include <cstdlib>
#include <fstream>

#include "cli/parse_values.h"
#include "net/handshake.h"

namespace cloudrenderer {

struct ServiceCommands::Given {
  // users' commands
  CLI::App *submit = nullptr, *status = nullptr, *fetch = nullptr, *cancel = nullptr, *change = nullptr, *remove = nullptr, *resume = nullptr, *logs = nullptr;
  std::string url, token_file, authority;
  std::vector<std::string> scenes;
  std::string name, priority, retries, timeout, budget, on_budget, deadline, check, job, frame, output;
  std::string spp, max_depth, seed, max_error, resolution, crop, integrator, light_paths, dialect, part_size;
  bool wait = false, quiet = false, hosts = false, preview = false;
  // manager --serve
  std::string folder, api, users, prices, advertise, jobs_at_once, patience, user_bytes, child_memory, keep, disk, ports;
  std::string max_hosts, host_start, host_worth, host_idle;

  void add_address(CLI::App& app) {
    app.add_option("--service", url, "http://HOST:PORT of the service (default: CLOUDRENDERER_SERVICE)");
    app.add_option("--user-token-file", token_file, "file with your token (default: CLOUDRENDERER_USER_TOKEN)");
    app.add_option("--service-ca", authority, "PEM: the service's certificate, or one that it leads to (default: CLOUDRENDERER_SERVICE_CA)");
  }
  ServiceAddress address() const {
    const char* said = std::getenv("CLOUDRENDERER_SERVICE");
    ServiceAddress out{url.empty() && said ? said : url, "", authority};
    if (const char* file = std::getenv("CLOUDRENDERER_SERVICE_CA"); file && authority.empty()) out.authority = file;
    if (out.url.empty()) throw UsageError("--service http://HOST:PORT is needed, or CLOUDRENDERER_SERVICE");
    if (const char* token = std::getenv("CLOUDRENDERER_USER_TOKEN"); token && token_file.empty()) out.token = token;
    if (!token_file.empty()) out.token = read_token(token_file);
    if (out.token.empty()) throw UsageError("--user-token-file is needed, or CLOUDRENDERER_USER_TOKEN");
    return out;
  }
  std::uint64_t job_number() const { return at_least<std::uint64_t>("the number of the job", job, 1); }
};

ServiceCommands::~ServiceCommands() = default;

ServiceCommands::ServiceCommands(CLI::App& app) : given_(std::make_unique<Given>()) {
  Given& g = *given_;
  g.submit = app.add_subcommand("submit", "give scenes to a service, which renders them");
  g.submit->add_option("scenes", g.scenes, "the .pbrt files of the frames; what they name is uploaded with them")->required();
  g.submit->add_option("--name", g.name, "what you call the job (default: the first scene's name)");
  g.submit->add_option("--priority", g.priority, "-10 to 10 (default 0), as far as the service lets you");
  g.submit->add_option("--retries", g.retries, "how often a frame that fails is tried again (default 2)");
  g.submit->add_option("--timeout", g.timeout, "seconds that a frame may take each time");
  g.submit->add_option("--budget", g.budget, "money that the job may cost");
  g.submit->add_option("--on-budget", g.on_budget, "when it is used up: stop (default) or ask, which waits for resume")
      ->check(CLI::IsMember({"stop", "ask"}));
  g.submit->add_option("--deadline", g.deadline, "when you want it: from now (90s, 45m, 2h, 1d) or a time (2026-03-01T18:00:00Z); asks for hosts");
  g.submit->add_option("--spp", g.spp, "samples per pixel");
  g.submit->add_option("--max-depth", g.max_depth, "maxdepth of the integrator");
  g.submit->add_option("--seed", g.seed, "another picture of the same scene");
  g.submit->add_option("--max-error", g.max_error, "stop when the relMSE is this small");
  g.submit->add_option("--resolution", g.resolution, "WxH pixels");
  g.submit->add_option("--crop", g.crop, "X0,X1,Y0,Y1: the part of the picture to render, in [0,1]");
  g.submit->add_option("--integrator", g.integrator, "pbrt's name of the integrator to use instead of the scene's");
  g.submit->add_option("--light-paths", g.light_paths, "paths from the lights: off, caustics or all (default: as the scene's integrator says)")
      ->check(CLI::IsMember({"off", "caustics", "all"}));
  g.submit->add_option("--dialect", g.dialect, "read the scene as pbrt v2, v3 or v4, whatever it looks like");
  g.submit->add_option("--part-size", g.part_size, "memory of a loaded part at most (default 64MiB)");
  g.submit->add_option("--check", g.check, "seconds to wait at most until it is known whether the job can fit the hosts (default 60)");
  g.submit->add_flag("--wait", g.wait, "until the job has ended; exit code 0 when all is well");
  g.submit->add_flag("--quiet", g.quiet, "say nothing but the number of the job");
  g.status = app.add_subcommand("status", "how far your jobs are");
  g.fetch = app.add_subcommand("fetch", "get a job's pictures");
  g.cancel = app.add_subcommand("cancel", "end a job");
  g.change = app.add_subcommand("change", "give a job that has not ended another priority");
  g.remove = app.add_subcommand("remove", "forget a job that has ended, with its pictures and logs");
  g.resume = app.add_subcommand("resume", "go on with a job that its budget has stopped");
  g.logs = app.add_subcommand("logs", "what happened to a job, or in a frame");
  g.status->add_option("job", g.job, "number of a job (default: a list of all)");
  g.status->add_flag("--hosts", g.hosts, "instead: hosts that are there, and how many of which kind would help now");
  for (CLI::App* command : {g.fetch, g.cancel, g.change, g.remove, g.resume, g.logs}) command->add_option("job", g.job, "number of the job")->required();
  g.fetch->add_option("-o,--output", g.output, "folder to write to (default: here)");
  g.fetch->add_flag("--preview", g.preview, "what there is of unfinished frames, too, as NAME.preview.exr");
  g.change->add_option("--priority", g.priority, "-10 to 10, as far as the service lets you")->required();
  g.resume->add_option("--budget", g.budget, "money that the job may cost from now on, what it has cost included");
  g.logs->add_option("--frame", g.frame, "the log of this frame, counted from 0");
  for (CLI::App* command : {g.submit, g.status, g.fetch, g.cancel, g.change, g.remove, g.resume, g.logs}) g.add_address(*command);
}

void ServiceCommands::add_serve(CLI::App& manager) {
  Given& g = *given_;
  manager.add_option("--serve", g.folder, "serve many users' jobs, and keep all that belongs to them in this folder");
  manager.add_option("--api", g.api, "with --serve: ADDR:PORT for users (default 127.0.0.1:8080)");
  manager.add_option("--users", g.users, "with --serve: JSON file of users (default: one, who has the cluster's token)");
  manager.add_option("--prices", g.prices, "with --serve: JSON file of what hosts cost an hour, by kind");
  manager.add_option("--advertise", g.advertise, "with --serve: the name at which workers reach this machine");
  manager.add_option("--jobs-at-once", g.jobs_at_once, "with --serve: frames that share the hosts at most (default 4)");
  manager.add_option("--patience", g.patience, "with --serve: seconds that a user waits for a place that others have beyond their share (default 30)");
  manager.add_option("--user-bytes", g.user_bytes, "with --serve: what a user may upload (default 100GiB)");
  manager.add_option("--child-memory", g.child_memory, "with --serve: memory of a process that reads a scene (default 4GiB)");
  manager.add_option("--max-hosts", g.max_hosts, "with --serve: hosts that are ever wanted (default 100)");
  manager.add_option("--host-start", g.host_start, "with --serve: seconds from wanting a host until it helps (default 60)");
  manager.add_option("--host-worth", g.host_worth, "with --serve: work in seconds that makes a new host worth its start (default 4 times --host-start)");
  manager.add_option("--host-idle", g.host_idle, "with --serve: seconds that a host must have been one too many before it may go (default 300)");
  manager.add_option("--keep", g.keep, "with --serve: how long after their end jobs, their pictures and logs are kept, 30d for example, and scenes that no job has (default: for ever)");
  manager.add_option("--disk", g.disk, "with --serve: what the folder may take; splits that no job needs are removed beyond it (default: no limit)");
  manager.add_option("--ports", g.ports, "with --serve: A-B, where the frames' managers listen (default: any free ports)");
}

bool ServiceCommands::serves() const { return !given_->folder.empty(); }

Command ServiceCommands::read_serve(const Address& listen, const RenderOptions& manager, const std::string& min_hosts) const {
  const Given& g = *given_;
  ServeOptions o;
  o.listen = listen;
  o.api = Address::parse(g.api.empty() ? "127.0.0.1:8080" : g.api);
  o.users = g.users;
  o.prices = g.prices;
  o.lost_after_s = manager.request.lost_after_s;
  o.log = manager.log;
  ServiceConfig& c = o.config;
  c.folder = g.folder;
  c.managers = listen;
  c.managers_host = g.advertise.empty() ? listen.host : g.advertise;
  if (Address{c.managers_host, 0}.is_wildcard())
    throw UsageError("--listen " + listen.to_string() + " does not tell workers where this machine is: --advertise HOST does");
  c.token = read_token(manager.token_file);
  c.tls = manager.request.tls;
  c.allow_inexact = manager.request.allow_inexact;
  if (!g.jobs_at_once.empty()) c.scheduler.slots = at_least<std::uint32_t>("--jobs-at-once", g.jobs_at_once, 1);
  if (!g.patience.empty()) c.scheduler.patience_s = at_least<double>("--patience", g.patience, 0);
  if (!g.user_bytes.empty()) c.user_bytes = size_option("--user-bytes", g.user_bytes);
  if (!g.child_memory.empty()) c.child_memory = size_option("--child-memory", g.child_memory);
  ElasticLimits& e = c.elastic;
  if (!min_hosts.empty()) e.least = at_least<std::uint32_t>("--min-hosts", min_hosts, 0);
  if (!g.max_hosts.empty()) e.most = at_least<std::uint32_t>("--max-hosts", g.max_hosts, 1);
  if (e.least > e.most) throw UsageError(fmt::format("--max-hosts must be at least --min-hosts, {}, got {}", e.least, e.most));
  if (!g.host_start.empty()) e.start_s = at_least<double>("--host-start", g.host_start, 0);
  e.worth_s = g.host_worth.empty() ? 4 * e.start_s : at_least<double>("--host-worth", g.host_worth, 0);
  if (!g.host_idle.empty()) e.idle_s = at_least<double>("--host-idle", g.host_idle, 0);
  e.jobs_at_once = c.scheduler.slots;
  if (!g.keep.empty()) c.rules.keep_s = duration_option("--keep", g.keep);
  if (!g.disk.empty()) c.rules.disk = size_option("--disk", g.disk);
  if (!g.ports.empty()) {
    const auto ends = fields(g.ports, '-');
    const auto first = number<std::uint16_t>(ends[0]), last = number<std::uint16_t>(ends.back());
    if (ends.size() > 2 || !first || !last || *first == 0 || *first > *last)
      throw UsageError("--ports is A-B with 1 <= A <= B <= 65535, got '" + g.ports + "'");
    c.manager_ports = PortRange{*first, *last};
    if (c.manager_ports->size() < c.scheduler.slots)
      throw UsageError(fmt::format("--ports {} are {} ports; {} frames at once (--jobs-at-once) need one each", g.ports, c.manager_ports->size(), c.scheduler.slots));
  }
  return o;
}

std::optional<Command> ServiceCommands::read() const {
  const Given& g = *given_;
  if (g.submit->parsed()) {
    SubmitOptions o;
    o.service = g.address();
    o.scenes = g.scenes;
    if (!g.check.empty()) o.check_s = at_least<double>("--check", g.check, 0);
    o.wait = g.wait;
    o.quiet = g.quiet;
    JobRequest& r = o.request;
    r.name = g.name;
    if (!g.priority.empty()) r.priority = at_least<int>("--priority", g.priority, -10);
    if (!g.retries.empty()) r.retries = at_least<std::uint32_t>("--retries", g.retries, 0);
    if (!g.timeout.empty()) r.timeout_s = at_least<double>("--timeout", g.timeout, 0);
    if (!g.budget.empty()) r.budget = at_least<double>("--budget", g.budget, 0);
    r.ask = g.on_budget == "ask";
    if (!g.deadline.empty()) {
      r.deadline = parse_deadline(g.deadline);
      if (!r.deadline) throw UsageError("--deadline must be a time from now like 90s, 45m, 2h or 1d, or a time like 2026-03-01T18:00:00Z, got '" + g.deadline + "'");
    }
    RenderSettings& s = r.settings;
    if (!g.spp.empty()) s.spp = at_least<std::uint32_t>("--spp", g.spp, 1);
    if (!g.max_depth.empty()) s.max_depth = at_least<std::uint32_t>("--max-depth", g.max_depth, 0);
    if (!g.seed.empty()) s.seed = at_least<std::uint32_t>("--seed", g.seed, 0);
    if (!g.max_error.empty()) s.max_error = at_least<double>("--max-error", g.max_error, 0);
    if (!g.resolution.empty()) std::tie(s.width, s.height) = resolution_option(g.resolution);
    if (!g.crop.empty()) {
      crop_option(g.crop);  // says what is wrong
      s.crop.emplace();
      for (std::size_t i = 0; i < s.crop->size(); ++i) (*s.crop)[i] = *number<double>(fields(g.crop, ',')[i]);
    }
    s.integrator = g.integrator;
    s.light_paths = g.light_paths;
    if (!g.dialect.empty()) dialect_option(g.dialect);
    s.dialect = g.dialect;
    if (!g.part_size.empty()) s.part_size = size_option("--part-size", g.part_size);
    return o;
  }
  if (g.status->parsed()) {
    if (g.hosts && !g.job.empty()) throw UsageError("status --hosts is of the service, not of a job");
    return StatusOptions{g.address(), g.job.empty() ? 0 : g.job_number(), g.hosts};
  }
  if (g.fetch->parsed()) return FetchOptions{g.address(), g.job_number(), g.output, g.preview};
  if (g.cancel->parsed()) return CancelOptions{g.address(), g.job_number()};
  if (g.change->parsed()) return ChangeOptions{g.address(), g.job_number(), at_least<int>("--priority", g.priority, -10)};
  if (g.remove->parsed()) return RemoveOptions{g.address(), g.job_number()};
  if (g.resume->parsed()) {
    ResumeOptions o{g.address(), g.job_number(), std::nullopt};
    if (!g.budget.empty()) o.budget = at_least<double>("--budget", g.budget, 0);
    return o;
  }
  if (g.logs->parsed()) {
    LogsOptions o{g.address(), g.job_number(), std::nullopt};
    if (!g.frame.empty()) o.frame = at_least<std::uint64_t>("--frame", g.frame, 0);
    return o;
  }
  return std::nullopt;
}

}  // namespace cloudrenderer
