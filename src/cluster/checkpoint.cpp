#include "cluster/checkpoint.h"

#include "base/error.h"
#include "base/log.h"
#include "parts/mapped_file.h"

namespace cloudrenderer {
namespace {

constexpr std::uint64_t kBytesPerPixel = 32;  // of a record, about
constexpr std::uint64_t kCompactFactor =
    4;  // a journal this much larger than the film is compacted
constexpr std::uint64_t kSmallJournal = 1u << 20;  // and never one below this

}  // namespace

Checkpoint::Checkpoint(const std::string& path, bool resume, const CheckpointJob& job)
    : file_(path), job_(job), compact_bytes_(job.frame.pixels() * kBytesPerPixel) {
  if (file_.bytes() == 0) {
    if (resume)
      spdlog::warn("there is nothing in the checkpoint {} yet: starting from the beginning", path);
    return;
  }
  if (!resume)
    throw UsageError("the checkpoint " + path +
                     " is there already: --resume goes on from it; else remove it");
  const MappedFile mapped = map_file(path);
  const auto header = read_header(mapped.bytes);
  if (!header) throw UsageError("cannot resume from " + path + ": " + header.error());
  if (!*header || (*header)->tile == 0) {
    if (*header)
      if (const auto field = difference(**header, job))
        throw UsageError("checkpoint " + path + " was made with " + *field);
    file_.cut_off(0);
    return;
  }
  if (const auto field = difference(**header, job))
    throw UsageError("checkpoint " + path + " was made with " + *field);
  made_ = **header;
  job_ = *made_;
}

void Checkpoint::prepare(ManagerOptions& options) const {
  options.keep_merged = true;
  if (!made_) return;
  options.fixed_tile = made_->tile;
  if (made_->fingerprint != 0) options.fingerprint = made_->fingerprint;
}

void Checkpoint::restore(ManagerCore& core, std::uint32_t spp) {
  if (!made_) return;
  const MappedFile mapped = map_file(path());
  CheckpointReader reader(mapped.bytes, *made_);
  std::size_t good = reader.position();
  std::uint32_t samples = 0;
  bool refused = false;
  while (const auto tile = reader.next()) {
    samples = std::max(samples, tile->samples.back().end);
    if (samples <= spp && !core.restore(*tile)) {
      refused = true;
      break;
    }
    good = reader.position();
  }
  if (!refused) good = reader.position();  // a decision may be the last record
  if (samples > spp)
    throw UsageError("checkpoint " + path() + " was made with spp " + std::to_string(samples) +
                     ", this render has spp " + std::to_string(spp));
  if (good != mapped.bytes.size()) {
    spdlog::warn("the checkpoint {} ends in {} bytes that cannot be used", path(),
                 mapped.bytes.size() - good);
    file_.cut_off(good);
  }
  if (!reader.goals().empty() && core.phase() == ManagerCore::Phase::gathering && !core.restore_goals(reader.goals()))
    spdlog::warn("the checkpoint {} asks for more samples of a pixel than this render may take: what it asks for is decided anew",
                 path());
  decisions_ = core.decisions();
  header_checksum_ = header_checksum(mapped.bytes);
  spdlog::info("{} of {} paths are in the checkpoint {}", core.progress().paths_done,
               core.progress().paths_total, path());
}

void Checkpoint::record(ManagerCore& core) {
  const std::vector<TileSums> merged = core.take_merged();
  const CheckpointFile::Place place = file_.place();
  if (place == CheckpointFile::Place::taken) return file_.fail("another file has taken its place");
  if (place == CheckpointFile::Place::gone) {
    spdlog::warn("the checkpoint {} has been removed, and is made anew", path());
    return rewrite(core);
  }
  const bool decided = core.decisions() != decisions_;
  if (merged.empty() && !decided) return;
  Bytes bytes;
  if (header_checksum_ == 0) {
    job_.tile = core.tile_size();
    job_.fingerprint = core.fingerprint().value_or(0);
    bytes = encode_header(job_);
    header_checksum_ = header_checksum(bytes);
  }
  if (decided) encode_goals(core.goals(), header_checksum_, bytes);
  decisions_ = core.decisions();
  for (const TileSums& tile : merged) encode_record(tile, header_checksum_, bytes);
  file_.append(std::move(bytes));
  if (file_.bytes() < std::max(kSmallJournal, kCompactFactor * compact_bytes_)) return;
  const std::uint64_t before = file_.bytes();
  rewrite(core);
  spdlog::info("the checkpoint {} is compacted from {} to {} bytes", path(), before, file_.bytes());
}

void Checkpoint::rewrite(const ManagerCore& core) {
  if (core.tile_size() == 0) return file_.replace({});  // no record can be made yet
  Bytes bytes = whole_checkpoint(core, job_);
  compact_bytes_ = bytes.size();
  header_checksum_ = header_checksum(bytes);
  decisions_ = core.decisions();
  file_.replace(std::move(bytes));
}

void Checkpoint::close(ManagerCore& core) {
  record(core);
  // Nothing was rendered: a header all the same, so that --resume finds what it looks for.
  if (header_checksum_ == 0) file_.append(whole_checkpoint(core, job_));
  file_.close();
}

Bytes whole_checkpoint(const ManagerCore& core, CheckpointJob job) {
  job.tile = core.tile_size();
  job.fingerprint = core.fingerprint().value_or(0);
  Bytes bytes = encode_header(job);
  const std::uint64_t checksum = header_checksum(bytes);
  if (!core.goals().empty()) encode_goals(core.goals(), checksum, bytes);
  const ManagerCore::Progress p = core.progress();
  bool first = true;
  for (std::size_t i = 0; i < core.tiles(); ++i) {
    auto tile = core.tile_sums(i);
    if (!tile) continue;
    if (std::exchange(first, false)) {
      tile->invalid = p.invalid_samples;
      tile->clamped = p.clamped_samples;
    }
    encode_record(*tile, checksum, bytes);
  }
  return bytes;
}

}  // namespace cloudrenderer
