// Hosts that know the secret and say anything: a manager's core goes on.
#include "fuzz/sealed.h"
#include "tasks/manager_core.h"

using namespace cloudrenderer;

namespace {

constexpr std::uint32_t kSide = 16, kSpp = 8, kParts = 4;

JobSpec small_job() {
  JobSpec job;
  job.frame = {kSide, kSide, 0, 0, kSide, kSide};
  job.spp = kSpp;
  job.start.set_job(1);
  job.start.set_width(kSide);
  job.start.set_height(kSide);
  job.start.set_x1(kSide);
  job.start.set_y1(kSide);
  job.start.set_spp(kSpp);
  job.start.set_part_count(kParts);
  for (std::uint32_t p = 0; p < kParts; ++p)
    job.parts.push_back({100, Vec3(static_cast<float>(p)), {}});
  return job;
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ManagerOptions options;
  options.round_samples = 4;
  options.allow_inexact = true;  // the corpus has hosts without a fingerprint
  ManagerCore core(options, small_job());
  double now = 0;
  std::uint32_t hosts = 0;
  fuzz::Pieces pieces(fuzz::input(data, size));
  while (pieces.next()) {
    now += pieces.operation & 128 ? 1.0 : 0.01;
    Result<wire::Message> message = wire::decode(fuzz::sealed_payload(pieces.bytes));
    const HostId from(1 + pieces.operation % 4);
    if (!message) {
      core.host_lost(from, now);
    } else if (const auto* hello = std::get_if<wire::Hello>(&*message)) {
      if (core.join(*hello, now)) ++hosts;
    } else {
      core.receive(from, std::move(*message), now);
    }
    core.tick(now);
    for (const auto& [to, said] : core.take_outbox()) {
      fuzz::require(to.value >= 1 && to.value <= hosts, "only hosts are spoken to");
      fuzz::require(static_cast<bool>(wire::decode(*wire::encode(said))),
                    "a host can read what it is told");
    }
    (void)core.take_gone();
    for (std::uint32_t y = 0; y < kSide; ++y)
      for (std::uint32_t x = 0; x < kSide; ++x) {
        const auto& count = core.film().at(x, y).count;
        fuzz::require(count[0] <= kSpp / 2 && count[1] <= kSpp / 2, "no sample counts twice");
      }
    const ManagerCore::Progress p = core.progress();
    fuzz::require(p.paths_done <= p.paths_total, "no path counts twice");
    fuzz::require(core.deadline() >= 0, "a deadline is a time");
  }
  return 0;
}
