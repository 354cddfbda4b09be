#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/size.h"
#include "cluster/job_start.h"
#include "cluster/processes.h"
#include "integrator/job.h"

namespace cloudrenderer {

namespace {

// What a host needs to hold the main scene and any one part, with what loading it takes on top.
void write_needs(const Manifest& m, const std::string& path) {
  std::uint64_t largest = 0, all = 0;
  for (std::uint32_t i = 0; i < m.parts.size(); ++i) {
    all += m.parts[i].loaded_bytes;
    std::uint64_t bytes = (i == 0 ? 0 : m.parts[i].loaded_bytes) + build_bytes(m, i);
    for (const std::uint32_t p : m.parts[i].prototypes) bytes += m.prototypes.at(p).loaded_bytes;
    largest = std::max(largest, bytes);
  }
  for (const PrototypeInfo& p : m.prototypes) all += p.loaded_bytes;
  std::uint64_t pixels = 0;
  std::uint32_t spp = 0;
  try {
    Warnings none;
    const JobSettings settings = job_settings(m.scene, {}, none);
    pixels = settings.film.frame.pixels();
    spp = settings.spp;
  } catch (const std::exception&) {  // the render's to say, which may be told other settings
  }
  const nlohmann::ordered_json json = {{"main_bytes", m.parts.empty() ? 0 : m.parts[0].loaded_bytes},
                                       {"largest_bytes", largest},
                                       {"bytes", all},
                                       {"parts", m.parts.size()},
                                       {"triangles", m.total_triangles},
                                       {"pixels", pixels},
                                       {"spp", spp}};
  std::ofstream out(path);
  out << json.dump(1) << "\n";
  if (!out.flush()) throw std::runtime_error("cannot write the report " + path);
}

}  // namespace

int run_split(const SplitCommand& options) {
  if (options.parent > 0) die_with_parent(options.parent);
  if (!std::filesystem::is_regular_file(options.scene))
    throw SceneError({}, options.scene + ": there is no such scene file");
  Warnings warnings;
  const Manifest m = split_scene(options.scene, options.output, options.options, warnings);
  print_warnings(warnings.list());
  std::uint64_t bytes = 0;
  for (const PartInfo& p : m.parts) bytes += p.loaded_bytes;
  for (const PrototypeInfo& p : m.prototypes) bytes += p.loaded_bytes;
  fmt::print("{}: {} parts, {} prototypes, {} triangles, about {} when loaded\n", options.output,
             m.parts.size(), m.prototypes.size(), m.total_triangles, format_size(bytes));
  if (!options.report.empty()) write_needs(m, options.report);
  return kDone;
}

}  // namespace cloudrenderer
