#include <CLI/CLI.hpp>

#include "cli/options.h"
#include "cli/parse_service.h"
#include "cli/parse_values.h"
#include "cluster/usage.h"
#include "net/handshake.h"

namespace cloudrenderer {
namespace {

// Options whose text needs more than a conversion are kept as text and read here, so that every
// message is ours.
struct Texts {
  std::string memory, part_size, spp, samples_per_ray, max_depth, light_paths, resolution, seed, max_error, max_time, crop,
      dialect, hosts, threads, min_hosts, replication, lost_after, wait, listen, advertise, manager,
      alpha, max_relmse, sample_paths, parent, tls, web, display, layers, sampling;
};

constexpr auto kLayers = std::to_array<const char*>({"error", "samples", "albedo", "normal", "depth", "position", "ids"});

std::string layer_names() {
  std::string out;
  for (const char* name : kLayers) out += (out.empty() ? "" : ", ") + std::string(name);
  return out;
}

std::set<std::string> read_layers(const std::string& text) {
  const std::set<std::string> known(kLayers.begin(), kLayers.end());
  if (text == "all") return known;
  std::set<std::string> out;
  for (const std::string& name : fields(text, ',')) {
    if (!known.contains(name))
      throw UsageError("--layers knows " + layer_names() + " and all, got '" + name + "'");
    out.insert(name);
  }
  return out;
}

void add_log(CLI::App& app, LogOptions& log) {
  app.add_option("--log", log.file, "write the log to this file instead of standard error");
  app.add_option("--log-level", log.level, "debug, info, warn, error or off")
      ->check(CLI::IsMember({"debug", "info", "warn", "error", "off"}));
}

void add_confine(CLI::App& app, std::string& folder) {
  app.add_option("--confine", folder, "refuse scenes that name a file outside of this folder, links resolved")
      ->check(CLI::ExistingDirectory);
}

void add_split(CLI::App& app, Texts& t, std::string& confine) {
  add_confine(app, confine);
  app.add_option("--part-size", t.part_size, "memory of a loaded part at most (default 64MiB)");
  app.add_option("--dialect", t.dialect, "read the scene as pbrt v2, v3 or v4, whatever it looks like");
}

void read_split(const Texts& t, SplitOptions& o) {
  if (!t.part_size.empty()) o.part_size = size_option("--part-size", t.part_size);
  if (!t.dialect.empty()) o.dialect = dialect_option(t.dialect);
}

void add_render(CLI::App& app, RenderOptions& o, Texts& t, std::string& integrator) {
  app.add_option("scene", o.request.scene, "a .pbrt file or a folder made by split");
  app.add_option("-o,--output", o.output,
                 "picture to write, .exr, .pfm, .png or .tga (default: as the scene says, here)");
  app.add_option("--replication", t.replication, "hosts that hold each part at least");
  app.add_option("--spp", t.spp, "samples per pixel");
  app.add_option("--samples-per-ray", t.samples_per_ray,
                 "samples that share what the camera sees: 1, 2, 4 or 8. More are faster where indirect light makes the noise, and worse for "
                 "fine detail (default: 2 if that is found to pay, from 32 samples a pixel on)")
      ->check(CLI::IsMember({"1", "2", "4", "8"}));
  app.add_option("--max-depth", t.max_depth, "maxdepth of the integrator");
  app.add_option("--light-paths", t.light_paths,
                 "paths from the lights too: for caustics (default with sppm and photon maps), or for all light that is not direct (all; "
                 "default with bdpt, mlt and metropolis), or off (default with path)")
      ->check(CLI::IsMember({"off", "caustics", "all"}));
  app.add_option("--resolution", t.resolution, "WxH pixels");
  app.add_option("--seed", t.seed, "another picture of the same scene");
  app.add_option("--max-error", t.max_error, "stop when the relMSE is this small, by the upper end of its estimate's interval");
  app.add_option("--max-time", t.max_time, "stop after about this many seconds of rendering (without --spp: not before)");
  app.add_option("--sampling", t.sampling,
                 "adaptive (default with --max-error and --max-time: samples go where the error is) or uniform")
      ->check(CLI::IsMember({"adaptive", "uniform"}));
  app.add_option("--reference", o.reference, "picture to measure the error against");
  app.add_option("--layers", t.layers, "also in the .exr: " + layer_names() + ", separated by commas, or all");
  app.add_option("--report", o.report, "write figures about the render to this JSON file");
  app.add_option("--sample-paths", t.sample_paths,
                 "with --report and one host: also trace so many paths for `simulate` (2048 are plenty)");
  app.add_option("--checkpoint", o.request.checkpoint,
                 "journal of what is done, for --resume (Ctrl-C without it: OUT.ckpt)");
  app.add_flag("--resume", o.request.resume,
               "go on from the checkpoint; with a larger --spp, add samples to its picture");
  app.add_option("--crop", t.crop, "X0,X1,Y0,Y1: the part of the picture to render, in [0,1]");
  app.add_option("--integrator", integrator,
                 "pbrt's name of the integrator to use instead of the scene's");
  app.add_option("--alpha", t.alpha,
                 "weight of a host's load against the number of hosts, when work is sent");
  app.add_option("--web", t.web, "ADDR:PORT for a page that shows the render, /metrics for Prometheus, and an API");
  app.add_option("--display", t.display, "HOST:PORT of the viewer tev, which shows the picture as it grows");
  app.add_flag("--quiet", o.quiet, "no progress");
  app.add_flag("--allow-inexact", o.request.allow_inexact, "take hosts whose arithmetic differs");
  add_split(app, t, o.request.split.confine);
  add_log(app, o.log);
}

void read_render(const Texts& t, const std::string& integrator, RenderOptions& o) {
  RenderRequest& r = o.request;
  JobOverrides& j = r.overrides;
  read_split(t, r.split);
  if (!t.replication.empty())
    r.replication = at_least<std::uint32_t>("--replication", t.replication, 1);
  if (!t.spp.empty()) j.spp = at_least<std::uint32_t>("--spp", t.spp, 1);
  if (!t.samples_per_ray.empty()) j.samples_per_ray = at_least<std::uint32_t>("--samples-per-ray", t.samples_per_ray, 1);
  if (!t.max_depth.empty()) j.max_depth = at_least<std::uint32_t>("--max-depth", t.max_depth, 0);
  if (!t.seed.empty()) j.seed = at_least<std::uint32_t>("--seed", t.seed, 0);
  if (!t.light_paths.empty()) j.light_paths = light_paths_of(t.light_paths);
  if (!integrator.empty()) j.integrator = integrator;
  if (!t.resolution.empty()) {
    const auto [width, height] = resolution_option(t.resolution);
    j.width = width;
    j.height = height;
  }
  if (!t.crop.empty()) j.crop = crop_option(t.crop);
  if (!t.max_error.empty()) r.max_error = at_least<double>("--max-error", t.max_error, 0);
  if (!t.max_time.empty()) r.max_time_s = at_least<double>("--max-time", t.max_time, 0);
  if (t.sampling == "adaptive" && !r.max_error && !r.max_time_s)
    throw UsageError("--sampling adaptive needs --max-error or --max-time: it goes on until one of them is reached");
  r.adaptive = t.sampling != "uniform";
  if (!t.layers.empty()) o.layers = read_layers(t.layers);
  if (!t.alpha.empty()) r.alpha = at_least<float>("--alpha", t.alpha, 0);
  if (!t.sample_paths.empty()) {
    r.sample_paths = at_least<std::uint32_t>("--sample-paths", t.sample_paths, 1);
    if (o.report.empty()) throw UsageError("--sample-paths goes into a report: --report FILE.json is missing");
  }
  r.log_level = o.log.level;
  if (!t.web.empty()) o.web = Address::parse(t.web);
  if (!t.display.empty()) o.display = Address::parse(t.display);
}

void add_tls(CLI::App& app, Texts& t) {
  app.add_option("--tls", t.tls,
                 "encrypt connections: on, off, or auto (default: all but those on the loopback)")
      ->check(CLI::IsMember({"on", "off", "auto"}));
}

// Of hosts that find each other over a network.
void add_door(CLI::App& app, Texts& t, std::string& token_file, TlsOptions& tls) {
  app.add_option("--token-file", token_file,
                 "file with the cluster's shared secret (default: CLOUDRENDERER_TOKEN, if set)");
  add_tls(app, t);
  app.add_option("--tls-cert", tls.certificate,
                 "this host's certificate chain, PEM (default: one is made at the start)");
  app.add_option("--tls-key", tls.key, "the key of --tls-cert, PEM");
  app.add_option("--tls-ca", tls.authority,
                 "PEM: take only peers whose certificates lead to one of these");
}

void read_tls(const Texts& t, TlsOptions& tls) {
  if (t.tls == "on") tls.mode = TlsMode::on;
  if (t.tls == "off") tls.mode = TlsMode::off;
}

void add_parent(CLI::App& app, Texts& t) { app.add_option("--parent", t.parent, "process to end with")->group(""); }

void add_means(CLI::App& app, Texts& t) {
  app.add_option("--threads", t.threads, "threads of a host (default: all processors)");
  app.add_option("--memory", t.memory,
                 "memory of a host for parts and textures (default: 80 % of what there is)");
}

// What is kept as text until it is read.
struct SimulateTexts {
  std::string hosts, resolution, spp, triangles, bandwidth, manager_bandwidth, latency, store_bandwidth, failures, reclaims,
      notice, replace, boot, start, replication, manager_price, segment, seed;
  std::vector<std::string> kinds;
};

void add_simulate(CLI::App& app, SimulateOptions& o, SimulateTexts& t) {
  app.add_option("model", o.model, "report of a render with --hosts 1 --sample-paths 2048 --report")->required();
  app.add_option("--hosts", t.hosts, "numbers of hosts, separated by commas (default 1,2,4,...,1024)");
  app.add_option("--kind", t.kinds,
                 "NAME:THREADS:MEMORY:PRICE[:SPEED[:WEIGHT]], for example c8.large:2:4GiB:0.085; price an hour, speed of a thread "
                 "against the machine of the report, share of the hosts; more than one: mixed")
      ->take_all();
  app.add_option("--resolution", t.resolution, "WxH pixels, instead of the render's");
  app.add_option("--spp", t.spp, "samples per pixel, likewise");
  app.add_option("--triangles", t.triangles, "as many in the same number of parts");
  app.add_option("--bandwidth", t.bandwidth, "of a host, Gbit/s each way (default 1)");
  app.add_option("--manager-bandwidth", t.manager_bandwidth, "of the manager, Gbit/s (default 10)");
  app.add_option("--store-bandwidth", t.store_bandwidth, "of the store of parts in all, Gbit/s (default: no limit)");
  app.add_flag("--parts-from-manager", o.plan.network.parts_from_manager, "hosts fetch parts from the manager");
  app.add_option("--latency", t.latency, "one way, milliseconds (default 0.2)");
  app.add_option("--failures", t.failures, "of a host, in an hour: gone without a word");
  app.add_option("--reclaims", t.reclaims, "of a host, in an hour: spot instances that are told so before");
  app.add_option("--notice", t.notice, "seconds from being told to the end (default 120)");
  app.add_option("--replace", t.replace, "seconds until another host is there in place of one that went (default: none comes)");
  app.add_option("--boot", t.boot, "seconds over which the hosts join");
  app.add_option("--start", t.start, "processor seconds that a host takes once as it begins to render (default 0)");
  app.add_option("--replication", t.replication, "hosts that hold each part at least");
  app.add_option("--manager-price", t.manager_price, "of the manager's machine, an hour");
  app.add_option("--segment", t.segment, "real paths that a simulated one stands for at most (default: by the size of the job)");
  app.add_option("--seed", t.seed, "of all that is random");
  app.add_option("--report", o.report, "write the predictions to this JSON file");
}

sim::HostKind read_kind(const std::string& text) {
  const auto f = fields(text, ':');
  if (f.size() < 4 || f.size() > 6)
    throw UsageError("--kind is NAME:THREADS:MEMORY:PRICE[:SPEED[:WEIGHT]], for example c8.large:2:4GiB:0.085, got '" + text + "'");
  sim::HostKind k;
  k.name = f[0];
  k.threads = at_least<std::uint32_t>("--kind: threads", f[1], 1);
  k.memory = size_option("--kind", f[2]);
  k.price = at_least<double>("--kind: price", f[3], 0);
  if (f.size() > 4) k.speed = at_least<double>("--kind: speed", f[4], 1e-3);
  if (f.size() > 5) k.weight = at_least<double>("--kind: weight", f[5], 1e-6);
  return k;
}

void read_simulate(const SimulateTexts& t, SimulateOptions& o) {
  constexpr double kGigabit = 1e9 / 8;
  const auto read = [](const char* option, const std::string& text, double& value, double unit = 1, double least = 0) {
    if (!text.empty()) value = unit * at_least<double>(option, text, least);
  };
  if (!t.hosts.empty()) {
    o.hosts.clear();
    for (const std::string& n : fields(t.hosts, ',')) o.hosts.push_back(at_least<std::uint32_t>("--hosts", n, 1));
  }
  for (const std::uint32_t n : o.hosts)
    if (n > 60000) throw UsageError("--hosts is at most 60000: a path's owner has 16 bits");
  if (!t.kinds.empty()) o.plan.kinds.clear();
  for (const std::string& kind : t.kinds) o.plan.kinds.push_back(read_kind(kind));
  if (!t.resolution.empty()) std::tie(o.width, o.height) = resolution_option(t.resolution);
  if (!t.spp.empty()) o.spp = at_least<std::uint32_t>("--spp", t.spp, 1);
  if (!t.triangles.empty()) o.triangles = static_cast<std::uint64_t>(at_least<double>("--triangles", t.triangles, 1));
  sim::Network& net = o.plan.network;
  read("--bandwidth", t.bandwidth, net.bandwidth, kGigabit, 1e-6);
  read("--manager-bandwidth", t.manager_bandwidth, net.manager_bandwidth, kGigabit, 1e-6);
  read("--store-bandwidth", t.store_bandwidth, net.store_bandwidth, kGigabit, 1e-6);
  read("--latency", t.latency, net.latency, 1e-3);
  sim::Trouble& trouble = o.plan.trouble;
  read("--failures", t.failures, trouble.failures);
  read("--reclaims", t.reclaims, trouble.reclaims);
  read("--notice", t.notice, trouble.notice_s);
  read("--replace", t.replace, trouble.replace_s);
  read("--boot", t.boot, o.plan.boot_s);
  read("--start", t.start, o.plan.start_s);
  read("--manager-price", t.manager_price, o.plan.manager_price);
  if (!t.replication.empty()) o.plan.replication = at_least<std::uint32_t>("--replication", t.replication, 1);
  if (!t.segment.empty()) o.plan.segment = at_least<std::uint32_t>("--segment", t.segment, 1);
  if (!t.seed.empty()) o.plan.seed = at_least<std::uint64_t>("--seed", t.seed, 0);
}

}  // namespace

Command parse_command_line(int argc, const char* const* argv) {
  CLI::App app("Renders pbrt scenes that are too big, or too slow, for one machine.",
               "cloudrenderer");
  app.set_version_flag("--version", "cloudrenderer " CLOUDRENDERER_VERSION);
  app.require_subcommand(1);
  Texts t;
  ServiceCommands service(app);
  std::string integrator;

  RenderOptions render, manager;
  CLI::App& render_app = *app.add_subcommand("render", "render a scene on this machine");
  add_render(render_app, render, t, integrator);
  render_app.add_option("--hosts", t.hosts, "worker processes to use (default 1: this process)");
  add_tls(render_app, t);
  add_means(render_app, t);

  CLI::App& manager_app =
      *app.add_subcommand("manager", "render a scene with workers that connect");
  add_render(manager_app, manager, t, integrator);
  manager_app.add_option("--listen", t.listen, "ADDR:PORT to listen on")->required();
  manager_app.add_option("--min-hosts", t.min_hosts,
                         "workers to wait for before the start (default 1); with --serve: hosts that are always wanted (default 0)");
  manager_app.add_option("--wait", t.wait, "give up after so many seconds without a worker");
  manager_app.add_option("--lost-after", t.lost_after,
                         "seconds of silence after which a worker is lost (default 3)");
  add_door(manager_app, t, manager.token_file, manager.request.tls);
  service.add_serve(manager_app);
  add_parent(manager_app, t);

  WorkerOptionsGiven worker;
  CLI::App& worker_app = *app.add_subcommand("worker", "work for a manager");
  worker_app.add_option("--manager", t.manager, "ADDR:PORT of the manager")->required();
  worker_app.add_option("--listen", t.listen,
                        "ADDR:PORT for the other workers (default: any free port)");
  worker_app.add_option("--advertise", t.advertise,
                        "ADDR:PORT at which the other workers reach this one");
  worker_app.add_option("--name", worker.config.name, "name in reports (default: the machine's)");
  worker_app.add_option("--kind", worker.config.kind, "kind of machine, as the service's price table names it");
  worker_app.add_option("--parts", worker.config.parts, "a copy of the split, to load parts from");
  add_door(worker_app, t, worker.token_file, worker.config.tls);
  worker_app.add_option("--wait", t.wait, "seconds to look for the manager, also for one that has gone (default 30)");
  worker_app.add_option("--alpha", t.alpha, "weight of a host's load against the number of hosts");
  worker_app.add_flag("--only-intersect", worker.config.only_intersect,
                      "take no paths: load parts and answer for them");
  worker_app.add_flag("--allow-inexact", worker.config.allow_inexact,
                      "join although the arithmetic differs");
  add_parent(worker_app, t);
  add_means(worker_app, t);
  add_log(worker_app, worker.log);

  SplitCommand split;
  CLI::App& split_app = *app.add_subcommand("split", "cut a scene into parts");
  split_app.add_option("scene", split.scene, "a .pbrt file")->required();
  split_app.add_option("-o,--output", split.output, "folder to write")->required();
  split_app.add_flag("--text", split.options.text, "also write the split as a pbrt scene");
  split_app.add_option("--report", split.report, "write what its hosts need to this JSON file");
  add_split(split_app, t, split.options.confine);
  add_parent(split_app, t);

  CompareOptions compare;
  CLI::App& compare_app = *app.add_subcommand("compare", "compare a picture with a reference");
  compare_app.add_option("a", compare.a, "a picture")->required();
  compare_app.add_option("b", compare.b, "the reference")->required();
  compare_app.add_option("--max-relmse", t.max_relmse, "exit code 1 when the relMSE is above");

  InfoOptions info;
  CLI::App& info_app =
      *app.add_subcommand("info", "what is in a scene or a split, and what is not supported");
  info_app.add_option("scene", info.scene, "a .pbrt file or a folder made by split");
  info_app.add_option("--dialect", t.dialect, "read the scene as pbrt v2, v3 or v4");
  add_confine(info_app, info.confine);
  info_app.add_flag("--language", info.language,
                    "print what is read of the scene language instead (docs/language.md)");

  SimulateOptions simulate;
  SimulateTexts st;
  CLI::App& simulate_app = *app.add_subcommand("simulate", "predict time and cost of a render by other clusters");
  add_simulate(simulate_app, simulate, st);

  if (argc > 1 && argv[1][0] != '-' &&
      app.get_subcommands([&](CLI::App* a) { return a->get_name() == argv[1]; }).empty())
    throw UsageError("there is no command '" + std::string(argv[1]) +
                     "'; known are render, manager, worker, split, compare, info, simulate, submit, status, fetch, cancel, change, remove, resume and logs");
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& asked) {  // --help, --version
    std::ostringstream out;
    app.exit(asked, out, out);
    return HelpText{out.str()};
  } catch (const CLI::ParseError& e) {
    throw UsageError(std::string(e.what()) + " (cloudrenderer --help says more)");
  }

