#include "tasks/work.h"

namespace cloudrenderer {
namespace {

template <class List, class F>
std::size_t total(const List& list, F size_of) {
  std::size_t n = 0;
  for (const auto& e : list) n += size_of(e);
  return n;
}

}  // namespace

std::size_t Work::segments() const {
  if (const auto* camera = std::get_if<CameraWork>(&what)) return camera->count;
  if (const auto* trace = std::get_if<TraceWork>(&what)) {
    return total(trace->local, [](const auto& e) { return e.size(); }) +
           total(trace->arrived, [](const auto& e) { return e.block.size(); }) +
           total(trace->returned, [](const auto& e) {
             return total(e.kept, [](const auto& k) { return k.segments->size(); });
           });
  }
  if (const auto* shade = std::get_if<ShadeWork>(&what))
    return total(shade->batches, [](const auto& e) { return e.size(); });
  return 0;
}

bool is_loader_work(const Work& work) {
  return std::holds_alternative<StartJobWork>(work.what) ||
         std::holds_alternative<LoadWork>(work.what) ||
         std::holds_alternative<PageWork>(work.what) ||
         std::holds_alternative<UnloadWork>(work.what) ||
         std::holds_alternative<EndJobWork>(work.what);
}

}  // namespace cloudrenderer
