#include <spdlog/fmt/fmt.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>

#include "cli/commands.h"
#include "simulate/simulation.h"

namespace cloudrenderer {
namespace {

using Json = nlohmann::ordered_json;

sim::SceneModel read_file(const std::string& path) {
  std::ifstream in(path);
  if (!in) throw UsageError("cannot read " + path);
  const std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  return sim::read_model(text, path);
}

Json to_json(const sim::Prediction& p) {
  return {{"hosts", p.hosts},
          {"error", p.error},
          {"wall_s", p.wall_s},
          {"load_s", p.load_s},
          {"render_s", p.render_s},
          {"cpu_s", p.cpu_s},
          {"paths", p.paths},
          {"bytes", p.bytes},
          {"bytes_per_path", p.paths > 0 ? p.bytes / p.paths : 0},
          {"loaded_bytes", p.loaded_bytes},
          {"moves_per_path", p.moves_per_path},
          {"asks_per_path", p.asks_per_path},
          {"cost", p.cost},
          {"busy", p.busy},
          {"efficiency", p.efficiency},
          {"tail", p.tail},
          {"wasted", p.wasted},
          {"copied", p.copied},
          {"lost", p.lost},
          {"reclaimed", p.reclaimed},
          {"joined", p.joined},
          {"paged_parts", p.paged_parts},
          {"teams", p.teams},
          {"connections", p.connections},
          {"bottleneck", p.bottleneck},
          {"bottleneck_share", p.bottleneck_share},
          {"segment", p.segment},
          {"events", p.events},
          {"manager",  // measured on this machine: not the same at every run
           {{"cpu_s", p.manager.cpu_s},
            {"cpu_share", p.manager.cpu_share},
            {"cpu_share_of", p.manager.share_of},
            {"peak_share", p.manager.peak_share},
            {"bytes_sent", p.manager.sent},
            {"bytes_received", p.manager.received},
            {"line_share", p.manager.out_share},
            {"messages", p.manager.messages}}}};
}

constexpr const char* kHead =
    "  hosts grain    wall s    load s  render s    cpu h  B/path moves   busy  effic.   tail  waste      cost  mgr core  peak  mgr MB  "
    "bottleneck\n";

void print_row(const sim::Prediction& p) {
  if (!p.error.empty()) {
    fmt::print("{:7}  {}\n", p.hosts, p.error);
    return;
  }
  fmt::print("{:7} {:5} {:9.2f} {:9.2f} {:9.2f} {:8.2f} {:7.1f} {:5.2f} {:5.1f}% {:6.1f}% {:5.1f}% {:5.2f}% {:9.3f} {:9.3f} {:5.2f} {:7.1f}  {} ({:.0f} %)\n",
             p.hosts, p.segment, p.wall_s, p.load_s, p.render_s, p.cpu_s / 3600, p.paths > 0 ? p.bytes / p.paths : 0.0, p.moves_per_path,
             100 * p.busy, 100 * p.efficiency, 100 * p.tail, 100 * p.wasted, p.cost, p.manager.cpu_share, p.manager.peak_share,
             p.manager.sent * 1e-6, p.bottleneck, 100 * p.bottleneck_share);
  std::fflush(stdout);
}

}  // namespace

int run_simulate(const SimulateOptions& o) {
  sim::SceneModel model = read_file(o.model);
  if (o.width != 0) {
    model.width = o.width;
    model.height = o.height;
  }
  if (o.spp != 0) model.spp = o.spp;
  if (o.triangles != 0) {
    if (model.triangles() == 0) throw UsageError("--triangles: the scene of " + o.model + " has none to multiply");
    model.scale_triangles(static_cast<double>(o.triangles) / static_cast<double>(model.triangles()));
  }
  double bytes = 0;
  for (const sim::ModelPart& p : model.parts) bytes += static_cast<double>(p.placement.bytes);
  fmt::print("{}: {} parts, {:.4g} triangles, {:.4g} GB loaded; {} x {} pixels, {} samples each; seed {}\n", model.name,
             model.parts.size(), static_cast<double>(model.triangles()), bytes * 1e-9, model.width, model.height, model.spp,
             o.plan.seed);
  fmt::print("{}", kHead);
  Json rows = Json::array();
  bool done = true;
  for (const std::uint32_t hosts : o.hosts) {
    sim::ClusterPlan plan = o.plan;
    plan.hosts = hosts;
    const sim::Prediction p = sim::simulate(model, plan);
    print_row(p);
    done = done && p.error.empty();
    rows.push_back(to_json(p));
  }
  if (!o.report.empty()) {
    Json kinds = Json::array();
    for (const sim::HostKind& k : o.plan.kinds)
      kinds.push_back({{"name", k.name},
                       {"threads", k.threads},
                       {"memory", k.memory},
                       {"price", k.price},
                       {"speed", k.speed},
                       {"weight", k.weight}});
    const Json out = {{"version", 1},
                      {"scene", model.name},
                      {"width", model.width},
                      {"height", model.height},
                      {"spp", model.spp},
                      {"parts", model.parts.size()},
                      {"triangles", model.triangles()},
                      {"loaded_bytes", bytes},
                      {"seed", o.plan.seed},
                      {"kinds", std::move(kinds)},
                      {"predictions", std::move(rows)}};
    std::ofstream file(o.report);
    file << out.dump(1) << "\n";
    if (!file.flush()) throw std::runtime_error("cannot write the report " + o.report);
  }
  return done ? kDone : kNoCluster;
}

}  // namespace cloudrenderer
