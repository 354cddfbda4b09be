// Loading and unloading.
#include <algorithm>

#include "tasks/work.h"

namespace cloudrenderer {
namespace {

// False: there is no room for the part, even without all that may be evicted.
bool load(PartLoader& loader, PartId part, BvhForm form, std::vector<PartId>& evict, WorkResult& r) {
  // A part that is there for a while and now is to stay is loaded anew: that is rare.
  if (const auto it = std::ranges::find(evict, part); it != evict.end()) std::rotate(it, it + 1, evict.end());
  const bool there = !evict.empty() && evict.back() == part;
  for (bool first = there; first || !loader.has_room(part, form); first = false) {
    if (evict.empty()) return false;
    loader.unload(evict.back());
    evict.pop_back();
  }
  r.error = loader.load(part, form);
  return true;
}

}  // namespace

WorkResult execute(PartLoader& loader, Work& work) {
  WorkResult r;
  if (auto* start = std::get_if<StartJobWork>(&work.what)) {
    r.error = loader.start_job(start->job);
    r.bytes_used = loader.bytes_used();
  } else if (auto* load = std::get_if<LoadWork>(&work.what)) {
    for (const PartId p : load->parts) {
      if (!cloudrenderer::load(loader, p, BvhForm::fast, load->evict, r)) {
        r.declined.push_back(p);
        continue;
      }
      if (!r.error.empty()) break;
      r.loaded.push_back(p);
    }
    r.bytes_used = loader.bytes_used();
  } else if (auto* page = std::get_if<PageWork>(&work.what)) {
    if (!cloudrenderer::load(loader, page->part, BvhForm::passing, page->evict, r))
      r.declined.push_back(page->part);
    else if (r.error.empty())
      r.loaded.push_back(page->part);
  } else if (auto* unload = std::get_if<UnloadWork>(&work.what)) {
    for (const PartId p : unload->parts) loader.unload(p);
    r.unloaded = unload->parts;
    r.bytes_used = loader.bytes_used();
  } else if (std::holds_alternative<EndJobWork>(work.what)) {
    loader.end_job();
  }
  return r;
}

}  // namespace cloudrenderer
