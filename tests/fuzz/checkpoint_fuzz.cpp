// A journal, as it came and with checksums that fit.
#include <xxhash.h>

#include <vector>

#include "fuzz/fuzz.h"
#include "tasks/checkpoint.h"

using namespace cloudrenderer;

namespace {

constexpr std::size_t kRecordHeader = 16;

template <class T>
T at(const Bytes& bytes, std::size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

void seal(Bytes& bytes) {
  constexpr std::size_t kSum = kCheckpointHeaderBytes - 8;
  if (bytes.size() < kCheckpointHeaderBytes) return;
  const std::uint64_t sum = XXH3_64bits(bytes.data(), kSum);
  std::memcpy(bytes.data() + kSum, &sum, sizeof sum);
  std::size_t record = kCheckpointHeaderBytes;
  while (bytes.size() - record >= kRecordHeader) {
    const auto length = at<std::uint32_t>(bytes, record + 4);
    if (length > bytes.size() - record - kRecordHeader) return;
    const std::uint64_t body =
        XXH3_64bits_withSeed(bytes.data() + record + kRecordHeader, length, sum + length);
    std::memcpy(bytes.data() + record + 8, &body, sizeof body);
    record += kRecordHeader + length;
  }
}

std::size_t read(const Bytes& bytes) {
  const Result<std::optional<CheckpointJob>> job = read_header(bytes);
  if (!job || !*job) return 0;
  (void)difference(**job, CheckpointJob());
  CheckpointReader reader(bytes, **job);
  std::size_t records = 0;
  while (const auto tile = reader.next()) {
    ++records;
    fuzz::require(reader.position() <= bytes.size(), "the reader stays inside");
    fuzz::require(!tile->samples.empty(), "a record has samples");
    fuzz::require(tile->sums.size() == std::size_t{tile->x1 - tile->x0} * (tile->y1 - tile->y0),
                  "sums for every pixel");
    Bytes again = encode_header(**job);
    encode_record(*tile, header_checksum(again), again);
    fuzz::require(CheckpointReader(again, **job).next().has_value(), "a record can be kept");
  }
  return records;
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::Input input = fuzz::input(data, size);
  Bytes bytes(input.begin(), input.end());
  (void)read(bytes);
  seal(bytes);
  (void)read(bytes);
  return 0;
}
