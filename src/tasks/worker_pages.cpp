// Out of core: parts that no host holds come and go by what waits for them.
#include <algorithm>
#include <utility>

#include "tasks/worker_core.h"

namespace cloudrenderer {
namespace {

constexpr HostId kManager{0};
constexpr std::uint32_t kMostDeclined = 100;  // attempts in a row: what is loaded does not go away

}  // namespace

using enum TaskMove;

// The batch waits until the part is there.
void WorkerCore::page(PartId part, PagedItem item, std::size_t count) {
  const bool segments = std::holds_alternative<TraceWork::Returned>(item);
  Task& task = create(segments ? TaskCategory::tracer : TaskCategory::intersection);
  move(task, n_load_first);
  kept_ += count;
  Paged& p = paged_[part];
  p.items.push_back({task.id, std::move(item), count});
  p.count += count;
  if (pages_.contains(part)) wake(part);  // it has come since the batch was traced
}

void WorkerCore::wake(PartId part) {
  const auto it = paged_.find(part);
  if (it == paged_.end()) return;
  Paged p = std::move(it->second);
  paged_.erase(it);
  kept_ -= p.count;
  for (Paged::Item& w : p.items) {
    move(w.id, h_collected);
    if (auto* segments = std::get_if<TraceWork::Returned>(&w.item))
      ready_returned(w.id, std::move(*segments), w.count);
    else
      ready_resolve(w.id, std::move(std::get<ResolveWork::Answered>(w.item)), w.count);
  }
}

void WorkerCore::wake_all() {
  while (!paged_.empty()) wake(paged_.begin()->first);
}

// Everything that can be done with what is resident is done first: the more rays wait for a part, the less its loading
// costs each of them.
bool WorkerCore::may_page() const {
  return job_ready_ && !paged_.empty() && running_ == 0 && now_ >= next_page_ && !has_work();
}

Work WorkerCore::take_page() {
  const auto most = std::ranges::max_element(
      paged_, {}, [](const auto& waiting) { return waiting.second.count; });
  Task& task = create(TaskCategory::loader);
  move(task, a_accept);
  Work work = base_work(now_);
  work.what = PageWork{most->first, take_pages()};
  run(work, task.id);
  return work;
}

// All that may be evicted, what fewest rays wait for last. Until the loader has chosen, none of them counts as there.
std::vector<PartId> WorkerCore::take_pages() {
  std::vector<PartId> pages(pages_.begin(), pages_.end());
  pages_.clear();
  const auto waiting = [this](PartId p) {
    const auto it = paged_.find(p);
    return it == paged_.end() ? 0 : it->second.count;
  };
  std::ranges::stable_sort(pages, std::greater{}, waiting);
  return pages;
}

void WorkerCore::keep_pages(const std::vector<PartId>& pages) {
  for (const PartId p : pages) {
    pages_.insert(p);
    wake(p);
  }
}

void WorkerCore::finish_page(const PageWork& work, WorkResult& r, double taken) {
  counters_.set_paging_s(counters_.paging_s() + (now_ - taken));
  keep_pages(work.evict);
  if (!r.loaded.empty()) {
    pages_declined_ = 0;
    counters_.set_paged_in(counters_.paged_in() + 1);
    return keep_pages(r.loaded);
  }
  // What batches still hold on to goes in a moment.
  next_page_ = now_ + options_.retry_s;
  if (r.error.empty() && ++pages_declined_ != kMostDeclined) return;
  wire::LoadReport report;
  report.set_job(job_->job());
  report.set_error(r.error.empty() ? "there is no room for part " + std::to_string(work.part.value) : r.error);
  send(kManager, std::move(report));
}

}  // namespace cloudrenderer
