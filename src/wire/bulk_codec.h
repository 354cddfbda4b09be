#pragma once
// The columns behind the control part of SubmitTask, Reply and PathEnds. Private to the codec.
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "wire/messages.h"

namespace cloudrenderer::wire {

SubmitControl control_of(const SubmitTask& m);
ReplyControl control_of(const Reply& m);
EndsControl control_of(const PathEnds& m);

std::size_t bulk_bytes(const SubmitTask& m, const SubmitControl& c);
std::size_t bulk_bytes(const Reply& m, const ReplyControl& c);
std::size_t bulk_bytes(const PathEnds& m, const EndsControl& c);

// `out` has exactly bulk_bytes().
void write_bulk(const SubmitTask& m, const SubmitControl& c, std::span<std::byte> out);
void write_bulk(const Reply& m, const ReplyControl& c, std::span<std::byte> out);
void write_bulk(const PathEnds& m, const EndsControl& c, std::span<std::byte> out);

Result<Message> read_submit(const SubmitControl& c, std::span<const std::byte> bulk);
Result<Message> read_reply(const ReplyControl& c, std::span<const std::byte> bulk);
Result<Message> read_ends(const EndsControl& c, std::span<const std::byte> bulk);

}  // namespace cloudrenderer::wire