  const unsigned threads =
      t.threads.empty() ? available_threads() : at_least<unsigned>("--threads", t.threads, 1);
  if (threads > 1024) throw UsageError("--threads is at most 1024");
  const int parent = t.parent.empty() ? 0 : at_least<int>("--parent", t.parent, 1);
  if (auto command = service.read()) return std::move(*command);
  const auto need_scene = [](const RenderOptions& o) {
    if (o.request.scene.empty()) throw UsageError("scene is required: a .pbrt file or a folder made by split");
  };
  if (render_app.parsed()) {
    need_scene(render);
    read_render(t, integrator, render);
    read_tls(t, render.request.tls);
    render.request.hosts = t.hosts.empty() ? 1 : at_least<std::uint32_t>("--hosts", t.hosts, 1);
    if (render.request.hosts > 1024) throw UsageError("--hosts is at most 1024");
    render.request.threads = threads;
    render.request.memory =
        t.memory.empty() ? default_memory(render.request.hosts) : size_option("--memory", t.memory);
    return render;
  }
  if (manager_app.parsed()) {
    read_tls(t, manager.request.tls);
    const Address listen = Address::parse(t.listen);
    if (!t.lost_after.empty())
      manager.request.lost_after_s = at_least<double>("--lost-after", t.lost_after, 0.1);
    if (service.serves()) {
      if (!manager.request.scene.empty()) throw UsageError("--serve takes no scene: users submit them");
      return service.read_serve(listen, manager, t.min_hosts);
    }
    need_scene(manager);
    read_render(t, integrator, manager);
    manager.request.listen = listen;
    manager.parent = parent;
    if (!t.min_hosts.empty())
      manager.request.min_hosts = at_least<std::uint32_t>("--min-hosts", t.min_hosts, 1);
    if (!t.wait.empty()) manager.request.wait_s = at_least<double>("--wait", t.wait, 0);
    return manager;
  }
  if (worker_app.parsed()) {
    WorkerConfig& c = worker.config;
    read_tls(t, c.tls);
    c.manager = Address::parse(t.manager);
    if (c.manager.host.empty()) throw UsageError("--manager needs a host, got '" + t.manager + "'");
    if (!t.listen.empty()) c.listen = Address::parse(t.listen);
    if (!t.advertise.empty()) c.advertise = Address::parse(t.advertise);
    if (!t.wait.empty())
      c.patience = std::chrono::duration<double>(at_least<double>("--wait", t.wait, 0));
    worker.parent = parent;
    if (!t.alpha.empty()) c.alpha = at_least<float>("--alpha", t.alpha, 0);
    c.threads = threads;
    c.memory = t.memory.empty() ? default_memory(1) : size_option("--memory", t.memory);
    return worker;
  }
  if (split_app.parsed()) {
    read_split(t, split.options);
    split.parent = parent;
    return split;
  }
  if (compare_app.parsed()) {
    if (!t.max_relmse.empty())
      compare.max_relmse = at_least<double>("--max-relmse", t.max_relmse, 0);
    return compare;
  }
  if (simulate_app.parsed()) {
    read_simulate(st, simulate);
    return simulate;
  }
  SplitOptions dialect;
  read_split(t, dialect);
  info.dialect = dialect.dialect;
  if (info.scene.empty() && !info.language) throw UsageError("info: scene is required");
  return info;
}

}  // namespace cloudrenderer
