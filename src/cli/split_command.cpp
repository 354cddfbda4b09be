#include <spdlog/fmt/fmt.h>

#include <filesystem>

#include "cli/commands.h"
#include "cli/size.h"

namespace cloudrenderer {

int run_split(const SplitCommand& options) {
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
  return kDone;
}

}  // namespace cloudrenderer
