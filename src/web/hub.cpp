#include "web/hub.h"

#include <nlohmann/json.hpp>

namespace cloudrenderer {
namespace {

using namespace std::chrono_literals;
constexpr auto kBeat = 250ms;     // between frames of a viewer
constexpr auto kViewEvery = 1s;   // between views of the job
constexpr auto kGoodbye = 900ms;  // for what viewers have not got yet when the job ends
constexpr std::size_t kTileBytes = 4;  // a pixel
constexpr std::size_t kCoarsePixels = 128 * 128;
constexpr Hub::Time::duration kPictureEvery = 1s;
constexpr int kPictureShare = 10;  // of the render's thread's time, one part of so many is for whole pictures at most

}  // namespace

void Hub::look(const RenderView& view, Time now) {
  std::size_t viewers = 0;
  std::uint64_t joins = 0;
  bool newcomers = false;
  {
    const std::lock_guard lock(mutex_);
    viewers = viewers_;
    joins = joins_;
    newcomers = joins != coarse_joins_;
  }
  const FilmOptions& film = view.facts.settings.film;
  const bool ended = view.core.finished();
  if (viewers > 0 && newcomers) {
    auto coarse = std::make_shared<const std::string>(encode_coarse(view.core, film, kCoarsePixels));
    const std::lock_guard lock(mutex_);
    coarse_ = std::move(coarse);
    coarse_joins_ = joins;
  }
  if (viewers > 0 || ended) {
    // As much as can be sent by the next look; at the end all that is left, for those who wait for it.
    const std::uint64_t pixels = ended ? view.core.film().frame().pixels()
                                       : static_cast<std::uint64_t>(kBytesPerSecond / kTileBytes / 4);
    std::vector<std::pair<std::size_t, std::string>> encoded;
    if (viewers > 0)
      for (const std::size_t tile : watch_.choose(view.core, pixels))
        encoded.emplace_back(tile, TileBoard::encode(view.core, tile, film));
    const std::lock_guard lock(mutex_);
    for (auto& [tile, bytes] : encoded) board_.put(tile, std::move(bytes));
  }
  take_picture(view, now);
  if (job_ && now < viewed_ + kViewEvery && !ended) return;
  viewed_ = now;
  auto job = std::make_shared<JobView>(job_view(scene_, view));
  const CostPoint point = cost_point(*job);
  if (view.progress.estimate && (history_.empty() || history_.back().estimated_relmse != point.estimated_relmse))
    add_point(history_, point);
  job->history = history_;
  const std::lock_guard lock(mutex_);
  job_ = std::move(job);
  changed_.notify_all();
}

void Hub::take_picture(const RenderView& view, Time now) {
  {
    const std::lock_guard lock(mutex_);
    if (!picture_wanted_ || (now < picture_due_ && !view.core.finished())) return;
  }
  const Time began = std::chrono::steady_clock::now();
  const Film& film = view.core.film();
  auto picture = std::make_shared<Picture>();
  picture->image = developed(film, view.facts.settings.film);
  picture->frame = film.frame();
  picture->spp = static_cast<double>(view.progress.paths_done) / static_cast<double>(film.frame().pixels());
  const auto took = std::chrono::steady_clock::now() - began;
  const std::lock_guard lock(mutex_);
  picture_ = std::move(picture);
  picture_wanted_ = false;
  picture_due_ = now + std::max(kPictureEvery, kPictureShare * took);
  changed_.notify_all();
}

std::shared_ptr<const Hub::Picture> Hub::picture(std::chrono::milliseconds patience) {
  std::unique_lock lock(mutex_);
  const Time asked = std::chrono::steady_clock::now();
  if (picture_ && asked < picture_due_) return picture_;  // as new as may be
  const auto old = picture_;
  picture_wanted_ = true;
  changed_.wait_until(lock, asked + patience, [&] { return closed_ || picture_ != old; });
  return picture_ == old ? nullptr : picture_;
}

void Hub::close() {
  std::unique_lock lock(mutex_);
  closed_ = true;
  changed_.notify_all();
  changed_.wait_for(lock, kGoodbye, [&] { return viewers_ == 0; });
}

std::shared_ptr<const JobView> Hub::job() const {
  const std::lock_guard lock(mutex_);
  return job_;
}

std::shared_ptr<Hub::Viewer> Hub::join() {
  const std::lock_guard lock(mutex_);
  if (viewers_ >= kMaxViewers || closed_) return nullptr;
  ++viewers_;
  auto viewer = std::make_shared<Viewer>(*this);
  viewer->joined_ = ++joins_;
  return viewer;
}

Hub::Viewer::~Viewer() {
  const std::lock_guard lock(hub_.mutex_);
  --hub_.viewers_;
  hub_.changed_.notify_all();
}

std::optional<std::string> Hub::Viewer::next() {
  std::shared_ptr<const JobView> job;
  std::vector<TileBoard::Bytes> tiles;
  TileBoard::Bytes coarse;
  bool last = false;
  {
    std::unique_lock lock(hub_.mutex_);
    hub_.changed_.wait_until(lock, due_, [&] { return hub_.closed_; });
    const Time now = std::chrono::steady_clock::now();
    due_ = now + kBeat;
    last = hub_.closed_;
    // What was sent beyond a beat's share, or beside tiles, is made up for.
    const std::size_t share = kBytesPerSecond / 4 / std::max<std::size_t>(1, hub_.viewers_), budget = share - std::min(share, owed_);
    owed_ -= share - budget;
    if (hub_.job_ != job_ && (now >= job_due_ || last)) job = hub_.job_;
    if (!began_ && (job || job_) && hub_.coarse_joins_ >= joined_) {  // behind the job, which has the picture's size
      began_ = true;
      coarse = hub_.coarse_;
      owed_ += coarse->size();
    } else if (last || (began_ && budget > 0)) {
      tiles = hub_.board_.next(tiles_, last ? std::string::npos : budget);
      std::size_t sent = 0;
      for (const TileBoard::Bytes& t : tiles) sent += t->size();
      owed_ += sent - std::min(sent, budget);
    }
  }
  std::string out;
  if (job) {
    job_ = job;
    const std::string text = to_json(*job).dump();
    // A job of a thousand hosts is long to tell: at most a fifth of the time goes to it.
    job_due_ = due_ + std::chrono::microseconds(5 * text.size() * 1'000'000 / kBytesPerSecond);
    owed_ += text.size();
    append_frame(out, FrameKind::job, text);
  }
  if (coarse) append_frame(out, FrameKind::coarse, *coarse);
  for (const TileBoard::Bytes& t : tiles) append_frame(out, FrameKind::tile, *t);
  if (last && out.empty()) return std::nullopt;
  return out;
}

}  // namespace cloudrenderer
