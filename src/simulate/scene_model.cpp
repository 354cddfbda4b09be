#include "simulate/scene_model.h"

#include <nlohmann/json.hpp>

#include "base/error.h"
#include "integrator/shared_rays.h"

namespace cloudrenderer::sim {
namespace {

using Json = nlohmann::json;

// The numbers of a path, one after the other (write_model in cluster/path_samples.cpp).
class Numbers {
 public:
  explicit Numbers(const Json& list) : list_(list) {}
  bool done() const { return at_ == list_.size(); }
  std::int64_t next() { return list_.at(at_++).get<std::int64_t>(); }
  std::uint32_t part(std::size_t parts) {
    const std::int64_t p = next();
    if (p < -1 || p >= static_cast<std::int64_t>(parts)) throw std::out_of_range("a path visits part " + std::to_string(p));
    return p < 0 ? PathVertex::kNone : static_cast<std::uint32_t>(p);
  }
  std::vector<std::uint32_t> list(std::size_t parts) {
    std::vector<std::uint32_t> out;
    for (std::int64_t n = next(); n > 0; --n) {
      out.push_back(part(parts));
      if (out.back() == PathVertex::kNone) throw std::out_of_range("a list of parts names none");
    }
    return out;
  }

 private:
  const Json& list_;
  std::size_t at_ = 0;
};

PathSample read_path(const Json& list, std::size_t parts) {
  PathSample path;
  Numbers in(list);
  while (!in.done()) {
    PathVertex v;
    v.parts = in.list(parts);
    v.hit = in.part(parts);
    v.shadow = in.next() != 0;
    if (v.shadow) {
      v.shadow_parts = in.list(parts);
      v.blocker = in.part(parts);
    }
    path.push_back(std::move(v));
  }
  if (path.empty()) throw std::out_of_range("a path has no vertex");
  return path;
}

double per(double amount, double of) { return of > 0 ? amount / of : 0; }

ComputeCosts read_costs(const Json& report, const SceneModel& m) {
  ComputeCosts c;
  const Json& model = report.at("model");
  const Json& engine = report.at("engine_cpu_s");
  const Json& rays = report.at("rays");
  const auto seconds = [&](const char* name) { return engine.at(name).get<double>(); };
  const double camera = rays.at("camera"), shadow = rays.at("shadow");
  const double paths = report.at("paths").get<double>() - report.value("paths_restored", 0.0);
  double vertices = 0;  // of a path, on average: of its first one a share where several paths have it
  for (const PathSample& p : m.samples.paths) vertices += static_cast<double>(p.size());
  vertices = paths * (per(vertices, static_cast<double>(m.samples.paths.size())) - 1 + 1. / m.samples_per_ray);
  c.camera = per(seconds("camera"), camera > 0 ? camera : paths);
  c.trace = per(seconds("trace"), vertices);
  c.shade = per(seconds("shade") - seconds("occlusion"), vertices);
  c.occlusion = per(seconds("occlusion"), shadow);
  const double engine_s = seconds("camera") + seconds("trace") + seconds("shade");
  c.path = std::max(0.0, per(model.at("render_cpu_s").get<double>() - engine_s, paths));
  if (m.triangles() > 0 && model.at("load_cpu_s").get<double>() > 0)
    c.triangle = per(model.at("load_cpu_s").get<double>(), static_cast<double>(m.triangles()));
  // Somebody may know better.
  const Json known = model.value("costs", Json::object());
  c.camera = known.value("camera", c.camera);
  c.trace = known.value("trace", c.trace);
  c.shade = known.value("shade", c.shade);
  c.occlusion = known.value("occlusion", c.occlusion);
  c.path = known.value("path", c.path);
  c.triangle = known.value("triangle", c.triangle);
  c.message = known.value("message", c.message);
  c.message_byte = known.value("message_byte", c.message_byte);
  c.move = known.value("move", c.move);
  return c;
}

}  // namespace

std::uint64_t SceneModel::triangles() const {
  std::uint64_t n = 0;
  for (const ModelPart& p : parts) n += p.triangles;
  return n;
}

void SceneModel::scale_triangles(double factor) {
  const auto scale = [&](std::uint64_t& bytes) { bytes = static_cast<std::uint64_t>(static_cast<double>(bytes) * factor); };
  for (std::size_t p = 1; p < parts.size(); ++p) {
    scale(parts[p].file_bytes);
    scale(parts[p].triangles);
    scale(parts[p].placement.bytes);
    scale(parts[p].placement.build);
    scale(parts[p].placement.page);
  }
}

SceneModel read_model(const std::string& text, const std::string& file) {
  try {
    const Json report = Json::parse(text);
    if (!report.contains("model"))
      throw UsageError(file + " has no \"model\": make the report with render --hosts 1 --sample-paths 2048 --report " + file);
    const Json& model = report.at("model");
    SceneModel m;
    m.name = report.at("scene");
    m.width = report.at("width");
    m.height = report.at("height");
    m.spp = report.at("spp");
    m.samples_per_ray = report.value("samples_per_ray", 1u);
    if (!may_be_samples_per_ray(m.samples_per_ray)) throw std::out_of_range("samples_per_ray is not 1, 2, 4 or 8");
    if (SharedRays(m.samples_per_ray, m.spp).end == 0) m.samples_per_ray = 1;  // there was no whole group
    m.columns = model.at("columns");
    m.manifest_bytes = model.at("manifest_bytes");
    for (const Json& p : model.at("parts")) {
      ModelPart part;
      part.placement.bytes = p.at("bytes");
      part.placement.build = p.at("build");
      part.placement.page = p.at("page");
      part.placement.visits = p.at("visits");
      part.placement.prototypes = p.value("prototypes", std::vector<std::uint32_t>());
      part.file_bytes = p.at("file_bytes");
      part.triangles = p.at("triangles");
      m.parts.push_back(std::move(part));
    }
    m.prototype_bytes = model.value("prototype_bytes", std::vector<std::uint64_t>());
    for (const ModelPart& p : m.parts)
      for (const std::uint32_t t : p.placement.prototypes)
        if (t >= m.prototype_bytes.size()) throw std::out_of_range("a part needs prototype " + std::to_string(t));
    const Json& samples = model.at("path_samples");
    m.samples.columns = samples.at("columns");
    m.samples.rows = samples.at("rows");
    m.samples.per_cell = samples.at("per_cell");
    for (const Json& p : samples.at("paths")) m.samples.paths.push_back(read_path(p, m.parts.size()));
    const PathSamples& s = m.samples;
    if (m.width == 0 || m.height == 0 || m.spp == 0 || m.parts.empty() || s.paths.empty() ||
        s.paths.size() != std::size_t{s.columns} * s.rows * s.per_cell)
      throw std::out_of_range("no film, no parts, or another number of paths than cells");
    m.costs = read_costs(report, m);
    return m;
  } catch (const Json::exception& e) {
    throw UsageError(file + ": not the report of a render on one host: " + e.what());
  } catch (const std::out_of_range& e) {
    throw UsageError(file + ": the model makes no sense: " + e.what());
  }
}

}  // namespace cloudrenderer::sim
